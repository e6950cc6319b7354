# SPDX-License-Identifier: Apache-2.0
"""Compares real scenes with traced rays: bakes each scene of tests/scenes/real_scenes.txt under its
closed rules at each resolution, compares a million points with rays, and prints a table. Ends with 1
if a point outside of the band of one voxel disagrees or a bake fails. `make verify-scenes` runs it
(RESOLUTIONS="4096 16384"); scenes come from UMBRAGE_SCENES (default ../shared/scenes)."""

import json
import os
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
SCENES = os.environ.get("UMBRAGE_SCENES", os.path.join(ROOT, "..", "shared", "scenes"))
LIST = os.path.join(ROOT, "tests", "scenes", "real_scenes.txt")
RULES = {"auto": "closed where parts are", "off": "open", "on": "closed on the caller's word"}


def run(*words):
    """What a program prints as JSON; None, with its reason told, if it ends in an error."""
    done = subprocess.run([os.path.join(BUILD, words[0]), *map(str, words[1:])],
                          capture_output=True, text=True)
    if done.returncode not in (0, 1):
        print(f"{' '.join(map(str, words))}: {done.stderr}", file=sys.stderr)
        return None
    return json.loads(done.stdout)


def compare(path, rule, light, resolution, folder):
    """(bake, sums over the lights), or None."""
    asset = os.path.join(folder, "a.umb")
    bake = run("umbrage-bake", path, "-o", asset, "--resolution", resolution, "--closed", rule,
               "--verify", 0, "--quiet", "--json", *light)
    if bake is None:
        return None
    found = run("umbrage", "verify", asset, "--scene", path, "--json")
    if found is None:
        return None
    return bake, {name: sum(one[name] for one in found["lights"])
                  for name in ("points", "inside_band", "outside_band")}


def row(scene, rule, light, resolutions, folder):
    """Prints a scene's line. (closed by the rule or not, points that disagree outside of the band;
    1 if a program fails)."""
    path, outside, cells, bake = os.path.join(SCENES, scene), 0, [], None
    for resolution in resolutions:
        result = compare(path, rule, light, resolution, folder)
        if result is None:
            return False, 1
        bake, sums = result
        outside += sums["outside_band"]
        cells += [f"{100 * sums['inside_band'] / max(sums['points'], 1):.2f} %",
                  sums["outside_band"]]
    name = RULES[rule] if bake["closed"] else RULES["off"]
    print("|", " | ".join(map(str, [scene, bake["triangles"], name, *cells])), "|", flush=True)
    return bake["closed"], outside


def scene_rows(scene, rules, light, resolutions, folder):
    """The rules that close something, and open once: all rules that leave everything open are the
    same."""
    closed, outside = True, 0
    for rule in [rule for rule in rules if rule != "off"] + ["off"]:
        if closed or rule != "off":
            closed, wrong = row(scene, rule, light, resolutions, folder)
            outside += wrong
    return outside


def main():
    resolutions = [int(word) for word in sys.argv[1:]] or [4096, 16384]
    heads = [f"{r}: inside the band | outside" for r in resolutions]
    print("| scene | triangles | rule |", " | ".join(heads), "|")
    print("|---" * (3 + 2 * len(resolutions)) + "|")
    outside = 0
    with tempfile.TemporaryDirectory() as folder, open(LIST, encoding="ascii") as lines:
        for scene, rules, light in map(str.split, lines):
            if not os.path.exists(os.path.join(SCENES, scene)):
                print(f"not there: {scene}", file=sys.stderr)
                continue
            options = [] if light == "file" else ["--sun", "150,40"]
            outside += scene_rows(scene, rules.split(","), options, resolutions, folder)
    sys.exit(1 if outside else 0)


if __name__ == "__main__":
    main()
