#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The daemon's jobs on a Slurm cluster of two virtual nodes (umbraged --executor slurm): the same ids as on one
machine. With UMBRAGE_SLURM=full also while the controller, an agent or a node is killed (what Slurm makes of
it takes up to a minute each), UMBRAGE_KILLS times in turn (6). Skipped where Slurm is not installed (make
deps-full) or without root.
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
FULL = os.environ.get("UMBRAGE_SLURM") == "full"
KILLS = int(os.environ.get("UMBRAGE_KILLS", "6"))
test = ut.Test(limit_s=3000 if FULL else 240)
TWO_NODES = os.path.join(ut.ROOT, "deploy", "slurm", "two-nodes.sh")
CLUSTER, JOBS, SOCKET = test.path("cluster"), test.path("jobs"), test.path("s")
CONF = os.path.join(CLUSTER, "slurm.conf")
os.environ["SLURM_CONF"] = CONF
os.environ["PORT"] = str(20000 + os.getpid() % 10000)


def nodes(action):
    return subprocess.run([TWO_NODES, action, CLUSTER], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, check=False)


def queue(job, state=None):
    """Tasks of a job that Slurm knows."""
    names = subprocess.run(["squeue", "-h", "-r", "-o", "%j"] + (["-t", state] if state else []),
                           stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                           check=False).stdout.decode().splitlines()
    return [name for name in names if job in name]


def cli(*words):
    done = ut.run("umbrage", *words, "--json", "--address", "unix:" + SOCKET, code=None)
    assert done.stdout, done.stderr
    return json.loads(done.stdout)


def pid_of(program):
    with open(os.path.join(CLUSTER, program + ".pid"), encoding="ascii") as file:
        return int(file.read())


def processes_of(node):
    """What runs for tasks on a virtual node."""
    found = []
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{pid}/environ", "rb") as file:
                environment = file.read().split(b"\0")
            with open(f"/proc/{pid}/stat", encoding="ascii") as file:
                parent = int(file.read().rpartition(")")[2].split()[1])
        except OSError:
            continue
        if b"SLURMD_NODENAME=" + node.encode() in environment and \
                b"SLURM_CONF=" + CONF.encode() in environment:
            found += [int(pid), parent] if b"slurm_script" in command(pid) else [int(pid)]
    return found


def command(pid):
    with open(f"/proc/{pid}/cmdline", "rb") as file:
        return file.read()


def kill(pid):
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass


def start_agent(node):
    subprocess.run(["slurmd", "-N", node, "-f", CONF], check=True)


def kill_controller():
    kill(pid_of("slurmctld"))
    time.sleep(1)
    subprocess.run(["slurmctld", "-f", CONF], check=True)


def kill_agent():
    """Its task runs on, and Slurm starts it a second time elsewhere."""
    kill(pid_of("slurmd-n2"))
    time.sleep(14)  # SlurmdTimeout is 10
    start_agent("n2")


def kill_node():
    kill(pid_of("slurmd-n2"))
    for pid in processes_of("n2"):
        kill(pid)
    time.sleep(14)
    start_agent("n2")


up = nodes("up")
if up.returncode != 0:
    nodes("down")
    ut.skip("no cluster: " + up.stderr.decode())
try:
    test.daemon("--jobs", JOBS, "--executor", "slurm", "--executor-interval", "1s", "--bake-threads", 1,
                "--bake-tile", 512, "--listen", "unix:" + SOCKET)
    scene = test.scene("city", 3)

    def settings(azimuth, verify=1000):
        return ("--resolution", 1024, "--sun", f"{azimuth},50", "--verify", verify)

    def plain(azimuth, verify=1000):
        return test.bake(scene, test.path("plain.umb"), *settings(azimuth, verify))["asset"]

    with test.check("four tiles on two nodes and a merge give the id of one bake"):
        done = cli("submit", scene, *settings(10), "--wait")
        assert done["state"] == "done" and done["asset"] == plain(10), done
        assert "effect=" in done["plan"] and (done["tiles"], done["tiles_done"]) == (4, 4), done

    with test.check("a scene that cannot be used never reaches the cluster"):
        with open(test.path("bad.obj"), "w", encoding="ascii") as file:
            file.write("v 0 0 nan\nf 1 2 3\n")
        done = cli("submit", test.path("bad.obj"), "--wait")
        assert done["failure"] == "rejected" and len(done["cause"]) > 10, done

    with test.check("a cancelled job leaves nothing in the queue"):
        job = cli("submit", scene, "--resolution", 4096, "--verify", 1000)["job"]
        ut.wait_until(lambda: queue(job), 60, "the tasks are in the queue")
        cli("cancel", job)
        ut.wait_until(lambda: not queue(job), 60, "the queue is empty")

    def survive(number, disturb):
        azimuth = 20 + number
        job = cli("submit", scene, *settings(azimuth))["job"]
        ut.wait_until(lambda: queue(job), 60, "the tasks are in the queue")
        begin = time.monotonic()
        disturb()
        done = cli("watch", job)
        assert done["state"] == "done" and done["asset"] == plain(azimuth), done
        print(f"    {disturb.__name__}: done {time.monotonic() - begin:.0f} s after, in try {done['epoch']}")
        ut.wait_until(lambda: not queue(job), 60, "nothing is left in the queue")
        assert not os.listdir(os.path.join(JOBS, "work"))

    if FULL:
        for number in range(KILLS):
            disturb = (kill_controller, kill_agent, kill_node)[number % 3]
            with test.check(f"{disturb.__name__.replace('_', ' ')}, time {number // 3 + 1}"):
                survive(number, disturb)
finally:
    nodes("down")

test.finish()
