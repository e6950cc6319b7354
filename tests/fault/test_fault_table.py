#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
A job table on a disk that cannot be read: each read at the start fails in turn, first alone, then
with all later ones. The start works or is refused with the cause. A table that is sound is never
called damaged, since that sentence asks the operator to restore a copy.
"""
import hashlib
import os
import shutil
import sqlite3

import fault_sweep as fs
from fault_sweep import ut

test = ut.Test(limit_s=600)
sweep = fs.Sweep(test)
ROWS = 3000  # some hundred pages, and more than SQLite reads at once
BAKE = ut.program("umbrage-bake")
sound = test.path("sound")


def digest(number):
    return hashlib.sha256(str(number).encode()).digest()


def opened(folder, **fault):
    """The last line of a service that opens the folder, without "end "."""
    end = sweep.run(["open_jobs", BAKE], calls="pread", action="EIO", stdin=folder.encode() + b"\n",
                    **{"at": 0, **fault})
    lines = end.out.decode().splitlines()
    assert end.code == 0 and lines and lines[-1].startswith("end "), end
    return lines[-1][4:], end


with test.check("a sound table opens"):
    assert opened(sound)[0] == "ok"
    with sqlite3.connect(os.path.join(sound, "jobs.db")) as table:
        table.executemany("INSERT INTO bake VALUES(?, ?, ?)",
                          ((digest(i), digest(-i), i) for i in range(1, ROWS)))
    table.close()
    reason, whole = opened(sound)
    assert reason == "ok" and whole.calls > 50, (reason, whole.calls)

for keep in (False, True):
    with test.check(f"reads that fail {'from one on' if keep else 'once'} are told as what they are"):
        failing = fs.Failures()
        refused = 0
        for at in sweep.points(whole.calls, 60 if fs.SHORT else 400):
            with failing.point("read", at):
                folder = test.path("tried")
                shutil.rmtree(folder, ignore_errors=True)
                shutil.copytree(sound, folder)
                reason, end = opened(folder, at=at, keep=keep)
                assert end.faults > 0
                assert reason == "ok" or "disk I/O error" in reason, reason
                refused += reason != "ok"
        print(f"    {whole.calls} reads, {failing.done} starts, {refused} refused")
        failing.end()
        assert refused > 0

test.finish()
