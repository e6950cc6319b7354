#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
What a request over HTTP costs umbraged and nginx: CPU time of the server for requests of one client
over one connection, on the same file, in turns. Prints medians of five rounds. `make bench-http`.
"""
import os
import shutil
import socket
import statistics
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

ROUNDS = 5


def cpu_us(pid):
    """CPU time of all threads of a process, user and system."""
    total = 0
    for thread in os.listdir(f"/proc/{pid}/task"):
        with open(f"/proc/{pid}/task/{thread}/schedstat", encoding="ascii") as file:
            total += int(file.read().split()[0])
    return total / 1e3


class Client:
    """One connection on which requests follow one another."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.buffer = bytearray(1 << 20)

    def get(self, fields, size):
        """A reply with a body of `size` bytes."""
        self.socket.sendall(b"GET /assets/city.umb HTTP/1.1\r\nHost: 127.0.0.1\r\n" + fields + b"\r\n")
        head = b""
        while b"\r\n\r\n" not in head:
            head += self.socket.recv(65536)
        left = size - len(head.partition(b"\r\n\r\n")[2])
        while left > 0:
            got = self.socket.recv_into(self.buffer, min(left, len(self.buffer)))
            assert got, "the server closed"
            left -= got


def start_nginx(test, port):
    """nginx on the test's folder, with the configuration of deploy/."""
    with open(os.path.join(ut.ROOT, "deploy/nginx/umbrage-assets.conf"), encoding="utf-8") as file:
        text = file.read().replace("/srv/umbrage-www", test.path("www")).replace(":8080", f":{port}")
    temporary = " ".join(f"{name}_temp_path {test.path(name)};"
                         for name in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
    with open(test.path("nginx.conf"), "w", encoding="utf-8") as file:
        file.write(f"daemon off; master_process off; pid {test.path('pid')}; error_log stderr crit; events {{}}\n"
                   f"http {{ keepalive_requests 1000000; access_log off; {temporary}\n{text}}}\n")
    program = shutil.which("nginx", path=os.environ["PATH"] + ":/usr/sbin")
    if program is None:
        ut.skip("nginx is not installed")
    return subprocess.Popen([program, "-c", test.path("nginx.conf")], stderr=subprocess.DEVNULL)


def main():
    test = ut.Test()
    store = test.path("www", "assets")
    os.makedirs(store)
    test.bake(test.scene("city", 24), store + "/city.umb", "--resolution", 8192, "--sun", "135,45", "--verify", 0)
    whole = os.path.getsize(store + "/city.umb")
    daemon = test.daemon("--http", "tcp:127.0.0.1:0", "--workers", 1, store=store)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    nginx = start_nginx(test, port)
    time.sleep(1)
    servers = [("umbraged", int(daemon.addresses["http+tcp"].rpartition(":")[2]), daemon.process.pid),
               ("nginx", port, nginx.pid)]
    print(f"{'request':14} {'umbraged, us':>13} {'nginx, us':>10}")
    for name, fields, size, times in (("304", b"If-None-Match: *\r\n", 0, 500),
                                      ("1 byte", b"Range: bytes=0-0\r\n", 1, 500),
                                      ("32 KiB", b"Range: bytes=0-32767\r\n", 32768, 500),
                                      ("256 KiB", b"Range: bytes=0-262143\r\n", 262144, 200),
                                      (f"{whole >> 10} KiB", b"", whole, 50)):
        costs = {}
        for _ in range(ROUNDS):
            for server, to, pid in servers:
                client = Client(to)
                client.get(fields, size)
                before = cpu_us(pid)
                for _ in range(times):
                    client.get(fields, size)
                costs.setdefault(server, []).append((cpu_us(pid) - before) / times)
        print(f"{name:14} {statistics.median(costs['umbraged']):13.1f} {statistics.median(costs['nginx']):10.1f}")
    nginx.terminate()
    nginx.wait()
    test.finish()


main()
