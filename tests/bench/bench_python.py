#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
bench_python.py [POINTS]: races the Python module with a C program (python_peer.c) on the same points, round by
round: large batches on one thread and on two, and the extra cost of a batch of 64 points. Then the module is
compared with one Embree ray a point, whose time `umbrage verify` prints. Prints one JSON object a row.
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
test = ut.Test()
COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000
ROUNDS = 7
ASSET, POINTS = test.path("city.umbm"), test.path("points.f32")
test.bake(test.scene("city", 20), test.path("city.umb"), "--resolution", 8192, "--closed", "off", "--sun", "135,45",
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
        return float(self.process.stdout.readline())

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def timed(call):
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def race(ours, peer):
    """Medians of seconds, ours and the peer's, in turns."""
    ours(), peer.round()
    pairs = [(timed(ours), peer.round()) for _ in range(ROUNDS)]
    peer.close()
    return [statistics.median(column) for column in zip(*pairs)]


for threads in (1, 2):
    mine, theirs = race(lambda: asset.query(points, taps=9, threads=threads, out=values), Peer(threads, 65536))
    print(json.dumps({"row": f"python_vs_c_threads{threads}", "value": round(theirs / mine, 3),
                      "python_ns": round(mine * 1e9 / len(points), 2), "c_ns": round(theirs * 1e9 / len(points), 2)}))

SMALL, BATCHES = 64, 20000
few = points[:SMALL * BATCHES]
few.tofile(test.path("few.f32"))
batches = [few[i:i + SMALL] for i in range(0, len(few), SMALL)]


def small():
    for batch in batches:
        asset.query(batch, taps=9)


mine, theirs = race(small, Peer(1, SMALL, test.path("few.f32")))
print(json.dumps({"row": "python_call_us", "value": round((mine - theirs) / len(batches) * 1e6, 2),
                  "python_us": round(mine / len(batches) * 1e6, 2), "c_us": round(theirs / len(batches) * 1e6, 2)}))
asset.close()
