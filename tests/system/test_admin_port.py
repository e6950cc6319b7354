#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The admin port, request by request: which are answered, refused and cut off; how many may be open at
once and how long one may take; and what a drain does to waiting requests.
"""
import os
import signal
import socket
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
daemon = test.daemon("--drain-delay", "60s", "--drain-timeout", "1s")
HOST, PORT = daemon.addresses["http"].rsplit(":", 1)
CLIENTS_MAX = 32


def connect():
    return socket.create_connection((HOST, int(PORT)), timeout=60)


def rest_of(link):
    """All that comes until the other end closes."""
    found = b""
    try:
        while True:
            piece = link.recv(65536)
            if not piece:
                return found
            found += piece
    except ConnectionResetError:
        return found


def ask(*pieces):
    """Status, headers and body for a request that is sent in pieces."""
    with connect() as link:
        for piece in pieces:
            link.sendall(piece)
            if len(pieces) > 1:
                time.sleep(0.05)  # so that it comes in more than one read
        head, _, body = rest_of(link).partition(b"\r\n\r\n")
    lines = head.decode().split("\r\n")
    headers = dict(line.split(": ", 1) for line in lines[1:])
    return int(lines[0].split(" ")[1]) if lines[0] else 0, headers, body


def get(path, method="GET", host="localhost"):
    return ask(f"{method} {path} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())


with test.check("pages are answered, with a query behind them too, and close the connection"):
    for path in ("/livez", "/readyz", "/readyz?verbose=1"):
        code, headers, body = get(path)
        assert (code, body) == (200, b"ok\n"), (path, code, body)
        assert headers["Connection"] == "close" and headers["Cache-Control"] == "no-store"
    code, headers, body = get("/metrics")
    assert code == 200 and b"umbrage_connections" in body
    assert int(headers["Content-Length"]) == len(body)

with test.check("HEAD has the length of the body and none of it"):
    for path in ("/livez", "/metrics", "/nowhere"):
        code, headers, body = get(path, "HEAD")
        assert code == (404 if path == "/nowhere" else 200) and body == b""
        assert int(headers["Content-Length"]) > 0

with test.check("other pages are 404, other methods 405, other hosts 421, no request 400"):
    assert get("/nowhere")[0] == 404
    assert get("/livezz")[0] == 404
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert get("/livez", method)[0] == 405
    for host in ("example.org", "localhost.example.org", "127.0.0.1.example.org", "1.2.3.4", "",
                 "[::1]x", "local"):
        assert get("/livez", host=host)[0] == 421, host
    for host in ("localhost", "LOCALHOST:9", "127.0.0.1", "127.1.2.3:80", "[::1]:1", " \tlocalhost "):
        assert get("/livez", host=host)[0] == 200, host
    assert ask(b"GET /livez HTTP/1.0\r\n\r\n")[0] == 200  # no Host at all
    for line in (b"GET", b"GET /livez", b"GET /livez HTTP/2.0", b""):
        assert ask(line + b"\r\n\r\n")[0] == 400, line

with test.check("a request in pieces is put together"):
    assert ask(b"GET /li", b"vez HTTP/1.1\r\nHost: local", b"host\r\n\r", b"\n")[0] == 200

with test.check("a request over 4 KiB is cut, and so is a peer that leaves"):
    assert ask(b"GET /livez HTTP/1.1\r\nX: " + b"x" * 5000) == (0, {}, b"")
    for _ in range(50):
        connect().close()
    assert get("/livez")[0] == 200

with test.check("a client has five seconds"):
    with connect() as link:
        begin = time.monotonic()
        link.sendall(b"GET /livez")
        assert rest_of(link) == b""
        assert time.monotonic() - begin > 4.5

with test.check("more clients than there is room for are closed, those within are answered"):
    links = [connect() for _ in range(CLIENTS_MAX + 8)]
    cut = 0
    for link in links:
        try:
            link.sendall(b"GET /livez HTTP/1.1\r\n\r\n")
            cut += b"200 OK" not in rest_of(link)
        except (BrokenPipeError, ConnectionResetError):
            cut += 1
        link.close()
    assert 1 <= cut <= 8, cut
    assert get("/livez")[0] == 200

with test.check("clients that take no answer hold no other client up"):
    slow = [connect() for _ in range(8)]
    for link in slow:
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        link.sendall(b"GET /metrics HTTP/1.1\r\n\r\n")
    assert get("/livez")[0] == 200
    for link in slow:
        link.close()

with test.check("a daemon that drains is alive and not ready; its end closes waiting clients"):
    daemon.signal(signal.SIGTERM)
    ut.wait_until(lambda: get("/readyz")[0] == 503, 10, "the drain")
    assert get("/readyz")[2] == b"draining\n"
    assert get("/livez")[0] == 200
    waiting = [connect() for _ in range(3)]
    daemon.signal(signal.SIGTERM)  # at once
    for link in waiting:
        assert rest_of(link) == b""
        link.close()
    assert daemon.wait() == 0

with test.check("a port in use and hosts that are not this machine are refused at start"):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        for address, code, word in ((f"127.0.0.1:{taken.getsockname()[1]}", 69, "cannot listen"),
                                    ("0.0.0.0:0", 2, "loopback"), ("127.0.0.1", 2, "HOST:PORT")):
            done = ut.run("umbraged", "--store", test.path("store"), "--listen",
                          "unix:" + test.path("s"), "--admin", address, code=code)
            assert b"--admin" in done.stderr and word.encode() in done.stderr, done.stderr

with test.check("the loopback of IPv6 is one, too"):
    if not socket.has_ipv6 or not os.path.exists("/proc/net/if_inet6"):
        ut.left_out("IPv6", "this machine has none")
    else:
        other = test.daemon("--admin", "[::1]:0")
        assert other.addresses["http"].startswith("[::1]:")

test.finish()
