#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
A file of the daemon's cache that was written in part must never be used. A daemon starts on a store
without cache, and each call on the cache folder fails in turn, or the daemon is killed at it. Then:

- a daemon that lives answers right, drains, leaves no temporary, and its cache is whole or absent;
- after a kill the next daemon answers right and rebuilds the same cache, byte for byte;
- strays of a killed daemon are swept once they are an hour old, and not before.
"""
import os
import shutil
import subprocess
import time

import fault_sweep as fs
from fault_sweep import ut

test = ut.Test(limit_s=1500)
sweep = fs.Sweep(test)
SEED = 5
OLD_S = 2 * 3600  # UMBS_STORE_TEMPORARY_AGE_S is one hour
CALLS = "write,pwrite,fsync,fdatasync,rename,renameat,open,openat,mmap,ftruncate,close,mkdir"
WAYS = ("EIO", "ENOMEM") if fs.SHORT else ("EIO", "ENOSPC", "EINTR", "ENOMEM", "EMFILE", "short")
FATAL = ("tear",) if fs.SHORT else ("kill", "tear")
print(f"seed {SEED}")

store = test.path("store")
cache = os.path.join(store, ".umbrage-cache")
asset = os.path.join(store, "city.umb")
os.mkdir(store)
asset_id = test.bake(test.scene("city", 2, form="ply"), asset, "--resolution", 256, "--verify",
                     0)["asset"]
points = ut.floats(ut.random_points((-100, -100, -10), (100, 100, 80), 2000, SEED))
answers = test.query_file(asset, points, "--taps", 3)
assert len(set(ut.from_floats(answers))) > 2, "points that tell nothing"


def ask(daemon):
    """Answers of a daemon; they must be the file's."""
    got = test.query_file("city", points, "--taps", 3, "--address", "unix:" + daemon.socket_path)
    assert got == answers, "other answers than the file's"


def cached():
    """Files of the cache beside its key, lock and list, which may be there or not."""
    return (sorted(set(os.listdir(cache)) - {"key", "lock", "proven"}) if os.path.isdir(cache)
            else [])


def read_cache():
    with open(os.path.join(cache, asset_id + ".umbm"), "rb") as file:
        return file.read()


def age(names):
    then = time.time() - OLD_S
    for name in names:
        os.utime(os.path.join(cache, name), (then, then))


def start(*args, **named):
    """A daemon with a fault; None if it is killed."""
    shutil.rmtree(cache, ignore_errors=True)
    fs.forget_trace(test.path("trace"))
    sweep.runs += 1
    with sweep.injected(CALLS, *args, under=cache, trace=test.path("trace"), **named) as board:
        if args[0] not in FATAL:
            return board, test.daemon("--workers", 1)
        process = subprocess.Popen([ut.program("umbraged"), "--store", store, "--listen",
                                    "unix:" + test.path("killed.sock")],
                                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        code = process.wait(fs.HANG_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        raise AssertionError("it was not killed") from None
    assert code == fs.KILLED, f"exit code {code}"
    return board, None


def stop(daemon):
    daemon.stop()
    test.daemons.remove(daemon)


def survive(way, at, keep):
    board, daemon = start(way, at=at, keep=keep)
    ask(daemon)
    stop(daemon)
    assert board.faults >= 1, "the call was not made"
    names = cached()
    assert names in ([], [asset_id + ".umbm"]), f"left in the cache: {names}"
    assert not names or read_cache() == good, "the cache is not whole"
    fs.failed_fsyncs_are_final(fs.read_trace(test.path("trace")))


def be_killed(way, at, old):
    start(way, at=at)
    strays = [name for name in cached() if name != asset_id + ".umbm"]
    assert all(name.startswith(".tmp.") for name in strays), f"nobody sweeps {strays}"
    if old:
        age(strays)
    daemon = test.daemon("--workers", 1)
    ask(daemon)
    assert read_cache() == good, "the cache is not whole"
    left = [name for name in cached() if name != asset_id + ".umbm"]
    assert left == ([] if old else strays), f"strays {strays}, afterwards {left}"
    stop(daemon)
    return len(strays)


with test.check("an undisturbed daemon writes its cache by sync, rename, sync of the folder"):
    whole, first = start("EIO", at=0)
    ask(first)
    loading = whole.calls  # the rest is made by its end, which a killed one never comes to
    stop(first)
    good = read_cache()
    count = whole.calls
    functions = [function for function, _, _ in fs.read_trace(test.path("trace"))]
    named = functions.index("rename")
    assert "fsync" in functions[:named] and "fsync" in functions[named:], functions
    assert cached() == [asset_id + ".umbm"], cached()
    print(f"    {count} calls: {' '.join(functions)}")

for way in WAYS:
    failures = fs.Failures()
    with test.check(f"a daemon answers right while any call on its cache fails: {way}"):
        for at in sweep.points(count):
            for keep in (False,) if way in ("short", "EINTR") or fs.SHORT else (False, True):
                with failures.point("from" if keep else "at", "call", at, functions[at - 1]):
                    survive(way, at, keep)
        print(f"    {failures.done} starts")
        failures.end()

for way in FATAL:
    failures = fs.Failures()
    with test.check(f"a daemon after one killed at any call on the cache answers right: {way}"):
        seen = 0
        for at in sweep.points(loading):
            with failures.point("at call", at, functions[at - 1]):
                seen += be_killed(way, at, old=at % 2 == 0)
        print(f"    {failures.done} kills, {seen} strays")
        failures.end()
        assert seen > 0, "no kill left a stray: the sweep was not tested"

test.finish()
