#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
compare_versions.py BEFORE AFTER OUT.png X0,Y0 X1,Y1 Z: where an edit of the scene changes the light.

BEFORE and AFTER are assets of two versions of a scene with the same lights. The square at height Z is drawn: red where
shade came, blue where light came, grey where nothing changed. Prints the square metres of both for each light.
"""
import sys

import matplotlib
import numpy as np

import umbrage

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

SPACING_M = 0.5


def main(before, after, picture, low, high, height):
    x, y = np.arange(low[0], high[0], SPACING_M), np.arange(low[1], high[1], SPACING_M)
    grid = np.empty((len(y), len(x), 3), np.float32)
    grid[..., 0], grid[..., 1], grid[..., 2] = x, y[:, None], height
    with umbrage.open(before) as old, umbrage.open(after) as new:
        if [light.name for light in old.lights] != [light.name for light in new.lights]:
            sys.exit("the assets have different lights")
        names = [light.name for light in new.lights]
        change = new.query(grid, light="all", taps=3) - old.query(grid, light="all", taps=3)
    for name, one in zip(names, change):
        print(f"{name}: {np.clip(-one, 0, None).sum() * SPACING_M**2:.1f} m2 of new shade, "
              f"{np.clip(one, 0, None).sum() * SPACING_M**2:.1f} m2 of new light")
    figure, axes = plt.subplots(1, len(names), figsize=(5 * len(names), 4.5), squeeze=False, layout="constrained")
    for axis, name, one in zip(axes[0], names, change):
        axis.imshow(one, cmap="RdBu", vmin=-1, vmax=1, origin="lower", extent=(low[0], high[0], low[1], high[1]))
        axis.set(title=name, xlabel="x, metres", ylabel="y, metres")
    figure.savefig(picture, dpi=120)


if __name__ == "__main__":
    if len(sys.argv) != 7:
        sys.exit(__doc__)
    places = [[float(number) for number in word.split(",")] for word in sys.argv[4:6]]
    main(*sys.argv[1:4], *places, float(sys.argv[6]))
