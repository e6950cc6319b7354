#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Tiles of the daemon's jobs: their progress must be reported while they are baked. After an edit only
the tiles that it reaches may be baked, and the id must be that of a full bake. A daemon that was
killed must not repeat finished tiles.
"""
import json
import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
JOBS, SOCKET = test.path("jobs"), test.path("s")
SETTINGS = ("--resolution", 2048, "--sun", "140,38")
DONE, BAKED, FOUND = ('umbrage_job_tiles{state="done"}', 'umbrage_job_tiles_total{how="baked"}',
                      'umbrage_job_tiles_total{how="found"}')


HELD_BAKE, HOLD = test.held_bakes()


def start():
    return test.daemon("--jobs", JOBS, "--bake-threads", 1, "--bake-tile", 256, "--bake-program",
                       HELD_BAKE, "--listen", "unix:" + SOCKET)


def metric(name):
    """One labelled figure of the daemon."""
    return next(float(line.rpartition(" ")[2]) for line in daemon.admin("/metrics")[1].splitlines()
                if line.startswith(name + " "))


def cli(*words):
    return json.loads(ut.run("umbrage", *words, "--json", "--address", "unix:" + SOCKET).stdout)


def write_city(path, x):
    """A plate with 100 boxes and a small one above them, at x."""
    boxes = [((-100, -100, -1), (100, 100, 0)), ((x, -1.5, 9), (x + 1, -0.5, 10))]
    for i in range(100):
        left, front = 19 * (i % 10) - 95, 19 * (i // 10) - 95
        boxes.append(((left, front, 0.01), (left + 7, front + 9, 1 + i % 7)))
    with open(path, "w", encoding="ascii") as out:
        for number, (low, high) in enumerate(boxes):
            for i in range(8):
                print("v", *((low, high)[i >> axis & 1][axis] for axis in range(3)), file=out)
            for face in ((1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3),
                         (2, 4, 8, 6)):
                print("f", *(8 * number + corner for corner in face), file=out)


daemon = start()
scene, moved = test.path("a.obj"), test.path("b.obj")
write_city(scene, -60)
write_city(moved, -10)

with test.check("a job of 64 tiles tells them all, and has the id of one tile"):
    whole = test.bake(scene, test.path("a.umb"), *SETTINGS, "--verify", 1000)["asset"]
    job = cli("submit", scene, *SETTINGS, "--verify", 1000, "--wait")
    assert job["asset"] == whole, job
    assert (job["tiles"], job["tiles_done"], job["tiles_found"]) == (64, 64, 0), job
    assert (metric(BAKED), metric(FOUND)) == (64, 0)

with test.check("after an edit only the tiles are baked that it reaches, and the id is a full bake's"):
    full = test.bake(moved, test.path("b.umb"), *SETTINGS, "--verify", 1000)["asset"]
    edited = cli("submit", moved, *SETTINGS, "--verify", 1000, "--wait")
    assert edited["asset"] == full != whole, edited
    baked = edited["tiles_done"] - edited["tiles_found"]
    print(f"{baked} of 64 tiles are baked again")
    assert edited["tiles_done"] == 64 and 2 <= baked <= 12, edited
    assert (metric(BAKED), metric(FOUND)) == (64 + baked, 64 - baked)

with test.check("a job whose tiles cannot be kept is baked all the same"):
    assert cli("submit", scene, "--resolution", 512, "--depth", "embree", "--verify", 1000,
               "--wait")["state"] == "done"

with test.check("a daemon that is killed repeats no tile that was finished"):
    open(HOLD, "w", encoding="ascii").close()
    job = cli("submit", scene, "--resolution", 4096, "--sun", "90,50", "--verify", 1000)["job"]
    ut.wait_until(lambda: metric(DONE) >= 20, 60, "tiles are done")
    done = metric(DONE)
    daemon.kill()
    os.remove(HOLD)
    daemon = start()
    again = cli("watch", job)
    assert again["state"] == "done" and again["epoch"] == 2, again
    print(f"{done:.0f} tiles were done before, {again['tiles_found']} were found")
    assert again["tiles"] == 256 and again["tiles_found"] >= done, again

test.finish()
