# SPDX-License-Identifier: Apache-2.0
"""Checks that a budget is kept: `umbrage query --budget NS` runs on 10^6 points, five times each, and its time
is compared with what its calibration expected. Each query is calibrated anew and may choose another setting,
so runs are compared by taken / expected: their median must lie within 20 % of 1. Ratios that spread by more
than 15 % (without the least and the largest) do not count. `make budgets` runs it. Exit code 1: a median that
counts is too far from 1."""

import json
import os
import statistics
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
BUDGETS, RUNS, POINTS = (30, 45, 60, 80, 100, 150), 5, 1000000
# name, scene, size, voxels a side, kind of points
CASES = (("city, surfaces", "city", 8, 4096, "surface"), ("city, a camera's view", "city", 8, 4096, "gbuffer"),
         ("terrain, surfaces", "terrain", 128, 4096, "surface"))


def run(name, *words):
    return subprocess.run([os.path.join(BUILD, name), *map(str, words)], capture_output=True, text=True)


def must(name, *words):
    done = run(name, *words)
    if done.returncode:
        sys.exit(f"{name} {' '.join(map(str, words))}: {done.stderr}")


def ask(asset, points, budget, answers):
    """What one query was expected to take and took, ns a point; None: no setting is that cheap."""
    done = run("umbrage", "query", asset, "--points", points, "--format", "f32", "--normals", "--budget", budget,
               "--json", "--encoding", "bit", "-o", answers, "--quiet")
    if done.returncode == 2:
        return None
    told = json.loads(done.stdout)
    return told["expected_ns"], told["ns_per_point"]


def judge(name, budget, asked):
    ratios = sorted(took / expected for expected, took in asked)
    ratio = statistics.median(ratios)
    spread = (ratios[-2] - ratios[1]) / ratio
    verdict = "too noisy to tell" if spread > 0.15 else "kept" if abs(ratio - 1) <= 0.2 else "BROKEN"
    print(f"{name}, {budget} ns: expected {statistics.median(e for e, _ in asked):.1f}, took "
          f"{statistics.median(took for _, took in asked):.1f} ns a point, ratio {ratio:.2f}, runs within {100 * spread:.0f} %: {verdict}",
          flush=True)
    return verdict


def main():
    verdicts = []
    with tempfile.TemporaryDirectory() as folder:
        path = lambda name: os.path.join(folder, name)
        for name, kind, size, resolution, points in CASES:
            if not os.path.exists(path(kind + ".umb")):
                must("scenegen", kind, "--size", size, "-o", path(kind + ".glb"))
                must("umbrage-bake", path(kind + ".glb"), "-o", path(kind + ".umb"), "--resolution", resolution,
                     "--verify", 0, "--quiet")
            must("umbrage", "points", path(kind + ".glb"), "--kind", points, "--normals", "--count", POINTS, "--quiet",
                 "-o", path("points"))
            for budget in BUDGETS:
                asked = [ask(path(kind + ".umb"), path("points"), budget, path("answers")) for _ in range(RUNS)]
                if None not in asked:
                    verdicts.append(judge(name, budget, asked))
    print(f"{verdicts.count('kept')} kept, {verdicts.count('BROKEN')} broken, "
          f"{verdicts.count('too noisy to tell')} too noisy to tell")
    return 1 if "BROKEN" in verdicts else 0


if __name__ == "__main__":
    sys.exit(main())
