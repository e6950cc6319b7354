#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
face_shares.py ASSET SCENE.obj OUT.csv: the share of each building's faces that lies in the shade of each light.

A building is an object (o) or group (g) of the OBJ file. Each triangle is sampled with a number of points that grows
with its area. The file has a line for each building and light: its area, the share in the shade, and the shares of
roofs, of walls and of the rest. Faces that look away from the light are in the shade.
"""
import csv
import sys

import numpy as np

import umbrage

SPACING_M = 0.5  # mean distance of samples
MOST = 2000      # samples of one triangle


def read_obj(path):
    """Triangles of an OBJ file by the names of their objects: {name: float64[n, 3, 3]}."""
    corners, parts, name = [], {}, "unnamed"
    with open(path, encoding="utf-8", errors="replace") as file:
        for line in file:
            words = line.split()
            if words[:1] == ["v"]:
                corners.append([float(word) for word in words[1:4]])
            elif words[:1] in (["o"], ["g"]):
                name = " ".join(words[1:]) or "unnamed"
            elif words[:1] == ["f"]:
                numbers = [int(word.split("/")[0]) for word in words[1:]]
                face = [corners[n - 1 if n > 0 else n] for n in numbers]
                parts.setdefault(name, []).extend([face[0], face[i], face[i + 1]] for i in range(1, len(face) - 1))
    return {name: np.array(triangles) for name, triangles in parts.items()}


def sample(triangles, random):
    """Points on triangles, their normals (both float32[n, 3]), and the area in square metres that each stands for."""
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    areas = np.linalg.norm(normals, axis=1) / 2
    keep = areas > 0
    triangles, normals, areas = triangles[keep], normals[keep], areas[keep]
    counts = np.clip(np.ceil(areas / SPACING_M**2), 1, MOST).astype(int)
    which = np.repeat(np.arange(len(triangles)), counts)
    u, v = random.random((2, len(which)))
    u, v = np.where(u + v > 1, (1 - u, 1 - v), (u, v))
    corner = triangles[which]
    points = corner[:, 0] + u[:, None] * (corner[:, 1] - corner[:, 0]) + v[:, None] * (corner[:, 2] - corner[:, 0])
    return points.astype(np.float32), normals[which].astype(np.float32), (areas / counts)[which]


def main(asset_name, scene, out):
    random = np.random.default_rng(1)
    with umbrage.open(asset_name) as asset, open(out, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["building", "light", "area_m2", "in_shade", "roofs", "walls", "rest"])
        for name, triangles in read_obj(scene).items():
            points, normals, areas = sample(triangles, random)
            if not len(points):
                continue
            up = normals[:, 2] / np.linalg.norm(normals, axis=1)
            kinds = {"all": up > -2, "roofs": up > 0.5, "walls": np.abs(up) <= 0.5, "rest": up < -0.5}
            for number, light in enumerate(asset.lights):
                shade = 1 - asset.query(points, normals, light=number, taps=3)
                shares = [f"{np.average(shade[kind], weights=areas[kind]):.4f}" if kind.any() else ""
                          for kind in kinds.values()]
                table.writerow([name, light.name, f"{areas.sum():.1f}", *shares])


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
