# SPDX-License-Identifier: Apache-2.0
"""Checks that a study can be repeated: runs `umbrage-study SCENE --quick` twice from nothing and compares the results.

Errors must be equal to the last digit. Times are the least of many runs: those of both studies must
agree within 15 % in the median over all settings; how far each pair is apart is printed. `make study-twice SCENE=FILE`; without SCENE a
generated city. Exit code 1: errors differ, or times do."""

import json
import os
import statistics
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
TIMES = {"ns_view": "spread", "ns_free": "spread_free", "ns_view_all": "spread_all"}
TIMED = set(TIMES) | set(TIMES.values()) | {"build_s", "instructions"}
AGREE = 0.15


def study(scene, folder):
    subprocess.run([os.path.join(BUILD, "umbrage-study"), scene, "-o", folder, "--quick", "--quiet",
                    *sys.argv[2:]], check=True)
    with open(os.path.join(folder, "report.json"), encoding="utf-8") as file:
        return json.load(file)


def errors(report):
    rows = [{k: v for k, v in row.items() if k not in TIMED} for row in report["results"]]
    techniques = [{k: row[k] for k in ("name", "mean", "lighter", "darker", "over_half")}
                  for row in report["techniques"]["rows"]]
    return rows, techniques, [bake["asset"] for bake in report["bakes"]], report["samples"]


def compare_times(first, second):
    """Prints a line a kind of time; returns the median difference of all pairs."""
    every = []
    for name, spread in TIMES.items():
        pairs = [(a[name], b[name]) for a, b in zip(first["results"], second["results"])]
        both = [abs(a - b) / min(a, b) for a, b in pairs if a is not None and b is not None]
        spreads = [row[spread] for report in (first, second) for row in report["results"]
                   if row[name] is not None]
        every += both
        print(f"{name}: {len(both)} of {len(pairs)} settings told by both, apart by "
              + (f"{100 * statistics.median(both):.1f} % (median), {100 * max(both):.1f} % (most), "
                 f"{sum(apart <= AGREE for apart in both)} within {100 * AGREE:.0f} %; their runs spread by "
                 f"{100 * statistics.median(spreads):.1f} % (median)" if both else "nothing"))
    return statistics.median(every) if every else float("inf")


def main():
    with tempfile.TemporaryDirectory() as folder:
        scene = sys.argv[1] if len(sys.argv) > 1 and sys.argv[1] else os.path.join(folder, "city.glb")
        if not os.path.exists(scene):
            subprocess.run([os.path.join(BUILD, "scenegen"), "city", "--size", "4", "-o", scene],
                           check=True, stderr=subprocess.DEVNULL)
        reports = [study(scene, os.path.join(folder, name)) for name in ("first", "second")]
        same = errors(reports[0]) == errors(reports[1])
        print(f"{scene}: {len(reports[0]['results'])} settings and {len(reports[0]['techniques']['rows'])} techniques, "
              f"{reports[0]['study_s']:.0f} s and {reports[1]['study_s']:.0f} s")
        print("errors, assets and samples: " + ("equal to the last digit" if same else "DIFFER"))
        apart = compare_times(*reports)
        agree = apart <= AGREE
        print(f"times: {100 * apart:.1f} % apart in the median" + ("" if agree else
              f": more than {100 * AGREE:.0f} %, the machine is too busy"))
        return 0 if same and agree else 1


if __name__ == "__main__":
    sys.exit(main())
