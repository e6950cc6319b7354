#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
umbrage derive and Regions.DeriveMap: maps from open and closed assets are compared with those of a
rasteriser in this file. KTX files are read by the specification. A daemon's bytes must be those made
locally. Refusals and a cancelled call are tested, too.
"""
import json
import os
import struct
import subprocess
import sys
from concurrent import futures

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
VK = {70: "<H", 100: "<f", 76: "<e", 78: "<2h", 83: "<2e", 103: "<2f", 92: "<4h", 97: "<4e",
      109: "<4f"}


class Ktx:
    """A KTX 2.0 file, read by the specification."""

    def __init__(self, data):
        assert data[:12] == b"\xabKTX 20\xbb\r\n\x1a\n"
        (self.format, self.type_size, self.width, self.height, depth, self.layers, faces,
         self.level_count, scheme, dfd, dfd_size, kvd, kvd_size, sgd, sgd_size) = \
            struct.unpack_from("<13I2Q", data, 12)
        assert (depth, faces, scheme, sgd, sgd_size) == (0, 1, 0, 0, 0)
        assert struct.unpack_from("<I", data, dfd)[0] == dfd_size
        texel = struct.calcsize(VK[self.format])
        assert data[dfd + 20] == texel and self.type_size in (2, 4)
        self.levels = []
        for i in range(self.level_count):
            at, size, plain = struct.unpack_from("<3Q", data, 80 + 24 * i)
            w, h = max(1, self.width >> i), max(1, self.height >> i)
            assert size == plain == w * h * texel * max(1, self.layers), (i, size)
            assert at % max(4, texel) == 0 and at + size <= len(data)
            self.levels.append(list(struct.iter_unpack(VK[self.format], data[at:at + size])))
        self.keys, at = {}, kvd
        while at < kvd + kvd_size:
            size, = struct.unpack_from("<I", data, at)
            key, value = data[at + 4:at + 4 + size].split(b"\0", 1)
            self.keys[key.decode()] = value.rstrip(b"\0").decode()
            at += 4 + (size + 3) // 4 * 4
        assert list(self.keys) == sorted(self.keys)
        self.map = json.loads(self.keys["umbrage.map"])


def read_obj(path):
    vertices, triangles = [], []
    with open(path, encoding="ascii") as file:
        for line in file:
            words = line.split()
            if words[:1] == ["v"]:
                vertices.append(tuple(map(float, words[1:4])))
            elif words[:1] == ["f"]:
                corners = [int(word.split("/")[0]) - 1 for word in words[1:]]
                triangles += [(corners[0], corners[i], corners[i + 1])
                              for i in range(1, len(corners) - 1)]
    return vertices, triangles


def rasterise(scene, one, width, height, slack):
    """Depths of the first hit through each texel's centre; edges widened by `slack` of a triangle."""
    vertices, triangles = scene
    m, o = one["world_to_map"], one["origin"]
    at = []
    for v in vertices:
        p = [v[k] - o[k] for k in range(3)]
        at.append([sum(m[4 * r + k] * p[k] for k in range(3)) + m[4 * r + 3] for r in range(3)])
    depth = [1.0] * (width * height)
    for corners in triangles:
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (at[i] for i in corners)
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0:
            continue
        for y in range(max(0, int(min(ay, by, cy)) - 1), min(height, int(max(ay, by, cy)) + 2)):
            for x in range(max(0, int(min(ax, bx, cx)) - 1), min(width, int(max(ax, bx, cx)) + 2)):
                px, py = x + 0.5, y + 0.5
                u = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area
                v = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area
                w = 1 - u - v
                if min(u, v, w) >= -slack:
                    z = u * az + v * bz + w * cz
                    depth[y * width + x] = min(depth[y * width + x], z)
    return depth


def derive(asset, *options, code=0):
    out = test.path("out.ktx2")
    done = ut.run("umbrage", "derive", asset, "-o", out, *options, code=code)
    if code != 0:
        return done.stderr.decode()
    with open(out, "rb") as file:
        return file.read()


