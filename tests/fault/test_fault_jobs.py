#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The bake service while files fail under it, and while it is killed at every step: taking a bundle,
baking, staging, publishing, noting. Afterwards a sound daemon starts on what is left, and then

- every job that was accepted is done, with the bytes of the undisturbed run, or failed with a cause;
- the store has that asset once or not at all, and no temporary; no bundle, work folder or process
  is left.
"""
import json
import os
import shutil
import subprocess
import time

import fault_sweep as fs
from fault_sweep import ut

test = ut.Test(limit_s=1500)
sweep = fs.Sweep(test)
CALLS = "files"
WAYS = ("ENOSPC",) if fs.SHORT else ("ENOSPC", "EIO", "EMFILE")
POINTS = 4 if fs.SHORT else 40  # of each way and each kill: over 100 faults in full
root = test.path("root")        # everything that counts lies below it
STORE, JOBS = os.path.join(root, "store"), os.path.join(root, "jobs")
ASSETS = os.path.join(JOBS, "assets")
SOCKET = test.path("s")
scene = test.scene("city", 2)
OPTIONS = ("--resolution", 256, "--verify", 2000)
expected = test.bake(scene, test.path("plain.umb"), *OPTIONS)["asset"]


def start():
    return [ut.program("umbraged"), "--store", STORE, "--jobs", JOBS, "--listen", "unix:" + SOCKET,
            "--bake-threads", "1", "--tile-cache", "0", "--drain-delay", "0", "--log-level", "warn",
            "--job-sandbox", "off"]  # inject.so opens its board, where no bake may


def cli(*words, timeout=40):
    return subprocess.run([ut.program("umbrage"), *[str(word) for word in words], "--address",
                           "unix:" + SOCKET], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          timeout=timeout, check=False)


def up(process):
    """Waits until it listens; False if it ended instead."""
    deadline = time.monotonic() + fs.HANG_S
    while process.poll() is None:
        if cli("list", "--quiet").returncode == 0:
            return True
        assert time.monotonic() < deadline, "the daemon neither serves nor ends"
        time.sleep(0.05)
    return False


def processes():
    done = subprocess.run(["pgrep", "-f", f"umbrage-bake .*{root}"], stdout=subprocess.PIPE,
                          check=False)
    return done.stdout.split()


def leftovers():
    found = [f"{folder}/{name}" for folder in ("incoming", "bundles", "work")
             for name in os.listdir(os.path.join(JOBS, folder))]
    return found + [name for name in os.listdir(ASSETS) + os.listdir(STORE)
                    if name not in (expected + ".umb", ".umbrage-cache")]


def ended(process):
    """Ends a daemon that still runs."""
    if process.poll() is None:
        process.terminate()
    try:
        process.wait(fs.HANG_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        raise AssertionError("the daemon does not end") from None


def disturbed(action, at, keep=False):
    """One submission to a daemon with a fault; the id of the job if it was accepted."""
    shutil.rmtree(root, ignore_errors=True)
    os.makedirs(STORE)
    sweep.runs += 1
    with sweep.injected(CALLS, action, at=at, keep=keep, under=root) as board:
        process = subprocess.Popen(start(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    job = None
    try:
        if up(process):
            done = cli("submit", scene, *OPTIONS, "--json")
            job = json.loads(done.stdout)["job"] if done.returncode == 0 else None
            deadline = time.monotonic() + 6
            while job and process.poll() is None and time.monotonic() < deadline:
                shown = cli("jobs", "--json")
                if shown.returncode != 0 or all(j["state"] not in ("queued", "running")
                                                for j in json.loads(shown.stdout)["jobs"]):
                    break
                time.sleep(0.05)
    finally:
        ended(process)
    return board, job


def sound(job):
    """What a sound daemon makes of what is left."""
    process = subprocess.Popen(start(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        assert up(process), "a sound daemon does not start on what is left"
        if job:
            done = cli("watch", job, "--json")
            assert done.stdout, done.stderr
            status = json.loads(done.stdout)
            if status["state"] == "done":
                assert status["asset"] == expected, status
                shown = ut.run("umbrage", "verify", os.path.join(ASSETS, expected + ".umb"))
                assert shown.returncode == 0
            else:
                assert status["state"] == "failed" and len(status["cause"]) > 10, status
        again = json.loads(cli("submit", scene, *OPTIONS, "--wait", "--json").stdout)
        assert again["state"] == "done" and again["asset"] == expected, again
        ut.wait_until(lambda: not leftovers() and not processes(), 10,
                      f"nothing is left: {leftovers()} {processes()}")
        return job and status["state"]
    finally:
        ended(process)


def tell(what, ends):
    """Counts how jobs ended. Not accepted: the submission was refused, or no daemon listened."""
    names = [end or "not accepted" for end in ends]
    print(f"{len(names)} {what}: " + ", ".join(f"{names.count(name)} {name}"
                                               for name in sorted(set(names))))


with test.check("an undisturbed daemon takes, bakes and publishes"):
    whole, job = disturbed("EIO", at=0)
    count = whole.calls
    assert count > 50 and sound(job) == "done"
    print(f"{count} calls on files")

points = sorted({1 + i * (count - 1) // (POINTS - 1) for i in range(POINTS)})

with test.check("a call that fails loses nothing"):
    ends = []
    for action in WAYS:
        for at in points:
            ends.append(sound(disturbed(action, at)[1]))
    tell("faults", ends)

with test.check("a disk that stays full loses nothing"):
    ends = [sound(disturbed("ENOSPC", at, keep=True)[1]) for at in points[::2]]
    tell("faults", ends)

with test.check("a kill at any step loses nothing"):
    ends = [sound(disturbed("kill", at)[1]) for at in points]
    tell("kills", ends)

test.finish()
