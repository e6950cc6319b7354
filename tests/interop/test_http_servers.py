#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Assets over HTTP/1.1: one list of rules for umbraged, nginx and Caddy. The two web servers run with
the configurations of deploy/, which only get another port and folder.

The rules are those of RFC 9110 (conditions, ranges), RFC 9111 (caching) and the Fetch standard
(CORS), and what docs/reference/protocol.md promises beyond them.
"""
import http.client
import os
import random
import re
import shutil
import socket
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
ORIGIN, STRANGER = "https://viewer.example", "https://other.example"
store = test.path("www", "assets")
os.makedirs(os.path.join(store, "by-id"))
test.bake(test.scene("city", 12), os.path.join(store, "city.umb"), "--resolution", "2048", "--sun", "135,45",
          "--verify", "0")
with open(os.path.join(store, "city.umb"), "rb") as file:
    whole = file.read()
asset_id = ut.run("umbrage", "info", os.path.join(store, "city.umb")).stdout.decode()
asset_id = re.search(r"[0-9a-f]{64}", asset_id).group(0)
os.link(os.path.join(store, "city.umb"), os.path.join(store, "by-id", asset_id + ".umb"))
NAME, ID = "/assets/city.umb", f"/assets/by-id/{asset_id}.umb"


class Reply:
    """A reply, read to its end."""

    def __init__(self, reply):
        self.status, self.reason = reply.status, reply.reason
        self.fields = [(name.lower(), value) for name, value in reply.getheaders()]
        self.body = reply.read()

    def field(self, name):
        """Value of a field that comes at most once."""
        values = [value for known, value in self.fields if known == name]
        assert len(values) <= 1, (name, values)
        return values[0] if values else None


class Server:
    """One server on a port of 127.0.0.1."""

    def __init__(self, name, port, process=None):
        self.name, self.port, self.process = name, port, process

    def ask(self, path, method="GET", **fields):
        """One request on a connection of its own. Fields: Range, If_Range, ..."""
        conn = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        conn.request(method, path, headers={name.replace("_", "-"): value for name, value in fields.items()})
        reply = Reply(conn.getresponse())
        conn.close()
        return reply

    def raw(self, data):
        """What a server answers to these bytes, until it closes."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=20) as conn:
            conn.sendall(data)
            answer = b""
            while True:
                piece = conn.recv(65536)
                if not piece:
                    return answer
                answer += piece


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def start(name, command, config):
    """Starts a web server with a configuration of deploy/, in which only port and folder differ."""
    port = free_port()
    with open(os.path.join(ut.ROOT, "deploy", config), encoding="utf-8") as file:
        text = file.read()
    for old, new in {"/srv/umbrage-www": test.path("www"), ":8080": f":{port}"}.items():
        assert old in text, old
        text = text.replace(old, new)
    path = test.path(os.path.basename(config))
    if name == "nginx":
        path = test.path("nginx.conf")
        text = (f"daemon off; master_process off; pid {test.folder}/nginx.pid; error_log stderr crit; events {{}} "
                f"http {{ access_log off; client_body_temp_path {test.folder}/b; proxy_temp_path {test.folder}/p; "
                f"fastcgi_temp_path {test.folder}/f; uwsgi_temp_path {test.folder}/u; "
                f"scgi_temp_path {test.folder}/s;\n{text}}}\n")
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
    process = subprocess.Popen([word.replace("CONF", path) for word in command], stderr=subprocess.DEVNULL,
                               env={**os.environ, "HOME": test.folder})

    def answers():
        assert process.poll() is None, f"{name} does not start"
        with socket.socket() as one:
            return one.connect_ex(("127.0.0.1", port)) == 0
    ut.wait_until(answers, 20, f"{name} answers")
    return Server(name, port, process)


