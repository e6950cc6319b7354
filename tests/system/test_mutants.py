#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Mutated scene files of every format through the bake service: the daemon must not end, every job
must end in time with a kind of failure, nothing may be written outside the jobs folder and the
store, and no process may stay behind. A sound scene is baked in between, to the right asset.
UMBRAGE_MUTANTS: how many (default 60; 10000 is the full campaign), UMBRAGE_SEED.
"""
import collections
import os
import random
import struct
import subprocess
import sys
import zlib

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
COUNT = int(os.environ.get("UMBRAGE_MUTANTS", "60"))
SEED = int(os.environ.get("UMBRAGE_SEED", "7"))
test = ut.Test(limit_s=280 if COUNT <= 200 else 3 * 3600)
B = test.messages.bakes
STORE, JOBS, FLOCK = test.path("store"), test.path("jobs"), 20
print(f"seed {SEED}, {COUNT} mutants")
rng = random.Random(SEED)
seeds = {}
for form in ("glb", "gltf", "obj", "ply", "stl"):
    done = subprocess.run([ut.program("scenegen"), "city", "--size", "1", "-o",
                           test.path("seed." + form)], stderr=subprocess.DEVNULL, check=False)
    if done.returncode == 0:
        seeds[form] = open(test.path("seed." + form), "rb").read()
assert len(seeds) >= 2, seeds.keys()
seeds["gltf"] = seeds.get("gltf") or (
    b'{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],'
    b'"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"uri":'
    b'"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA",'
    b'"byteLength":36}],"bufferViews":[{"buffer":0,"byteLength":36}],"accessors":[{"bufferView":0,'
    b'"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}]}')
NUMBERS = (b"nan", b"inf", b"-1", b"0", b"1e308", b"4294967295", b"1000000000", b"99999999999999999999")
INTERESTING = [struct.pack("<I", v) for v in (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7F800000,
                                              0x7FC00000, 1000000000)]


def mutate(data):
    """A few changes of the kinds that break parsers: bytes, words, numbers, cuts, repeats."""
    data = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        at = rng.randrange(len(data))
        kind = rng.randrange(6)
        if kind == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[at:at + 4] = rng.choice(INTERESTING)
        elif kind == 2:
            data[at:at + rng.randrange(1, 12)] = rng.choice(NUMBERS)
        elif kind == 3:
            del data[at:at + rng.randrange(1, 64)]
        elif kind == 4:
            end = min(len(data), at + rng.randrange(1, 256))
            data[at:at] = data[at:end] * rng.randrange(1, 4)
        else:
            del data[at:]
        if not data:
            data = bytearray(b"x")
    return bytes(data)


def snapshot():
    """Everything in the test's folder except the folders of the service."""
    found = set()
    for folder, folders, names in os.walk(test.folder):
        folders[:] = [f for f in folders if os.path.join(folder, f) not in (STORE, JOBS)]
        found.update(os.path.join(folder, name) for name in names)
    return found


daemon = test.daemon("--jobs", JOBS, "--bake-workers", 2, "--bake-threads", 1, "--bake-memory",
                     "512MiB", "--job-time", "30s", "--tile-cache", 0, "--owner-jobs", 100)
client = test.client(daemon.grpc_unix)
sound = test.bake(test.path("seed.glb"), test.path("sound.umb"), "--resolution", 64, "--verify",
                  0)["asset"]
before = snapshot()
classes = collections.Counter()


def finish(job, what):
    status = client.finished_job(job, timeout=100)
    name = B.JobFailure.Name(status.failure) if status.state != B.JOB_DONE else "ok"
    classes[name] += 1
    assert status.state in (B.JOB_DONE, B.JOB_FAILED, B.JOB_POISON), (what, status)
    assert status.state == B.JOB_DONE or len(status.cause) > 5, (what, status)
    return status


with test.check("every mutant ends with a class, and sound scenes are baked in between"):
    for first in range(0, COUNT, FLOCK):
        flock = []
        for number in range(first, min(first + FLOCK, COUNT)):
            form = sorted(seeds)[number % len(seeds)]
            name = "scene." + form
            flock.append((client.submit({name: mutate(seeds[form])}, name, resolution=64,
                                        verify=0).job, f"mutant {number} ({form})"))
        for job, what in flock:
            finish(job, what)
        asset = sound
        good = client.submit({"s.glb": seeds["glb"]}, "s.glb", resolution=64, verify=0)
        assert finish(good.job, "the sound scene").asset.hex() == asset
    print(", ".join(f"{count} {name}" for name, count in sorted(classes.items())))
    assert classes["FAILURE_INTERNAL"] == 0, classes


def png(width, height):
    """A PNG that claims that size and inflates to zeros."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(
            ">I", zlib.crc32(kind + data))
    rows = zlib.compressobj(9)
    packed = b"".join(rows.compress(bytes(1 << 20)) for _ in range(64)) + rows.flush()
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0))
            + chunk(b"IDAT", packed) + chunk(b"IEND", b""))


with test.check("a texture that would inflate to gigabytes is told as such, in bounded memory"):
    mtl = b"newmtl m\nmap_d bomb.png\nmap_Kd bomb.png\n"
    obj = (b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\n"
           b"f 1/1 2/2 3/3\n")
    status = finish(client.submit({"a.obj": obj, "a.mtl": mtl, "bomb.png": png(60000, 60000)},
                                  "a.obj", resolution=64, verify=0).job, "the texture bomb")
    print(B.JobState.Name(status.state), status.cause, status.notices)
    assert daemon.resident_bytes() < 1 << 30

with test.check("nothing was written elsewhere, and nothing is left"):
    assert snapshot() - before <= {p for p in snapshot() if p.endswith(".log")}, snapshot() - before
    for folder in ("incoming", "bundles", "work"):
        ut.wait_until(lambda: not os.listdir(os.path.join(JOBS, folder)), 10, f"{folder} is empty")
    assert not subprocess.run(["pgrep", "-f", f"umbrage-bake .*{JOBS}"], stdout=subprocess.PIPE,
                              check=False).stdout
    assert daemon.process.poll() is None

test.finish()
