#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
bench_python.py [POINTS]: races the Python module with a C program (python_peer.c) on the same points, round by
round: large batches on one thread and on two, and the extra cost of a batch of 64 points. Then the module is
compared with one Embree ray a point from the same script (embree_loop.py), call by call and in one call. Prints one
JSON object a row.
"""
import json
import os
import statistics
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

umbrage, np = ut.need_module()
import embree_loop  # noqa: E402
test = ut.Test()
COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000
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
values = np.empty(len(points), np.float32)


class Peer:
    """The C program, a round at a time."""

    def __init__(self, threads, batch, file=POINTS):
        self.process = subprocess.Popen([ut.program("python_peer"), ASSET, file, str(threads), str(batch)],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def round(self):
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return tuple(float(word) for word in self.process.stdout.readline().split())

    def close(self):
        self.process.stdin.close()
        self.process.wait()


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
    """Prints a row: the median of `value` over the turns, and median times of one of `count` items. A turn's two runs
    meet the same load, so a ratio of a turn wanders less than a ratio of medians."""
    wall, busy, peer_wall, peer_busy = (round(statistics.median(column) * 1e9 / count / scale, 2) for column in zip(*turns))
    print(json.dumps({"row": row, "value": statistics.median(value(one[1], one[3]) for one in turns),
                      "value_by_clock": statistics.median(value(one[0], one[2]) for one in turns), "python": busy,
                      "peer": peer_busy, "python_by_clock": wall, "peer_by_clock": peer_wall, **more}))


# Values are of processors' time: on a busy machine the clock counts other programs, and threads wait for each other.
for threads in (1, 2):
    peer = Peer(threads, 65536)
    times = race(lambda: asset.query(points, taps=9, threads=threads, out=values), peer.round)
    peer.close()
    show(f"python_vs_c_threads{threads}", lambda ours, theirs: round(theirs / ours, 3), len(points), 1, times, unit="ns a point")

SMALL, BATCHES = 64, 20000
few = points[:SMALL * BATCHES]
few.tofile(test.path("few.f32"))
batches = [few[i:i + SMALL] for i in range(0, len(few), SMALL)]


def small():
    for batch in batches:
        asset.query(batch, taps=9)


peer = Peer(1, SMALL, test.path("few.f32"))
times = race(small, peer.round)
peer.close()
show("python_call_us", lambda ours, theirs: round((ours - theirs) / len(batches) * 1e6, 2), len(batches), 1000, times,
     unit="us a batch of 64")

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
