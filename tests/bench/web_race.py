#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
One thread of node, and of headless Chromium if it is installed, against the native kernels without AVX on the same
points: `make web-race`. Node: CPU time, in turns, medians of the rounds. Chromium: wall clock, the least of twelve
rounds, beside the least of the native kernels. UMBRAGE_PACKAGE names another build of the package.

    web_race.py FILE POINTS [ROUNDS]
"""
import json
import os
import statistics
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import web_browser  # noqa: E402

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
PACKAGE = os.environ.get("UMBRAGE_PACKAGE", os.path.join(BUILD, "web", "umbrage"))
WAYS = [("box", 1), ("box", 9), ("box", 17), ("tent", 9), ("tent", 17), ("footprint", 3)]


def start(*words):
    return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)


def ask(process, filter_, taps):
    process.stdin.write(f"{filter_} {taps}\n")
    process.stdin.flush()
    return [float(number) for number in process.stdout.readline().split()]


def browse(asset, points):
    """Nanoseconds a point of each way in Chromium."""
    with tempfile.TemporaryDirectory() as folder:
        os.symlink(os.path.abspath(asset), os.path.join(folder, "asset.umb"))
        os.symlink(os.path.abspath(points), os.path.join(folder, "points.f32"))
        with open(os.path.join(folder, "ways.json"), "w", encoding="utf-8") as file:
            json.dump(WAYS, file)
        folders = {"package": PACKAGE, "race": folder, "web": os.path.join(ROOT, "tests", "web")}
        with web_browser.Browser(folders, os.path.join(folder, "profile")) as browser:
            browser.look("/web/race.html")
            return browser.result("race", 300)


def main():
    asset, points, rounds = sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 9
    native = start(os.path.join(BUILD, "base_kernels"), asset, points)
    web = start("node", os.path.join(ROOT, "tests/bench/web_race.mjs"), PACKAGE, asset, points)
    least = []
    for way in WAYS:
        ask(native, *way), ask(web, *way)  # the engine compiles what is hot
        pairs = [(ask(native, *way), ask(web, *way)) for _ in range(rounds)]
        base, ours = (statistics.median(times[0] for times in side) for side in zip(*pairs))
        ratio = statistics.median(b[0] / a[0] for a, b in pairs)
        least.append(min(a[1] for a, _ in pairs))
        print(f"{way[0]} {way[1]:2}: native baseline {base:6.1f} ns a point, WebAssembly {ours:6.1f}, ratio {ratio:.2f}")
    for process in (native, web):
        process.stdin.close()
        process.wait(10)
    if web_browser.installed():
        for way, base, ours in zip(WAYS, least, browse(asset, points)):
            print(f"{way[0]} {way[1]:2}: native baseline {base:6.1f} ns a point, Chromium {ours:6.1f}, ratio {ours / base:.2f}")


if __name__ == "__main__":
    main()
