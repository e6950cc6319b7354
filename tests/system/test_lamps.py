#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Lamps near surfaces: right voxels are never refused, and no light passes through a floor. Fixed cases, and random lamps
in the short form of `make lamps` (lamps.py): every bake is compared with brute force in long double.
"""
import os
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import lamps  # noqa: E402
import umbrage_test as ut  # noqa: E402

lamps.BUILD = ut.BUILD
test = ut.Test(limit_s=580)
RANDOM = 30


def case(triangles, light, resolution, number=0):
    return {"number": number, "kind": "given", "where": "given", "light": light, "triangles": triangles, "rule": "off",
            "resolution": resolution}


def given(triangles, light, resolution, wanted, verify=20000):
    """Runs a case; its outcome must be among those wanted."""
    one = case(triangles, light, resolution)
    outcome, figures = lamps.run_case(one, points=1500, verify=verify)
    assert outcome in wanted, f"{lamps.describe(one)}: {outcome}"
    return outcome, figures


ROOM = lamps.level(20, 0) + lamps.level(20, 5)
DISTANCES = {512: (1e-6, 1e-4, 0.01), 2048: (1e-5, 1e-3, 0.1), 4096: (0.01, 0.2), 16384: (0.1,)}
for resolution, distances in DISTANCES.items():
    with test.check(f"a lamp under a bare ceiling, {resolution} voxels a side"):
        for distance in distances:
            given(ROOM, [0.3, 0.2, 5 - distance], resolution, {"right"}, 20000)

with test.check("a lamp 5 m above a square kilometre whose height is no float"):
    floor = [(0, *([v[0], v[1], 0.37] for v in t[1:])) for t in lamps.level(1000, 0)]
    given(floor + lamps.box([10, 10, 0.37], [11, 11, 300], 0), [30, -70, 5.37], 4096, {"right"})

BASE = [(0, *([v[0] + 5, v[1] + 5, v[2]] for v in t[1:])) for t in lamps.level(10, 0)]
for height, outcome in ((0, "refused"), (1e-7, "refused"), (-1e-7, "refused"), (1e-6, "right"), (1e-5, "right"),
                        (1e-3, "right"), (-1e-5, "right")):
    with test.check(f"a lamp at height {height} over a closed floor is {outcome}"):
        post = lamps.box([2, 2, 1], [3, 3, 2], 0)
        found, figures = given(BASE + post, [5, 5, height], 1024, {outcome})
        assert found == "refused" or 0 < figures["lit"] < figures["compared"], figures

with test.check("without a self-check no point below the floor is lit"):
    for height in (1e-6, 1e-5, 1e-3):
        one = case(BASE, [5, 5, height], 1024)
        obj, _ = lamps.write_case(one, test.folder)
        asset = test.path("below.umb")
        assert lamps.bake(one, obj, asset, 0).returncode == 0
        below = "\n".join(f"{0.05 + 0.1 * (i % 100)} {0.05 + 0.1 * (i // 100)} {-0.05 * 2 ** (i % 8)}" for i in range(10000))
        run = subprocess.run([ut.program("umbrage"), "query", asset, "--points", "-", "--bias", "none", "--quiet"],
                             input=below, capture_output=True, text=True, check=True)
        lit = [float(v) > 0 for v in run.stdout.split()]
        assert len(lit) == 10000 and not any(lit), f"{height} m: {sum(lit)} lit"

with test.check("a spot light on a surface that it shines away from is baked, others are refused"):
    for direction, half, outcome in (([0, 0, 1], 60, "right"), ([0, 0, 1], 80, "right"), ([0.2, 0.1, 1], 60, "right"),
                                     ([1, 0, 0.1], 40, "refused"), ([0, 1, 1], 80, "refused")):
        given(BASE + lamps.box([2, 2, 1], [3, 3, 2], 0), [5, 5, 0, *direction, half], 1024, {outcome})

with test.check("a refusal names the lamp, its place, the distance, the limit and what to do; exit 65"):
    one = case(BASE, [5, 5, 1e-8], 512)
    obj, _ = lamps.write_case(one, test.folder)
    run = lamps.bake(one, obj, test.path("no.umb"), 1000)
    assert run.returncode == 65 and not os.path.exists(test.path("no.umb")), run
    for word in ("light 0 ('point 5,5,1e-08')", "at 5 5 1e-08", "1e-08 m away, at 5 5 0", "the limit is 1.05e-07 m",
                 "move the light at least 2e-07 m away"):
        assert word in run.stderr, (word, run.stderr)

with test.check("faces of wide spot lights leave no gap between them"):
    walls = lamps.box([-5, -5, 0], [5, 5, 4], 0)
    for i, direction in enumerate(([1, 0.4, 0.3], [-0.3, 0.8, -0.5], [0.2, 0.1, -1])):
        given(walls + lamps.box([1, 1, 1], [2, 2, 2], 0), [0.3, -0.2, 2.1, *direction, 85], 256 << i, {"right"})

with test.check("the diagonal of a floor that runs through texel centres is as deep as the floor"):
    for i in range(6):  # found by the long campaign: case 233 of seed 1
        one = lamps.make_case(1, 233, [512])
        given(one["triangles"], [v + 0.01 * i * (k == 2) for k, v in enumerate(one["light"])], 512, {"right"})

with test.check("a voxel whose centre lies behind the lamp is lit"):
    one = lamps.make_case(21, 160, [512])  # 0.5 micrometres from a ceiling, voxels 3 micrometres deep
    assert lamps.run_case(one, points=2048)[0] == "right", lamps.describe(one)

with test.check(f"{RANDOM} random lamps near surfaces, each bake against brute force"):
    sums = lamps.run_cases([lamps.make_case("short", i, [512, 512, 1024]) for i in range(RANDOM)], points=1000)
    print(sums)
    assert sums["bad"] == 0 and sums["right"] > RANDOM / 2 and sums["refused"] > 0, sums
    assert sums["lit"] > sums["compared"] / 10 and sums["band"] > 100 and sums["outside"] > 100, sums

test.finish()
