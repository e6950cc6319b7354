#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
umbrage submit, watch, jobs, cancel, fetch and rm with a daemon on a Unix socket: the asset must
have the same bytes as umbrage-bake's, files must be gathered from where a scene names them, and
watching must survive a restart.
"""
import json
import os
import shutil
import struct
import subprocess
import sys
import time
import zlib

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
STORE, JOBS, SOCKET = test.path("store"), test.path("jobs"), test.path("jobs.sock")
ASSETS = os.path.join(JOBS, "assets")


HELD_BAKE, HOLD = test.held_bakes()


def start():
    return test.daemon("--jobs", JOBS, "--bake-threads", 1, "--bake-program", HELD_BAKE, "--listen",
                       "unix:" + SOCKET)


def cli(*words, code=0, where=None):
    return ut.run("umbrage", *words, code=code, env={"UMBRAGE_ADDRESS": where or "unix:" + SOCKET})


def answer(*words, code=0):
    return json.loads(cli(*words, "--json", code=code).stdout)


def read(path):
    with open(path, "rb") as file:
        return file.read()


daemon = start()
scene = test.scene("city", 4)
options = ("--resolution", 512, "--sun", "120,40", "--sun=200,30", "--verify", 10000)
plain = test.bake(scene, test.path("plain.umb"), *options)["asset"]

with test.check("submit --wait prints the job and the asset that umbrage-bake makes"):
    done = answer("submit", scene, *options, "--wait")
    assert done["asset"] == plain and done["state"] == "done" and len(done["job"]) == 32, done
    assert "effect=" in done["plan"]

with test.check("the same again is the same job, whatever the options' form"):
    again = answer("submit", scene, "--resolution=512", "--sun=120,40", "--sun", "200,30",
                   "--verify=10000")
    assert again == {"job": done["job"], "existing": True}, again
    assert [job["job"] for job in answer("jobs")["jobs"]] == [done["job"]]
    assert answer("watch", done["job"])["asset"] == plain
    assert cli("watch", done["job"], "--quiet").stdout.decode().strip() == plain

with test.check("fetch gives a file that verifies, and goes on from what an earlier one left"):
    out = test.path("out.umb")
    whole = read(os.path.join(ASSETS, plain + ".umb"))
    for left in (None, whole[:1000], whole, b"something else entirely", whole + b"more"):
        if left is not None:
            with open(out + ".part", "wb") as file:
                file.write(left)
        cli("fetch", plain, "-o", out, "--quiet")
        assert read(out) == whole and not os.path.exists(out + ".part")
        os.remove(out)
    cli("fetch", 64 * "0", "-o", out, code=66)
    refused = cli("fetch", plain, "-o", "-", code=2)
    assert b"./-" in refused.stderr and not refused.stdout, refused
    assert not os.path.exists(out) and not os.path.exists(out + ".part")

with test.check("files of a glTF and an OBJ are gathered, and no others"):
    os.makedirs(test.path("deep", "models"))
    os.makedirs(test.path("deep", "data files"))
    with open(test.path("deep", "data files", "a.bin"), "wb") as file:
        file.write(struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0))
    with open(test.path("deep", "models", "a.gltf"), "w", encoding="ascii") as file:
        json.dump({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
                   "nodes": [{"mesh": 0}],
                   "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
                   "buffers": [{"uri": "a.bin", "byteLength": 36}],
                   "bufferViews": [{"buffer": 0, "byteLength": 36}],
                   "images": [{"uri": "missing.png"}],
                   "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3,
                                  "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}]}, file)
    shutil.copyfile(test.path("deep", "data files", "a.bin"), test.path("deep", "models", "a.bin"))
    gltf = test.path("deep", "models", "a.gltf")
    expected = test.bake(gltf, test.path("gltf.umb"), "--resolution", 64, "--verify", 1000)["asset"]
    assert answer("submit", gltf, "--resolution", 64, "--verify", 1000, "--wait")["asset"] == expected
    with open(test.path("deep", "models", "a.obj"), "w", encoding="ascii") as file:
        file.write("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n")
    with open(test.path("deep", "models", "a.mtl"), "w", encoding="ascii") as file:
        file.write("newmtl m\nmap_Kd -s 1 1 1 ../data\\ files/no.png\n")
    obj = test.path("deep", "models", "a.obj")
    expected = test.bake(obj, test.path("obj.umb"), "--resolution", 64, "--verify", 1000)["asset"]
    done = cli("submit", obj, "--resolution", 64, "--verify", 1000, "--wait", "--json")
    assert json.loads(done.stdout)["asset"] == expected
    os.rename(test.path("deep", "models", "a.mtl"), test.path("deep", "a.mtl"))
    with open(obj, "a", encoding="ascii") as file:
        file.write("mtllib ../a.mtl\n")
    done = cli("submit", obj, "--resolution", 64, "--verify", 1000, "--json")
    assert b"'../a.mtl', which is not sent" in done.stderr, done.stderr
    job = json.loads(done.stdout)["job"]
    assert answer("watch", job, code=None)["state"] in ("done", "failed")

with test.check("a map whose name has blanks goes along, behind its options too"):
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))
    os.mkdir(test.path("leaves"))
    with open(test.path("leaves", "a leaf.png"), "wb") as file:  # half is a hole
        file.write(b"\x89PNG\r\n\x1a\n" +
                   chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 1, 8, 4, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(b"\0\0\xff\0\0")) + chunk(b"IEND", b""))
    with open(test.path("leaves", "a.mtl"), "w", encoding="ascii") as file:
        file.write("newmtl leaf\nmap_d -clamp on -bm 0.5 a leaf.png\n")
    with open(test.path("leaves", "a.obj"), "w", encoding="ascii") as file:
        file.write("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
                   "usemtl leaf\nf 1/1 2/2 3/3\n")
    obj = test.path("leaves", "a.obj")
    expected = test.bake(obj, test.path("leaf.umb"), "--resolution", 64, "--verify", 1000)
    assert answer("submit", obj, "--resolution", 64, "--verify", 1000, "--wait")["asset"] == expected["asset"]

with test.check("a link out of the scene's folder is not followed"):
    os.remove(test.path("deep", "models", "a.bin"))
    os.symlink(test.path("deep", "data files", "a.bin"), test.path("deep", "models", "a.bin"))
    done = cli("submit", gltf, "--resolution", 128, "--wait", "--json", code=None)
    assert b"'a.bin', which is not sent" in done.stderr, done.stderr
    assert json.loads(done.stdout)["state"] == "failed", done.stdout

with test.check("a scene that cannot be used ends with 65 and the reason"):
    with open(test.path("bad.obj"), "w", encoding="ascii") as file:
        file.write("v 0 0 nan\nf 1 2 3\n")
    failed = cli("submit", test.path("bad.obj"), "--wait", code=65)
    assert b"rejected" in failed.stderr and test.folder.encode() not in failed.stderr, failed.stderr
    cli("submit", test.path("missing.obj"), code=66)
    cli("submit", scene, "--resolution", code=2)
    cli("submit", scene, "--output", "x", code=2)
    cli("watch", 32 * "0", code=66)


def watched(*options):
    """A job that runs for as long as HOLD is there, and `umbrage watch` of it, which has begun."""
    open(HOLD, "w", encoding="ascii").close()
    job = answer("submit", scene, *options)["job"]
    watcher = subprocess.Popen([ut.program("umbrage"), "watch", job, "--json"],
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               env={**os.environ, "UMBRAGE_ADDRESS": "unix:" + SOCKET})
    ut.wait_until(lambda: daemon.metric("umbrage_inflight") == 1 and
                  {"running"} == {told["state"] for told in answer("jobs")["jobs"]
                                  if told["job"] == job}, 20, "it runs and is watched")
    return job, watcher


with test.check("a watch goes on across a restart of the daemon"):
    job, watcher = watched("--resolution", 2048)
    daemon.kill()
    os.remove(HOLD)
    time.sleep(0.3)  # the watcher finds nobody for a while
    daemon = start()
    text, talk = watcher.communicate(timeout=60)
    assert watcher.returncode == 0, talk
    assert json.loads(text)["state"] == "done"

with test.check("a cancelled job ends its watcher with 75"):
    job, watcher = watched("--resolution", 2048, "--closed", "off")
    assert answer("cancel", job)["failure"] == "cancelled"
    watcher.communicate(timeout=20)
    assert watcher.returncode == 75
    assert answer("cancel", job)["failure"] == "cancelled"

with test.check("rm takes the file along, and plain TCP is refused without a token"):
    cli("rm", plain)
    assert not os.path.exists(os.path.join(ASSETS, plain + ".umb"))
    cli("rm", plain, code=66)
    refused = cli("jobs", code=77, where=daemon.tcp)
    assert b"token" in refused.stderr

test.finish()
