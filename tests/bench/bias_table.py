# SPDX-License-Identifier: Apache-2.0
"""The table of docs/results/biases.md: false light and false shadow of wide windows on five
scenes under three suns, by tests/bench/bias_race.c. `make bias-table` runs it; scenes come from
UMBRAGE_SCENES (default ../shared/scenes). A cell has the shares in percent for suns 70, 45 and 15 degrees
high."""

import os
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
SCENES = os.environ.get("UMBRAGE_SCENES", os.path.join(ROOT, "..", "shared", "scenes"))
SUNS = (70, 45, 15)
COLUMNS = ("false light, a ray", "false shadow, a ray", "false light, the area", "false shadow, the area")
# Name, file, up axis, voxels a side.
ALL = (("houses", "houses.glb", "y", 16384),
       ("arena", "arena_zdm2/zdm2.glb", "y", 8192),
       ("Delft", "city_delft/delft_all.obj", "z", 8192),
       ("garden", "garden_sterngarten/Sterngarten_Wien_innerArea-optimized.obj", "z", 8192),
       ("terrain", "terrain_jacksboro/jacksboro.ply", "z", 8192))


def run(*words):
    done = subprocess.run([os.path.join(BUILD, words[0]), *map(str, words[1:])], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{words[0]}: {done.stderr.strip()}")
    return done.stdout


def race(folder, scene, up, resolution):
    """Rows of one scene: {bias: [one tuple of four shares for each sun]}."""
    rows = {}
    for sun in SUNS:
        asset = os.path.join(folder, "asset.umb")
        run("umbrage-bake", scene, "-o", asset, "--resolution", resolution, "--closed", "off", "--up", up,
            "--sun", f"135,{sun}", "--verify", 0, "--quiet")
        for line in run("bias_race", scene, asset, 320, 180, up).splitlines():
            name, *shares = line.split("\t")
            rows.setdefault(name, []).append(shares[:4])
    return rows


def main():
    with tempfile.TemporaryDirectory() as folder:
        houses = os.path.join(folder, "houses.glb")
        run("scenegen", "houses", "--size", 50, "-o", houses)
        print("| scene | bias | " + " | ".join(COLUMNS) + " |")
        print("|---|---|---|---|---|---|")
        for name, path, up, resolution in ALL:
            scene = houses if path == "houses.glb" else os.path.join(SCENES, path)
            if not os.path.exists(scene):
                print(f"| {name} | not there: {path} | | | | |")
                continue
            for bias, suns in race(folder, scene, up, resolution).items():
                cells = [" / ".join(sun[k] for sun in suns) for k in range(4)]
                print(f"| {name} | {bias} | " + " | ".join(cells) + " |", flush=True)


main()
