# SPDX-License-Identifier: Apache-2.0
"""The table of default pictures in docs/results/pictures.md: false light and false shadow of `umbrage render` as it is
without options, on six scenes under three suns. `make picture-table` runs it; the real scenes come from
UMBRAGE_SCENES (default ../shared/scenes). A cell has the shares in percent for suns 70, 45 and 15 degrees high.
picture_table.py [RESOLUTION [SAMPLES]] measures one resolution, with SAMPLES x SAMPLES rays a footprint."""

import json
import os
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
SCENES = os.environ.get("UMBRAGE_SCENES", os.path.join(ROOT, "..", "shared", "scenes"))
SUNS = (70, 45, 15)
RESOLUTIONS = (2048, 4096)
SAMPLES = 4  # rays a side of a footprint
# Name, words of scenegen or a file, its up axis.
ALL = (("houses", ("houses", "--size", 6), ()),
       ("city", ("city", "--size", 8), ()),
       ("terrain", ("terrain", "--size", 256), ()),
       ("hall", ("hall", "--size", 3), ()),
       ("arena", "arena_zdm2/zdm2.glb", ()),
       ("Delft", "city_delft/delft_all.obj", ("--up", "z")))
SHARES = ("false_light", "false_shadow")
MOST = {"false_light": 0.5, "false_shadow": 0.1}  # percent: what pictures are held to


def run(*words):
    done = subprocess.run([os.path.join(BUILD, words[0]), *map(str, words[1:])], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, words))}: {done.stderr.strip()}")
    return done.stdout


def compare(scene, asset, up, truth):
    """The shares of a default picture in percent, against rays."""
    figures = json.loads(run("umbrage", "render", scene, "--asset", asset, "--compare", "--aa", 1, "--json", *up, *truth))
    if figures["judged"] < 5000:
        sys.exit(f"{scene}: the camera sees {figures['judged']} samples that face the sun")
    return tuple(100 * figures[share] for share in SHARES)


def measure(folder, scene, up, resolution, samples):
    """For each sun false light and false shadow against a ray, and against the footprint."""
    asset = os.path.join(folder, "asset.umb")
    rows = []
    for sun in SUNS:
        run("umbrage-bake", scene, "-o", asset, "--resolution", resolution, "--sun", f"135,{sun}", "--verify", 0, "--quiet", *up)
        rows.append(compare(scene, asset, up, ("--truth", "surface")) +
                    compare(scene, asset, up, ("--truth", "footprint", "--samples", samples)))
    return rows


def cell(shares, most):
    text = " / ".join(f"{share:.3f}" for share in shares)
    return f"**{text}**" if max(shares) > most else text


def main():
    numbers = [int(word) for word in sys.argv[1:]]
    with tempfile.TemporaryDirectory() as folder:
        print("| scene | voxels a side | false light, a ray | false shadow, a ray | false light, the footprint | "
              "false shadow, the footprint |\n|---|---|---|---|---|---|")
        for name, words, up in ALL:
            scene = os.path.join(SCENES, words) if isinstance(words, str) else os.path.join(folder, name + ".glb")
            if not isinstance(words, str):
                run("scenegen", *words, "-o", scene)
            elif not os.path.exists(scene):
                print(f"| {name} | not there: {words} | | | | |")
                continue
            for resolution in numbers[:1] or RESOLUTIONS:
                rows = measure(folder, scene, up, resolution, (numbers + [0, SAMPLES][len(numbers):])[1])
                cells = [cell([row[k] for row in rows], MOST[SHARES[k % 2]]) for k in range(4)]
                print(f"| {name} | {resolution} | " + " | ".join(cells) + " |", flush=True)


main()
