#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
path_shade.py ASSET OUT.png X,Y,Z X,Y,Z ...: how much of a walk lies in the shade, hour by hour.

ASSET has the suns of a day (umbrage-bake --sun-path). The path is walked in steps of half a metre. The picture has a
row for each sun and a column for each step: dark is shade. Prints the share of the path in the shade at each time.
"""
import sys

import matplotlib
import numpy as np

import umbrage

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

STEP_M = 0.5


def walk(corners):
    """Points along a path, float32[n, 3], and their distance from its start, metres."""
    corners = np.asarray(corners, float)
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    along = np.concatenate([[0], np.cumsum(lengths)])
    steps = np.arange(0, along[-1], STEP_M)
    points = np.stack([np.interp(steps, along, corners[:, axis]) for axis in range(3)], axis=1)
    return points.astype(np.float32), steps


def main(asset_name, picture, corners):
    points, metres = walk(corners)
    with umbrage.open(asset_name) as asset:
        light = asset.query(points, light="all", taps=9)  # [suns, steps]
        times = [one.name.split()[-1][:5] for one in asset.lights]
    for time, row in zip(times, light):
        print(f"{time}  {100 * (1 - row.mean()):5.1f} % of {metres[-1]:.0f} m in the shade")
    figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
    axes.imshow(light, cmap="gray", vmin=0, vmax=1, aspect="auto", extent=(0, metres[-1], len(times), 0))
    axes.set_yticks(np.arange(len(times)) + 0.5, times)
    axes.set(xlabel="metres along the path", ylabel="mean solar time", title="Shade of a walk")
    figure.savefig(picture, dpi=120)


if __name__ == "__main__":
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2], [[float(number) for number in word.split(",")] for word in sys.argv[3:]])
