#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Every scene file of ${UMBRAGE_SCENES:-../shared/scenes}, submitted to a daemon and given to umbrage-bake: equal
ids, or the same refusal. By hand (minutes):

    tests/system/job_scenes.py WORKERS [local|slurm] [RESOLUTION]
"""
import json
import os
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

workers = sys.argv[1] if len(sys.argv) > 1 else "1"
executor = sys.argv[2] if len(sys.argv) > 2 else "local"
resolution = sys.argv[3] if len(sys.argv) > 3 else "1024"
SCENES = os.environ.get("UMBRAGE_SCENES", os.path.join(ut.ROOT, "..", "shared", "scenes"))
test = ut.Test(limit_s=3600)
TWO_NODES = os.path.join(ut.ROOT, "deploy", "slurm", "two-nodes.sh")
CLUSTER, SOCKET = test.path("cluster"), test.path("s")
files = sorted(os.path.join(folder, name) for folder, _, names in os.walk(SCENES) for name in names
               if name.lower().endswith((".gltf", ".glb", ".obj", ".ply", ".stl")))


def cli(*words):
    done = ut.run("umbrage", *words, "--json", "--address", "unix:" + SOCKET, code=None)
    return json.loads(done.stdout) if done.stdout else {"failure": done.stderr.decode().strip()}


def options(path):
    """A sun for scenes without lights of their own."""
    words = ["--resolution", resolution, "--verify", "10000"]
    plan = subprocess.run([ut.program("umbrage-bake"), path, "--plan", "--json", "--resolution", "64"],
                          stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False)
    return words if plan.returncode == 0 else words + ["--sun", "150,40"]


def direct(path, words):
    out = test.path("plain.umb")
    done = subprocess.run([ut.program("umbrage-bake"), path, "-o", out, "--json", "--quiet", *words],
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, check=False)
    if done.returncode == 0:
        return json.loads(done.stdout)["asset"]
    return done.stderr.decode().strip().splitlines()[-1].replace("umbrage-bake: ", "")


if executor == "slurm":
    os.environ["SLURM_CONF"] = os.path.join(CLUSTER, "slurm.conf")
    os.environ["PORT"] = str(20000 + os.getpid() % 10000)
    subprocess.run([TWO_NODES, "up", CLUSTER], check=True)
try:
    daemon = test.daemon("--jobs", test.path("jobs"), "--executor", executor, "--executor-interval",
                         "500ms", "--bake-workers", workers, "--bake-threads", "1", "--bake-tile",
                         "512", "--owner-jobs", "1000", "--owner-bytes", "16GiB", "--listen",
                         "unix:" + SOCKET)
    wanted = {path: options(path) for path in files}
    jobs = {path: cli("submit", path, *words) for path, words in wanted.items()}
    equal = 0
    for path, words in wanted.items():
        name = os.path.relpath(path, SCENES)
        there = direct(path, words)
        here = cli("watch", jobs[path]["job"]) if "job" in jobs[path] else jobs[path]
        answer = here.get("asset") or here.get("cause") or here["failure"]
        with test.check(f"{name}: {there[:12] if len(there) == 64 else 'refused: ' + there}"):
            assert answer == there or (len(answer) != 64 and len(there) != 64), (answer, there)
            equal += len(there) == 64
    print(f"{equal} of {len(files)} files are assets, with the same id both ways")
finally:
    if executor == "slurm":
        subprocess.run([TWO_NODES, "down", CLUSTER], check=False)
test.finish()
