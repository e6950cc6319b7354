#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
plot_study.py STUDY OUT.png: error against time and memory of every setting that a study measured.

STUDY is a folder that `umbrage study` made, or its report.json. Prints the settings on the front: those that no other
beats in both error and time.
"""
import json
import math
import os
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def read_study(path):
    """A study's JSON from its folder or file."""
    with open(os.path.join(path, "report.json") if os.path.isdir(path) else path, encoding="utf-8") as file:
        return json.load(file)


def settings_of(study):
    """One dict a measured setting: method, voxels, taps, error (rms), nanoseconds a point, bytes of memory."""
    rows = []
    for row in study["results"]:
        if row["rms"] is not None and row["ns_view"]:
            bake = study["bakes"][row["bake"]]
            rows.append({"method": row["method"], "voxels": bake["resolution"], "taps": row["taps"], "level": row["level"],
                         "error": row["rms"], "ns": row["ns_view"], "bytes": row["memory_bytes"]})
    return rows


def front(rows):
    """Settings that no other beats in error and time, the fastest first."""
    best, kept = math.inf, []
    for row in sorted(rows, key=lambda row: (row["ns"], row["error"])):
        if row["error"] < best:
            best = row["error"]
            kept.append(row)
    return kept


def draw(study, picture):
    rows, kept = settings_of(study), front(settings_of(study))
    figure, panels = plt.subplots(1, 2, figsize=(11, 5), layout="constrained", sharey=True)
    methods = sorted({row["method"] for row in rows})
    colours = plt.get_cmap("tab20")
    for axes, key, scale in ((panels[0], "ns", 1), (panels[1], "bytes", 2**20)):
        for number, method in enumerate(methods):
            chosen = [row for row in rows if row["method"] == method]
            axes.scatter([row[key] / scale for row in chosen], [row["error"] for row in chosen], color=colours(number % 20),
                         s=[12 + 4 * row["taps"] for row in chosen], alpha=0.8, label=method)
        axes.set(xscale="log", yscale="log")
        axes.grid(alpha=0.3)
    panels[0].plot([row["ns"] for row in kept], [row["error"] for row in kept], color="black", linewidth=1, label="front")
    if study["rays"]["ns_view"]:
        panels[0].axvline(study["rays"]["ns_view"], color="grey", linestyle="--", label="one ray a point")
    panels[0].set(xlabel="nanoseconds a point of a picture, one thread", ylabel="error of visibility (root mean square)")
    panels[1].set(xlabel="memory, MiB")
    panels[1].legend(*panels[0].get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(1.02, 1), fontsize="small")
    figure.suptitle(f"{os.path.basename(study['scene'])}: larger dots have wider windows")
    figure.savefig(picture, dpi=120)
    return kept


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    for one in draw(read_study(sys.argv[1]), sys.argv[2]):
        print(f"{one['method']} {one['voxels']} voxels, {one['taps']} taps, level {one['level']}: error {one['error']:.4f}, "
              f"{one['ns']:.1f} ns, {one['bytes'] / 2**20:.2f} MiB")
