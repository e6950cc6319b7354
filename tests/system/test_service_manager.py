#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
# run: alone (a watchdog and deadlines of seconds)
"""
The daemon under a service manager: states and signs of life over its socket, settings from a file, read
again on SIGHUP, and JSON logs.
"""
import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
os.mkdir(test.path("store"))
os.mkdir(test.path("second"))
notices = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
notices.bind(test.path("notify"))
notices.settimeout(20)
config = test.path("umbraged.conf")


def write_config(*lines):
    with open(config + ".new", "w", encoding="ascii") as file:
        file.write("[umbraged]\n" + "".join(line + "\n" for line in lines))
    os.rename(config + ".new", config)


def next_notice(first):
    """The next notice that begins with the text; other notices are skipped."""
    while True:
        text = notices.recv(4096).decode()
        if text.startswith(first):
            return text


def events(daemon):
    return [json.loads(line) for line in daemon.log().splitlines()]


with test.check("settings of a file are those of the command line"):
    write_config(f"store = {test.path('store')}", "workers = 3", "log-format = json")
    done = ut.run("umbraged", "--config", config, "--print-config")
    assert b"workers = 3\n" in done.stdout and b"log-format = json\n" in done.stdout
    ut.run("umbraged", "--config", config, "--check-config")
with test.check("a bad file is exit code 78 and one sentence with its line"):
    write_config("store = /tmp", "colour = red")
    for option in ("--check-config", "--print-config"):
        done = ut.run("umbraged", "--config", config, option, code=78)
        assert b"line 3" in done.stderr and b"colour" in done.stderr, done.stderr
        assert done.stderr.count(b"\n") == 1
    ut.run("umbraged", "--config", test.path("nowhere"), "--check-config", code=66)

write_config(f"store = {test.path('store')}", f"store = {test.path('second')}", "log-format = json")
os.environ["NOTIFY_SOCKET"] = test.path("notify")
os.environ["WATCHDOG_USEC"] = "600000"
daemon = test.daemon("--config", config)
with test.check("the manager hears READY after the start, then signs of life"):
    assert "READY=1" in next_notice("READY=1")
    begin = time.monotonic()
    for _ in range(3):
        next_notice("WATCHDOG=1")
    assert time.monotonic() - begin < 5
with test.check("every line of the log is a JSON object"):
    names = [event["event"] for event in events(daemon)]
    assert "ready" in names and "listening" in names, names
    assert all(event["ts"].endswith("Z") for event in events(daemon))
with test.check("SIGHUP takes the log level over and says what waits for a restart"):
    write_config(f"store = {test.path('store')}", "log-format = json", "log-level = debug", "workers = 5")
    daemon.signal(signal.SIGHUP)
    assert "\nMONOTONIC_USEC=" in next_notice("RELOADING=1")
    next_notice("READY=1")
    ut.wait_until(lambda: any(e["event"] == "reloaded" for e in events(daemon)), 10, "reloaded")
    waiting = [e["setting"] for e in events(daemon) if e["event"] == "restart_needed"]
    assert waiting == ["workers = 5"], waiting
with test.check("SIGHUP with a bad file changes nothing and says why"):
    write_config("colour = red")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: any(e["event"] == "not_reloaded" and "colour" in e["reason"]
                              for e in events(daemon)), 10, "not_reloaded")
    assert daemon.admin("/readyz")[0] == 200
with test.check("the manager hears STOPPING at the drain"):
    daemon.signal(signal.SIGTERM)
    next_notice("STOPPING=1")
    daemon.exited()
with test.check("the admin port answers nobody who asks for another machine"):
    daemon = test.daemon()
    for host, code in (("localhost:9464", 200), ("127.0.0.1", 200), ("[::1]:1", 200), (None, 200),
                       ("rebound.example", 421), ("127.0.0.1.example", 421), ("127.", 200),
                       ("localhost.example:9464", 421), ("", 421)):
        with socket.create_connection(("127.0.0.1", int(daemon.addresses["http"].split(":")[1]))) as raw:
            line = "" if host is None else f"Host: {host}\r\n"
            raw.sendall(f"GET /livez HTTP/1.1\r\n{line}\r\n".encode())
            answer = raw.recv(4096).decode()
            assert answer.startswith(f"HTTP/1.1 {code} "), (host, answer)


class Handed:
    """A daemon that is handed listening sockets, as systemd does it."""

    def __init__(self, sockets, names, *options):
        self.log = open(test.path("handed.log"), "w+b")
        # Inherited descriptors begin at 3, and LISTEN_PID is the daemon's own number.
        words = "".join(f"exec {3 + i}<&{one.fileno()}; " for i, one in enumerate(sockets))
        words += f"export LISTEN_PID=$$ LISTEN_FDS={len(sockets)} LISTEN_FDNAMES={':'.join(names)}; exec \"$@\""
        self.process = subprocess.Popen(
            ["bash", "-c", words, "bash", ut.program("umbraged"), "--store", test.path("store"),
             "--drain-delay", "0", *options],
            pass_fds=[one.fileno() for one in sockets], stderr=self.log)

    def text(self):
        self.log.flush()
        with open(self.log.name, encoding="ascii") as file:
            return file.read()

    def end(self):
        self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(30)
        assert code == 0, self.text()


def high(one):
    """Out of the way of the numbers that are handed over."""
    fd = fcntl.fcntl(one.fileno(), fcntl.F_DUPFD, 50)
    one.close()
    return socket.socket(fileno=fd)


with test.check("handed-over sockets replace --listen, and outlive the daemon"):
    tcp = socket.create_server(("127.0.0.1", 0))
    unix = socket.socket(socket.AF_UNIX)
    unix.bind(test.path("handed.sock"))
    unix.listen(16)
    tcp, unix = high(tcp), high(unix)
    port = tcp.getsockname()[1]
    early = socket.create_connection(("127.0.0.1", port))  # before there is a daemon
    early.settimeout(20)
    for turn in range(2):
        handed = Handed([tcp, unix], ["umbraged.socket", "umbraged.socket"], "--listen", "tcp:127.0.0.1:1")
        early.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(3) + b"\4" + bytes(5))
        assert early.recv(9)[3] == 4, "no SETTINGS"
        listed = ut.run("umbrage", "list", "--address", "unix:" + test.path("handed.sock"), "--json")
        assert json.loads(listed.stdout)["assets"] == []
        early.close()
        early = socket.create_connection(("127.0.0.1", port))
        early.settimeout(20)
        handed.end()
        assert os.path.exists(test.path("handed.sock"))
        log = handed.text()
        assert f'address="tcp:127.0.0.1:{port}" from=service_manager' in log and ":1\"" not in log, log
    early.close()
with test.check("what is handed over must be a listening socket; tls: needs a certificate"):
    for one, name, reason in ((high(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)), "x", "not a listening"),
                              (tcp, "tls", "--tls-cert")):
        handed = Handed([one], [name])
        assert handed.process.wait(30) == 2, handed.text()
        assert reason in handed.text(), handed.text()
del os.environ["NOTIFY_SOCKET"], os.environ["WATCHDOG_USEC"]
test.finish()
