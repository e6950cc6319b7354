#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
bench_python.py [POINTS]: races the Python module (python_turns.py) with a C program (python_peer.c) on the same points,
turn by turn: large batches on one thread and on two, and the extra cost of a batch of 64 points. Then the module is
compared with one Embree ray a point from the same script (embree_loop.py), call by call and in one call. Prints one
JSON object a row.
"""
import json
import os
import statistics
import subprocess
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "harness"))
import umbrage_test as ut  # noqa: E402

umbrage, np = ut.need_module()
import embree_loop  # noqa: E402
test = ut.Test()
BATCH = 65536  # points of a call of the C program
COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000
PAIRS, TURNS = 7, 6  # new processes, and turns of each: the places that a process gets in memory are worth 3 %
ROUNDS = 7
ASSET, POINTS = test.path("city.umbm"), test.path("points.f32")
SCENE = test.scene("city", 20, form="ply")
test.bake(SCENE, test.path("city.umb"), "--resolution", 8192, "--closed", "off", "--sun", "135,45",
          "--verify", 0)
ut.run("umbrage", "unpack", test.path("city.umb"), "-o", ASSET, "--quiet")
asset = umbrage.open(ASSET)
low, high = (np.array(corner) for corner in asset.info.bounds)
side = int(COUNT ** 0.5)
x, y = np.meshgrid(np.linspace(low[0], high[0], side), np.linspace(low[1], high[1], side))
points = np.stack([x.ravel(), y.ravel(), np.full(x.size, (low[2] + high[2]) / 3)], 1).astype(np.float32)
points.tofile(POINTS)


class Side:
    """A program that answers the points once for each turn."""

    def __init__(self, *words):
        self.process = subprocess.Popen([str(word) for word in words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                        env={**os.environ, "PYTHONPATH": os.path.join(ut.BUILD, "python")})

    def turn(self):
        """Seconds by the clock, and of processors."""
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return tuple(float(word) for word in self.process.stdout.readline().split())

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def race_batches(threads):
    """Turns of both programs on all points: seconds as race() has them. The first of a turn changes from turn to turn."""
    turns = []
    for _ in range(PAIRS):
        ours = Side(sys.executable, os.path.join(HERE, "python_turns.py"), ASSET, POINTS, threads)
        theirs = Side(ut.program("python_peer"), ASSET, POINTS, threads, BATCH)
        ours.turn(), theirs.turn()
        for number in range(TURNS):
            if number % 2:
                turns.append((*ours.turn(), *theirs.turn()))
            else:
                peer = theirs.turn()
                turns.append((*ours.turn(), *peer))
        ours.close(), theirs.close()
    return turns


def timed(call):
    """Seconds of a call by the clock, and of processors."""
    begin, busy = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - begin, time.process_time() - busy


def race(ours, theirs):
    """ROUNDS turns: our seconds by the clock and of processors, then theirs."""
    ours(), theirs()
    return [(*timed(ours), *theirs()) for _ in range(ROUNDS)]


def show(row, value, count, scale, turns, **more):
    """Prints a row: the value of median times, and these times of one of `count` items."""
    wall, busy, peer_wall, peer_busy = (statistics.median(column) / count * 1e9 / scale for column in zip(*turns))
    print(json.dumps({"row": row, "value": value(busy, peer_busy), "value_by_clock": value(wall, peer_wall),
                      "python": round(busy, 2), "peer": round(peer_busy, 2), "python_by_clock": round(wall, 2),
                      "peer_by_clock": round(peer_wall, 2), **more}))


# Values are of processors' time: on a busy machine the clock counts other programs, and threads wait for each other.
for threads in (1, 2):
    turns = race_batches(threads)
    least = round(min(turn[3] for turn in turns) / min(turn[1] for turn in turns), 3)
    show(f"python_vs_c_threads{threads}", lambda ours, theirs: round(theirs / ours, 3), len(points), 1, turns,
         unit="ns a point", value_of_least=least)

SMALL, BATCHES = 64, 20000
few = points[:SMALL * BATCHES]
few.tofile(test.path("few.f32"))
batches = [few[i:i + SMALL] for i in range(0, len(few), SMALL)]


def small():
    for batch in batches:
        asset.query(batch, taps=9)


peer = Side(ut.program("python_peer"), ASSET, test.path("few.f32"), 1, SMALL)
times = race(small, peer.turn)
peer.close()
show("python_call_us", lambda ours, theirs: round(ours - theirs, 2), len(batches), 1000, times, unit="us a batch of 64")

# Rays from every fiftieth point: a Python loop over all of them takes minutes.
RAYS = 200_000
some = np.ascontiguousarray(points[:len(points) // RAYS * RAYS].reshape(RAYS, -1, 3)[:, 0]) if len(points) > RAYS else points
towards = -np.array(asset.lights[0].direction, np.float32)
scene = embree_loop.Scene(*embree_loop.read_ply(SCENE))
lit = asset.query(some, taps=1)
for name, ask in (("call", scene.lit_by_call), ("batch", scene.lit_by_batch)):
    same = float((ask(some, towards) == (lit > 0.5)).mean())
    assert same > 0.97, f"{same:.4f} of the answers are the rays'"  # voxels of 0.1 m at edges
    times = race(lambda: asset.query(some, taps=1), lambda: timed(lambda: ask(some, towards)))
    show(f"embree_{name}_factor", lambda ours, theirs: round(theirs / ours, 1), len(some), 1, times, unit="ns a point",
         same=round(same, 5))
asset.close()