store = test.path("store")
os.mkdir(store)
for kind, size in (("city", 4), ("terrain", 16)):
    with test.check(f"{kind}: every texel is what the scene shows there, open and closed"):
        scene = test.path(kind + ".obj")
        ut.run("scenegen", kind, "--size", size, "-o", scene)
        bake = ["--sun", "140,38", "--resolution", 256, "--up", "z", "--verify", 0]
        test.bake(scene, f"{store}/{kind}-open.umb", *bake, "--closed", "off")
        test.bake(scene, f"{store}/{kind}-front.umb", *bake, "--effect", "front=on")
        ktx = Ktx(derive(f"{store}/{kind}-open.umb", "--rect", "60,70,124,118", "--size", "64x48"))
        same = Ktx(derive(f"{store}/{kind}-front.umb", "--rect", "60,70,124,118", "--size",
                          "64x48"))
        assert ktx.levels == same.levels
        one, = ktx.map["maps"]
        mesh = read_obj(scene)
        # A ray through an edge that only one triangle has may hit or miss: those are left out.
        wide, narrow = (rasterise(mesh, one, 64, 48, s) for s in (1e-9, -1e-9))
        half = ktx.map["depth_error_m"] / one["depth_m"]
        compared = hits = 0
        for (got,), a, b in zip(ktx.levels[0], wide, narrow):
            if abs(a - b) > 1e-6:
                continue
            compared += 1
            hits += a < 1
            # Half a voxel of the definition, and the rounding of a float near 1.
            assert abs(got - a) <= half + 2e-7, (got, a, half)
        assert compared > 3000 and hits > 1000, (compared, hits)
    with test.check(f"{kind}: a coarse map differs from a rendered one at silhouettes alone"):
        ktx = Ktx(derive(f"{store}/{kind}-open.umb", "--size", "40"))
        one, = ktx.map["maps"]
        shifted = []
        for dx in (-0.5, 0, 0.5):
            for dy in (-0.5, 0, 0.5):
                moved = dict(one, world_to_map=list(one["world_to_map"]))
                moved["world_to_map"][3] += dx * 40 / 256  # half a voxel, in texels
                moved["world_to_map"][7] += dy * 40 / 256
                shifted.append(rasterise(mesh, moved, 40, 40, 1e-9))
        half = ktx.map["depth_error_m"] / one["depth_m"]
        beyond = 0
        for i, (got,) in enumerate(ktx.levels[0]):
            seen = [s[i] for s in shifted]
            if not min(seen) - half - 2e-7 <= got <= max(seen) + half + 2e-7:
                beyond += 1  # what is narrower than a voxel may slip between nine rays
        assert beyond <= 4, beyond

with test.check("every technique, format and option makes the file it says"):
    asset = store + "/city-open.umb"
    for technique, name, options, levels in (
            ("depth", 70, ["--format", "u16"], 1), ("vsm", 103, ["--mips", "--blur", 3], 6),
            ("vsm", 78, ["--format", "u16", "--depth-plane"], 1), ("esm", 76, ["--format", "f16"], 1),
            ("evsm", 109, ["--mips"], 6), ("msm", 92, ["--format", "u16"], 1)):
        ktx = Ktx(derive(asset, "--technique", technique, "--size", 32, *options))
        assert (ktx.format, ktx.level_count, ktx.layers) == (name, levels, 0), technique
        assert ktx.map["technique"] == technique
    deep = Ktx(derive(asset, "--size", 32)).levels[0]
    vsm = Ktx(derive(asset, "--technique", "vsm", "--size", 32)).levels[0]
    assert all(abs(m[0] - (2 * d[0] - 1)) < 1e-6 for d, m in zip(deep, vsm))
with test.check("cascades are the layers of one texture, nearer ones finer"):
    view = ["--cascades", 3, "--camera", "eye=0,0,30,target=50,50,10,far=150", "--up", "z"]
    ktx = Ktx(derive(asset, "--size", 64, *view))
    assert ktx.layers == 3
    splits = [one["split"] for one in ktx.map["maps"]]
    assert splits[0][0] == 0.1 and splits[2][1] == 150 and splits[0][1] == splits[1][0]
    texel = [max(abs(x) for x in one["world_to_map"][:3]) for one in ktx.map["maps"]]
    assert texel[0] > texel[1] > texel[2]
