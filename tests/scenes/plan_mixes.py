# SPDX-License-Identifier: Apache-2.0
"""Scenes for tests of the plan's decisions. The bytes are always the same. MIXES: closed and open
parts together, as OBJ (z up, metres), for `make plan-scenes`; write_leaves: trees whose leaves are
BLEND, as GLB."""
import json
import math
import os
import random
import struct
import zlib

COLUMN = [(0, 0), (1, 0), (1, 1), (0, 1)]


class Obj:
    def __init__(self, seed):
        self.rng = random.Random(seed)
        self.vertices, self.faces = [], []

    def polygon(self, *corners):
        first = len(self.vertices) + 1
        self.vertices += corners
        self.faces.append(range(first, first + len(corners)))

    def rect(self, x, y, width, depth, z=0.0):
        self.polygon((x, y, z), (x + width, y, z), (x + width, y + depth, z), (x, y + depth, z))

    def wall(self, a, b, low, high):
        self.polygon((*a, low), (*b, low), (*b, high), (*a, high))

    def prism(self, outline, low, high, lid=True):
        """A closed body over a convex outline, counter-clockwise; without its lid it is open."""
        count = len(outline)
        first = len(self.vertices) + 1
        self.vertices += [(x, y, low) for x, y in outline] + [(x, y, high) for x, y in outline]
        for i in range(count):
            k = (i + 1) % count
            self.faces.append((first + i, first + k, first + count + k, first + count + i))
        self.faces.append([first + i for i in reversed(range(count))])
        if lid:
            self.faces.append([first + count + i for i in range(count)])

    def box(self, x, y, z, width, depth, height, turn=0.0, lid=True):
        """A closed box around (x, y), turned by an angle in radians, from z up."""
        c, s = math.cos(turn), math.sin(turn)
        self.prism([(x + (i - 0.5) * width * c - (k - 0.5) * depth * s,
                     y + (i - 0.5) * width * s + (k - 0.5) * depth * c) for i, k in COLUMN],
                   z, z + height, lid)

    def cylinder(self, x, y, z, radius, height, sides=16, lid=True):
        self.prism([(x + radius * math.cos(2 * math.pi * i / sides),
                     y + radius * math.sin(2 * math.pi * i / sides)) for i in range(sides)],
                   z, z + height, lid)

    def ball(self, x, y, z, radius, rings=12, gap=False):
        """A closed ball; with a gap one of its faces is missing."""
        first = len(self.vertices) + 1
        around = 2 * rings
        self.vertices.append((x, y, z + radius))
        for i in range(1, rings):
            tilt = math.pi * i / rings
            self.vertices += [(x + radius * math.sin(tilt) * math.cos(math.pi * k / rings),
                               y + radius * math.sin(tilt) * math.sin(math.pi * k / rings),
                               z + radius * math.cos(tilt)) for k in range(around)]
        self.vertices.append((x, y, z - radius))
        last = len(self.vertices)

        def at(i, k):
            return first if i == 0 else last if i == rings else first + 1 + (i - 1) * around + k % around
        for i in range(rings):
            for k in range(around):
                face = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]
                if not (gap and i == rings // 2 and k == 0):
                    self.faces.append(face[:3] if i == 0 else (face[0], face[1], face[3]) if i + 1 == rings else face)

    def house(self, x, y, width, depth, height, turn=0.0, eaves=0.0):
        """A closed house with a gable roof; with eaves its roof is two open sheets above it."""
        c, s = math.cos(turn), math.sin(turn)

        def place(u, v, w):
            return (x + u * c - v * s, y + u * s + v * c, w)
        a, b, top = width / 2, depth / 2, height + width / 3
        first = len(self.vertices) + 1
        self.vertices += [place(*p) for p in ((-a, -b, 0), (a, -b, 0), (a, b, 0), (-a, b, 0),
                                              (-a, -b, height), (a, -b, height), (a, b, height),
                                              (-a, b, height), (0, -b, top), (0, b, top))]
        for face in ((3, 2, 1, 0), (0, 1, 5, 8, 4), (2, 3, 7, 9, 6), (1, 2, 6, 5), (3, 0, 4, 7),
                     (5, 6, 9, 8), (7, 4, 8, 9)):
            self.faces.append([first + i for i in face])
        if eaves > 0:
            slope = (top - height) / a
            for side in (-1, 1):
                self.polygon(place(0, -b - eaves, top + 0.05), place(0, b + eaves, top + 0.05),
                             place(side * (a + eaves), b + eaves, height - eaves * slope + 0.05),
                             place(side * (a + eaves), -b - eaves, height - eaves * slope + 0.05))

    def land(self, cells, step, height, z=0.0, solid=False):
        """A rolling ground of cells x cells quads; a solid one has sides and a floor."""
        rng = self.rng
        waves = [(rng.uniform(0.5, 6), rng.uniform(0.5, 6), rng.uniform(0, 6.3), rng.uniform(0, 6.3),
                  height / (i + 1.5)) for i in range(6)]

        def at(i, k):
            u, v = 2 * math.pi * i / cells, 2 * math.pi * k / cells
            return z + sum(h * math.sin(a * u + p) * math.cos(b * v + q) for a, b, p, q, h in waves)
        first = len(self.vertices) + 1
        n = cells + 1
        self.vertices += [(i * step, k * step, at(i, k)) for k in range(n) for i in range(n)]
        for k in range(cells):
            for i in range(cells):
                q = first + k * n + i
                self.faces += [(q, q + 1, q + n + 1), (q, q + n + 1, q + n)]
        if solid:
            floor = len(self.vertices) + 1
            self.vertices += [(i * step, k * step, z - 3 * height) for k in range(n) for i in range(n)]
            for k in range(cells):
                for i in range(cells):
                    q = floor + k * n + i
                    self.faces += [(q, q + n + 1, q + 1), (q, q + n, q + n + 1)]
            for i in range(cells):
                for a, b in (((i, 0), (i + 1, 0)), ((i + 1, cells), (i, cells)),
                             ((0, i + 1), (0, i)), ((cells, i), (cells, i + 1))):
                    p, q = a[1] * n + a[0], b[1] * n + b[0]
                    self.faces += [(first + q, first + p, floor + p), (first + q, floor + p, floor + q)]
        return at

    def tree(self, x, y, z, height, leaves):
        """A closed trunk and open cards."""
        rng = self.rng
        self.cylinder(x, y, z, height / 40, height * 0.6, 8)
        for _ in range(leaves):
            size = height / 12
            u, v, w = (rng.gauss(0, height / 6) for _ in range(3))
            a, b = rng.uniform(0, 6.3), rng.uniform(-1, 1)
            right = (math.cos(a) * size, math.sin(a) * size, 0)
            up = (-math.sin(a) * b * size, math.cos(a) * b * size, size)
            c = (x + u, y + v, z + height * 0.7 + w)
            self.polygon(*[tuple(c[j] + s * right[j] + t * up[j] for j in range(3)) for s, t in COLUMN])

    def write(self, path):
        with open(path, "w", encoding="ascii") as file:
            file.write("# z up, metres\n")
            file.writelines("v %.5f %.5f %.5f\n" % vertex for vertex in self.vertices)
            file.writelines("f " + " ".join(map(str, face)) + "\n" for face in self.faces)


def objects_on_land(o, count=120, size=2000.0):
    o.rect(0, 0, size, size)
    for i in range(count):
        x, y = o.rng.uniform(20, size - 20), o.rng.uniform(20, size - 20)
        if i % 3 == 0:
            o.ball(x, y, 4, 4)
        elif i % 3 == 1:
            o.box(x, y, 0, o.rng.uniform(3, 12), o.rng.uniform(3, 12), o.rng.uniform(3, 25), o.rng.uniform(0, 3))
        else:
            o.cylinder(x, y, 0, o.rng.uniform(1, 4), o.rng.uniform(4, 30))


def few_objects_on_land(o):
    objects_on_land(o, 8)


def tower_among_sheets(o):
    o.cylinder(50, 50, 0, 6, 60, 24)
    for _ in range(60):
        x, y, a = o.rng.uniform(0, 100), o.rng.uniform(0, 100), o.rng.uniform(0, 6.3)
        o.wall((x, y), (x + 8 * math.cos(a), y + 8 * math.sin(a)), 0, o.rng.uniform(2, 12))


def sheets_about_towers(o):
    for _ in range(40):
        o.cylinder(o.rng.uniform(0, 300), o.rng.uniform(0, 300), 0, o.rng.uniform(4, 12), o.rng.uniform(20, 80))
    for _ in range(10):
        x, y = o.rng.uniform(0, 300), o.rng.uniform(0, 300)
        o.wall((x, y), (x + 10, y + 3), 0, 8)


def trees(o, count=40, leaves=300):
    o.rect(-10, -10, 120, 120)
    for _ in range(count):
        o.tree(o.rng.uniform(0, 100), o.rng.uniform(0, 100), 0, o.rng.uniform(6, 15), leaves)


def bare_trees(o):
    trees(o, 60, 6)


def town_on_plane(o, count=150, eaves=0.0, size=600.0):
    o.rect(0, 0, size, size)
    for _ in range(count):
        o.house(o.rng.uniform(20, size - 20), o.rng.uniform(20, size - 20), o.rng.uniform(7, 12),
                o.rng.uniform(8, 18), o.rng.uniform(3, 8), o.rng.uniform(0, 3.1), eaves)


def town_with_eaves(o):
    town_on_plane(o, 150, 0.6)


def small_town_on_wide_plane(o):
    o.rect(-4000, -4000, 8000, 8000)
    town_on_plane(o, 60, 0.0, 200.0)


def town_alone(o):
    for _ in range(80):
        o.house(o.rng.uniform(0, 400), o.rng.uniform(0, 400), 9, 12, 6, o.rng.uniform(0, 3))


def half_open_town(o, share=0.5):
    for i in range(100):
        o.box(20 * (i % 10), 20 * (i // 10), 0, o.rng.uniform(6, 14), o.rng.uniform(6, 14), o.rng.uniform(5, 40),
              o.rng.uniform(0, 0.4), lid=o.rng.random() >= share)


def mostly_open_town(o):
    half_open_town(o, 0.9)


def mostly_closed_town(o):
    half_open_town(o, 0.1)


def five_closed_of_216(o):
    for i in range(216):
        o.box(25 * (i % 15), 25 * (i // 15), o.rng.uniform(0, 9), o.rng.uniform(6, 18), o.rng.uniform(6, 18),
              o.rng.uniform(5, 30), o.rng.uniform(0, 3), lid=i % 43 == 0)


def balls_on_plane(o):
    o.rect(0, 0, 100, 100)
    for _ in range(40):
        o.ball(o.rng.uniform(5, 95), o.rng.uniform(5, 95), o.rng.uniform(2, 12), o.rng.uniform(1, 4), 16)


def balls_with_gaps(o):
    for i in range(40):
        o.ball(o.rng.uniform(5, 95), o.rng.uniform(5, 95), o.rng.uniform(2, 40), o.rng.uniform(1, 6), 16, i % 3 != 0)


def houses_on_open_land(o):
    at = o.land(120, 5.0, 12.0)
    for _ in range(60):
        i, k = o.rng.randrange(5, 115), o.rng.randrange(5, 115)
        o.box(5 * i, 5 * k, at(i, k) - 3, 8, 10, 12, o.rng.uniform(0, 3))


def trees_on_solid_land(o):
    at = o.land(100, 4.0, 8.0, solid=True)
    for _ in range(25):
        i, k = o.rng.randrange(5, 95), o.rng.randrange(5, 95)
        o.tree(4 * i, 4 * k, at(i, k), o.rng.uniform(8, 15), 150)


def solid_land(o):
    o.land(140, 5.0, 15.0, solid=True)


def furniture_in_open_room(o):
    o.rect(0, 0, 8, 6)
    o.wall((0, 0), (8, 0), 0, 2.8)
    o.wall((0, 0), (0, 6), 0, 2.8)
    for _ in range(14):
        x, y = o.rng.uniform(1, 7), o.rng.uniform(1, 5)
        o.box(x, y, 0.72, o.rng.uniform(0.5, 1.6), o.rng.uniform(0.5, 0.9), 0.04)
        for i, k in COLUMN:
            o.box(x + (i - 0.5) * 0.4, y + (k - 0.5) * 0.4, 0, 0.05, 0.05, 0.72)


def cars_with_panes(o):
    o.rect(0, 0, 60, 60)
    for i in range(36):
        x, y = 5 + 10 * (i % 6), 5 + 10 * (i // 6)
        o.box(x, y, 0.3, 1.8, 4.4, 0.6)
        for u, v in ((-0.8, -1.5), (0.8, -1.5), (-0.8, 1.5), (0.8, 1.5)):
            o.ball(x + u, y + v, 0.32, 0.32, 6)
        for u in (-0.85, 0.85):
            o.polygon((x + u, y - 1.2, 0.9), (x + u, y + 1.2, 0.9), (x + 0.8 * u, y + 0.8, 1.5), (x + 0.8 * u, y - 0.8, 1.5))
        o.polygon((x - 0.7, y - 0.8, 1.5), (x + 0.7, y - 0.8, 1.5), (x + 0.7, y + 0.8, 1.5), (x - 0.7, y + 0.8, 1.5))


def speck_on_sheet(o):
    o.rect(0, 0, 1000, 1000)
    o.box(500, 500, 0, 2, 2, 2)


def posts_and_fences(o):
    o.rect(0, 0, 80, 80)
    for i in range(80):
        o.cylinder(i, 40, 0, 0.06, 2, 8)
        o.wall((i, 20), (i + 0.9, 20), 0.2, 1.8)


def slabs_over_plane(o):
    o.rect(0, 0, 50, 50)
    for i in range(25):
        o.box(o.rng.uniform(5, 45), o.rng.uniform(5, 45), 1 + i, o.rng.uniform(3, 12), o.rng.uniform(3, 12), 0.02,
              o.rng.uniform(0, 3))


def stones_on_open_land(o):
    at = o.land(100, 2.0, 5.0)
    for _ in range(600):
        i, k = o.rng.randrange(2, 98), o.rng.randrange(2, 98)
        o.ball(2 * i + o.rng.uniform(0, 2), 2 * k + o.rng.uniform(0, 2), at(i, k), o.rng.uniform(0.1, 0.8), 5)


def hall_of_columns(o):
    o.rect(0, 0, 40, 40)
    o.rect(0, 0, 40, 40, 9)
    for i in range(64):
        o.cylinder(2.5 + 5 * (i % 8), 2.5 + 5 * (i // 8), 0, 0.4, 9, 24)


def pipes_over_grid(o):
    for i in range(40):
        o.wall((i, 0), (i, 40), 0, 0.3)
        o.wall((0, i), (40, i), 0, 0.3)
    for _ in range(30):
        o.cylinder(o.rng.uniform(0, 40), o.rng.uniform(0, 40), 0.3, o.rng.uniform(0.1, 0.6), o.rng.uniform(1, 12))


MIXES = {function.__name__: function for function in (
    objects_on_land, few_objects_on_land, tower_among_sheets, sheets_about_towers, trees, bare_trees,
    town_on_plane, town_with_eaves, small_town_on_wide_plane, town_alone, half_open_town,
    mostly_open_town, mostly_closed_town, five_closed_of_216, balls_on_plane, balls_with_gaps,
    houses_on_open_land, trees_on_solid_land, solid_land, furniture_in_open_room, cars_with_panes,
    speck_on_sheet, posts_and_fences, slabs_over_plane, stones_on_open_land, hall_of_columns,
    pipes_over_grid)}


def write(name, folder):
    obj = Obj(sum(name.encode()))
    MIXES[name](obj)
    path = os.path.join(folder, name + ".obj")
    obj.write(path)
    return path


def png(width, height, alpha):
    """A PNG of white texels with an alpha, as bytes."""
    rows = b"".join(b"\0" + b"".join(bytes((255, 255, 255, alpha(x, y))) for x in range(width)) for y in range(height))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def leaf_alpha(x, y, edge=1.0):
    """Leaves of 32 texels that are opaque within an ellipse, soft for `edge` texels around it."""
    u, v = (x % 32 - 15.5) / 13.0, (y % 32 - 15.5) / 7.0
    inside = (1.0 - math.hypot(u, v)) * 7.0 / edge
    return round(255 * min(max(inside + 0.5, 0.0), 1.0))


def write_leaves(path, mode="BLEND", edge=1.0, trees=6, cards=80, seed=5):
    """Trees with cards of leaves over a ground, as GLB (y up). mode: the leaves' alphaMode."""
    rng = random.Random(seed)
    positions, uvs, ground = [], [], [(-20, 0, -20), (-20, 0, 20), (20, 0, 20), (20, 0, -20)]
    for _ in range(trees):
        x, z = rng.uniform(-15, 15), rng.uniform(-15, 15)
        for _ in range(cards):
            centre = (x + rng.gauss(0, 1.2), 5 + rng.gauss(0, 1.2), z + rng.gauss(0, 1.2))
            turn, lean = rng.uniform(0, 6.3), rng.uniform(-1, 1)
            right = (math.cos(turn), 0, math.sin(turn))
            up = (-math.sin(turn) * lean, 1, math.cos(turn) * lean)
            positions += [tuple(centre[j] + 0.8 * (s - 0.5) * right[j] + 0.8 * (t - 0.5) * up[j] for j in range(3))
                          for s, t in COLUMN]
            uvs += COLUMN
    quads = len(positions) // 4
    corners = [(0, 1, 2), (0, 2, 3)]
    leaves = [4 * i + c for i in range(quads) for face in corners for c in face]
    floor = [c for face in corners for c in face]
    blobs = [struct.pack(f"<{len(leaves)}I", *leaves), struct.pack(f"<{len(floor)}I", *floor),
             b"".join(struct.pack("<3f", *p) for p in positions), b"".join(struct.pack("<3f", *p) for p in ground),
             b"".join(struct.pack("<2f", *p) for p in uvs), png(128, 128, lambda x, y: leaf_alpha(x, y, edge))]
    views, offset, data = [], 0, b""
    for blob in blobs:
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(blob)})
        data += blob + b"\0" * (-len(blob) % 4)
        offset = len(data)

    def accessor(view, kind, count, component=5126, **more):
        return {"bufferView": view, "componentType": component, "type": kind, "count": count, **more}

    def bounds(points):
        return {"min": [min(p[j] for p in points) for j in range(3)], "max": [max(p[j] for p in points) for j in range(3)]}
    gltf = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "buffers": [{"byteLength": len(data)}], "bufferViews": views,
            "accessors": [accessor(0, "SCALAR", len(leaves), 5125), accessor(1, "SCALAR", len(floor), 5125),
                          accessor(2, "VEC3", len(positions), **bounds(positions)),
                          accessor(3, "VEC3", 4, **bounds(ground)), accessor(4, "VEC2", len(uvs))],
            "images": [{"bufferView": 5, "mimeType": "image/png"}], "textures": [{"source": 0}],
            "materials": [{"name": "leaf", "alphaMode": mode, "doubleSided": True,
                           "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}, {"name": "ground"}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 2, "TEXCOORD_0": 4}, "indices": 0, "material": 0},
                                       {"attributes": {"POSITION": 3}, "indices": 1, "material": 1}]}]}
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    with open(path, "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data)) +
                   struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data)
