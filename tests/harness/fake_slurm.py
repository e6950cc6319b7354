#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Imitates a Slurm cluster of one machine, for tests of the daemon's Slurm executor without Slurm. The
commands sbatch, squeue, scancel and scontrol print and do what the executor relies on. The names
are links to this file; state lies in `state` beside them, a file a task; faults are files there:

    down        every command fails, as with a dead controller
    refuse      sbatch fails, as with a partition that is none or full
    lose        the next so many submissions get a number and are forgotten
    twice       every task is run a second time, at the same time
    held        tasks wait as "BeginTime" until scontrol says StartTime=now
    kill        the next so many tasks are killed as they start, and leave the queue
    calls       written: a line for each command
"""
import json
import os
import signal
import subprocess
import sys
import time

HERE = os.path.realpath(__file__)


def path(*names):
    return os.path.join(STATE, *names)


def take(name):
    """Returns 1 and uses up one fault, if a counted fault has any left."""
    try:
        with open(path(name), encoding="ascii") as file:
            left = int(file.read() or "1")
    except OSError:
        return False
    if left <= 1:
        os.unlink(path(name))
    else:
        with open(path(name), "w", encoding="ascii") as file:
            file.write(str(left - 1))
    return True


def write(task):
    with open(path("task." + task["id"] + ".new"), "w", encoding="ascii") as file:
        json.dump(task, file)
    os.rename(path("task." + task["id"] + ".new"), path("task." + task["id"]))


def tasks():
    for name in sorted(os.listdir(STATE)):
        if name.startswith("task.") and not name.endswith(".new"):
            try:
                with open(path(name), encoding="ascii") as file:
                    yield json.load(file)
            except OSError:
                pass  # it has just ended


def numbers(array):
    for part in array.split(","):
        first, _, last = part.partition("-")
        yield from range(int(first), int(last or first) + 1)


def sbatch(words):
    if os.path.exists(path("refuse")):
        sys.exit("sbatch: error: Batch job submission failed: Invalid partition name specified")
    options = {}
    while words and words[0].startswith("--"):
        name, _, value = words.pop(0).partition("=")
        options[name] = value
    with open(path("numbers"), "a", encoding="ascii") as file:
        file.write("x")
        number = str(file.tell())
    print(number)
    if take("lose"):
        return
    with open(words[0], encoding="ascii") as file:
        script = file.read()
    with open(path("script." + number), "w", encoding="ascii") as file:
        file.write(script)
    array = options.get("--array")
    for index in numbers(array) if array else [None]:
        write({"id": number if index is None else f"{number}_{index}", "index": index,
               "name": options["--job-name"], "script": path("script." + number),
               "words": words[1:], "number": number, "pid": 0,
               "held": os.path.exists(path("held"))})
    subprocess.Popen([sys.executable, HERE, "node", number], stdin=subprocess.DEVNULL,
                     stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                     start_new_session=True, close_fds=True)


def node(number):
    """Runs the tasks of one submission, one after the other."""
    waiting = True
    while waiting:
        waiting = False
        for task in tasks():
            if task["number"] != number:
                continue
            waiting = True
            if task["held"]:
                time.sleep(0.05)
                continue
            run(task)


def run(task):
    env = {"SLURM_JOB_ID": task["number"], "PATH": os.environ["PATH"]}
    if task["index"] is not None:
        env["SLURM_ARRAY_TASK_ID"] = str(task["index"])
    killed = take("kill")
    count = 2 if os.path.exists(path("twice")) else 1
    runs = [subprocess.Popen(["/bin/sh", task["script"], *task["words"]], cwd="/",
                             env={**env, "SLURM_RESTART_COUNT": str(i)}, start_new_session=True)
            for i in range(count)]
    write({**task, "pid": runs[0].pid})
    for child in runs:
        if killed:
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()
    if os.path.exists(path("task." + task["id"])):
        os.unlink(path("task." + task["id"]))


def squeue():
    for task in tasks():
        state = "PD" if task["pid"] == 0 else "R"
        reason = "BeginTime" if task["held"] else "None" if state == "R" else "Resources (of a node)"
        index = "N/A" if task["index"] is None else task["index"]
        print(task["id"], index, state, task["name"], reason)


def scancel(words):
    for task in list(tasks()):
        if task["id"] in words or task["number"] in words:
            if os.path.exists(path("task." + task["id"])):
                os.unlink(path("task." + task["id"]))
            if task["pid"]:
                try:
                    os.killpg(task["pid"], signal.SIGKILL)
                except ProcessLookupError:
                    pass


def scontrol(words):
    assert words[0] == "update" and words[2] == "StartTime=now", words
    for task in list(tasks()):
        if task["id"] in words[1].removeprefix("JobId=").split(","):
            write({**task, "held": False})


def main(name, words):
    if name == "fake_slurm.py":
        node(words[1])
        return 0
    with open(path("calls"), "a", encoding="ascii") as file:
        file.write(name + " " + " ".join(words) + "\n")
    if os.path.exists(path("down")):
        print(f"{name}: error: Unable to contact slurm controller", file=sys.stderr)
        return 1
    if name == "squeue":
        squeue()
    else:
        {"sbatch": sbatch, "scancel": scancel, "scontrol": scontrol}[name](words)
    return 0


# Its place tells the state folder: workers get a near-empty environment.
STATE = os.path.join(os.path.dirname(os.path.abspath(sys.argv[0])), "state") \
    if os.path.basename(sys.argv[0]) != "fake_slurm.py" else os.environ["FAKE_SLURM"]
if __name__ == "__main__":
    os.environ["FAKE_SLURM"] = STATE
    sys.exit(main(os.path.basename(sys.argv[0]), sys.argv[1:]))