def servers():
    """umbraged, and the web servers that are installed."""
    daemon = test.daemon("--http", "tcp:127.0.0.1:0", "--http-origin", ORIGIN, store=store)
    yield Server("umbraged", int(daemon.addresses["http+tcp"].rpartition(":")[2]))
    for name, command, config in (("nginx", ["-c", "CONF"], "nginx/umbrage-assets.conf"),
                                  ("caddy", ["run", "--adapter", "caddyfile", "--config", "CONF"], "caddy/Caddyfile")):
        program = shutil.which(name) or shutil.which(name, path="/usr/sbin:/sbin")
        if program is None:
            ut.left_out(name, "it is not installed")
            continue
        server = start(name, [program] + command, config)
        yield server
        server.process.terminate()
        server.process.wait()


def part_of(reply, offset, length):
    """Demands a reply with one range."""
    assert reply.status == 206, reply.status
    assert reply.field("content-range") == f"bytes {offset}-{offset + length - 1}/{len(whole)}", reply.fields
    assert reply.field("content-length") == str(length), reply.fields
    assert reply.body == whole[offset:offset + length]


def parts(reply):
    """(offset, bytes) of a reply with several ranges, as strictly as RFC 2046 has it."""
    assert reply.status == 206, reply.status
    boundary = re.fullmatch(r"multipart/byteranges; ?boundary=\"?([^\"]+)\"?", reply.field("content-type")).group(1)
    assert int(reply.field("content-length")) == len(reply.body)
    begin = b"--" + boundary.encode()
    pieces = (b"\r\n" + reply.body.removeprefix(b"\r\n")).split(b"\r\n" + begin)
    assert pieces[0] == b"" and re.fullmatch(rb"--\r\n?(\r\n)?", pieces[-1]), (pieces[0], pieces[-1][:9])
    found = []
    for piece in pieces[1:-1]:
        head, _, body = piece.partition(b"\r\n\r\n")
        first, last, size = map(int, re.search(rb"(?im)^content-range: bytes (\d+)-(\d+)/(\d+)", head).groups())
        assert size == len(whole) and len(body) == last - first + 1
        found.append((first, body))
    return found


def whole_files(server):
    for path in (NAME, ID):
        get, head = server.ask(path), server.ask(path, "HEAD")
        assert get.status == 200 and get.body == whole
        assert get.field("content-length") == str(len(whole)) and get.field("accept-ranges") == "bytes"
        assert get.field("content-type") == "application/octet-stream", get.fields
        assert get.field("x-content-type-options") == "nosniff"
        assert re.fullmatch(r'"[^"]+"', get.field("etag")), "a strong entity tag"
        assert head.status == 200 and head.body == b""
        changing = {"date"}
        assert sorted(f for f in head.fields if f[0] not in changing) == \
            sorted(f for f in get.fields if f[0] not in changing), (head.fields, get.fields)