with test.check("the contrast that hides a seam is found, stated in the file and told"):
    matched = view + ["--technique", "vsm", "--blur", 9, "--match-contrast", "--blend", 0.1]
    ktx = Ktx(derive(asset, "--size", 64, *matched))
    stated = [one["contrast"] for one in ktx.map["maps"]]
    assert stated[0] == 1 and all(c > 0 for c in stated) and len(set(stated)) > 1, stated
    assert ktx.map["blend"] == 0.1
    told = json.loads(ut.run("umbrage", "derive", asset, "-o", test.path("out.ktx2"), "--size", 64, *matched,
                             "--json").stdout)
    assert told["contrast"] == stated, told
    plain = Ktx(derive(asset, "--size", 64, *view, "--technique", "vsm", "--blur", 9))
    assert plain.levels == ktx.levels and "contrast" not in plain.map["maps"][0] and "blend" not in plain.map
    ktx = Ktx(derive(asset, "--size", 32, "--technique", "evsm", "--contrast", 2.5))
    assert ktx.map["maps"][0]["contrast"] == 2.5
with test.check("what cannot be derived is refused in words"):
    test.bake(test.path("city.obj"), store + "/city-closed.umb", *bake)
    said = derive(store + "/city-closed.umb", code=69)
    assert "umbrage: light 0 was baked under the closed rule" in said and "front=on" in said, said
    for options, words, code in (
            (["--size", "0"], "sides from 1 to 16384", 2), (["--size", "8y8"], "--size: '8y8'", 2),
            (["--size", "12", "--technique", "vsm", "--mips"], "12", 2),
            (["--technique", "pcf"], "--technique: 'pcf'", 2), (["--mips"], "--mips", 2),
            (["--technique", "esm", "--format", "u16"], "--format: f16 goes with esm and evsm", 2),
            (["--format", "f16"], "--format: f16 goes with esm and evsm", 2),
            (["--technique", "vsm", "--exponent", "5"], "--exponent: needs --technique esm or evsm", 2),
            (["--technique", "esm", "--negative-exponent", "5"], "--negative-exponent: needs --technique evsm", 2),
            (["--technique", "evsm", "--depth-plane"], "--depth-plane: needs --technique vsm", 2),
            (["--contrast", "2"], "--contrast: needs --technique vsm or evsm", 2),
            (["--technique", "vsm", "--contrast", "0"], "--contrast: '0'", 2),
            (["--technique", "vsm", "--match-contrast"], "--match-contrast: needs --cascades", 2),
            (["--blend", "0.1"], "--blend: needs --camera", 2),
            (view + ["--blend", "0.6"], "blend 0.6", 2),
            (["--moment-bias", "0"], "--moment-bias: needs --technique msm", 2),
            (["--up", "z"], "--up: needs --camera", 2), (["--weight", "3"], "--weight: needs --camera", 2),
            (["--fit", "scene"], "--fit: needs --camera", 2), (["--near", "1"], "--near: needs --camera", 2),
            (["--aspect", "1"], "--aspect: needs --camera", 2),
            (["--size", "100000"], "sides from 1 to 16384", 2),
            (["--technique", "esm", "--exponent", "1000"], "exponent", 2),
            (["--rect", "1,2,3"], "--rect: '1,2,3'", 2), (["--rect", "5,5,5,9"], "rect", 2),
            (["--light", "7"], "light: 7, the asset's lights are 0 to 0", 66), (["--cascades", "2"], "--camera", 2),
            (["--cascades", "9", "--camera", "x"], "--cascades: '9'", 2),
            (["--cascades", "2", "--camera", "eye=0,0,0,target=0,9,0,far=9"], "up axis", 2)):
        said = derive(asset, *options, code=code)
        assert words in said, (options, said)
