# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/results/study.md, between their markers: what accuracy costs on generated and real
scenes, beside a shadow map, a NanoVDB grid and rays. `make accuracy` runs it. A study is read from
UMBRAGE_STUDIES/FILE-NAME if it is there, so that scenes can be measured one by one on a busy machine;
else it is made. A time whose runs differ too much is written as -."""

import json
import os
import sys
import tempfile

import accuracy_tables as tables

BEGIN, END = "<!-- study tables: make accuracy -->\n", "<!-- end of study tables -->\n"
FINEST = 4096


def study(name, scene, folder):
    kept = os.environ.get("UMBRAGE_STUDIES")
    name = os.path.basename(scene)
    place = os.path.join(kept, name) if kept else os.path.join(folder, name + "-study")
    report = os.path.join(place, "report.json")
    if not (kept and os.path.exists(report)):
        tables.run("umbrage-study", scene, "-o", place, "--quick", "--max-resolution", FINEST, "--sun", tables.SUN,
                   "--quiet")
    with open(report, encoding="utf-8") as file:
        print(f"{name}: studied", flush=True)
        return json.load(file)


def short(value):
    return "-" if value is None else "0" if value == 0 else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def pick(report, method, resolution, taps, level=0, closed=None):
    """A setting; of assets the closed one, if there is one and closed is not said."""
    found = [row for row in report["results"]
             if row["method"] == method and row["taps"] == taps and row["level"] == level
             and report["bakes"][row["bake"]]["resolution"] == resolution
             and closed in (None, report["bakes"][row["bake"]]["closed"])]
    found.sort(key=lambda row: not report["bakes"][row["bake"]]["closed"])
    return found[0] if found else None


def time_of(row):
    return "-" if row is None or row["ns_view"] is None else f"{row['ns_view']:.0f} ± {100 * row['spread']:.0f} %"


def megabytes(row):
    return "-" if row is None else short(row["memory_bytes"] / 1e6)


def peers(studies):
    """Each filter at the finest resolution, beside what else answers the same points."""
    yield ("| scene | taps | edges within, m | visibility RMS | closed: ns, MB | open: ns, MB | depth map: ns, MB | "
           "NanoVDB: ns, MB | Embree: ns |\n|---|---|---|---|---|---|---|---|---|\n")
    for name, report in studies:
        rays = report["rays"]
        for taps, ray in ((1, "ns_view"), (9, "ns_area81")):
            ours = pick(report, "dag", FINEST, taps)
            cells = [f"{time_of(row)}, {megabytes(row)}" if row else "-" for row in (
                pick(report, "dag", FINEST, taps, closed=True), pick(report, "dag", FINEST, taps, closed=False), pick(report, "depth map", FINEST, taps),
                pick(report, "nanovdb", FINEST, taps))]
            eight = rays["ns_view8" if taps == 1 else "ns_area81_8"]
            yield (f"| {name if taps == 1 else ''} | {taps} | {short(ours['off_p95_m'])} | {short(ours['rms'])} | "
                   + " | ".join(cells) + f" | {short(rays[ray])}, eight a call {short(eight)} |\n")


def knobs(studies):
    """Resolution, and at the finest one the filter and the level: edges, RMS, ns, kB on disk."""
    yield ("\n| scene | 512 voxels a side | 1024 | 2048 | 4096 | 3 taps | 9 taps | level 3 | level 5 |\n"
           "|---|---|---|---|---|---|---|---|---|\n")
    for name, report in studies:
        cells = []
        for resolution in (512, 1024, 2048, FINEST):
            row = pick(report, "dag", resolution, 1)
            bake = report["bakes"][row["bake"]]
            cells.append(f"{short(row['off_p95_m'])} m, {short(row['rms'])}, {short(row['ns_view'])} ns, "
                         f"{short(bake['packed_bytes'] / 1e3)} kB")
        for taps, level in ((3, 0), (9, 0), (1, 3), (1, 5)):
            row = pick(report, "dag", FINEST, taps, level)
            cells.append(f"{short(row['off_p95_m'])} m, {short(row['rms'])}, {short(row['ns_view'])} ns")
        yield f"| {name} | " + " | ".join(cells) + " |\n"


def derived(studies):
    """The maps for GPUs of 1024 texels beside the asset that they came from: RMS, MB."""
    names = ("pcf", "vsm", "esm", "evsm", "msm")
    yield ("\n| scene | 9 x 9 taps of the asset of 1024 | " + " | ".join(f"derived {name}" for name in names) + " |\n"
           + "|---" * (2 + len(names)) + "|\n")
    for name, report in studies:
        rows = [pick(report, "dag", 1024, 9, closed=False)]
        rows += [pick(report, f"derived {kind}", 1024, 9) for kind in names]
        yield f"| {name} | " + " | ".join(f"{short(row['rms'])}, {megabytes(row)}" for row in rows) + " |\n"


def main():
    with tempfile.TemporaryDirectory() as folder:
        studies = [(name, study(name, scene, folder)) for name, scene in tables.scenes_in(folder)]
    worst = max(report["study_s"] for _, report in studies)
    text = [f"{tables.source()};\n`umbrage study SCENE --quick --sun {tables.SUN}`, {worst:.0f} s at most; ns a "
            "point on one thread in camera views,\n± the spread of its runs; MB in memory. *Edges within*: where "
            "an answer is on the wrong side,\n95 % of the true edges are nearer.\n\n", *peers(studies), *knobs(studies),
            *derived(studies)]
    tables.replace("study.md", BEGIN, END, "".join(text))


if __name__ == "__main__":
    sys.exit(main())
