#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""One scene and one set of settings have one id, whoever built the program and however it runs.

    tests/system/determinism.py BUILD...

Each program of each BUILD (gcc and clang, -O2 and -O3: `make determinism` makes them) bakes each case with tiles of
1024 to the whole map, in turn with the rasteriser for this processor and the portable one, and with 1, 2 and 4 threads,
so that all builds and tile sizes run with each of these. One bake is killed in the middle and resumed. Ends with 1 if
two ids of a case differ. test_determinism.sh is the short form, with one build, and part of `make test`.
UMBRAGE_DETERMINISM_LOG2 (14) is the resolution."""

import json
import os
import subprocess
import sys
import tempfile
import time

LOG2 = int(os.environ.get("UMBRAGE_DETERMINISM_LOG2", "14"))
THREADS = (1, 2, 4)
SUN = ("--sun", "140,38")
# name, kind of scenegen and its size, options
CASES = (
    ("city", "city", 20, SUN),
    ("city with front", "city", 12, (*SUN, "--effect", "front=on")),
    ("city open", "city", 12, (*SUN, "--closed", "off")),
    ("terrain", "terrain", 256, SUN),
    ("walls", "arch", 8, SUN),
    ("three suns", "bridge", 30, (*SUN, "--sun", "200,50", "--sun", "80,20")),
    ("lamps", "city", 8, ("--point", "3,5,25", "--spot", "-200,100,120,0.5,-0.3,-1,60")),
)


def words(build, scene, out, *options):
    return [os.path.join(build, "umbrage-bake"), scene, "-o", out, "--resolution", str(1 << LOG2),
            "--verify", "0", "--memory", "8GiB", "--quiet", "--json", *map(str, options)]


def bake(*arguments):
    done = subprocess.run(words(*arguments), capture_output=True, text=True)
    if done.returncode != 0:
        return {"asset": f"failed ({done.returncode}): {done.stderr.strip()}"}
    return json.loads(done.stdout)


def resumed(build, scene, out, cache, *options):
    """A bake that is killed when some tiles are done, and done again."""
    options = (*options, "--tile", 1024, "--cache", cache)
    with open(os.devnull, "w", encoding="ascii") as nowhere:
        process = subprocess.Popen(words(build, scene, out, *options), stdout=nowhere, stderr=nowhere)
        while process.poll() is None:
            if os.path.isdir(cache) and sum(n.endswith(".umbt") for n in os.listdir(cache)) >= 5:
                process.kill()
            time.sleep(0.002)
    return bake(build, scene, out, *options)


def runs(builds):
    """(build, what is said of the run, options; None: killed and resumed)."""
    for number, build in enumerate(builds):
        for tile in range(10, LOG2 + 1):
            depth = ("raster", "plain")[(number + tile) % 2]
            threads = THREADS[(number + tile) % len(THREADS)]
            yield build, f"{depth}, tiles of {1 << tile}, {threads} threads", (
                "--depth", depth, "--tile", 1 << tile, "--threads", threads)
        yield build, "killed and resumed", None


def main(builds):
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "a.umb")
        for name, kind, size, options in CASES:
            scene = os.path.join(folder, f"{kind}{size}.ply")
            subprocess.run([os.path.join(builds[0], "scenegen"), kind, "--size", str(size), "-o", scene],
                           check=True, stderr=subprocess.DEVNULL)
            first, count, start = None, 0, time.monotonic()
            for number, (build, said, how) in enumerate(runs(builds)):
                if how is None:
                    result = resumed(build, scene, out, os.path.join(folder, f"{name}{number}"), *options)
                    said += f" ({result.get('tiles_found', 0)} tiles found)"
                else:
                    result = bake(build, scene, out, *options, *how)
                first = first or result["asset"]
                count += 1
                if result["asset"] != first:
                    bad += 1
                    print(f"DIFFERS {name}: {build}, {said}: {result['asset']}", flush=True)
            seconds = time.monotonic() - start
            print(f"{name}: {count} bakes, id {first[:16]} ({seconds:.0f} s)", flush=True)
    print("all ids agree" if bad == 0 else f"{bad} bakes differ")
    return bad != 0


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1:]))
