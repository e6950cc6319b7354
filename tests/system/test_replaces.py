#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
umbrage submit --replaces NAME: the name means the new asset when its job is done, only changed files
are sent, and a bake that fails leaves the name as it was. The bytes are counted on their way, by a
socket between client and daemon.
"""
import json
import os
import shutil
import socket
import struct
import sys
import threading
import zlib

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
test = ut.Test()
S = test.messages.shadows
STORE, JOBS, SOCKET, TOKENS = test.path("store"), test.path("jobs"), test.path("s"), test.path("tokens")
COUNTED = test.path("counted")
BUNDLES, ASSETS = os.path.join(JOBS, "bundles"), os.path.join(JOBS, "assets")
TOKEN = {name: f"{name}-0123456789abcdef" for name in ("ann", "bob")}
PNG_BYTES = 300_000
OPTIONS = ("--resolution", 256, "--sun", "120,40", "--verify", 5000)


class Counter:
    """Passes connections on to the daemon and counts what clients send."""

    def __init__(self):
        self.bytes = 0
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(COUNTED)
        self.listener.listen()
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            near, far = self.listener.accept()[0], socket.socket(socket.AF_UNIX)
            far.connect(SOCKET)
            threading.Thread(target=self.copy, args=(near, far, 1), daemon=True).start()
            threading.Thread(target=self.copy, args=(far, near, 0), daemon=True).start()

    def copy(self, source, target, count):
        try:
            while data := source.recv(65536):
                self.bytes += count * len(data)
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)
        except OSError:
            pass

    def take(self):
        taken, self.bytes = self.bytes, 0
        return taken


def cli(who, *words, code=0):
    return ut.run("umbrage", *words, code=code, env={"UMBRAGE_ADDRESS": "unix:" + COUNTED,
                                                     "UMBRAGE_TOKEN": TOKEN[who]})


def submit(who, name, *more, code=0):
    done = cli(who, "submit", scene, *OPTIONS, "--replaces", name, "--json", *more, code=code)
    return json.loads(done.stdout)


def id_of(who, name):
    try:
        return client.describe(S.DescribeRequest(asset=name), timeout=30, metadata=[
            ("authorization", "Bearer " + TOKEN[who])]).summary.id.hex()
    except grpc.RpcError as error:
        assert error.code() == grpc.StatusCode.NOT_FOUND, error
        return None


def write_scene(x, colour=b"\0"):
    """A triangle with a map of holes, over another one."""
    with open(scene, "w", encoding="ascii") as file:
        file.write(f"mtllib a.mtl\nv {x} 0 0\nv 9 0 0\nv 0 9 0\nv {x} 0 3\nv 5 0 3\nv 0 5 3\nvt 0 0\nvt 1 0\n"
                   "vt 0 1\nf 1 2 3\nusemtl leaf\nf 4/1 5/2 6/3\n")
    rows = b"".join(b"\0" + os.urandom(996) + colour * 4 for _ in range(PNG_BYTES // 1000))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    if not os.path.exists(png):
        with open(png, "wb") as file:
            file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(
                ">IIBBBBB", 500, len(rows) // 1001, 8, 4, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(rows)) +
                chunk(b"IEND", b""))


def bundles():
    return sorted(os.listdir(BUNDLES))


os.makedirs(test.path("scene"))
scene, png = test.path("scene", "a.obj"), test.path("scene", "leaf.png")
with open(test.path("scene", "a.mtl"), "w", encoding="ascii") as material:
    material.write("newmtl leaf\nmap_d leaf.png\n")
write_scene(0)
with open(os.open(TOKENS, os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="ascii") as tokens:
    tokens.writelines(f"{name} query,submit {token}\n" for name, token in TOKEN.items())


def start():
    return test.daemon("--jobs", JOBS, "--token-file", TOKENS, "--bake-threads", 1, "--listen", "unix:" + SOCKET)


daemon = start()
client, counter = test.client(daemon.grpc_tcp), Counter()

with test.check("a new name sends everything and means the asset"):
    first = submit("ann", "town", "--wait")
    assert first["state"] == "done" and counter.take() > PNG_BYTES, first
    assert id_of("ann", "ann/town") == first["asset"] == id_of("ann", first["asset"])
    assert len(bundles()) == 1, bundles()

with test.check("another owner sees neither name nor asset"):
    assert id_of("bob", "ann/town") is None and id_of("bob", first["asset"]) is None

with test.check("an edit sends the file that changed, and the name means the new asset"):
    write_scene(1)
    sent = submit("ann", "town")
    assert sent["files_sent"] == 1 and sent["bytes_sent"] == os.path.getsize(scene), sent
    assert counter.take() < 10_000
    second = json.loads(cli("ann", "watch", sent["job"], "--json").stdout)
    counter.take()
    plain = test.bake(scene, test.path("plain.umb"), *OPTIONS)["asset"]
    assert second["asset"] == plain != first["asset"], second
    assert id_of("ann", "ann/town") == plain and id_of("ann", first["asset"]) == first["asset"]
    assert len(bundles()) == 1, bundles()

with test.check("without an edit nothing is sent, and going back takes the asset that is there"):
    again = submit("ann", "town", "--wait")
    assert again["asset"] == plain and counter.take() < 5_000
    write_scene(0)
    back = submit("ann", "town", "--wait")
    assert back["asset"] == first["asset"] == id_of("ann", "ann/town")
    assert counter.take() < 5_000

with test.check("after a start the name means the same, and its files are still there"):
    daemon.kill()
    os.remove(os.path.join(ASSETS, "ann", "town.umb"))
    daemon = start()
    client = test.client(daemon.grpc_tcp)
    ut.wait_until(lambda: id_of("ann", "ann/town") == first["asset"], 20, "it is served")
    write_scene(2)
    counter.take()
    moved = submit("ann", "town", "--wait")
    assert id_of("ann", "ann/town") == moved["asset"] != first["asset"]

with test.check("a bake that fails leaves the name as it was"):
    before = bundles()
    with open(scene, "w", encoding="ascii") as file:
        file.write("v 0 0 nan\nf 1 1 1\n")
    submit("ann", "town", "--wait", code=65)
    assert id_of("ann", "ann/town") == moved["asset"] and bundles() == before
    write_scene(2)

with test.check("one owner's files are not another's"):
    counter.take()
    other = submit("bob", "town", "--wait")
    assert counter.take() > PNG_BYTES and other["asset"] == moved["asset"]
    assert id_of("bob", "bob/town") == other["asset"] and id_of("ann", "bob/town") == other["asset"]

with test.check("files that say they are kept and are not are refused"):
    held = sorted(os.listdir(os.path.join(BUNDLES, bundles()[0])))
    assert held == ["a.mtl", "a.obj", "leaf.png"], held
    B = test.messages.bakes
    stub = [("authorization", "Bearer " + TOKEN["bob"])]
    for replaces, kept, hash_, code in (("town", True, 32 * b"\1", "FAILED_PRECONDITION"),
                                        ("other", True, 32 * b"\1", "FAILED_PRECONDITION"),
                                        ("", True, 32 * b"\1", "INVALID_ARGUMENT"),
                                        ("../x", False, 32 * b"\1", "INVALID_ARGUMENT"),
                                        (".x", False, 32 * b"\1", "INVALID_ARGUMENT"),
                                        (64 * "0", False, 32 * b"\1", "INVALID_ARGUMENT"),
                                        (65 * "n", False, 32 * b"\1", "INVALID_ARGUMENT")):
        manifest = B.Manifest(scene="a.obj", replaces=replaces, files=[
            B.BundleFile(path="a.obj", size=os.path.getsize(scene), sha256=hash_, kept=kept)])
        try:
            client.raw_submit(iter([B.SubmitRequest(manifest=manifest)]), metadata=stub, timeout=30)
            raise AssertionError(f"'{replaces}' was taken")
        except grpc.RpcError as error:
            assert error.code().name == code, (replaces, error)

with test.check("rm of the asset takes the name and its files along"):
    cli("ann", "rm", moved["asset"])
    assert id_of("ann", "ann/town") is None and not os.path.lexists(os.path.join(ASSETS, "ann", "town.umb"))
    cli("bob", "rm", moved["asset"])
    ut.wait_until(lambda: bundles() == [], 10, "no files are left")

test.finish()
