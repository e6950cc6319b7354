# SPDX-License-Identifier: Apache-2.0
"""Checks the plan's decisions about the closed rule. `make plan-scenes` bakes generated mixes of
closed and open parts and the real scenes under both rules, and compares the bytes of the files with
what `--plan` said. A scene fails if the bytes are outside the range that the plan states, or if the
chosen rule has over a tenth more bytes than the other one. Forecasts that are off by more than
--factor are counted.

    plan_scenes.py [--resolution 4096,16384] [--factor 1.3] [--only NAME,...] [--mixes-only]
"""
import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "tests", "scenes"))
import plan_mixes  # noqa: E402

BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
SCENES = os.environ.get("UMBRAGE_SCENES", os.path.join(ROOT, "..", "shared", "scenes"))
LIST = os.path.join(ROOT, "tests", "scenes", "real_scenes.txt")
GENERATED = {"terrain": 256, "city": 20, "arch": 8, "bridge": 60, "hall": 7, "forest": 12}
# The chosen rule may have at most this many times the bytes of the other rule.
BYTES_MAX = 1.1


def bake(*words):
    """(JSON of a bake or plan, its processor seconds)"""
    before = os.times()
    done = subprocess.run([os.path.join(BUILD, "umbrage-bake"), *map(str, words), "--json", "--quiet"],
                          capture_output=True, text=True)
    after = os.times()
    if done.returncode != 0:
        raise RuntimeError(f"{words[0]}: {done.stderr.strip()}")
    seconds = after.children_user + after.children_system - before.children_user - before.children_system
    return json.loads(done.stdout), seconds


def scenes(folder, only, mixes_only):
    """Paths of all scenes; generated ones are written when they are asked for."""
    for name in plan_mixes.MIXES:
        if not only or name in only:
            yield name, plan_mixes.write(name, folder)
    if mixes_only:
        return
    for kind, size in GENERATED.items():
        if not only or kind in only:
            path = os.path.join(folder, kind + ".ply")
            subprocess.run([os.path.join(BUILD, "scenegen"), kind, "--size", str(size), "-o", path],
                           check=True, capture_output=True)
            yield kind, path
    with open(LIST, encoding="utf-8") as lines:
        for line in lines:
            path = os.path.join(SCENES, line.split("#")[0].strip().split(" ")[0])
            name = os.path.basename(path)
            if os.path.isfile(path) and (not only or name in only):
                yield name, path


def judge(path, resolution, folder, factor):
    """A row of the table, and what is wrong in it."""
    common = [path, "--resolution", resolution, "--threads", 1]
    plan, seconds = bake(*common, "--plan")
    nothing, rest = bake(*common, "--plan", "--closed", "off")
    asset = os.path.join(folder, "asset.umb")
    sizes, bakes = {}, {}
    for rule in ("off", "parts"):
        done, bakes[rule] = bake(*common, "--closed", rule, "--verify", 0, "-o", asset)
        sizes[rule] = os.path.getsize(asset) - done["transmittance_bytes"]  # the price is of voxels
        os.unlink(asset)
    chosen = "parts" if plan["closed"] else "off"
    row = {"closed": plan["closed_parts"], "parts": plan["parts"], "open_bytes": sizes["off"],
           "closed_bytes": sizes["parts"], "chosen": "closed" if plan["closed"] else "open",
           "seconds": seconds - rest, "bake": bakes[chosen], "off": 0}
    wrong = []
    price = plan.get("closed_price")
    if price is None:
        if plan["closed_parts"] > 0:
            wrong.append("no price")
    else:
        for rule, key in (("off", "open_bytes"), ("parts", "closed_bytes")):
            row["said_" + key] = price[key]
            ratio = (price[key] + HEAD_BYTES) / sizes[rule]
            row["ratio_" + key] = ratio
            row["off"] += not 1 / factor <= ratio <= factor
            # The forecast leaves out the head, whose length an estimate of it changes a little.
            stated = max(price["factor"], EXACT_FACTOR)
            if not 1 / stated <= ratio <= stated:
                wrong.append(f"{key} x {ratio:.2f}, beyond {stated:.2f}")
    if sizes[chosen] > BYTES_MAX * min(sizes.values()):
        wrong.append(f"chose {row['chosen']}")
    return row, wrong


# Bytes of plan, settings, notes and accuracy curve, which the forecast of the voxels leaves out.
HEAD_BYTES = 1400
# Bytes that were exact may differ by this factor: HEAD_BYTES is an estimate, and small files are mostly head.
EXACT_FACTOR = 1.1


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--resolution", default="4096,16384")
    parser.add_argument("--factor", type=float, default=1.3)
    parser.add_argument("--only", default="")
    parser.add_argument("--mixes-only", action="store_true")
    options = parser.parse_args()
    only = [name for name in options.only.split(",") if name]
    failed = off = 0
    print("| scene | resolution | closed parts | closed, bytes | said | open, bytes | said | saved | chosen | s | s of the bake | wrong |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, path in scenes(folder, only, options.mixes_only):
            if bake(path, "--plan", "--resolution", 64)[0]["closed_parts"] == 0:
                print(f"| {name} | | 0 | | | | | | open | | | |", flush=True)
                continue
            for resolution in map(int, options.resolution.split(",")):
                row, wrong = judge(path, resolution, folder, options.factor)
                failed += bool(wrong)
                off += row["off"]
                said = {key: f"x {row['ratio_' + key]:.2f}" if "ratio_" + key in row else "" for key in ("open_bytes", "closed_bytes")}
                print(f"| {name} | {resolution} | {row['closed']} of {row['parts']} | {row['closed_bytes']} | {said['closed_bytes']} "
                      f"| {row['open_bytes']} | {said['open_bytes']} | {100 * (1 - row['closed_bytes'] / row['open_bytes']):.1f} % "
                      f"| {row['chosen']} | {row['seconds']:.2f} | {row['bake']:.2f} | {'; '.join(wrong)} |", flush=True)
    print(f"{failed} rows are wrong; {off} forecasts are off by more than {options.factor:g}")
    return failed > 0


if __name__ == "__main__":
    sys.exit(main())
