#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The web server of `umbrage view`: what it serves, what it refuses, its bounds, and --export. The page itself is a stand-in
of a few bytes, so that the test needs no compiler for WebAssembly; test_view_browser.py opens the real one.
"""
import contextlib
import json
import os
import re
import shutil
import socket
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import link  # noqa: E402
import umbrage_test as ut  # noqa: E402
import view_server  # noqa: E402

if not os.path.exists("/usr/share/javascript/three/build/three.module.js"):
    ut.skip("three.js is not installed: libjs-three")
test = ut.Test()
store = test.path("store")
os.mkdir(store)
ID = test.bake(test.scene("city", 6), os.path.join(store, "city.umb"), "--resolution", 1024, "--verify", 0)["asset"]
asset_file = os.path.join(store, "city.umb")
with open(asset_file, "rb") as file:
    whole = file.read()
ASSET = f"/asset-{ID}.umb"
# The program with a page beside it.
program = test.path("bin", "umbrage")
PAGE = {"viewer/index.html": b"<!doctype html>\n", "umbrage/umbrage.wasm": b"\0asm", "umbrage/index.js": b"export {};\n"}
for name, body in PAGE.items():
    os.makedirs(os.path.dirname(test.path("bin", "web", name)), exist_ok=True)
    with open(test.path("bin", "web", name), "wb") as file:
        file.write(body)
shutil.copy(ut.program("umbrage"), program)
# A scene with a library and a texture, and a file beside it that it does not name.
os.mkdir(test.path("scene"))
for name, text in (("wall.obj", "mtllib a b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), ("a b.mtl", "newmtl a\nmap_Kd t.png\n"),
                   ("t.png", "picture"), ("secret.png", "secret")):
    with open(test.path("scene", name), "w", encoding="ascii") as file:
        file.write(text)
view = view_server.View(asset_file, "--scene", test.path("scene", "wall.obj"), program=program)
HOST = f"Host: 127.0.0.1:{view.port}\r\n"


def send(data, port=None, timeout=20):
    """What the server answers to bytes, until it closes."""
    with socket.create_connection(("127.0.0.1", port or view.port), timeout=timeout) as peer:
        peer.sendall(data)
        parts = []
        while part := peer.recv(1 << 16):
            parts.append(part)
        return b"".join(parts)


def slow_peer(path):
    """A connection that has asked for a file, and has room for little of it."""
    peer = socket.socket()
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    peer.connect(("127.0.0.1", view.port))
    peer.sendall(f"GET /{view.key}{path} HTTP/1.1\r\n{HOST}\r\n".encode())
    return peer


def take_slowly(peer, ended):
    """Takes two bytes a second; notes the time at which the server has closed."""
    with peer, contextlib.suppress(OSError):
        while peer.recv(2):
            time.sleep(1)
            if is_closed(peer):
                break
    ended.append(time.monotonic())


def is_closed(peer):
    """Has the other end closed or reset this connection? State ESTABLISHED is 1 in struct tcp_info."""
    return peer.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1)[0] != 1


def ask(path, method="GET", fields="", host=HOST, server=None):
    """Status, header fields and body of a reply. server: another than the first."""
    server = server or view
    reply = send(f"{method} /{server.key}{path} HTTP/1.1\r\n{host}Connection: close\r\n{fields}\r\n".encode("latin-1"), server.port)
    head, _, body = reply.partition(b"\r\n\r\n")
    lines = head.decode().split("\r\n")
    return int(lines[0].split()[1]), {key.lower(): value for key, value in (line.split(": ", 1) for line in lines[1:])}, body


with test.check("the page, the package, three.js, the scene and its files are served with their types"):
    for path, start, kind in (("/", b"<!doctype", "text/html"), ("/umbrage/umbrage.wasm", b"\0asm", "application/wasm"),
                              ("/umbrage/index.js", b"export", "text/javascript"),
                              ("/three/build/three.module.js", b"", "text/javascript"),
                              ("/three/examples/jsm/loaders/GLTFLoader.js", b"", "text/javascript"),
                              ("/scene/wall.obj", b"mtllib", ""), ("/scene/a%20b.mtl", b"newmtl", ""),
                              ("/scene/t.png", b"picture", "image/png"), ("/config.json?x=1", b"{", "application/json")):
        status, fields, body = ask(path)
        assert status == 200 and body.startswith(start) and fields["content-type"].startswith(kind), (path, status, fields)
        assert len(body) == int(fields["content-length"]) and fields["x-content-type-options"] == "nosniff", path
        policy = fields["content-security-policy"]
        assert "default-src 'none'" in policy and "frame-ancestors 'none'" in policy, policy
        assert fields["cross-origin-resource-policy"] == "same-origin" and "access-control-allow-origin" not in fields, fields
    config = json.loads(ask("/config.json")[2])
    assert config == {"name": "city.umb", "asset": ASSET[1:], "id": ID, "up": "y", "scene": "scene/wall.obj"}, config

with test.check("the asset is served whole and by ranges, and may be cached for ever"):
    assert ask(ASSET)[2] == whole
    for field, first, last in (("0-99", 0, 99), ("1000-", 1000, len(whole) - 1), ("-77", len(whole) - 77, len(whole) - 1)):
        status, fields, body = ask(ASSET, fields=f"Range: bytes={field}\r\n")
        assert (status, body) == (206, whole[first:last + 1]), (field, status)
        assert fields["content-range"] == f"bytes {first}-{last}/{len(whole)}" and "immutable" in fields["cache-control"]
        assert fields["etag"] == f'"{ID}"', fields
    assert ask(ASSET, fields="Range: bytes=0-1,5-6\r\n")[2] == whole
    for tag, size in ((f'"{ID}"', 2), ('"another"', len(whole))):
        assert len(ask(ASSET, fields=f"Range: bytes=0-1\r\nIf-Range: {tag}\r\n")[2]) == size, tag
    assert ask(ASSET, fields=f"Range: bytes={len(whole)}-\r\n")[0] == 416
    status, fields, body = ask(ASSET, "HEAD")
    assert (status, fields["content-length"], body) == (200, str(len(whole)), b"")

with test.check("many requests share a connection"):
    one = f"GET /{view.key}/scene/t.png HTTP/1.1\r\n{HOST}\r\n"
    answer = send((one * 19 + one.replace(HOST, HOST + "Connection: close\r\n")).encode())
    assert answer.count(b"HTTP/1.1 200 OK") == 20 and answer.count(b"picture") == 20, answer[:200]

with test.check("paths outside of the list do not exist"):
    for path in ("/../bin/umbrage", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/scene/secret.png", "/scene/../secret.png",
                 "/scene/%2e%2e/store/city.umb", "/viewer/index.html", "/umbrage/", "/scene", "/index.html%00", "/%", "/%zz",
                 "/INDEX.HTML", "/umbrage/umbrage.wasm/", "/" + "a" * 8000):
        status, _, body = ask(path)
        assert status == 404 and body == b"no such file\n", (path[:60], status, body)

with test.check("without the random part of the address nothing exists: other users of the machine do not know it"):
    assert re.fullmatch("[0-9a-f]{32}", view.key), view.address
    other = view_server.View(asset_file, program=program)
    other.close()
    assert other.key != view.key
    keys = ("", "/" + other.key, "/" + "0" * 32, "/" + view.key[:31], "/" + view.key + "x")
    for key in keys:
        for path in ("/", "/index.html", ASSET, "/config.json"):
            reply = send(f"GET {key}{path} HTTP/1.1\r\n{HOST}Connection: close\r\n\r\n".encode())
            assert reply.startswith(b"HTTP/1.1 404 ") and reply.endswith(b"\r\n\r\nno such file\n"), (key, path, reply)

with test.check("a Host that is not this machine is refused: no page elsewhere reaches it by DNS rebinding"):
    for host in ("evil.example", f"evil.example:{view.port}", "127.0.0.1.evil.example", "localhost.evil.example", "10.0.0.1", ""):
        status, _, body = ask("/", host=f"Host: {host}\r\n")
        assert status == 421 and body == b"Host: is not this machine\n", (host, status, body)
    for host in ("localhost", f"localhost:{view.port}", "127.0.0.1"):
        assert ask("/", host=f"Host: {host}\r\n")[0] == 200, host

with test.check("only GET and HEAD, no body, no long line, nothing malformed"):
    for method in ("POST", "PUT", "DELETE", "OPTIONS", "CONNECT", "get"):
        status, fields, _ = ask("/", method)
        assert (status, fields["allow"]) == (405, "GET, HEAD"), (method, status)
    for data, status in ((f"GET / HTTP/1.1\r\n{HOST}Content-Length: 5\r\n\r\nhello", b"400"),
                         (f"GET / HTTP/1.1\r\n{HOST}Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n", b"400"),
                         ("GET /" + "a" * 9000, b"400"), (f"GET / HTTP/1.1\r\n{HOST}" + "A: b\r\n" * 70 + "\r\n", b"400"),
                         (f"GET / HTTP/1.1\r\n{HOST}" + "A: b\r\n" * 2000, b"400"), ("GET / HTTP/1.1\r\n\r\n", b"400"),
                         (f"GET / HTTP/1.1\r\n{HOST}{HOST}\r\n", b"400"), ("\0\1\2\3", b"400"),
                         (f"GET  / HTTP/1.1\r\n{HOST}\r\n", b"400"), (f"GET / HTTP/2.0\r\n{HOST}\r\n", b"400"),
                         (f"GET / HTTP/1.1\n{HOST}\n\n", None)):
        if status is not None:
            reply = send(data.encode("latin-1"))
            assert reply.startswith(b"HTTP/1.1 4") or reply.startswith(b"HTTP/1.1 5"), (data[:60], reply[:80])
            assert b"Connection: close" in reply, data[:60]

with test.check("at most 32 connections: a new one replaces the one that has waited longest for a request"):
    with open(test.path("scene", "t.png"), "wb") as file:
        file.write(bytes(400_000))  # 10 s and 6.1 s: checked at the end
    slow, taken = slow_peer("/scene/t.png"), []
    threading.Thread(target=take_slowly, args=(slow, taken), daemon=True).start()
    idle = [socket.create_connection(("127.0.0.1", view.port)) for _ in range(31)]
    begun = time.monotonic()
    for peer in idle:
        peer.sendall(b"GET / HT")
    time.sleep(0.2)
    for number in range(3):
        assert ask("/")[0] == 200, number
    assert time.monotonic() - begun < 4, "silent connections hold the server"
    idle[0].settimeout(5)
    assert idle[0].recv(1) == b"", "the oldest one is kept"

with test.check("an unfinished head ends after ten seconds"):
    idle[30].settimeout(20)
    assert idle[30].recv(1) == b"" and 8 < time.monotonic() - begun < 18, time.monotonic() - begun
    for peer in idle:
        peer.close()

with test.check("a peer that takes a byte now and then loses its place"):
    while not taken and time.monotonic() - begun < 40:
        time.sleep(0.1)
    assert taken and 14 < taken[0] - begun < 30, (taken, begun)
    with open(test.path("scene", "t.png"), "wb") as file:
        file.write(b"picture")

with test.check("it listens on loopback alone"):
    with open("/proc/net/tcp", encoding="ascii") as file:
        places = [line.split()[1] for line in file if line.split()[1].endswith(f":{view.port:04X}")]
    assert set(places) == {f"0100007F:{view.port:04X}"}, places
view.close()

with test.check("an asset of a daemon and of a web server is passed on, and proven by its id"):
    daemon, web, bare = test.daemon(), link.RangeServer(store), link.RangeServer(asset_file)
    for words in (("city", "--address", daemon.tcp), (f"http://127.0.0.1:{web.port}/city.umb?sign=a/secret",)):
        other = view_server.View(*words, program=program)
        assert ask(ASSET, host="Host: localhost\r\n", server=other)[2] == whole, words
        config = json.loads(ask("/config.json", host="Host: localhost\r\n", server=other)[2])
        assert config["id"] == ID and "secret" not in str(config), config
        other.close()
    for user in ("me:secret@", "me@"):
        other = view_server.View(f"http://{user}127.0.0.1:{bare.port}", program=program)
        config = json.loads(ask("/config.json", host="Host: localhost\r\n", server=other)[2])
        assert config["name"] == f"127.0.0.1:{bare.port}", config
        other.close()
    web.close()
    bare.close()
    plain = link.RangeServer(store, serves_ranges=False)
    place = f"http://127.0.0.1:{plain.port}/city.umb"
    done = ut.subprocess.run([program, "view", place, "--export", test.path("no-ranges")], check=False,
                             stderr=ut.subprocess.PIPE)
    assert done.returncode == 69 and f"'{place}': the server does not serve ranges (200".encode() in done.stderr, done
    assert not os.path.exists(test.path("no-ranges"))
    plain.close()

with test.check("--export writes the files that would be served, and replaces nothing"):
    out = test.path("site")
    words = [asset_file, "--scene", test.path("scene", "wall.obj"), "--export", out]
    done = ut.subprocess.run([program, "view", *words, "--json"], check=True, stdout=ut.subprocess.PIPE)
    names = {os.path.relpath(os.path.join(place, name), out) for place, _, files in os.walk(out) for name in files}
    assert json.loads(done.stdout)["files"] == len(names) and {"index.html", "config.json", ASSET[1:], "scene/t.png",
                                                               "three/build/three.module.js"} <= names, names
    with open(os.path.join(out, ASSET[1:]), "rb") as file:
        assert file.read() == whole
    done = ut.subprocess.run([program, "view", *words], check=False, stderr=ut.subprocess.PIPE)
    assert done.returncode == 73 and b"is not empty" in done.stderr, done

with test.check("the scene's up axis is the asset's, unless --up says otherwise"):
    test.bake(test.scene("city", 3), test.path("z.umb"), "--resolution", 256, "--up", "z", "--verify", 0)
    for words, up in (((), "z"), (("--up", "y"), "y")):
        other = view_server.View(test.path("z.umb"), *words, program=program)
        assert json.loads(ask("/config.json", host="Host: localhost\r\n", server=other)[2])["up"] == up, words
        other.close()

with test.check("another scene than the asset's is refused as umbrage verify refuses it, and --force goes on"):
    shutil.copy(ut.program("umbrage-bake"), test.path("bin"))
    other_scene = test.path("scene", "wall.obj")
    done = ut.subprocess.run([program, "view", asset_file, "--scene", other_scene], check=False, stderr=ut.subprocess.PIPE)
    verify = ut.subprocess.run([ut.program("umbrage"), "verify", asset_file, "--scene", other_scene], check=False,
                               stderr=ut.subprocess.PIPE)
    said = [one.stderr.decode().partition(": ")[2] for one in (done, verify)]
    assert done.returncode == verify.returncode == 65 and said[0] == said[1] and "--force goes on" in said[0], (done, verify)
    for words in ((other_scene, "--force"), (test.scene("city", 6),)):
        other = view_server.View(asset_file, "--scene", *words, program=program)
        assert "notice" not in other.close(), words
    os.remove(test.path("bin", "umbrage-bake"))
    other = view_server.View(asset_file, "--scene", other_scene, program=program)
    assert "the scene was not compared with the asset: umbrage-bake is not beside" in other.close()

with test.check("a port that is taken is told before the asset is read"):
    with socket.socket() as taken_port:
        taken_port.bind(("127.0.0.1", 0))
        taken_port.listen()
        number = taken_port.getsockname()[1]
        done = ut.subprocess.run([program, "view", test.path("no.umb"), "--port", str(number)], check=False,
                                 stderr=ut.subprocess.PIPE)
        assert done.returncode == 69 and f"127.0.0.1:{number}: Address already in use".encode() in done.stderr, done

with test.check("mistakes are named"):
    for name, text in (("page.obj", "mtllib page.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"),
                       ("page.mtl", "newmtl a\nmap_Kd page.html\n"), ("page.html", "<script>alert(1)</script>")):
        with open(test.path("scene", name), "w", encoding="ascii") as file:
            file.write(text)
    for words, code, text in (([test.path("no.umb")], 66, b"no.umb"), ([asset_file, "--scene", test.path("no.glb")], 66, b"no.glb"),
                              ([asset_file, "--scene", asset_file], 65, b"not a scene"), ([asset_file, "--port", "70000"], 2, b"65535"),
                              ([asset_file, "--scene", test.path("scene", "page.obj")], 69, b"page.html"),
                              ([test.path("scene", "wall.obj")], 65, b"wall.obj")):
        done = ut.subprocess.run([program, "view", *words], check=False, stdout=ut.subprocess.PIPE, stderr=ut.subprocess.PIPE,
                                 timeout=20)
        assert done.returncode == code and text in done.stderr and done.stderr.count(b"\n") == 1, (words, done)
    shutil.rmtree(test.path("bin", "web"))
    done = ut.subprocess.run([program, "view", asset_file], check=False, stderr=ut.subprocess.PIPE)
    assert done.returncode != 0 and b"make web" in done.stderr, done
test.finish()
