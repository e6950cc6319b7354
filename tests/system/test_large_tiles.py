#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Tiles of 1K to 16K at a resolution of 16K: one id, whatever the tile, the threads, the instructions, the memory,
and whether the bake was killed and resumed; and --memory is kept: the peak of the process stays below it.
"""
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time

import test_tiles

BUILD = os.environ.get("BUILD", "build/release")
BAKE = os.path.join(BUILD, "umbrage-bake")
SETTINGS = ["--resolution", "16384", "--sun", "140,38", "--verify", "0", "--quiet", "--json"]
MIB = 1 << 20
check = test_tiles.check


def make_town():
    draw = random.Random(3)
    boxes = [((-100, -100, -1), (100, 100, 0))]
    for i in range(16):
        x, y = 50 * (i % 4) - 96, 50 * (i // 4) - 96
        boxes.append(((x, y, 0.01), (x + 9 + 20 * draw.random(), y + 30, 3 + 30 * draw.random())))
    return boxes


def bake(*words):
    """Runs a bake; returns its report and the peak of its memory in bytes."""
    with subprocess.Popen([BAKE, *words, *SETTINGS], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True) as process:
        out, talk = process.stdout.read(), process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        check(" ".join(words), False, talk)
        return {"asset": None}, 0
    return json.loads(out), usage.ru_maxrss * 1024


def determinism(folder, scene):
    out = os.path.join(folder, "a.umb")
    first, _ = bake(scene, "-o", out, "--tile", "4096", "--threads", "1")
    for words in (["--tile", "1024", "--threads", "4"], ["--tile", "2048", "--threads", "2"],
                  ["--tile", "8192", "--threads", "4"], ["--tile", "16384", "--threads", "2"],
                  ["--depth", "plain", "--tile", "4096"]):
        report, _ = bake(scene, "-o", out, *words)
        check(f"{' '.join(words)}: the same id", report["asset"] == first["asset"], report)
    cache = os.path.join(folder, "cache")
    words = [scene, "-o", out, "--tile", "1024", "--cache", cache]
    os.unlink(out)
    # One thread, so that the bake is far from its end when the hundredth tile is seen.
    with subprocess.Popen([BAKE, *words, "--threads", "1", *SETTINGS],
                          stdout=subprocess.DEVNULL) as process:
        while process.poll() is None and not (os.path.isdir(cache) and len(os.listdir(cache)) > 99):
            time.sleep(0.001)
        process.kill()
    check("the kill hit a running bake", process.returncode == -signal.SIGKILL
          and not os.path.exists(out), process.returncode)
    report, _ = bake(*words)
    check("killed and resumed: the same id", report["asset"] == first["asset"], report)
    check("killed and resumed: 99 tiles or more found, others baked",
          99 <= report["tiles_found"] < report["tiles"], report)
    return first["asset"]


def memory(folder, scene, asset):
    """The limit of memory, where it is tight: the tile must become smaller, or the bake must
    refuse."""
    out = os.path.join(folder, "a.umb")
    for size, closed, cached in ((100, "auto", 1), (100, "off", 0), (200, "off", 1)):
        words = ["--memory", f"{size}MiB", "--closed", closed]
        words += ["--cache", os.path.join(folder, closed + str(size))] if cached else []
        report, peak = bake(scene, "-o", out, *words)
        check(f"{' '.join(words[:4])}{' with a cache' if cached else ''}: peak {peak // MIB} MiB",
              0 < peak <= size * MIB)
        check("and the same id", closed == "off" or report["asset"] == asset, report)


def main():
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with tempfile.TemporaryDirectory() as folder:
        scene = os.path.join(folder, "town.obj")
        test_tiles.write_boxes(scene, make_town())
        memory(folder, scene, determinism(folder, scene))
    return 1 if test_tiles.failures else 0


if __name__ == "__main__":
    sys.exit(main())
