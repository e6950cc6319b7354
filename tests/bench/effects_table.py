# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/results/effects.md: the plan of every real scene, and the cost of each effect in the
state that the plan chooses and in the other state. `make effects-table` runs it (RESOLUTION=2048); scenes
come from UMBRAGE_SCENES (default ../shared/scenes).

The time of a bake is the user time of one thread, the least of two, without the comparison with rays. The
time of a query is the kernel's own, the least of seven, over the points with normals that the pixels of a
fitted picture see. If there are several lights, the first is queried."""

import json
import os
import re
import resource
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
SCENES = os.environ.get("UMBRAGE_SCENES", os.path.join(ROOT, "..", "shared", "scenes"))
LIST = os.path.join(ROOT, "tests", "scenes", "real_scenes.txt")
POINTS = 262144
REPEATS = 7

# What to turn an effect to, where the plan has it otherwise. Penumbras are not in the list: turning
# them off gives the same asset, and turning them on is the effect `front`. The closed rule is only
# turned off, since open parts cannot be baked as closed.
TURNED = {"closed": "off", "front": "on", "cut-out": "off", "transmittance": "off", "static": "on",
          "mraa": "on", "voaa": "on"}
SUNS_OF = ("delft_all.obj", "denhaag_9solids.obj", "jacksboro.ply")
SUNS = ["--sun=90,30", "--sun=135,45", "--sun=180,50", "--sun=225,45"]
LINE = re.compile(r'effect=(\S+) state=(\S+) reason="(.*)" cost="(.*)"$')


def run(*words):
    """(what a program prints as JSON, its user seconds); None where it refuses."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    done = subprocess.run([os.path.join(BUILD, words[0]), *map(str, words[1:])],
                          capture_output=True, text=True)
    seconds = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    if done.returncode != 0:
        return None
    return json.loads(done.stdout) if "--json" in words else {}, seconds


def plan_of(scene, *options):
    """Returns {effect: (state, reason)} and the rest of the output of --plan, or None."""
    found = run("umbrage-bake", scene, "--plan", "--json", "--quiet", *options)
    if found is None:
        return None
    effects = [LINE.match(line).groups() for line in found[0]["plan"]]
    return {name: (state, reason) for name, state, reason, _ in effects}, found[0]


def state_of(effects, name):
    return effects[name][0] if name in effects else "off"


class Points:
    """The points that a picture of the scene shows, relative to the asset's origin."""

    def __init__(self, scene, origin, folder):
        self.origin = "--origin=" + ",".join(map(repr, origin))
        self.path = os.path.join(folder, "points")
        run("umbrage-study", "points", scene, "-o", self.path, "--kind", "gbuffer",
                         "--count", POINTS, "--normals", "--quiet", self.origin)

    def ns(self, asset, *options):
        """Nanoseconds a point, or a dash where the asset has no such answers."""
        least = None
        for _ in range(REPEATS):
            found = run("umbrage", "query", asset, "--points", self.path, "--format", "f32",
                        "--normals", self.origin, "--encoding", "bit", "-o", asset + ".bits",
                        "--json", "--quiet", *options)
            if found is None:
                return "-"
            ns = found[0]["ns_per_point"]
            least = ns if least is None else min(least, ns)
        return f"{least:.0f}" if least >= 10 else f"{least:.1f}"


def bake(scene, asset, resolution, *options):
    """(bytes, user seconds) of an asset."""
    times = []
    for _ in range(2):
        found = run("umbrage-bake", scene, "-o", asset, "--resolution", resolution, "--threads", 1,
                    "--verify", 0, "--json", "--quiet", *options)
        if found is None:
            return None
        times.append(found[1])
    return found[0]["bytes"], min(times)


def figures(scene, points, resolution, folder, *options):
    """Cells of one asset: bytes, seconds, ns with 1 tap, with 9, as penumbra."""
    asset = os.path.join(folder, "a.umb")
    made = bake(scene, asset, resolution, *options)
    if made is None:
        return None
    return [f"{made[0]}", f"{made[1]:.2f}", points.ns(asset, "--taps", 1),
            points.ns(asset, "--taps", 9), points.ns(asset, "--filter", "penumbra")]


def compare(scene, effects, points, resolution, folder):
    """Table cells of the asset as planned, and (effect, cells with it, cells without it) for each
    effect that can be switched."""
    planned, rows = figures(scene, points, resolution, folder), []
    for name, other in TURNED.items():
        option = f"--effect={name}={other}"
        changed = plan_of(scene, option)
        if planned is None or changed is None or state_of(effects, name) == other:
            continue
        if state_of(changed[0], name) != other:
            continue
        turned = figures(scene, points, resolution, folder, option)
        if turned is not None:
            rows.append((name, turned, planned) if other == "on" else (name, planned, turned))
    if scene.endswith(SUNS_OF):
        suns = figures(scene, points, resolution, folder, *SUNS)
        one = figures(scene, points, resolution, folder, SUNS[0])
        rows.append((f"suns ({len(SUNS)} and 1)", suns, one))
    return planned, rows


def print_table(heads, rows):
    print("|", " | ".join(heads), "|")
    print("|---" * len(heads) + "|")
    for row in rows:
        print("|", " | ".join(map(str, row)), "|")
    print(flush=True)


def main():
    resolution = int(sys.argv[1]) if len(sys.argv) > 1 else 2048
    planned_rows, both = [], []
    with open(LIST, encoding="ascii") as lines:
        scenes = [line.split()[0] for line in lines]
    for scene in scenes:
        path = os.path.join(SCENES, scene)
        found = plan_of(path) if os.path.exists(path) else None
        if found is None:
            print(f"left out: {scene}", file=sys.stderr)
            continue
        effects, plan = found
        on = ", ".join(name for name, (state, _) in effects.items() if state == "on") or "none"
        with tempfile.TemporaryDirectory() as folder:
            points = Points(path, plan["origin"], folder)
            planned, rows = compare(path, effects, points, resolution, folder)
            planned_rows.append((scene, plan["triangles"], on, *(planned or [])))
            both += [(scene, name, *[f"{a} / {b}" for a, b in zip(more, less)][:-1])
                     for name, more, less in rows]
        print(f"done: {scene}", file=sys.stderr)
    costs = ["bytes", "bake, s", "ns, 1 tap", "ns, 9 taps"]
    print_table(["scene", "triangles", "effects on at 16384", *costs, "ns, penumbra"], planned_rows)
    both.sort(key=lambda row: row[1])
    print_table(["scene", "effect", *[cost + ": on / off" for cost in costs]], both)


if __name__ == "__main__":
    main()
