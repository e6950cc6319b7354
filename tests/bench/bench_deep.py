# SPDX-License-Identifier: Apache-2.0
"""Measures the cost of 7 x 7 windows over deep maps by search, links and streams: `make bench-deep`. Prints a JSON line
for each figure: how many times as fast as a search. The scenes are generated hair and, if UMBRAGE_SCENES has them, the
real hair and helmet. On hair, the way that a map chooses by itself must be 1.3 times as fast; otherwise the exit code
is 1."""
import json
import os
import statistics
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "tests", "harness"))
import translucent_scenes  # noqa: E402

BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
SCENES = os.environ.get("UMBRAGE_SCENES", os.path.join(ROOT, "..", "shared", "scenes"))
RUNS = 5
BAR = 1.3


def times(scene):
    """Nanoseconds a point of each way, from one run."""
    run = subprocess.run([os.path.join(BUILD, "umbrage-study"), "deep", scene, "--threads", "1", "--json"],
                         capture_output=True, text=True, check=True)
    told = json.loads(run.stdout)
    assert told["same_bits"], told
    return {way: told[way]["ns_per_point"] for way in ("searched", "linked", "streamed")}


def main():
    ok = True
    with tempfile.TemporaryDirectory() as folder:
        generated = os.path.join(folder, "hair.obj")
        translucent_scenes.hair(generated)
        scenes = {"hair": os.path.join(SCENES, "hair_long01", "long01_blend.glb"), "generated-hair": generated,
                  "helmet": os.path.join(SCENES, "helmet_flight", "FlightHelmet.gltf")}
        for name, path in scenes.items():
            if not os.path.exists(path):
                print(f"left out: {name}", file=sys.stderr)
                continue
            runs = [times(path) for _ in range(RUNS)]
            for way in ("linked", "streamed"):
                ratios = sorted(run["searched"] / run[way] for run in runs)
                value = statistics.median(ratios)
                print(json.dumps({"bench": "deep", "case": f"{name}-7x7", "figure": f"{way}_vs_searched",
                                  "value": round(value, 3), "better": "higher", "runs": RUNS,
                                  "spread": round((ratios[-2] - ratios[1]) / value, 3)}), flush=True)
                ok &= value >= BAR or way == "linked" or name == "helmet"
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
