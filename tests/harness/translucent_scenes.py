#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Scenes with translucent casters, written as OBJ and MTL (z up, metres): the same bytes always.

    hair(path, strands=600)   a head on a floor, with translucent ribbons hanging from it
    glass(path)               panes, a ball of glass inside another, an opaque post, on a floor
    yard(path)                three boxes on a floor, for lamps
"""
import math
import os
import random
import sys


class Obj:
    def __init__(self, path, opacities):
        """opacities: {material: what it takes of the light}."""
        self.path, self.lines, self.count = path, [], 0
        library = os.path.splitext(path)[0] + ".mtl"
        with open(library, "w", encoding="ascii") as file:
            for name, opacity in opacities.items():
                file.write(f"newmtl {name}\nd {opacity}\n")
        self.lines.append(f"mtllib {os.path.basename(library)}")

    def material(self, name):
        self.lines.append(f"usemtl {name}")

    def polygon(self, *corners):
        self.lines += ["v %.6f %.6f %.6f" % corner for corner in corners]
        self.lines.append("f " + " ".join(str(self.count + 1 + i) for i in range(len(corners))))
        self.count += len(corners)

    def box(self, low, high):
        (a, b, c), (d, e, f) = low, high
        for face in (((a, b, c), (a, e, c), (d, e, c), (d, b, c)), ((a, b, f), (d, b, f), (d, e, f), (a, e, f)),
                     ((a, b, c), (d, b, c), (d, b, f), (a, b, f)), ((a, e, c), (a, e, f), (d, e, f), (d, e, c)),
                     ((a, b, c), (a, b, f), (a, e, f), (a, e, c)), ((d, b, c), (d, e, c), (d, e, f), (d, b, f))):
            self.polygon(*face)

    def ball(self, centre, radius, rings=24):
        def at(i, k):
            tilt, turn = math.pi * i / rings, math.pi * k / rings
            return tuple(c + radius * d for c, d in zip(centre, (math.sin(tilt) * math.cos(turn),
                                                                 math.sin(tilt) * math.sin(turn), math.cos(tilt))))
        for i in range(rings):
            for k in range(2 * rings):
                corners = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]
                self.polygon(*(corners[:3] if i == 0 else corners if i + 1 < rings else
                               (corners[0], corners[1], corners[3])))

    def write(self):
        with open(self.path, "w", encoding="ascii") as file:
            file.write("\n".join(self.lines) + "\n")


def hair(path, strands=600):
    rng = random.Random(3)
    obj = Obj(path, {"floor": 1, "head": 1, "dark": 0.5, "light": 0.2})
    obj.material("floor")
    obj.polygon((-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0))
    obj.material("head")
    obj.ball((0, 0, 2.2), 0.5)
    for strand in range(strands):
        obj.material("dark" if strand % 3 else "light")
        turn, tilt = 2 * math.pi * rng.random(), 0.5 * math.pi * rng.random()
        point = [0.52 * math.sin(tilt) * math.cos(turn), 0.52 * math.sin(tilt) * math.sin(turn),
                 2.2 + 0.52 * math.cos(tilt)]
        way = [math.sin(tilt) * math.cos(turn), math.sin(tilt) * math.sin(turn), math.cos(tilt)]
        side = [-math.sin(turn) * 0.008, math.cos(turn) * 0.008, 0.004 * rng.random()]
        for _ in range(14):
            way = [0.86 * way[0] + 0.02 * (rng.random() - 0.5), 0.86 * way[1] + 0.02 * (rng.random() - 0.5),
                   max(way[2] - 0.22, -1.0)]
            after = [p + 0.1 * w for p, w in zip(point, way)]
            obj.polygon(*(tuple(p + sign * s for p, s in zip(place, side))
                          for place, sign in ((point, -1), (point, 1), (after, 1), (after, -1))))
            point = after
    obj.write()


def glass(path):
    obj = Obj(path, {"floor": 1, "thin": 0.3, "tinted": 0.5, "dark": 0.9, "ball": 0.35})
    obj.material("floor")
    obj.polygon((-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0))
    obj.box((-3, 2, 0), (-2.6, 2.4, 3))
    for name, x, lean in (("thin", -2.0, 0.3), ("tinted", -1.0, 0.0), ("dark", 0.0, -0.4), ("thin", 0.6, 0.0)):
        obj.material(name)
        obj.polygon((x, -2.0, 0.2), (x, 1.0, 0.2), (x + lean, 1.0, 2.4), (x + lean, -2.0, 2.4))
    obj.material("tinted")
    obj.polygon((-3, -3, 2.7), (0, -3, 2.8), (0, 0, 2.9), (-3, 0, 2.8))
    obj.material("ball")
    obj.ball((2.2, 0.4, 1.2), 1.0)
    obj.ball((2.2, 0.4, 1.2), 0.5, 12)
    obj.write()


def yard(path):
    obj = Obj(path, {"floor": 1, "crate": 1, "tower": 1, "wall": 1})
    obj.material("floor")
    obj.polygon((-8, -8, 0), (8, -8, 0), (8, 8, 0), (-8, 8, 0))
    for name, low, high in (("crate", (-3, -1, 0), (-1, 1, 2)), ("tower", (1, 1, 0), (2, 3, 3)),
                            ("wall", (0, -4, 0), (3, -3, 1.2))):
        obj.material(name)
        obj.box(low, high)
    obj.write()


if __name__ == "__main__":
    {"hair": hair, "glass": glass, "yard": yard}[sys.argv[1]](sys.argv[2])
