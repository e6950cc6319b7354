#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The daemon's Slurm executor with an imitated cluster (harness/fake_slurm.py): the same ids as on
this machine; submissions that are lost, tasks that run twice, are killed or held back, and a
controller that is away must all be survived. A cancelled or forgotten job must leave no task.
"""
import json
import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
SLURM, JOBS, SOCKET = test.path("slurm"), test.path("jobs"), test.path("s")
STATE = os.path.join(SLURM, "state")
os.makedirs(STATE)
for name in ("sbatch", "squeue", "scancel", "scontrol"):
    os.symlink(os.path.join(ut.ROOT, "tests", "harness", "fake_slurm.py"), os.path.join(SLURM, name))
os.environ["PATH"] = SLURM + ":/usr/bin:/bin"
scene = test.scene("city", 3)
expected = {}


def start(interval="200ms"):
    return test.daemon("--jobs", JOBS, "--executor", "slurm", "--slurm-options",
                       "--partition=bake  --qos=low", "--bake-threads", 1, "--bake-tile", 256,
                       "--executor-interval", interval, "--listen", "unix:" + SOCKET)


def cli(*words):
    done = ut.run("umbrage", *words, "--json", "--address", "unix:" + SOCKET, code=None)
    assert done.stdout, done.stderr
    return json.loads(done.stdout)


def fault(name, count=1):
    with open(os.path.join(STATE, name), "w", encoding="ascii") as file:
        file.write(str(count))


def mend(name):
    os.unlink(os.path.join(STATE, name))


def calls(word):
    with open(os.path.join(STATE, "calls"), encoding="ascii") as file:
        return [line for line in file if line.startswith(word)]


def queue():
    return [name for name in os.listdir(STATE) if name.startswith("task.")]


def settings(azimuth):
    return ("--resolution", 512, "--sun", f"{azimuth},50", "--verify", 1000)


def bake(azimuth, epoch=1):
    """One job of four tiles, with its id compared."""
    done = cli("submit", scene, *settings(azimuth), "--wait")
    plain = test.bake(scene, test.path("plain.umb"), *settings(azimuth))["asset"]
    assert done["state"] == "done" and done["asset"] == plain and done["epoch"] == epoch, done
    assert (done["tiles"], done["tiles_done"]) == (4, 4), done
    return done


daemon = start()

with test.check("an array of tiles and a merge give the id of one bake"):
    done = bake(10)
    assert "effect=" in done["plan"], done
    first = calls("sbatch")
    assert len(first) == 2 and "--array=0-3 " in first[0] and "--array" not in first[1], first
    assert "--partition=bake --qos=low " in first[0], first
    for call in first:  # the tasks are shut in, and the scene is one that this try read
        assert " --sandbox=required " in call and f" --scene-buffer={JOBS}/work/" in call, call
    assert "import" not in first[0] and ".glb" not in "".join(first)  # no foreign format leaves here
    assert not queue() and not os.listdir(os.path.join(JOBS, "work"))

with test.check("tiles that an earlier job left are found"):
    done = cli("submit", scene, "--resolution", 512, "--sun", "10,50", "--verify", 2000, "--wait")
    assert (done["tiles_done"], done["tiles_found"]) == (4, 4), done

with test.check("submissions that the controller forgot are made again"):
    fault("lose", 2)  # the array, and the one that replaces it
    bake(20)
    assert daemon.metric("umbrage_job_task_failures_total") == 8

with test.check("tasks that run twice give the same"):
    fault("twice")
    bake(30)
    mend("twice")

with test.check("tasks that are killed and vanish are given out again, alone"):
    before = len(calls("sbatch"))
    fault("kill", 2)
    bake(40)
    arrays = [call for call in calls("sbatch")[before:] if "--array" in call]
    # The task is found missing in one look, or in two looks one after the other.
    again = {word for call in arrays[1:] for word in call.split() if word.startswith("--array=")}
    assert again in ({"--array=0-1"}, {"--array=0", "--array=1"}) and len(arrays) <= 3, arrays

with test.check("tasks that wait for their time only are started"):
    fault("held")
    bake(50)
    mend("held")
    assert calls("scontrol update")

with test.check("a controller that is away is waited for"):
    fault("down")
    job = cli("submit", scene, *settings(60))["job"]
    before = len(calls("squeue"))
    ut.wait_until(lambda: len(calls("squeue")) > before + 2, 60, "it is asked")
    mend("down")
    done = cli("watch", job)
    assert done["state"] == "done" and done["epoch"] == 1, done

with test.check("a farm that answers and takes nothing is asked again, and its refusal is logged once"):
    fault("refuse")
    failures, before = daemon.metric("umbrage_job_task_failures_total"), len(calls("sbatch"))
    job = cli("submit", scene, *settings(65))["job"]
    ut.wait_until(lambda: len(calls("sbatch")) > before + 2, 60, "it is asked")
    assert daemon.metric("umbrage_job_task_failures_total") == failures + 1
    assert daemon.log().count("Invalid partition name specified") == 1
    mend("refuse")
    done = cli("watch", job)
    assert done["state"] == "done" and done["epoch"] == 1, done

with test.check("a scene that cannot be used, and settings that are none, never reach the farm"):
    before = len(calls("sbatch"))
    with open(test.path("bad.obj"), "w", encoding="ascii") as file:
        file.write("v 0 0 nan\nf 1 2 3\n")
    for words in ((test.path("bad.obj"),), (scene, "--resolution", 1000)):
        done = cli("submit", *words, "--wait")
        assert done["failure"] == "rejected" and len(done["cause"]) > 10, done
    assert len(calls("sbatch")) == before

with test.check("first occluders come in tiles; a bake whose tiles cannot be kept is one task"):
    for kind in (("--effect", "front=on"), ("--effect", "penumbra=on"), ("--depth", "embree")):
        words = ("--resolution", 512, *kind, "--sun", "120,40", "--verify", 1000)
        before = len(calls("sbatch"))
        done = cli("submit", scene, *words, "--wait")
        plain = test.bake(scene, test.path("plain.umb"), *words)["asset"]
        assert done["state"] == "done" and done["asset"] == plain, done
        arrays = [call for call in calls("sbatch")[before:] if "--array" in call]
        assert (len(arrays) > 0) == (kind[0] == "--effect"), (kind, arrays)

with test.check("a cancelled job leaves nothing in the queue"):
    fault("held")
    job = cli("submit", scene, *settings(70))["job"]
    ut.wait_until(queue, 60, "the tasks are in the queue")
    assert cli("cancel", job)["failure"] == "cancelled"
    ut.wait_until(lambda: not queue(), 60, "the queue is empty")

with test.check("what a killed daemon had submitted is ended by the next one, and its job is done"):
    job = cli("submit", scene, *settings(80))["job"]
    # Waits for all four: an sbatch that outlives the daemon would submit the others after the
    # search.
    ut.wait_until(lambda: len(queue()) == 4, 60, "all tasks are in the queue")
    daemon.kill()
    mend("held")
    fault("down")  # the tasks that wait are not ended by their folder, as they do not run
    daemon = start("20s")  # the job is done before the first look at the queue
    mend("down")
    done = cli("watch", job)
    assert done["state"] == "done" and done["epoch"] == 2, done
    ut.wait_until(lambda: not queue(), 60, "the queue is empty")

test.finish()
