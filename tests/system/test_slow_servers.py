#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Limits of umbrage fetch, submit and stream: servers that are silent, send slowly or announce false
sizes; scenes and options that name pipes, devices and sockets.
"""
import os
import socket
import struct
import subprocess
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import fake_bakes  # noqa: E402
import umbrage_test as ut  # noqa: E402

test = ut.Test()
asset = test.path("city.umb")
baked = test.bake(test.scene("city", 4), asset, "--resolution", 512, "--verify", 0)["asset"]
with open(asset, "rb") as file:
    whole = file.read()
server = fake_bakes.Server(test.messages)
M = server.M
out = test.path("out", "got.umb")
os.mkdir(test.path("out"))
HANG_S = 60  # none of what follows takes a tenth of it


def fetch(*words, code=0):
    return ut.run("umbrage", "fetch", baked, "--address", server.address, "-o", out, "--quiet", *words,
                  code=code, timeout=HANG_S).stderr.decode()


def nothing_left():
    left = os.listdir(test.path("out"))
    for name in left:
        os.remove(test.path("out", name))
    return not left


# --- fetch -------------------------------------------------------------------------------------

with test.check("fetch: an honest server's file arrives"):
    server.fetch = server.file(whole)
    fetch()
    with open(out, "rb") as file:
        assert file.read() == whole
    os.remove(out)

with test.check("fetch: a file beyond --max-bytes is refused before a byte of it is kept"):
    for size, words, limit in ((1 << 62, [], 64 << 30), (len(whole), ["--max-bytes", "1K"], 1024)):
        server.fetch = server.file(whole, size)
        said = fetch(*words, code=None)
        assert f"the limit is {limit} (--max-bytes)" in said and nothing_left(), said
    assert "--max-bytes" in fetch("--max-bytes", "0", code=2)

with test.check("fetch: a file for which the disk has no room is refused at its first message"):
    disk = os.statvfs(test.path("out"))
    server.fetch = server.file(whole, disk.f_frsize * disk.f_blocks + (1 << 30))
    said = fetch("--max-bytes", "1000000G", code=74)
    assert "the disk has room for" in said and nothing_left(), said

with test.check("fetch: the first bytes give another asset or another length away"):
    asked = []

    def endless(head):
        def serve(request, _context):
            yield M.FetchReply(offset=request.offset, size=1 << 30, data=head)
            for at in range(len(head), 1 << 30, 65536):
                asked.append(at)
                yield M.FetchReply(offset=at, size=1 << 30, data=bytes(65536))
        return serve
    other = whole[:16] + struct.pack("<Q", 1 << 30) + whole[24:48] + bytes(32) + whole[80:256]
    for head, words in ((bytes(256), "another asset"), (other, "another asset"), (whole[:256], "by its head")):
        server.fetch = endless(head)
        said = fetch(code=65)
        assert words in said and len(asked) < 1000, (said, len(asked))
        nothing_left()

with test.check("fetch: a server that says nothing, nothing more or nothing new is given up"):
    def silent(_request, _context):
        server.wait()
        yield M.FetchReply()

    def stuck(request, _context):
        yield M.FetchReply(offset=request.offset, size=len(whole), data=whole[request.offset:][:1000])
        server.wait()

    def empty(request, context):
        while context.is_active():
            yield M.FetchReply(offset=request.offset, size=len(whole))

    def drip(request, context):
        for at in range(request.offset, len(whole)):
            if not context.is_active() or server.released.wait(0.2):
                return
            yield M.FetchReply(offset=at, size=len(whole), data=whole[at:at + 1])
    for serve, words in ((silent, "stalled after 0 bytes"), (stuck, "stalled after 1"), (empty, "data: 0 bytes"),
                         (drip, "stalled after")):
        server.fetch = serve
        begin = time.monotonic()
        said = fetch("--stall-timeout", "2", code=None)
        assert words in said and not os.path.exists(out), (serve, said)
        assert time.monotonic() - begin < HANG_S / 2
        nothing_left()
    assert "--stall-timeout" in fetch("--stall-timeout", "0", code=2)

with test.check("fetch: a pipe in the place of the part is left alone"):
    os.mkfifo(out + ".part")
    assert "not a regular file" in fetch(code=73)
    assert os.path.exists(out + ".part")
    os.remove(out + ".part")

# --- submit ------------------------------------------------------------------------------------


def submit(scene, *words, code=0):
    return ut.run("umbrage", "submit", scene, "--address", server.address, *words, code=code,
                  timeout=HANG_S).stderr.decode()


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def write(name, text):
    with open(test.path(name), "w", encoding="ascii") as made:
        made.write(text)
    return test.path(name)


sent = []


def accept(requests, _context):
    sent[:] = [f.path for r in requests for f in r.manifest.files]
    return M.SubmitReply(job="0" * 32)


os.mkfifo(test.path("pipe"))
os.symlink("/dev/zero", test.path("zero"))
os.symlink("pipe", test.path("link"))
with socket.socket(socket.AF_UNIX) as made:
    made.bind(test.path("socket"))

with test.check("submit: a library that is a pipe, a device or a socket is not waited for"):
    server.submit = accept
    for name in ("pipe", "link", "zero", "socket", "../../../../dev/zero", "/dev/zero"):
        said = submit(write("a.obj", f"mtllib {name}\n" + OBJ))
        assert "is not here" in said and sent == ["a.obj"], (name, said, sent)
    for name in ("pipe", "zero"):
        said = submit(write("b.gltf", '{"images": [{"uri": "%s"}]}' % name))
        assert "is not here" in said and sent == ["b.gltf"], (name, said, sent)
        write("c.mtl", f"newmtl m\nmap_Kd {name}\nmap_d -s 1 1 1 {name}\n")
        submit(write("c.obj", "mtllib c.mtl\n" + OBJ))
        assert sent == ["c.obj", "c.mtl"], sent
    os.mkfifo(test.path("scene.obj"))
    assert "not a regular file" in submit(test.path("scene.obj"), code=66)

with test.check("submit: a library outside of the folder is not read, a scene's names are counted"):
    os.mkdir(test.path("inner"))
    write("outer.mtl", "map_Kd leaf.png\n")
    write("inner/leaf.png", "no picture")
    submit(write("inner/d.obj", "mtllib ../outer.mtl\n" + OBJ))
    assert sent == ["d.obj"], sent
    submit(write("inner/e.obj", "mtllib e.mtl\n" * 300000 + OBJ), code=75)
    write("inner/e.mtl", "newmtl m\n" + "Kd 1 1 1\n" * 100000)
    begin = time.monotonic()  # a library is looked through once, not in each line that names it
    submit(write("inner/e.obj", "mtllib e.mtl\n" * 20000 + OBJ), "--quiet")
    assert time.monotonic() - begin < HANG_S / 2 and sent == ["e.obj", "e.mtl"], sent
    write("inner/e.mtl", "#" * (65 << 20))
    assert "the limit of a file that names others" in submit(test.path("inner/e.obj"), code=75)

with test.check("submit: a server that takes nothing, or never answers, is given up"):
    def deaf(_requests, _context):
        server.wait()
        return M.SubmitReply()

    def mute(requests, _context):
        for _ in requests:
            pass
        server.wait()
        return M.SubmitReply()
    large = test.scene("city", 60)
    for serve in (deaf, mute):
        server.submit = serve
        assert "stalled after" in submit(large, "--stall-timeout", "2", "--quiet", code=75), serve

# --- other files that are named -----------------------------------------------------------------

with test.check("pipes without a writer, devices and sockets are refused where a file is needed"):
    pipe = test.path("pipe")
    for words, code in ((["info", pipe], 66), (["verify", pipe], 66), (["stream", "--from-file", pipe], 66),
                        (["stream", asset, "--resume", pipe], 66), (["stream", "--from-file", "/dev/zero"], 66),
                        (["list", "--address", server.address, "--token-file", pipe], 2),
                        (["list", "--address", "tls:127.0.0.1:1", "--tls-ca", pipe], 66),
                        (["list", "--address", "tls:127.0.0.1:1", "--tls-cert", pipe], 66),
                        (["list", "--address", "tls:127.0.0.1:1", "--tls-cert", asset, "--tls-key", pipe], 66)):
        done = ut.run("umbrage", *words, code=None, timeout=HANG_S)
        assert done.returncode == code and b"umbrage: " in done.stderr, (words, done)

with test.check("a daemon does not wait for a certificate out of a pipe"):
    os.mkdir(test.path("none"))
    done = ut.run("umbraged", "--store", test.path("none"), "--listen", "tls:127.0.0.1:0", "--tls-cert", pipe,
                  "--tls-key", pipe, code=66, timeout=HANG_S)
    assert b"not a regular file" in done.stderr, done

with test.check("a token may come from a program through a pipe"):
    script = f"'{ut.program('umbrage')}' list --address {server.address} --token-file <(sleep 0.3; echo {'t' * 20})"
    done = subprocess.run(["bash", "-c", script], stderr=subprocess.PIPE, timeout=HANG_S, check=False)
    assert b"token" not in done.stderr, done.stderr

# --- stream ------------------------------------------------------------------------------------


def dripping(pause_s):
    """A web server of ranges that sends a byte now and then; returns its URL."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve(one):
        try:
            asked = one.recv(4096).split(b"bytes=")[1].split(b"\r\n")[0].split(b"-")
            first, last = int(asked[0]), min(int(asked[1]), len(whole) - 1)
            one.sendall(b"HTTP/1.1 206 Partial Content\r\nContent-Length: %d\r\nContent-Range: bytes %d-%d/%d\r\n\r\n"
                        % (last - first + 1, first, last, len(whole)))
            for at in range(first, last + 1):
                one.sendall(whole[at:at + 1])
                if server.released.wait(pause_s):
                    return
        except (OSError, IndexError):
            pass  # the client went away

    def accept_all():
        while True:
            threading.Thread(target=serve, args=listener.accept()[:1], daemon=True).start()
    threading.Thread(target=accept_all, daemon=True).start()
    return f"http://127.0.0.1:{listener.getsockname()[1]}/city.umb"


with test.check("stream: --timeout ends a web server that drips"):
    begin = time.monotonic()
    said = ut.run("umbrage", "stream", "--from-url", dripping(0.05), "--quiet", "--timeout", 3, code=None,
                  timeout=HANG_S)
    assert said.returncode in (69, 75) and said.stderr and time.monotonic() - begin < 20, said
    assert "--timeout" in ut.run("umbrage", "stream", asset, "--timeout", "x", code=2).stderr.decode()

server.close()
test.finish()
