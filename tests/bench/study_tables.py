# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/results/study.md, between their markers: what accuracy costs on generated and real
scenes, beside a shadow map, a NanoVDB grid and rays. `make accuracy` runs it. A study is read from
UMBRAGE_STUDIES/FILE-NAME if it is there, so that scenes can be measured one by one on a busy machine;
else it is made."""

import json
import os
import re
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
    """Returns a setting. For assets the closed one, if there is one and the caller does not say
    otherwise."""
    found = [row for row in report["results"]
             if row["method"] == method and row["taps"] == taps and row["level"] == level
             and report["bakes"][row["bake"]]["resolution"] == resolution
             and closed in (None, report["bakes"][row["bake"]]["closed"])]
    found.sort(key=lambda row: not report["bakes"][row["bake"]]["closed"])
    return found[0] if found else None


def time_of(row):
    return "-" if row is None else f"{row['ns_view']:.0f}"


def share(value):
    """A share as per cent, of two digits."""
    return "0" if value == 0 else f"{100 * value:.2g} %"


def metres(value):
    return "0" if value == 0 else f"{short(value)} m" if value >= 1 else f"{short(1000 * value)} mm"


def megabytes(row):
    return "-" if row is None else short(row["memory_bytes"] / 1e6)


def peers(studies):
    """Each filter at the finest resolution, and the peers that answer the same points."""
    yield ("| scene | taps | wrong | off by, mean | visibility RMS | closed: ns, MB | open: ns, MB | depth map: ns, MB | "
           "NanoVDB: ns, MB | Embree: ns |\n|---|---|---|---|---|---|---|---|---|---|\n")
    for name, report in studies:
        rays = report["rays"]
        for taps, ray in ((1, "ns_view"), (9, "ns_area81")):
            ours = pick(report, "dag", FINEST, taps)
            cells = [f"{time_of(row)}, {megabytes(row)}" if row else "-" for row in (
                pick(report, "dag", FINEST, taps, closed=True), pick(report, "dag", FINEST, taps, closed=False), pick(report, "depth map", FINEST, taps),
                pick(report, "nanovdb", FINEST, taps))]
            eight = rays["ns_view8" if taps == 1 else "ns_area81_8"]
            yield (f"| {name if taps == 1 else ''} | {taps} | {share(ours['wrong_view'])} | {metres(ours['off_mean_m'])} | {short(ours['rms'])} | "
                   + " | ".join(cells) + f" | {short(rays[ray])}, eight a call {short(eight)} |\n")


def knobs(studies):
    """Resolution, and at the finest one the filter and the level: wrong answers, mean distance, ns, kB on disk."""
    yield ("\n| scene | 512 voxels a side | 1024 | 2048 | 4096 | 3 taps | 9 taps | level 3 | level 5 |\n"
           "|---|---|---|---|---|---|---|---|---|\n")
    for name, report in studies:
        cells = []
        for resolution in (512, 1024, 2048, FINEST):
            row = pick(report, "dag", resolution, 1)
            bake = report["bakes"][row["bake"]]
            cells.append(f"{share(row['wrong_view'])}, {metres(row['off_mean_m'])}, {short(row['ns_view'])} ns, "
                         f"{short(bake['packed_bytes'] / 1e3)} kB")
        for taps, level in ((3, 0), (9, 0), (1, 3), (1, 5)):
            row = pick(report, "dag", FINEST, taps, level)
            cells.append(f"{share(row['wrong_view'])}, {metres(row['off_mean_m'])}, {short(row['ns_view'])} ns")
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


def prices(studies):
    """The second line of each verdict: the price of half the error."""
    yield ("\n| scene | half the share of wrong answers: voxels a side | bytes | time of a look-up | bake |\n"
           "|---|---|---|---|---|\n")
    for name, report in studies:
        found = re.search(r"Half the error costs: (\S+) times the voxels a side, and with them (\S+) times the bytes, "
                          r"(\S+) times the time of a look-up and (\S+) times the bake", report["verdict"])
        cells = [f"{times} times" for times in found.groups()] if found else ["-"] * 4
        yield f"| {name} | " + " | ".join(cells) + " |\n"


def techniques(studies):
    """The nearest map of the literature, compared with its own box and with umbrage of equal texels and
    of equal bytes."""
    yield ("\n| scene | nearest map: difference, MB, ns | umbrage of equal texels | without vectors, ns | "
           "of no more bytes |\n|---|---|---|---|---|\n")
    for name, report in studies:
        rows = report["techniques"]["rows"]
        best = min((row for row in rows if row["truth"] == "box" and not row["dag"]), key=lambda row: row["mean"])
        cells = [f"{short(row['mean'])}, {short(row['bytes'] / 1e6)}, {short(row['ns'])}"
                 for row in (best, rows[best["same_texels"]])]
        fits = rows[best["same_bytes"]] if best["same_bytes"] >= 0 else None
        yield (f"| {name} | {best['name']}: {cells[0]} | {cells[1]} | {short(rows[best['same_texels']]['ns_scalar'])} | "
               + (f"{fits['resolution']}: {short(fits['mean'])}, {short(fits['bytes'] / 1e6)}, {short(fits['ns'])}" if fits else "-")
               + " |\n")


def main():
    with tempfile.TemporaryDirectory() as folder:
        studies = [(name, study(name, scene, folder)) for name, scene in tables.scenes_in(folder)]
    worst = max(report["study_s"] for _, report in studies)
    text = [f"{tables.source()};\n`umbrage study SCENE --quick --sun {tables.SUN}`, {worst:.0f} s at most; ns: the least "
            "CPU time of a point\non one thread in camera views; MB in memory. *Wrong*: share of what three cameras see. "
            "*Off by*: mean\ndistance of all samples from the true edge, 0 where right.\n\n",
            *peers(studies), *knobs(studies), *prices(studies), *derived(studies), *techniques(studies)]
    tables.replace("study.md", BEGIN, END, "".join(text))


if __name__ == "__main__":
    sys.exit(main())
