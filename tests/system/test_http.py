#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
umbraged's HTTP/1.1 beyond what other servers have too (tests/interop/test_http_servers.py): rights,
rates, timers, hostile requests and peers, TLS, replaced files, the drain, and `umbrage stream`.
"""
import http.client
import os
import re
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
store = test.path("store")
os.mkdir(store)
ANN, BOB, EVE = ("ann-0123456789abcdef", "bob-0123456789abcdef", "eve-0123456789abcdef")
tokens = test.path("tokens")
with open(os.open(tokens, os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="ascii") as file:
    file.write(f"ann query,submit {ANN}\nbob query {BOB} 20000\neve submit {EVE}\n")
scene = test.scene("city", 24)
options = ("--resolution", 4096, "--sun", "135,45", "--verify", 0)
ID = test.bake(scene, os.path.join(store, "city.umb"), *options)["asset"]
test.bake(test.scene("city", 3), test.path("other.umb"), "--resolution", 512, "--verify", 0)
with open(os.path.join(store, "city.umb"), "rb") as file:
    whole = file.read()
assert len(whole) > 600_000, len(whole)
NAME, BY_ID = "/assets/city.umb", f"/assets/by-id/{ID}.umb"


def port_of(daemon, kind="tcp"):
    return int(daemon.addresses["http+" + kind].rpartition(":")[2])


def ask(daemon, path=NAME, method="GET", conn=None, token=None, **fields):
    """One request; status, fields and body."""
    close = conn is None
    conn = conn or http.client.HTTPConnection("127.0.0.1", port_of(daemon), timeout=20)
    headers = {name.replace("_", "-"): value for name, value in fields.items()}
    if token:
        headers["Authorization"] = "Bearer " + token
    conn.request(method, path, headers=headers)
    reply = conn.getresponse()
    body = reply.read()
    if close:
        conn.close()
    return reply.status, {name.lower(): value for name, value in reply.getheaders()}, body


class Raw:
    """A connection for bytes of any kind, over TCP or a Unix socket."""

    def __init__(self, daemon, kind="tcp"):
        if kind == "unix":
            self.socket = socket.socket(socket.AF_UNIX)
            self.socket.connect(daemon.addresses["http+unix"])
        else:
            self.socket = socket.create_connection(("127.0.0.1", port_of(daemon)))
        self.socket.settimeout(20)

    def say(self, *lines, end=b"\r\n\r\n"):
        self.socket.sendall(b"\r\n".join(line.encode("latin-1") for line in lines) + end)
        return self

    def rest(self):
        """Everything until the server closes."""
        answer = b""
        try:
            while piece := self.socket.recv(65536):
                answer += piece
        except ConnectionResetError:
            pass
        self.socket.close()
        return answer

    def body(self):
        """The body of one reply with a Content-Length."""
        answer = b""
        while b"\r\n\r\n" not in answer:
            piece = self.socket.recv(65536)
            assert piece, answer
            answer += piece
        head, _, body = answer.partition(b"\r\n\r\n")
        size = int(re.search(rb"(?i)content-length: (\d+)", head).group(1))
        while len(body) < size and (piece := self.socket.recv(65536)):
            body += piece
        return head, body


def statuses(answer):
    return [int(code) for code in re.findall(rb"(?m)^HTTP/1\.1 (\d+) ", answer)]


GET = (f"GET {NAME} HTTP/1.1", "Host: localhost")
daemon = test.daemon("--http", "tcp:127.0.0.1:0", "--http", "unix:" + test.path("http.sock"), "--handshake-timeout",
                     "1s", "--stall-timeout", "1s", "--log-level", "debug")

with test.check("a head has one spelling; every other one is refused, and the connection closes"):
    CASES = [
        (400, ("GET  /assets/city.umb HTTP/1.1", "Host: h")),
        (400, (" GET /assets/city.umb HTTP/1.1", "Host: h")),
        (400, ("GET /assets/city.umb", "Host: h")),
        (400, ("GET assets/city.umb HTTP/1.1", "Host: h")),
        (505, ("GET / HTTP/1.1 ", "Host: h")),
        (400, ("GET /a\tb HTTP/1.1", "Host: h")),
        (400, ("G(T / HTTP/1.1", "Host: h")),
        (505, ("GET / HTTP/1.2", "Host: h")),
        (505, ("GET / HTTP/2.0", "Host: h")),
        (505, ("PRI * HTTP/2.0",)),
        (400, ("", "", "GET / HTTP/1.1", "Host: h")),
        (400, ("GET / HTTP/1.1",)),
        (400, ("GET / HTTP/1.1", "Host: h", "Host: h")),
        (400, ("GET / HTTP/1.1", "Host : h")),
        (400, ("GET / HTTP/1.1", "Host: h", " folded: x")),
        (400, ("GET / HTTP/1.1", "Host: h", "no colon")),
        (400, ("GET / HTTP/1.1", "Host: h", ": x")),
        (400, ("GET / HTTP/1.1", "Host: h", "X: a\0b")),
        (400, ("GET / HTTP/1.1", "Host: h", "X: a\rb")),
        (400, ("GET / HTTP/1.1\nHost: h", "X: y")),
        (400, ("GET / HTTP/1.1", "Host: h", "Range: bytes=0-1", "Range: bytes=2-3")),
        (400, ("GET / HTTP/1.1", "Host: h", "Authorization: Bearer x", "Authorization: Bearer y")),
        (414, ("GET /" + "a" * 9000 + " HTTP/1.1", "Host: h")),
        (431, ("GET / HTTP/1.1", "Host: h", "X: " + "a" * 9000)),
        (431, ("GET / HTTP/1.1", "Host: h", *(f"X{i}: y" for i in range(64)))),
        (417, ("GET / HTTP/1.1", "Host: h", "Expect: 100-continue")),
    ]
    abuse = daemon.metric("umbrage_h2_abuse_total")
    asked = [Raw(daemon).say(*lines) for _, lines in CASES]  # together: each lingers for a second
    for (status, lines), conn in zip(CASES, asked):
        answer = conn.rest()
        assert statuses(answer) == [status], (lines, answer[:200])
        assert b"\r\nConnection: close\r\n" in answer, answer
    assert daemon.metric("umbrage_h2_abuse_total") == abuse + len(CASES)
    answer = Raw(daemon).say("\x16\x03\x01\x02\x00", end=b"").rest()  # TLS on a plain port
    assert statuses(answer) == [400], answer

with test.check("a body is refused in every disguise, and nothing behind it is a request"):
    smuggled = "\r\n".join(GET) + "\r\n\r\n"
    length = f"Content-Length: {len(smuggled)}"
    SHAPES = [(413, (length,)), (501, ("Transfer-Encoding: chunked",)), (413, (length, "Transfer-Encoding: chunked")),
              (501, ("Transfer-Encoding: chunked", length)), (501, ("Transfer-Encoding: xchunked",)),
              (400, ("Transfer-Encoding : chunked",)), (400, ("Content-Length: 0", "Content-Length: 5")),
              (400, ("Content-Length: +0",)), (400, ("Content-Length: 0x10",)), (400, ("Content-Length: ",)),
              (413, ("Content-Length: 00",)), (413, ("Content-Length: 99999999999999999999999",))]
    cases = [(status, fields, method) for status, fields in SHAPES for method in ("GET", "POST", "HEAD", "OPTIONS")]
    asked = [Raw(daemon).say(f"{method} {NAME} HTTP/1.1", "Host: localhost", *fields,
                             end=b"\r\n\r\n" + smuggled.encode()) for _, fields, method in cases]
    for case, conn in zip(cases, asked):
        assert statuses(conn.rest()) == [case[0]], case
    assert statuses(Raw(daemon).say(*GET, "Content-Length: 0", "Connection: close").rest()) == [200]

with test.check("targets: absolute form, queries, a blank line before; percent-encoding names nothing"):
    for target, status in ((f"http://localhost{NAME}", 200), (f"HTTPS://x:1{NAME}", 200), (NAME + "?v=1", 200),
                           ("http://localhost", 400), ("/assets/%63ity.umb", 404), ("/assets/city%2eumb", 404),
                           ("/assets/./city.umb", 404), ("/assets//city.umb", 404), ("/assets/city.umb/", 404),
                           ("/ASSETS/city.umb", 404), ("/assets/../store/city.umb", 404),
                           (f"/assets/by-id/{ID.upper()}.umb", 404), (f"/assets/by-id/{ID[:-1]}.umb", 404),
                           ("/assets/" + "a" * 300 + ".umb", 404), ("/assets/.umbrage-cache/key.umb", 404)):
        answer = Raw(daemon).say("", f"HEAD {target} HTTP/1.1", "Host: localhost", "Connection: close").rest()
        assert statuses(answer) == [status], (target, answer[:100])
    assert statuses(Raw(daemon).say("OPTIONS * HTTP/1.1", "Host: localhost", "Connection: close").rest()) == [204]

with test.check("too many ranges, and overlaps, are refused with the file's size"):
    many = "bytes=" + ",".join(f"{2 * i}-{2 * i}" for i in range(129))
    for text, words in ((many, "128 ranges"), ("bytes=0-9,9-12", "overlap"), ("bytes=-10,0-", "overlap")):
        status, fields, said = ask(daemon, Range=text)
        assert status == 416 and fields["content-range"] == f"bytes */{len(whole)}", (status, fields)
        assert words in said.decode(), said
    status, fields, said = ask(daemon, Range=many.rpartition(",")[0])
    assert status == 206 and said.count(b"Content-Range") == 128
    assert int(fields["content-length"]) == len(said)

with test.check("a plain daemon without tokens answers under this machine's names only"):
    assert ask(daemon, Host="evil.example")[0] == 421 and ask(daemon, Host="evil.example:80")[0] == 421
    for host in ("localhost", "127.0.0.1:8080", "[::1]:1", "LOCALHOST"):
        assert ask(daemon, Host=host)[0] == 200, host

with test.check("slow heads end with 408, silent connections quietly"):
    quiet = Raw(daemon)
    abuse = daemon.metric("umbrage_h2_abuse_total")
    slow = Raw(daemon)
    started = time.monotonic()
    slow.socket.sendall(b"GET /assets/")
    assert statuses(slow.rest()) == [408] and 0.5 < time.monotonic() - started < 8
    assert quiet.rest() == b""
    assert daemon.metric("umbrage_h2_abuse_total") == abuse + 1  # the slow one, not the silent one

with test.check("a head that comes byte by byte is answered"):
    drip = Raw(daemon)
    for byte in ("\r\n".join(GET) + "\r\nConnection: close\r\n\r\n").encode():
        drip.socket.sendall(bytes([byte]))
    assert drip.rest().endswith(whole)

with test.check("thousands of requests in one connection are answered in their order, in bounded memory"):
    piped = Raw(daemon)
    count = 4000
    data = b"".join(f"GET {NAME} HTTP/1.1\r\nHost: localhost\r\nRange: bytes={i}-{i}\r\n\r\n".encode()
                    for i in range(count - 1))
    data += f"GET {NAME} HTTP/1.1\r\nHost: localhost\r\nRange: bytes=7-7\r\nConnection: close\r\n\r\n".encode()
    sender = threading.Thread(target=piped.socket.sendall, args=(data,), daemon=True)
    sender.start()
    answer = piped.rest()
    sender.join()
    got = [int(n) for n in re.findall(rb"Content-Range: bytes (\d+)-", answer)]
    assert got == list(range(count - 1)) + [7], (len(got), got[-3:])
    # A client that reads nothing: the daemon stops reading, too, and then cuts it.
    glutton = Raw(daemon, "unix")
    glutton.socket.settimeout(10)
    try:
        while True:
            glutton.socket.sendall(data[:100_000])
    except (TimeoutError, BrokenPipeError, ConnectionResetError):
        pass
    assert daemon.metric("umbrage_buffered_bytes") < 2 << 20
    glutton.socket.close()

with test.check("a reader that takes nothing is cut after the stall timeout; others are served meanwhile"):
    lazy = [Raw(daemon, "unix").say(*GET) for _ in range(8)]
    for _ in range(20):
        assert ask(daemon)[2] == whole
    assert daemon.metric("umbrage_buffered_bytes") < 8 * (1 << 20)
    ut.wait_until(lambda: daemon.metric("umbrage_buffered_bytes") < 65536, 10, "their replies are given up")
    for one in lazy:
        assert len(one.rest()) < len(whole)

with test.check("a file that is replaced under a reader arrives whole; the next request gets the new one"):
    reader = Raw(daemon, "unix").say(*GET)
    first = reader.socket.recv(1000)
    shutil.copy(test.path("other.umb"), test.path("other.tmp"))
    os.rename(test.path("other.tmp"), os.path.join(store, "city.umb"))
    started = time.monotonic()

    def is_new():
        got = reader.socket.recv(20000)  # fast enough for the stall timeout
        global first
        first += got
        return ask(daemon, method="HEAD")[1]["etag"] != f'"{ID}"'
    ut.wait_until(is_new, 10, "the new version is served")
    while len(first.partition(b"\r\n\r\n")[2]) < len(whole) and (piece := reader.socket.recv(65536)):
        first += piece
    assert first.partition(b"\r\n\r\n")[2] == whole
    assert ask(daemon, BY_ID)[0] == 404
    status, _, body = ask(daemon, If_Range=f'"{ID}"', Range="bytes=0-9")
    assert status == 200 and len(body) == os.path.getsize(test.path("other.umb"))
    with open(test.path("city.tmp"), "wb") as file:
        file.write(whole)
    os.rename(test.path("city.tmp"), os.path.join(store, "city.umb"))
    ut.wait_until(lambda: ask(daemon, BY_ID, "HEAD")[0] == 200, 10, "the old version is back")

with test.check("a drain lets a reply end, says so in the next ones, and closes idle connections"):
    idle = http.client.HTTPConnection("127.0.0.1", port_of(daemon), timeout=20)
    assert ask(daemon, method="HEAD", conn=idle)[0] == 200
    reader = Raw(daemon, "unix").say(*GET)
    got = reader.socket.recv(1000)
    daemon.signal(signal.SIGTERM)
    ut.wait_until(lambda: "stage=last" in daemon.log(), 10, "the drain begins")
    while piece := reader.socket.recv(65536):
        got += piece
    assert got.partition(b"\r\n\r\n")[2] == whole
    assert idle.sock.recv(1) == b""
    daemon.exited()

with test.check("the log has a line for each request, and the metrics their sum"):
    log = daemon.log()
    assert re.search(r'event=http .*path="/assets/city.umb" status=200 bytes=\d+ dur_us=\d+', log), log[-500:]
    assert re.search(r"event=http .*status=499", log), "of the readers that were cut"

# ---- with tokens ----

guarded = test.daemon("--http", "tcp:127.0.0.1:0", "--token-file", tokens, "--http-origin", "*",
                      "--jobs", test.path("jobs"), "--bake-threads", 1)

with test.check("without a good token nothing is told about any asset"):
    for token, status in ((None, 401), ("x" * 20, 401), (EVE, 403)):
        told = [ask(guarded, path, method, token=token) for path in (NAME, BY_ID, "/assets/none.umb")
                for method in ("GET", "HEAD")]
        assert {one[0] for one in told} == {status}, told
        assert len({one[2] for one in told}) == 2, told  # of GET and of HEAD
        if status == 401:
            assert told[0][1]["www-authenticate"].startswith("Bearer")
        assert told[0][1]["access-control-allow-origin"] == "*"
    assert ask(guarded, method="OPTIONS", Origin="https://a.example")[0] == 204  # a browser sends no token with it
    assert guarded.metric("umbrage_unauthorized_total") >= 18

with test.check("with one the reply is for private caches"):
    status, fields, body = ask(guarded, token=ANN)
    assert status == 200 and body == whole and "private" in fields["cache-control"], fields
    assert "private" in ask(guarded, BY_ID, token=ANN)[1]["cache-control"]

with test.check("a token's rate counts bytes; beyond it 429 says when to come again"):
    refused = None
    for _ in range(20):
        status, fields, _ = ask(guarded, Range=f"bytes=0-{64 * 1024 - 1}", token=BOB)
        if status == 429:
            refused = int(fields["retry-after"])
            break
        assert status == 206
    assert refused is not None and 1 <= refused <= 10, refused
    assert ask(guarded, token=ANN)[0] == 200
    ut.wait_until(lambda: ask(guarded, method="HEAD", token=BOB)[0] == 200, 20, "its rate recovers")

with test.check("an asset of a job is for its owner"):
    made = ut.run("umbrage", "submit", test.scene("city", 4), "--resolution", 512, "--sun", "120,40", "--verify", 1000, "--wait",
                  "--json", env={"UMBRAGE_ADDRESS": guarded.grpc_unix, "UMBRAGE_TOKEN": ANN})
    job_asset = re.search(r'"asset": *"([0-9a-f]{64})"', made.stdout.decode()).group(1)
    path = f"/assets/by-id/{job_asset}.umb"
    assert ask(guarded, path, token=ANN)[0] == 200
    other = ask(guarded, path, token=BOB)
    none = ask(guarded, f"/assets/by-id/{'0' * 64}.umb", token=BOB)
    assert other[0] == none[0] == 404
    assert other[2].replace(job_asset.encode(), b"") == none[2].replace(b"0" * 64, b""), (other, none)

with test.check("umbrage stream fetches with a token, and only one that the user names"):
    url = f"http://127.0.0.1:{port_of(guarded)}{BY_ID}"
    secret = test.path("secret")
    with open(os.open(secret, os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="ascii") as file:
        file.write(ANN + "\n")
    part, same = test.path("a.part"), test.path("b.part")
    ut.run("umbrage", "stream", "--from-url", url, "--token-file", secret, "--id", ID, "-o", part, "--quiet")
    ut.run("umbrage", "stream", os.path.join(store, "city.umb"), "-o", same, "--quiet")
    with open(part, "rb") as one, open(same, "rb") as two:
        assert one.read() == two.read()
    said = ut.run("umbrage", "stream", "--from-url", url, "--quiet", code=77, env={"UMBRAGE_TOKEN": ANN})
    assert b"401" in said.stderr and b"--token-file" in said.stderr, said.stderr
    said = ut.run("umbrage", "stream", "--from-url", url, "--token-file", "/dev/null", code=2)
    assert b"token" in said.stderr

with test.check("connections without rights give way to those with a token"):
    small = test.daemon("--http", "tcp:127.0.0.1:0", "--token-file", tokens, "--max-connections", 16,
                        "--max-address-connections", 16)
    idle = [Raw(small) for _ in range(40)]
    for one in idle[:20]:
        try:
            one.socket.sendall(b"GET /assets/city.umb HTTP/1.1\r\n")
        except OSError:
            pass  # it had to go
    for _ in range(10):
        assert ask(small, method="HEAD", token=ANN)[0] == 200
    for one in idle:
        one.socket.close()
    small.stop()

with test.check("without tokens other machines are let in only if the operator says so"):
    command = [ut.program("umbraged"), "--store", store, "--http", "tcp:0.0.0.0:0", "--listen",
               "unix:" + test.path("x.sock")]
    done = subprocess.run(command, stderr=subprocess.PIPE, check=False, timeout=60)
    assert done.returncode == 2 and b"--http: '0.0.0.0:0' lets other machines" in done.stderr, done.stderr
    anyone = test.daemon("--http", "tcp:0.0.0.0:0", "--without-tokens")
    assert ask(anyone, Host="assets.example")[0] == 200
    anyone.stop()

if shutil.which("openssl"):
    with test.check("TLS: HTTP/1.1 by ALPN or without it, HTTP/2 not; gRPC addresses stay gRPC's"):
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
                        "-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1",
                        "-keyout", test.path("key.pem"), "-out", test.path("cert.pem")], check=True,
                       stderr=subprocess.DEVNULL)
        secure = test.daemon("--http", "tls:127.0.0.1:0", "--listen", "tls:127.0.0.1:0", "--tls-cert",
                             test.path("cert.pem"), "--tls-key", test.path("key.pem"))

        def shake(port, protocols):
            context = ssl.create_default_context(cafile=test.path("cert.pem"))
            if protocols:
                context.set_alpn_protocols(protocols)
            plain = socket.create_connection(("127.0.0.1", port), timeout=20)
            return context.wrap_socket(plain, server_hostname="127.0.0.1")

        https = port_of(secure, "tls")
        for protocols in (["http/1.1"], ["h2", "http/1.1"], []):
            conn = http.client.HTTPConnection("127.0.0.1", https)
            conn.sock = shake(https, protocols)
            assert ask(secure, conn=conn)[2] == whole and ask(secure, conn=conn, Range="bytes=5-9")[2] == whole[5:10]
            conn.close()
        for port, protocols in ((https, ["h2"]), (int(secure.addresses["tls"].rpartition(":")[2]), ["http/1.1"])):
            try:
                shake(port, protocols).recv(1)
            except ssl.SSLError:
                continue
            raise AssertionError((port, protocols))
        ut.run("umbrage", "stream", "--from-url", f"https://127.0.0.1:{https}{NAME}", "--tls-ca",
               test.path("cert.pem"), "--id", ID, "--quiet")
        ut.run("umbrage", "stream", "--from-url", f"https://127.0.0.1:{https}{NAME}", "--quiet", code=69)
else:
    ut.left_out("TLS", "the openssl command is not installed")
test.finish()