with test.check("without -o the file has the asset's name"):
    subprocess.run([os.path.abspath(ut.program("umbrage")), "derive", asset, "--size", "8"],
                   cwd=test.path(""), check=True, stderr=subprocess.DEVNULL)
    with open(test.path("city-open.ktx2"), "rb") as file:
        assert file.read() == derive(asset, "--size", 8)

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
daemon = test.daemon("--workers", 1, "--max-points", 70000)
address = ["--address", "unix:" + daemon.socket_path]
with test.check("a daemon's maps are those made here, byte by byte"):
    for options in ([], ["--technique", "evsm", "--mips", "--size", 128],
                    ["--technique", "msm", "--format", "u16", "--rect", "0.5,-3,90,90.25"],
                    ["--technique", "vsm", "--blur", 5, "--depth-plane"], view,
                    view + ["--fit", "lispsm", "--technique", "esm", "--exponent", "20"], matched):
        options = ["--size", 64] + options
        assert derive("city-open", *address, *options) == derive(asset, *options), options
with test.check("refusals over the wire name field and limit"):
    said = derive("city-open", *address, "--size", 512, code=2)
    assert "512 x 512" in said and "70000" in said, said
    assert "front=on" in derive("city-closed", *address, "--size", 8, code=69)
    assert "no-such" in derive("no-such", *address, code=66)
channel = grpc.insecure_channel(daemon.grpc_unix)
M = test.messages.regions
call = channel.unary_stream("/umbrage.v1.Regions/DeriveMap",
                            request_serializer=lambda m: m.SerializeToString(),
                            response_deserializer=M.RegionReply.FromString)


def refused(code, words, request, timeout=60):
    try:
        list(call(request, timeout=timeout))
    except grpc.RpcError as error:
        assert error.code() == code and words in error.details(), (error.code(), error.details())
        return
    raise AssertionError(f"answered: {request}")


with test.check("a stranger's client gets the same, and hears what is wrong"):
    pieces = list(call(M.DeriveMapRequest(asset="city-open", width=128, height=128, technique=3),
                       timeout=60))
    data = b"".join(piece.data for piece in pieces)
    assert len(pieces) > 1 and pieces[0].file_bytes == len(data)
    assert data == derive(asset, "--size", 128, "--technique", "evsm")
    eye = [1, 2, 3]
    for code, words, fields in (
            (Code.INVALID_ARGUMENT, "technique: 9", {"technique": 9}),
            (Code.INVALID_ARGUMENT, "format: 5", {"format": 5}),
            (Code.INVALID_ARGUMENT, "rect: has 3 numbers", {"rect": [1, 2, 3]}),
            (Code.INVALID_ARGUMENT, "rect[1]", {"rect": [1, float("nan"), 3, 4]}),
            (Code.INVALID_ARGUMENT, "blur", {"blur": 2, "technique": 1}),
            (Code.INVALID_ARGUMENT, "view.count: 0", {"view": M.CascadeView(eye=eye)}),
            (Code.INVALID_ARGUMENT, "view.up", {"view": M.CascadeView(eye=eye, up=[1, 2], count=1)}),
            (Code.INVALID_ARGUMENT, "camera", {"view": M.CascadeView(count=1)}),
            (Code.INVALID_ARGUMENT, "width, height", {"width": 0}),
            (Code.RESOURCE_EXHAUSTED, "70000", {"width": 4294967295, "height": 4294967295}),
            (Code.NOT_FOUND, "light: 3", {"light": 3}), (Code.NOT_FOUND, "", {"asset": "none"})):
        refused(code, words, M.DeriveMapRequest(**{
            "asset": "city-open", "width": 8, "height": 8, **fields}))
with test.check("a call that is given up stops, and all its bytes are given back"):
    heavy = M.DeriveMapRequest(asset="city-open", width=256, height=256, technique=3, blur=63)
    for _ in range(4):
        one = call(heavy, timeout=60)
        one.cancel()
    with futures.ThreadPoolExecutor(8) as pool:  # busy clients hear of the deadline from the daemon first
        list(pool.map(lambda i: refused(Code.DEADLINE_EXCEEDED, "", heavy, timeout=0.002 + 0.0002 * i), range(80)))
    ut.wait_until(lambda: daemon.metric("umbrage_buffered_bytes") == 0, 30, "bytes are given back")
    assert list(call(M.DeriveMapRequest(asset="city-open", width=8, height=8), timeout=60))
channel.close()
test.finish()