def single_ranges(server):
    size = len(whole)
    rng = random.Random(7)
    cases = [(0, 0), (0, 99), (size - 1, size - 1), (size // 2, size - 1), (0, size - 1)]
    cases += [sorted((rng.randrange(size), rng.randrange(size))) for _ in range(40)]
    for first, last in cases:
        part_of(server.ask(NAME, Range=f"bytes={first}-{last}"), first, last - first + 1)
    part_of(server.ask(NAME, Range="bytes=100-"), 100, size - 100)
    part_of(server.ask(NAME, Range="bytes=-100"), size - 100, 100)
    part_of(server.ask(NAME, Range=f"bytes=0-{size + 1000}"), 0, size)
    part_of(server.ask(NAME, Range="bytes=7-99999999999999999"), 7, size - 7)
    part_of(server.ask(NAME, Range=f"bytes=-{size + 1000}"), 0, size)


def ranges_without_bytes(server):
    for text in (f"bytes={len(whole)}-", f"bytes={len(whole) + 5}-{len(whole) + 9}", "bytes=-0"):
        reply = server.ask(NAME, Range=text)
        if server.name == "caddy" and text == "bytes=-0":
            continue  # Go's net/http answers with a range of no bytes
        assert reply.status == 416, (text, reply.status)
        assert reply.field("content-range") == f"bytes */{len(whole)}", (text, reply.fields)


def malformed_ranges(server):
    """Refused or ignored, never half understood."""
    for text in ("bytes=5-2", "bytes=", "bytes=a-b", "bytes=1", "bytes 0-1", "bytes=0-1-2", "bytes=--1"):
        reply = server.ask(NAME, Range=text)
        assert reply.status == 416 or (reply.status == 200 and reply.body == whole), (text, reply.status)
    reply = server.ask(NAME, Range="pages=1-2")
    assert reply.status == 416 or (reply.status == 200 and reply.body == whole)


def several_ranges(server):
    size = len(whole)
    rng = random.Random(3)
    for count in (2, 3, 17, 64):
        cuts = sorted(rng.sample(range(size), 2 * count))
        wanted = [(cuts[2 * i], cuts[2 * i + 1] - 1) for i in range(count) if cuts[2 * i] < cuts[2 * i + 1]]
        rng.shuffle(wanted)
        found = parts(server.ask(NAME, Range="bytes=" + ", ".join(f"{a}-{b}" for a, b in wanted)))
        assert sorted((first, first + len(body) - 1) for first, body in found) == sorted(wanted)
        assert all(body == whole[first:first + len(body)] for first, body in found)
    # One of two lies behind the end: one part, or one range.
    reply = server.ask(NAME, Range=f"bytes=0-9,{size + 1}-{size + 9}")
    body = parts(reply)[0][1] if "multipart" in reply.field("content-type") else reply.body
    assert reply.status == 206 and body == whole[:10]


def overlaps(server):
    """Ranges that would add up to more than the file do not make a reply of more than the file."""
    for text in ("bytes=0-99,50-149", "bytes=" + ",".join(["0-"] * 100), "bytes=0-,0-,0-"):
        reply = server.ask(NAME, Range=text)
        assert reply.status in (200, 206, 416), (text, reply.status)
        assert len(reply.body) <= len(whole) + 4096, (text, len(reply.body))


def conditions(server):
    tag = server.ask(NAME).field("etag")
    if server.name == "umbraged":
        assert tag == f'"{asset_id}"' and server.ask(ID).field("etag") == tag
    for text in (tag, f'"x", {tag}', f"W/{tag}", "*"):
        for method in ("GET", "HEAD"):
            reply = server.ask(NAME, method, If_None_Match=text)
            assert reply.status == 304 and reply.body == b"", (text, reply.status)
            assert reply.field("etag") == tag and reply.field("cache-control"), reply.fields
    assert server.ask(NAME, If_None_Match='"x"').body == whole
    assert server.ask(NAME, If_None_Match=tag, Range="bytes=0-9").status == 304
    part_of(server.ask(NAME, If_Range=tag, Range="bytes=5-9"), 5, 5)
    for text in ('"x"', f"W/{tag}"):
        reply = server.ask(NAME, If_Range=text, Range="bytes=5-9")
        assert reply.status == 200 and reply.body == whole, (text, reply.status)
    assert server.ask(NAME, If_Match='"x"').status == 412
    assert server.ask(NAME, If_Match=tag).body == whole


def caching(server):
    for method in ("GET", "HEAD"):
        by_id = server.ask(ID, method).field("cache-control")
        assert re.search(r"\bpublic\b", by_id) and "immutable" in by_id, by_id
        assert int(re.search(r"max-age=(\d+)", by_id).group(1)) >= 31536000
        by_name = server.ask(NAME, method).field("cache-control")
        assert "must-revalidate" in by_name and "immutable" not in by_name, by_name
        assert int(re.search(r"max-age=(\d+)", by_name).group(1)) <= 60
    assert "immutable" not in (server.ask("/assets/none.umb").field("cache-control") or "")


def cors(server):
    for path, status in ((NAME, 200), (ID, 200)):
        reply = server.ask(path, Origin=ORIGIN)
        assert reply.status == status and reply.field("access-control-allow-origin") == ORIGIN, reply.fields
        exposed = {word.strip().lower() for word in reply.field("access-control-expose-headers").split(",")}
        assert {"content-range", "etag", "accept-ranges"} <= exposed, exposed
        assert "origin" in reply.field("vary").lower()
    assert server.ask(NAME, Origin=ORIGIN, Range="bytes=0-9").field("access-control-allow-origin") == ORIGIN
    for stranger in (STRANGER, "null", ORIGIN + ".evil.example", ORIGIN.replace("https", "http"), ORIGIN + ":444"):
        reply = server.ask(NAME, Origin=stranger)
        assert reply.field("access-control-allow-origin") is None, (stranger, reply.fields)
        assert "origin" in reply.field("vary").lower(), "a cache must not give one origin's reply to another"
    reply = server.ask(NAME, "OPTIONS", Origin=ORIGIN, Access_Control_Request_Method="GET",
                       Access_Control_Request_Headers="range,if-range")
    assert reply.status in (200, 204) and reply.body == b""
    assert reply.field("access-control-allow-origin") == ORIGIN
    assert {"GET", "HEAD"} <= set(re.split(r", *", reply.field("access-control-allow-methods")))
    assert {"range", "if-range", "if-none-match"} <= \
        set(re.split(r", *", reply.field("access-control-allow-headers").lower()))
    assert int(reply.field("access-control-max-age")) >= 600
    assert reply.field("access-control-allow-credentials") is None
    reply = server.ask(NAME, "OPTIONS", Origin=STRANGER, Access_Control_Request_Method="GET")
    assert reply.field("access-control-allow-origin") is None, reply.fields


def others(server):
    for path in ("/assets/none.umb", "/assets/by-id/" + "0" * 64 + ".umb", "/assets/city", "/assets/", "/",
                 "/city.umb"):
        assert server.ask(path).status == 404, path
    for method in ("POST", "PUT", "DELETE"):
        assert server.ask(NAME, method).status in (403, 404, 405), method
    for path in ("/assets/../../../../../../etc/passwd", "/../../etc/passwd", "/assets/%2e%2e/%2e%2e/etc/passwd",
                 "/assets/..%2f..%2fetc/passwd", "/assets/city.umb%00.umb", "//etc/passwd", "/assets/\\..\\city.umb"):
        answer = server.raw(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n".encode())
        assert re.match(rb"HTTP/1\.1 (30[1278]|40[04])", answer), (path, answer[:80])
        assert b"root:" not in answer


def connections(server):
    """Requests that follow one another, and that wait in the connection."""
    conn = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    for first in range(0, 400, 20):
        conn.request("GET", NAME, headers={"Range": f"bytes={first}-{first + 19}"})
        part_of(Reply(conn.getresponse()), first, 20)
    conn.close()
    piped = b"".join(f"GET {NAME} HTTP/1.1\r\nHost: 127.0.0.1\r\nRange: bytes={i}-{i}\r\n"
                     f"{'Connection: close' if i == 29 else 'X: y'}\r\n\r\n".encode() for i in range(30))
    answer = server.raw(piped)
    got = [int(n) for n in re.findall(rb"(?i)content-range: bytes (\d+)-", answer)]
    assert got == list(range(30)), (got, answer[-300:])
    answer = server.raw(f"GET {NAME} HTTP/1.0\r\n\r\n".encode())
    assert answer.split(b"\r\n", 1)[0].endswith(b"200 OK") and answer.endswith(whole)


for each in servers():
    for rule in (whole_files, single_ranges, ranges_without_bytes, malformed_ranges, several_ranges, overlaps,
                 conditions, caching, cors, others, connections):
        with test.check(f"{each.name}: {rule.__name__.replace('_', ' ')}"):
            rule(each)
test.finish()
