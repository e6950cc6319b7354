#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Edits with a cache: the id of a full bake, a self-check that compares only what changed, and no wrong
asset from a damaged cache. `make edits` makes more of the edits, on real scenes."""
import ctypes
import hashlib
import os
import random
import shutil
import stat
import struct
import subprocess
import sys
import tempfile

os.environ.setdefault("UMBRAGE_EDITS_LOG2", "11")  # before the module reads them
os.environ.setdefault("UMBRAGE_EDITS_VERIFY", "200000")  # 3000 points a tile
import edits

EDITS = 6
failures = 0
HEAD = 56


def check(name, good, seen=""):
    global failures
    print("ok  " if good else "FAIL", name, "" if good else seen)
    failures += not good


def forged(place, other):
    """The tile `place` with the content of the tile `other`, its checksum right."""
    xxhash = ctypes.CDLL("libxxhash.so.0")
    xxhash.XXH3_64bits.restype = ctypes.c_uint64
    head, content = place[:40] + other[40:48], other[HEAD:]
    hashed = head + content
    return head + struct.pack("<Q", xxhash.XXH3_64bits(hashed, ctypes.c_size_t(len(hashed)))) + content


def read(path):
    with open(path, "rb") as file:
        return file.read()


def write(path, content):
    with open(path, "wb") as file:
        file.write(content)


def tiles_of(cache):
    """Names of the tiles, the largest last, and of the record of the self-check, told by its length; without the
    merged octree."""
    squares = 1 << 2 * (edits.LOG2 - 6)
    record = 16 + 64 * 64 + 32 * squares + 32
    names = sorted(os.listdir(cache), key=lambda name: os.path.getsize(os.path.join(cache, name)))
    records = [name for name in names if struct.unpack_from("<Q", read(os.path.join(cache, name)), 40)[0] == record]
    base = base_of(records)
    return [name for name in names if name not in records and name != base], records


def base_of(records):
    """Name of the merged octree that an edit begins with."""
    places = b"".join(bytes.fromhex(name[:64]) for name in records)
    return hashlib.sha256(b"umbrage base   \0" + places).hexdigest() + ".umbt"


def inheritance(folder, scene, moved, out):
    """What is compared again: nothing without an edit, the squares of the edit after one."""
    cache = os.path.join(folder, "cache")
    first = edits.bake(scene, "-o", out, "--cache", cache, *edits.SETTINGS)
    check("a first bake draws points everywhere",
          first["verify"]["sampled"] and first["verify"]["points"] > 100000, first["verify"])
    again = edits.bake(scene, "-o", out, "--cache", cache, *edits.SETTINGS)["verify"]
    check("the same scene inherits all tiles", (again["tiles_inherited"], again["columns"],
                                                again["sampled"]) == (64, 0, False), again)
    edited = edits.bake(moved, "-o", out, "--cache", cache, *edits.SETTINGS)
    seen = edited["verify"]
    check("an edit compares every column of the squares that it changed",
          not seen["sampled"] and 60 <= seen["tiles_inherited"] < 64 and 0 < seen["squares_compared"] < 40
          and seen["columns"] == 4096 * seen["squares_compared"] and seen["oldest"] > 1.7e9, seen)
    check("other squares of its tiles are inherited", seen["squares_inherited"] > 0, seen)
    full = edits.bake(moved, "-o", out, "--verify", "0", *edits.SETTINGS)
    check("its id is a full bake's", edited["asset"] == full["asset"])
    back = edits.bake(scene, "-o", out, "--cache", cache, *edits.SETTINGS)
    check("and so is the id of the scene as it was", back["asset"] == first["asset"])
    fewer = edits.bake(scene, "-o", out, "--cache", os.path.join(folder, "few"), "--verify", "1000",
                       *edits.SETTINGS)
    check("a check of few points is a check", fewer["verify"]["sampled"])
    more = edits.bake(scene, "-o", out, "--cache", os.path.join(folder, "few"), *edits.SETTINGS)
    check("but no closer one inherits from it", more["verify"]["sampled"], more["verify"])
    return first["asset"], full["asset"], cache


def spoilt(folder, scene, moved, out, assets, cache):
    """Damage of every kind, in tiles and in the record: the id stays right."""
    draw = random.Random(5)
    for round_ in range(5):
        bad = os.path.join(folder, f"bad{round_}")
        shutil.copytree(cache, bad)
        names = os.listdir(bad)
        for name in names:
            path = os.path.join(bad, name)
            content = bytearray(read(path))
            kind = draw.randrange(6)
            if kind == 0:
                del content[draw.randrange(len(content)):]
            elif kind == 1:
                content[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
            elif kind == 2:
                content = read(os.path.join(cache, draw.choice(names)))
            elif kind == 3:
                content = forged(bytes(content), read(os.path.join(cache, draw.choice(names))))
            write(path, content)
        which = round_ % 2
        got = subprocess.run([edits.BAKE, (scene, moved)[which], "-o", out, "--cache", bad, *edits.SETTINGS,
                              "--verify", edits.VERIFY],
                             capture_output=True, text=True, check=False)
        # A forged tile without a record may end the bake: then nothing is published.
        good = assets[which] in got.stdout if got.returncode == 0 else (
            got.returncode == 70 and "disagree with traced rays" in got.stderr)
        check(f"a spoilt cache gives the right asset or none ({round_}: {got.returncode})", good,
              got.stdout + got.stderr)
        shutil.rmtree(bad)


def forgery(folder, scene, out, asset, cache):
    """A tile's content under another's name, well formed."""
    edits.bake(scene, "-o", out, "--cache", cache, *edits.SETTINGS)
    tiles, records = tiles_of(cache)
    check("a frustum has one record", len(records) == 1, records)
    place, other = os.path.join(cache, tiles[-1]), os.path.join(cache, tiles[-2])
    base = os.path.join(cache, base_of(records))
    os.unlink(base)  # else no tile is read
    true, wrong = read(place), forged(read(place), read(other))
    write(place, wrong)
    report = edits.bake(scene, "-o", out, "--cache", cache, *edits.SETTINGS)
    check("a tile that the record contradicts is baked again",
          report["asset"] == asset and report["tiles_damaged"] == 1, report)
    check("and is whole afterwards", read(place)[HEAD:] == true[HEAD:])
    os.unlink(out)
    write(place, wrong)
    os.unlink(os.path.join(cache, records[0]))
    os.unlink(base)
    problem = edits.bake(scene, "-o", out, "--cache", cache, *edits.SETTINGS, expect=70)
    check("without a record the rays find it, and nothing is published",
          "disagree with traced rays" in problem and not os.path.exists(out), problem)
    healed = edits.bake(scene, "-o", out, "--cache", cache, *edits.SETTINGS)
    check("the next bake makes the tile anew", healed["asset"] == asset and read(place)[HEAD:] == true[HEAD:])


def bases(folder, scene, moved, out, assets, cache):
    """The merged octree of the bake before: used, and ignored where it is cut, damaged, foreign or old."""
    edits.bake(scene, "-o", out, "--cache", cache, *edits.SETTINGS)
    tiles, records = tiles_of(cache)
    path = os.path.join(cache, base_of(records))
    whole = read(path)
    kept = edits.bake(moved, "-o", out, "--cache", cache, *edits.SETTINGS)
    check("an edit begins with the octree of the bake before",
          kept["asset"] == assets[1] and 56 <= kept["tiles_of_base"] < 64 and read(path) == whole, kept)
    other = os.path.join(folder, "other")
    edits.bake(scene, "-o", out, "--cache", other, "--resolution", str(1 << (edits.LOG2 - 1)), "--tile",
               str(1 << (edits.LOG2 - 4)), *edits.SETTINGS[4:])
    foreign = max((os.path.join(other, name) for name in os.listdir(other)), key=os.path.getsize)
    spoils = {"cut": whole[:len(whole) // 2], "empty": b"", "a flipped bit": whole[:-9] + bytes([whole[-9] ^ 4]) + whole[-8:],
              "a tile": forged(whole, read(os.path.join(cache, tiles[-1]))), "foreign": forged(whole, read(foreign)),
              "missing": None}
    for name, content in spoils.items():
        os.unlink(path)
        if content is not None:
            write(path, content)
        report = edits.bake(moved, "-o", out, "--cache", cache, *edits.SETTINGS)
        check(f"a base that is {name} is not used",
              report["asset"] == assets[1] and report["tiles_of_base"] == 0 and report["tiles_found"] == 64, report)
        check(f"and is made anew ({name})", os.path.getsize(path) > len(whole) // 2)


def shared(folder, scene, out, asset):
    """In a folder that others can write to, nothing is inherited."""
    cache = os.path.join(folder, "shared")
    edits.bake(scene, "-o", out, "--cache", cache, *edits.SETTINGS)
    os.chmod(cache, stat.S_IRWXU | stat.S_IRWXG)
    report = edits.bake(scene, "-o", out, "--cache", cache, *edits.SETTINGS)
    check("a cache that others can change proves nothing",
          report["asset"] == asset and report["verify"]["sampled"] and report["tiles_found"] == 64, report)
    words = [word for word in edits.SETTINGS if word != "--quiet"]
    told = subprocess.run([edits.BAKE, scene, "-o", out, "--cache", cache, *words, "--verify", edits.VERIFY],
                          capture_output=True, text=True, check=True).stderr
    check("and a notice says why", "compares every tile" in told and "mode 0770" in told, told)


def main():
    with tempfile.TemporaryDirectory() as folder:
        city, scene = os.path.join(folder, "city.obj"), os.path.join(folder, "scene.obj")
        moved, out = os.path.join(folder, "moved.obj"), os.path.join(folder, "a.umb")
        subprocess.run([os.path.join(edits.BUILD, "scenegen"), "city", "--size", "12", "-o", city],
                       check=True, stderr=subprocess.DEVNULL)
        state = edits.Edits(edits.Scene(city), random.Random(1))
        state.write(scene)
        for face in state.scene.parts[len(state.scene.parts) // 2]:
            for vertex in state.scene.faces[face][1]:
                state.moved[vertex] = [1.5, 0.0, 0.0]
        state.write(moved)
        first, second, cache = inheritance(folder, scene, moved, out)
        spoilt(folder, scene, moved, out, (first, second), cache)
        forgery(folder, scene, out, first, cache)
        bases(folder, scene, moved, out, (first, second), cache)
        shared(folder, scene, out, first)
        check("ten edits", edits.try_edits(city, EDITS, seed=3) == 0)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
