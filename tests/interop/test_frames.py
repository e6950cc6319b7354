#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Frame loops: a camera and its depths in, packed answers out, changes where the client has the frame before.
The test computes the points of pixels independently and queries the file. A foreign client
(python3-grpcio) and `umbrage frames` must get the same answers.
"""
import ctypes
import json
import math
import os
import random
import struct
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
test = ut.Test()
os.mkdir(test.path("store"))
city = test.path("store") + "/city.umb"
test.bake(test.scene("city", 8), city, "--resolution", 2048, "--verify", 0)
daemon = test.daemon("--workers", 2)
client = test.client(daemon.grpc_unix)
M = test.messages.shadows
stream = client.bidi("/umbrage.v1.Shadows/QueryStream", M.QueryReply)
PLAIN, ZSTD, CHANGES = range(3)
WIDTH, HEIGHT, FOV = 80, 45, 60.0
xxhash, zstd = ctypes.CDLL("libxxhash.so.0"), ctypes.CDLL("libzstd.so.1")
xxhash.XXH3_64bits.restype = ctypes.c_uint64
xxhash.XXH3_64bits.argtypes = [ctypes.c_char_p, ctypes.c_size_t]
zstd.ZSTD_decompress.restype = ctypes.c_size_t
zstd.ZSTD_decompress.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_char_p, ctypes.c_size_t]


def unpack(data, size):
    room = ctypes.create_string_buffer(size + 1)
    assert zstd.ZSTD_decompress(room, size, data, len(data)) == size
    return room.raw[:size]


def scaled(v, length):
    factor = length / math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    return [x * factor for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class Frame:
    """A street seen from a little further on, with holes; depths are of no scene in particular."""

    def __init__(self, step):
        self.eye = [1.0 + 0.05 * step, 1.7, 1.0]
        self.forward = [99.0, 0.0, 8.0]
        noise = random.Random(7)
        self.depth = [0.0 if (x + y) % 11 == 0 else (4 + 40 * noise.random() if y < 20 else 60 / (y - 19))
                      for y in range(HEIGHT) for x in range(WIDTH)]
        self.bytes = ut.floats(self.depth)
        self.depth = ut.from_floats(self.bytes)

    def points(self):
        """Relative to the eye, as docs/reference/protocol.md says."""
        tall = math.tan(math.radians(FOV) / 2)
        forward = scaled(self.forward, 1)
        right = scaled(cross(forward, [0, 1, 0]), 1)
        up = scaled(cross(right, forward), tall)
        right = scaled(right, tall * WIDTH / HEIGHT)
        values = []
        for i, depth in enumerate(self.depth):
            x = (2.0 * (i % WIDTH) + 1) / WIDTH - 1
            y = 1 - (2.0 * (i // WIDTH) + 1) / HEIGHT
            values += [depth * (forward[k] + x * right[k] + y * up[k]) for k in range(3)]
        return ut.floats(values)

    def request(self, **fields):
        return M.QueryRequest(asset="city", **{"taps": 3, "depth": self.bytes, "picture": M.Picture(
            eye=self.eye, forward=self.forward, up=[0, 1, 0], fov_y=math.radians(FOV), width=WIDTH,
            height=HEIGHT), **fields})

    def expected(self, encoding="u8"):
        """Answers of the file, point by point; empty pixels are lit."""
        told = test.query_file(city, self.points(), "--origin=" + ",".join(map(repr, self.eye)), "--taps",
                               "3", encoding=encoding)
        if encoding == "u8":
            return bytes(v if d > 0 else 255 for v, d in zip(told, self.depth))
        bits = bytearray(told)
        for i, depth in enumerate(self.depth):
            bits[i // 8] |= (not depth > 0) << (i % 8)
        return bytes(bits)


def mark(values):
    return xxhash.XXH3_64bits(values, len(values)) or 1


frames = [Frame(step) for step in range(4)]

with test.check("a picture's pixels are answered as their points are, and holes are lit"):
    reply = client.query(frames[0].request(), timeout=60)
    assert reply.packing == PLAIN
    assert reply.visibility == frames[0].expected()
    assert 0.1 < sum(v > 127 for v in reply.visibility) / (WIDTH * HEIGHT) < 0.99
    reply = client.query(frames[0].request(format=M.ANSWER_BIT, pack=True), timeout=60)
    assert reply.packing == ZSTD and len(reply.visibility) < WIDTH * HEIGHT // 8
    assert unpack(reply.visibility, WIDTH * HEIGHT // 8) == frames[0].expected("bit")

with test.check("a stream sends only the changes to what the client has, and says which"):
    def ask():
        held = b""
        for frame in (frames[0], frames[0], frames[1], frames[2]):
            yield frame.request(pack=True, base_mark=mark(held) if held else 0)
            held = frame.expected()
        yield frames[3].request(pack=True, base_mark=mark(b"something else"))
        yield frames[3].request(pack=True, base_mark=mark(frames[3].expected()), format=M.ANSWER_BIT)
        yield frames[3].request(pack=True)
    held, sizes = b"", []
    for frame, wanted, reply in zip(
            [frames[i] for i in (0, 0, 1, 2, 3, 3, 3)],
            (ZSTD, CHANGES, CHANGES, CHANGES, ZSTD, ZSTD, ZSTD), client.stream(ask(), timeout=60)):
        assert reply.packing in (wanted, ZSTD), (reply.packing, wanted)
        assert len(sizes) != 1 or reply.packing == CHANGES  # nothing changed
        size = WIDTH * HEIGHT // (8 if len(sizes) == 5 else 1)
        values = unpack(reply.visibility, size)
        if reply.packing == CHANGES:
            values = bytes(a ^ b for a, b in zip(values, held))
        assert values == frame.expected("bit" if len(sizes) == 5 else "u8"), len(sizes)
        held = values
        sizes.append(len(reply.visibility))
    assert len(sizes) == 7
    assert sizes[1] < 40 and sizes[2] <= sizes[0] * 1.2, sizes

with test.check("positions can be packed, too, of several lights at once"):
    one = M.QueryRequest(asset="city", points=frames[0].points(), origin=frames[0].eye, taps=3)
    plain = client.query(one, timeout=60).visibility
    one.pack = True
    assert unpack(client.query(one, timeout=60).visibility, len(plain)) == plain
    one.ClearField("asset")
    one.targets.extend([M.Target(asset="city"), M.Target(asset="city")])
    assert unpack(client.query(one, timeout=60).visibility, 2 * len(plain)) == 2 * plain
    empty = client.query(M.QueryRequest(asset="city", pack=True), timeout=60)
    assert len(empty.visibility) == 0 and empty.packing == PLAIN

with test.check("a budget is calibrated on the pixels of a picture, few or many"):
    wide, tall = 1024, 512
    for picture in (frames[0].request(taps=0, budget_ns=100000.0, want_stats=True),
                    frames[0].request(taps=0, budget_ns=100000.0, want_stats=True,
                                      depth=ut.floats([20.0] * (wide * tall)), picture=M.Picture(
                                          eye=[1, 1.7, 1], forward=[99, 0, 8], up=[0, 1, 0],
                                          fov_y=1, width=wide, height=tall))):
        reply = client.query(picture, timeout=60)
        assert len(reply.visibility) == len(picture.depth) // 4, len(reply.visibility)
        assert 0 < reply.stats.expected_ns <= 100000, reply.stats

with test.check("what does not fit is refused by field"):
    for words, request in (
            ("picture: beside points", frames[0].request(points=b"\0" * 12)),
            ("depth: 3600 numbers for 79 x 45", frames[0].request(picture=M.Picture(
                eye=[0, 0, 0], forward=[0, 0, 1], up=[0, 1, 0], fov_y=1, width=79, height=45))),
            ("picture.eye", frames[0].request(picture=M.Picture(eye=[1, 2], fov_y=1, width=80, height=45))),
            ("footprints[7]: nan, must be finite and not below 0", frames[0].request(
                filter=3, footprints=ut.floats([1.0] * 7 + [float("nan")] * 3593))),
            ("footprints[9]: -1", frames[0].request(
                filter=3, footprints=ut.floats([1.0] * 9 + [-1.0] * 3591))),
            ("fov_y", frames[0].request(picture=M.Picture(
                eye=[0, 0, 0], forward=[0, 0, 1], up=[0, 1, 0], width=80, height=45))),
            ("depth: 14400 bytes without", M.QueryRequest(asset="city", depth=frames[0].bytes)),
            ("normals", frames[0].request(normals=b"\0" * 12))):
        client.refused(lambda: client.query(request, timeout=60), Code.INVALID_ARGUMENT, words)

with test.check("umbrage frames gets the same, in fewer bytes"):
    with open(test.path("walk.txt"), "w", encoding="utf-8") as file:
        for frame in [*frames[:3], frames[2]]:  # at the end it stands still
            target = [e + f for e, f in zip(frame.eye, frame.forward)]
            print(f"eye={','.join(map(repr, frame.eye))},target={','.join(map(repr, target))},fov={FOV!r}",
                  file=file)
    with open(test.path("depths"), "wb") as file:
        file.write(frames[0].bytes * 4)  # they do not differ
    told = {}
    for name, extra in (("packed", ()), ("plain", ("--plain",))):
        done = ut.run("umbrage", "frames", "city", "--address", daemon.tcp, "--path",
                      test.path("walk.txt"), "--depth", test.path("depths"), "--size", f"{WIDTH}x{HEIGHT}",
                      "--taps", "3", "--format", "u8", "--json", "-o", test.path(name), *extra)
        told[name] = json.loads(done.stdout)
    with open(test.path("packed"), "rb") as packed, open(test.path("plain"), "rb") as plain:
        answers = packed.read()
        assert answers == plain.read()
    assert len(answers) == 4 * WIDTH * HEIGHT and answers[:WIDTH * HEIGHT] == frames[0].expected()
    changes = [f["changes_only"] for f in told["packed"]["frames"]]
    assert not changes[0] and len(changes) == 4 and changes[4 - 1], changes
    assert told["packed"]["bytes"] < told["plain"]["bytes"] / 4
    ut.run("umbrage", "frames", "city", "--address", daemon.tcp, "--path", test.path("walk.txt"),
           "--depth", test.path("depths"), "--size", f"{WIDTH}x{HEIGHT + 1}", "--quiet", code=65)
    for path, depths, words, code in (("walk.txt", "store", "it is a folder", 66),
                                      ("store", "depths", "it is a folder", 66),
                                      ("walk.txt", "walk.txt", "walk.txt' ends within frame 0", 65)):
        done = ut.run("umbrage", "frames", "city", "--address", daemon.tcp, "--path", test.path(path),
                      "--depth", test.path(depths), "--size", f"{WIDTH}x{HEIGHT}", code=code)
        assert words in done.stderr.decode(), done.stderr

with test.check("-o - gives the answers on stdout, and what is said of them is talk"):
    words = ["frames", "city", "--address", daemon.tcp, "--path", test.path("walk.txt"), "--depth",
             test.path("depths"), "--size", f"{WIDTH}x{HEIGHT}", "--taps", "3", "--format", "u8", "-o", "-"]
    done = ut.run("umbrage", *words)
    assert done.stdout == answers and done.stderr.count(b"\nframe ") == 3, done.stderr
    assert not ut.run("umbrage", *words, "--quiet").stderr
    assert b"--json" in ut.run("umbrage", *words, "--json", code=2).stderr
    with open("/dev/full", "wb") as full:
        done = subprocess.run([ut.program("umbrage"), *words, "-q"], stdout=full, check=False)
    assert done.returncode == 74, done

test.finish()
