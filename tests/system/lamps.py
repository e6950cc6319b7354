#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Random lamps near surfaces: `make lamps`, or lamps.py [COUNT [SEED [FIRST]]].

Each case is a scene (floor and ceiling, room, solid boxes, a small city; 0.5 m to 2 km, turned or along the axes, some
in national coordinates), a point or spot light (on a surface, 1e-7 to 100 m above or below one, inside a solid, in the
air), a resolution of 512 to 16384 and a rule. It is baked with the self-check, and tests/agreement/lamp_check.c
compares the answers with brute force in long double. A bake must succeed, and no answer may be wrong. A bake may be
refused (exit 65) only if the lamp is nearer to a surface than the limit.
"""
import concurrent.futures
import json
import math
import os
import random
import subprocess
import sys
import tempfile

BUILD = os.environ.get("BUILD", "build/release")
NEAR = 2.0 ** -26  # of the reach: what a face leaves out
RESOLUTIONS = [512] * 60 + [1024] * 50 + [2048] * 40 + [4096] * 26 + [8192] * 16 + [16384] * 8
OFFSETS = [(0, 0, 0)] * 6 + [(2600000, 1200000, 400), (447751.25, 5936000.5, 12), (1e7, -1e7, 1e3), (0.3, -0.7, 0.1)]


def quad(a, b, c, d, closed=0):
    return [(closed, a, b, c), (closed, a, c, d)]


def box(low, high, closed=1):
    """Twelve triangles, outward."""
    p = [[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)]
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return [t for s in sides for t in quad(*(p[i] for i in s), closed=closed)]


def level(size, z):
    h = size / 2
    return quad([-h, -h, z], [h, -h, z], [h, h, z], [-h, h, z])


def make_scene(rng, kind, size):
    if kind == "floor":
        post = box([0.1 * size, 0.1 * size, 0], [0.11 * size, 0.12 * size, size * rng.uniform(0.01, 0.5)])
        return level(size, 0) + (post if rng.random() < 0.7 else [])
    if kind == "ceiling":
        return level(size, 0) + level(size, size * rng.uniform(0.1, 0.5))
    if kind == "room":  # seen from inside: open to the closed rule's eye only if a wall is missing
        walls = box([-size / 2, -size / 2, 0], [size / 2, size / 2, size * rng.uniform(0.2, 0.6)], 1)
        missing = rng.random() < 0.5
        walls = [(0, *t[1:]) for t in walls[2 * rng.randrange(1, 6) if missing else 0:]] if missing else walls
        table = box([0.1 * size, 0, 0.05 * size], [0.3 * size, 0.2 * size, 0.07 * size])
        return walls + table
    boxes = level(size, 0) if kind == "city" else []
    for _ in range(rng.randrange(1, 40 if kind == "city" else 4)):
        x, y = (rng.uniform(-0.45, 0.4) * size for _ in range(2))
        boxes += box([x, y, 0], [x + size * rng.uniform(0.01, 0.1), y + size * rng.uniform(0.01, 0.1),
                                 size * rng.uniform(0.01, 0.3)])
    return boxes


def rotation(rng):
    """A random rotation, by a quaternion; half of them none."""
    if rng.random() < 0.5:
        return [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    q = [rng.gauss(0, 1) for _ in range(4)]
    n = math.sqrt(sum(v * v for v in q))
    w, x, y, z = (v / n for v in q)
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]


def turn(m, p):
    return [sum(m[i][k] * p[k] for k in range(3)) for i in range(3)]


def normal_of(t):
    a = [t[2][k] - t[1][k] for k in range(3)]
    b = [t[3][k] - t[1][k] for k in range(3)]
    n = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    length = math.sqrt(sum(v * v for v in n))
    return [v / length for v in n]


def make_lamp(rng, triangles, size):
    """Position, and of a spot light its direction and half the angle of its cone."""
    t = rng.choice(triangles)
    n = normal_of(t)
    where = rng.choice(["on", "above", "above", "above", "below", "below", "inside", "air"])
    b = rng.choice([0.25, 0.5, rng.random()])
    c = rng.choice([0.25, 0.5]) * (1 - b)
    at = [t[1][k] + b * (t[2][k] - t[1][k]) + c * (t[3][k] - t[1][k]) for k in range(3)]
    if where in ("above", "below"):
        away = 10 ** rng.uniform(-7, math.log10(max(100, 2e-7)))
        away = min(away, 2 * size) * (1 if where == "above" else -1)
        at = [at[k] + away * n[k] for k in range(3)]
    elif where == "inside":
        at = [at[k] - 0.003 * size * rng.random() * n[k] for k in range(3)]
    elif where == "air":
        at = [rng.uniform(-0.6, 0.6) * size, rng.uniform(-0.6, 0.6) * size, rng.uniform(-0.1, 0.6) * size]
    if rng.random() < 0.6:
        return where, at, None
    facing = rng.choice([n, [-v for v in n], [rng.gauss(0, 1) for _ in range(3)]])
    return where, at, (facing, rng.choice([20, 40, 60, 75, 85]))


def make_case(seed, number, resolutions):
    rng = random.Random(f"{seed} {number}")
    kind = rng.choice(["floor", "ceiling", "room", "boxes", "city"])
    size = rng.choice([20, 10 ** rng.uniform(-0.3, 3.3)])
    triangles, m, offset = make_scene(rng, kind, size), rotation(rng), rng.choice(OFFSETS)
    where, at, spot = make_lamp(rng, triangles, size)

    def move(p):
        return [v + o for v, o in zip(turn(m, p), offset)]
    light = move(at) + (turn(m, spot[0]) + [spot[1]] if spot else [])
    rule = rng.choice(["off", "off", "auto"])
    triangles = [(t[0] if rule == "auto" else 0, *(move(p) for p in t[1:])) for t in triangles]
    return {"number": number, "kind": kind, "where": where, "light": light, "triangles": triangles, "rule": rule,
            "resolution": rng.choice(resolutions)}


def write_case(case, folder):
    """The scene as OBJ and for lamp_check."""
    obj, text = os.path.join(folder, "s.obj"), os.path.join(folder, "s.txt")
    with open(obj, "w", encoding="ascii") as out:
        for t in case["triangles"]:
            for p in t[1:]:
                out.write("v " + " ".join(repr(v) for v in p) + "\n")
        for i in range(len(case["triangles"])):
            out.write(f"f {3 * i + 1} {3 * i + 2} {3 * i + 3}\n")
    with open(text, "w", encoding="ascii") as out:
        out.write("light " + " ".join(repr(float(v)) for v in case["light"]) + "\n")
        for t in case["triangles"]:
            out.write(f"t {t[0]} " + " ".join(repr(v) for p in t[1:] for v in p) + "\n")
    return obj, text


def lamp_options(case):
    numbers = ",".join(repr(float(v)) for v in case["light"][:6])
    return [f"--point={numbers}"] if len(case["light"]) == 3 else [f"--spot={numbers},{float(case['light'][6])!r}"]


def bake(case, obj, asset, verify):
    return subprocess.run([os.path.join(BUILD, "umbrage-bake"), obj, "-o", asset, "--up", "z", "--quiet", "--resolution",
                           str(case["resolution"]), "--closed", case["rule"], "--verify", str(verify), "--threads", "1",
                           *lamp_options(case)], capture_output=True, text=True, timeout=3000)


def run_case(case, points=2000, verify=20000):
    """Bakes and compares. Returns (`right`, `refused` or what is wrong, figures)."""
    with tempfile.TemporaryDirectory() as folder:
        obj, text = write_case(case, folder)
        asset = os.path.join(folder, "a.umb")
        baked = bake(case, obj, asset, verify)
        check = subprocess.run([os.path.join(BUILD, "lamp_check"), text, asset if baked.returncode == 0 else "-",
                                str(case["number"] + 1), str(points)], capture_output=True, text=True)
        if check.returncode not in (0, 1):
            return check.stderr, {}
        figures = json.loads(check.stdout)
        if baked.returncode == 65 and "light 0 (" in baked.stderr and "move the light" in baked.stderr:
            limit = 3 * NEAR * figures["reach"]  # the corner of a wide face is that much farther than its plane
            near = figures["distance"] <= limit or "nothing of the scene" in baked.stderr
            return ("refused" if near else "refused without need: " + baked.stderr), figures
        if baked.returncode != 0:
            return f"exit {baked.returncode}: {baked.stderr}", figures
        return ("right" if figures["wrong"] == 0 else f"wrong: {check.stdout}"), figures


def describe(case):
    return (f"case {case['number']}: {case['kind']}, {len(case['triangles'])} triangles, lamp {case['where']} "
            f"{lamp_options(case)[0]}, {case['resolution']}, closed {case['rule']}")


def run_cases(cases, points=2000, verify=20000, workers=2, tell=print):
    """Runs cases side by side. Returns sums of what came of them."""
    sums = {"right": 0, "refused": 0, "bad": 0, "compared": 0, "lit": 0, "outside": 0, "band": 0, "skipped": 0}
    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        for case, (outcome, figures) in zip(cases, pool.map(lambda c: run_case(c, points, verify), cases)):
            sums[outcome if outcome in sums else "bad"] += 1
            for name in ("compared", "lit", "outside", "band", "skipped"):
                sums[name] += figures.get(name, 0)
            if outcome not in sums:
                tell(f"{describe(case)}: {outcome.strip()[:400]}", flush=True)
            if sum(sums[k] for k in ("right", "refused", "bad")) % 100 == 0:
                tell(f"  {sums}", flush=True)
    return sums


if __name__ == "__main__":
    count, seed, first = (int(v) for v in (sys.argv[1:] + ["2000", "1", "0"][len(sys.argv) - 1:]))
    result = run_cases([make_case(seed, i, RESOLUTIONS) for i in range(first, first + count)],
                       workers=int(os.environ.get("LAMP_WORKERS", "2")))
    print(f"{count} lamps, seed {seed}: {result['right']} right, {result['refused']} refused, {result['bad']} bad; "
          f"{result['compared']} points, {result['lit']} lit, {result['outside']} outside of frusta, {result['band']} in "
          f"the band, {result['skipped']} in solids")
    sys.exit(result["bad"] > 0)
