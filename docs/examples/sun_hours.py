#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
sun_hours.py ASSET OUT.png X0,Y0 X1,Y1 Z [METRES]: hours of sun on a square, as an array and as a picture.

ASSET has the suns of a day (umbrage-bake --sun-path), at equal times apart. The square lies at height Z; METRES is the
distance of its points (default 0.5). Writes OUT.npy beside the picture: float32[rows, columns], hours.
"""
import os
import sys

import matplotlib
import numpy as np

import umbrage

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def hours_of_sun(asset, low, high, height, spacing=0.5):
    """Hours of sun at points of a level grid: float32[rows, columns]. Rows go from low y to high y."""
    x, y = np.arange(low[0], high[0], spacing), np.arange(low[1], high[1], spacing)
    grid = np.empty((len(y), len(x), 3), np.float32)
    grid[..., 0], grid[..., 1], grid[..., 2] = x, y[:, None], height
    normals = np.zeros_like(grid)
    normals[..., 2] = 1
    times = [one.name.split()[-1] for one in asset.lights]
    minutes = [60 * int(time[:2]) + int(time[3:5]) for time in times]
    step_h = (minutes[-1] - minutes[0]) / 60 / (len(minutes) - 1)
    total = np.zeros(grid.shape[:-1], np.float32)
    for number in range(len(times)):  # one sun after the other: the grid may be large
        total += asset.query(grid, normals, light=number, taps=3, threads=os.cpu_count() or 1)
    return total * step_h


def main(asset_name, picture, low, high, height, spacing=0.5):
    with umbrage.open(asset_name) as asset:
        hours = hours_of_sun(asset, low, high, height, spacing)
    np.save(os.path.splitext(picture)[0] + ".npy", hours)
    print(f"{hours.size} points: {hours.min():.1f} to {hours.max():.1f} hours of sun, mean {hours.mean():.1f}")
    figure, axes = plt.subplots(figsize=(7, 6), layout="constrained")
    shown = axes.imshow(hours, cmap="inferno", origin="lower", extent=(low[0], high[0], low[1], high[1]))
    figure.colorbar(shown, label="hours of sun")
    axes.set(xlabel="x, metres", ylabel="y, metres", title="Hours of sun")
    figure.savefig(picture, dpi=120)


if __name__ == "__main__":
    if len(sys.argv) not in (6, 7):
        sys.exit(__doc__)
    corners = [[float(number) for number in word.split(",")] for word in sys.argv[3:5]]
    main(sys.argv[1], sys.argv[2], corners[0], corners[1], *(float(word) for word in sys.argv[5:]))
