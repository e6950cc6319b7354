#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Bakes on a Slurm cluster of two virtual nodes: the same ids as on one machine, also when the
controller is killed right after a submission (only with UMBRAGE_SLURM=full: what Slurm makes of it
takes up to two minutes); a cancelled job leaves nothing in the queue. Skipped where Slurm is not
installed (make deps-full) or without root.
"""
import json
import os
import shutil
import signal
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

if os.geteuid() != 0 or any(shutil.which(name) is None for name in ("slurmctld", "slurmd", "munged")):
    ut.skip("needs root and Slurm")
test = ut.Test()
SLURM = os.path.join(ut.ROOT, "deploy", "slurm")
CLUSTER, BIN, SOCKET = test.path("cluster"), test.path("bin"), test.path("s")
CONF = os.path.join(CLUSTER, "slurm.conf")
PORT = str(20000 + os.getpid() % 10000)
os.mkdir(BIN)
for name in ("umbrage-bake-slurm", "umbrage-tile"):
    shutil.copy(os.path.join(SLURM, name), BIN)
shutil.copy(ut.program("umbrage-bake"), BIN)
env = {**os.environ, "SLURM_CONF": CONF, "PORT": PORT}


def nodes(action):
    return subprocess.run([os.path.join(SLURM, "two-nodes.sh"), action, CLUSTER], env=env,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, check=False)


def queue(job):
    """Tasks of a job that Slurm knows."""
    names = subprocess.run(["squeue", "-h", "-r", "-o", "%j"], env=env, stdout=subprocess.PIPE,
                           check=False).stdout.decode().splitlines()
    return [name for name in names if job in name]


def cli(*words):
    done = ut.run("umbrage", *words, "--json", "--address", "unix:" + SOCKET, code=None)
    assert done.stdout, done.stderr
    return json.loads(done.stdout)


up = nodes("up")
if up.returncode != 0:
    nodes("down")
    ut.skip("no cluster: " + up.stderr.decode())
try:
    with open(os.path.join(BIN, "umbrage-slurm.conf"), "w", encoding="ascii") as file:
        file.write(up.stdout.decode() + "UMBRAGE_ACROSS=2\n")
    test.daemon("--jobs", test.path("jobs"), "--bake-program", BIN + "/umbrage-bake-slurm",
                "--bake-threads", 1, "--listen", "unix:" + SOCKET)
    scene = test.scene("city", 3)
    plain = test.bake(scene, test.path("plain.umb"), "--resolution", 1024, "--verify", 1000)["asset"]

    with test.check("four tiles on two nodes and a merge give the id of one bake"):
        done = cli("submit", scene, "--resolution", 1024, "--verify", 1000, "--wait")
        assert done["state"] == "done" and done["asset"] == plain, done
        assert "effect=" in done["plan"]

    with test.check("a scene that cannot be used never reaches the cluster"):
        with open(test.path("bad.obj"), "w", encoding="ascii") as file:
            file.write("v 0 0 nan\nf 1 2 3\n")
        done = cli("submit", test.path("bad.obj"), "--wait")
        assert done["failure"] == "rejected" and len(done["cause"]) > 10, done

    def kill_controller():
        expected = test.bake(scene, test.path("other.umb"), "--resolution", 1024, "--sun", "90,50",
                             "--verify", 1000)["asset"]
        job = cli("submit", scene, "--resolution", 1024, "--sun", "90,50", "--verify", 1000)["job"]
        ut.wait_until(lambda: queue(job), 20, "the tasks are in the queue")
        with open(os.path.join(CLUSTER, "slurmctld.pid"), encoding="ascii") as file:
            os.kill(int(file.read()), signal.SIGKILL)
        time.sleep(1)
        subprocess.run(["slurmctld", "-f", CONF], env=env, check=True)
        done = cli("watch", job)
        assert done["asset"] == expected and done["epoch"] == 1, done

    if os.environ.get("UMBRAGE_SLURM") == "full":
        with test.check("a controller that is killed at once loses no job"):
            kill_controller()

    with test.check("a cancelled job leaves nothing in the queue"):
        job = cli("submit", scene, "--resolution", 4096, "--verify", 1000)["job"]
        ut.wait_until(lambda: queue(job), 20, "the tasks are in the queue")
        cli("cancel", job)
        ut.wait_until(lambda: not queue(job), 30, "the queue is empty")
finally:
    nodes("down")

test.finish()
