# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/results/accuracy.md between its markers: accuracy curves of generated and real
scenes, and the number of points that broke a bound. `make accuracy` runs it. Real scenes come from
UMBRAGE_SCENES (default ../shared/scenes); a missing one is left out and named."""

import json
import os
import platform
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
SCENES = os.environ.get("UMBRAGE_SCENES", os.path.join(ROOT, "..", "shared", "scenes"))
RESULTS = os.path.join(ROOT, "docs", "results")
BEGIN, END = "<!-- accuracy tables: make accuracy -->\n", "<!-- end of accuracy tables -->\n"
RESOLUTION, POINTS, SUN = 4096, 1000000, "135,40"
GENERATED = (("generated city", "city", 12), ("generated terrain", "terrain", 128))
REAL = (("Delft", "city_delft/delft_all.obj"), ("Den Haag", "city_denhaag/denhaag_9solids.obj"),
        ("Sterngarten, Vienna", "garden_sterngarten/Sterngarten_Wien_innerArea-optimized.obj"),
        ("an arena", "arena_zdm2/zdm2.glb"), ("a lion statue, scanned",
                                              "scan_lionstatue/lionstatue.obj"),
        ("Jacksboro, terrain", "terrain_jacksboro/jacksboro.ply"))


def run(*words):
    done = subprocess.run([os.path.join(BUILD, words[0]), *map(str, words[1:])],
                          capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(map(str, words))}: {done.stderr}")
    return done.stdout


def machine():
    with open("/proc/cpuinfo", encoding="ascii", errors="replace") as info:
        names = [line.split(":", 1)[1].strip() for line in info if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {len(names) or os.cpu_count()} processors"


def source():
    commit = subprocess.run(["git", "-C", ROOT, "rev-parse", "--short", "HEAD"],
                            capture_output=True, text=True).stdout.strip() or "unknown"
    return f"Commit {commit}, {machine()}"


def scenes_in(folder):
    """Names and files of the scenes that are there; the generated ones are made in a folder."""
    scenes = []
    for name, kind, size in GENERATED:
        path = os.path.join(folder, kind + ".glb")
        run("scenegen", kind, "--size", size, "-o", path)
        scenes.append((name, path))
    for name, path in REAL:
        path = os.path.join(SCENES, path)
        if os.path.exists(path):
            scenes.append((name, path))
        else:
            print(f"skipped: {name}, no file {path}")
    return scenes


def replace(name, begin, end, text):
    """Puts a text between two markers of a page of results."""
    path = os.path.join(RESULTS, name)
    with open(path, encoding="utf-8") as page:
        before, rest = page.read().split(begin)
    with open(path, "w", encoding="utf-8") as page:
        page.write(before + begin + text + end + rest.split(end)[1])


def measure(scene, folder):
    asset = os.path.join(folder, "asset.umb")
    baked = json.loads(run("umbrage-bake", scene, "-o", asset, "--resolution", RESOLUTION, "--sun",
                           SUN, "--verify", 0, "--json", "--quiet"))
    light = json.loads(run("umbrage", "info", asset, "--json"))["lights"][0]
    checked = json.loads(run("umbrage", "verify", asset, "--scene", scene, "--bounds", "--points",
                             POINTS, "--json", "--quiet"))["bounds"]
    return {"bytes": os.path.getsize(asset), "curve": light["curve"], "checked": checked,
            "closed": baked.get("closed", light["frusta"][0]["closed"])}


def rows_of(name, got):
    for row, checked in zip(got["curve"], got["checked"]):
        if row["level"] or row["taps"] in (1, 3, 9, 17):
            yield (f"| {name} | {row['level']} | {row['taps']} | {row['bound_m']:.3g} | "
                   f"{row['visibility_error']:.3f} | {row['lines']:.2f} | {checked['points']} | "
                   f"{100 * checked['differ'] / max(checked['points'], 1):.2f} % | "
                   f"{checked['undefined']} | {checked['beyond']} |\n")
            name = ""


def main():
    text = [f"{source()}; {RESOLUTION} voxels a side, sun {SUN},\n`--closed auto`; {POINTS} points on "
            "surfaces, of which those that face the light are compared.\n\n",
            "| scene | level | taps | bound, m | visibility error | cache lines | compared | differ "
            "from a ray | undefined | beyond the bound |\n|---|---|---|---|---|---|---|---|---|---|\n"]
    broken = 0
    with tempfile.TemporaryDirectory() as folder:
        for name, path in scenes_in(folder):
            got = measure(path, folder)
            broken += sum(row["beyond"] for row in got["checked"])
            text += rows_of(name, got)
            print(f"{name}: {got['bytes']} bytes, "
                  f"{sum(row['beyond'] for row in got['checked'])} beyond their bound", flush=True)
    replace("accuracy.md", BEGIN, END, "".join(text))
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
