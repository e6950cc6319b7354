#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Bakes with a cache after random edits of a scene: the id of each equals a full bake's.

    tests/system/edits.py EDITS [SCENE.obj...]

Without scenes: the generated city, and Delft and the garden of ${UMBRAGE_SCENES:-../shared/scenes}. An
edit moves a connected part, adds a box, removes a part, gives a part a translucent material, or changes
nothing; it starts from the edit before or from the scene. UMBRAGE_EDITS_LOG2 (12) is the resolution.
test_edits.py is the short form, and part of `make test`."""
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile

BUILD = os.environ.get("BUILD", "build/release")
BAKE = os.path.join(BUILD, "umbrage-bake")
LOG2 = int(os.environ.get("UMBRAGE_EDITS_LOG2", "12"))
SETTINGS = ["--resolution", str(1 << LOG2), "--tile", str(1 << (LOG2 - 3)), "--sun", "140,38",
            "--quiet", "--json"]
VERIFY = os.environ.get("UMBRAGE_EDITS_VERIFY", "1000000")  # points of a self-check that inherits nothing
GLASS = "newmtl umbrage_glass\nd 0.4\n"
KINDS = ("move", "move", "move", "add", "remove", "material", "none")


def bake(*words, expect=0):
    """Runs umbrage-bake; returns its JSON, or its complaint where another exit code is expected."""
    verify = [] if "--verify" in words else ["--verify", VERIFY]
    done = subprocess.run([BAKE, *words, *verify], capture_output=True, text=True, check=False)
    if done.returncode != expect:
        raise SystemExit(f"{' '.join(words)}: exit code {done.returncode}, not {expect}: {done.stderr}")
    return json.loads(done.stdout) if expect == 0 else done.stderr


def index_of(word, vertices):
    number = int(word.split("/")[0])
    return number - 1 if number > 0 else vertices + number


class Scene:
    """An OBJ file as vertices and faces; other lines stay where they are."""

    def __init__(self, path):
        self.folder, self.vertices, self.lines, self.faces = os.path.dirname(path), [], [], []
        with open(path, encoding="utf-8", errors="replace") as file:
            for line in file:
                words = line.split()
                if words and words[0] == "v":
                    self.lines.append(("v", len(self.vertices)))
                    self.vertices.append([float(word) for word in words[1:4]])
                elif words and words[0] == "f":
                    self.lines.append(("f", len(self.faces)))
                    self.faces.append((line, [index_of(w, len(self.vertices)) for w in words[1:]]))
                elif words and words[0] != "mtllib":
                    self.lines.append(("=", line))
        self.libraries = [name for name in os.listdir(self.folder) if name.endswith(".mtl")]
        self.parts = self.find_parts()

    def find_parts(self):
        """Faces that share a vertex, as lists of face numbers."""
        parent = list(range(len(self.vertices)))

        def root(i):
            while parent[i] != i:
                parent[i] = parent[parent[i]]
                i = parent[i]
            return i

        for _, corners in self.faces:
            for corner in corners[1:]:
                parent[root(corner)] = root(corners[0])
        parts = {}
        for number, (_, corners) in enumerate(self.faces):
            parts.setdefault(root(corners[0]), []).append(number)
        return list(parts.values())


class Edits:
    """The state of a scene after some edits, and how to write it."""

    def __init__(self, scene, draw):
        self.scene, self.draw = scene, draw
        self.reset()

    def reset(self):
        self.moved, self.removed, self.glass, self.added = {}, set(), set(), []

    def small_part(self):
        """A part of at most a twentieth of the faces; some faces of the file's order if parts are large."""
        most = max(12, len(self.scene.faces) // 20)
        for _ in range(30):
            part = self.draw.choice(self.scene.parts)
            if len(part) <= most:
                return part
        first = self.draw.randrange(len(self.scene.faces))
        return range(first, min(first + 40, len(self.scene.faces)))

    def edit(self):
        kind = self.draw.choice(KINDS)
        if self.draw.random() < 0.3:
            self.reset()
        if kind == "move":
            offset = [self.draw.uniform(-2, 2), self.draw.uniform(-2, 2), 0.0]
            for face in self.small_part():
                for vertex in self.scene.faces[face][1]:
                    self.moved[vertex] = offset
        elif kind == "add":
            at = self.draw.choice(self.scene.vertices)
            self.added.append(([x + self.draw.uniform(-1, 1) for x in at], self.draw.uniform(0.2, 2)))
        elif kind == "remove":
            self.removed.update(self.small_part())
        elif kind == "material":
            self.glass.update(self.small_part())
        return kind

    def write(self, path):
        for name in os.listdir(self.scene.folder):
            if name.lower().endswith((".mtl", ".png", ".jpg", ".jpeg")):
                target = os.path.join(os.path.dirname(path), name)
                if not os.path.exists(target):
                    shutil.copy(os.path.join(self.scene.folder, name), target)
        with open(os.path.join(os.path.dirname(path), "umbrage_glass.mtl"), "w", encoding="ascii") as file:
            file.write(GLASS)
        with open(path, "w", encoding="utf-8") as out:
            for name in (*self.scene.libraries, "umbrage_glass.mtl"):
                out.write(f"mtllib {name}\n")
            self.write_lines(out)
            self.write_boxes(out)

    def write_lines(self, out):
        material = "usemtl umbrage_opaque\n"
        for kind, what in self.scene.lines:
            if kind == "v":
                offset = self.moved.get(what, (0, 0, 0))
                out.write("v %.9g %.9g %.9g\n" % tuple(
                    a + b for a, b in zip(self.scene.vertices[what], offset)))
            elif kind == "=":
                out.write(what)
                material = what if what.startswith("usemtl") else material
            elif what in self.removed:
                continue
            elif what in self.glass:
                out.write("usemtl umbrage_glass\n" + self.scene.faces[what][0] + material)
            else:
                out.write(self.scene.faces[what][0])

    def write_boxes(self, out):
        count = len(self.scene.vertices)
        out.write("usemtl umbrage_opaque\n")
        for at, half in self.added:
            for corner in range(8):
                print("v", *(at[k] + (half if corner >> k & 1 else -half) for k in range(3)), file=out)
            for face in ((1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)):
                print("f", *(count + corner for corner in face), file=out)
            count += 8


def try_edits(path, edits, seed=1):
    """Returns the number of edits whose id differs, and prints what was inherited."""
    wrong, kinds, inherited, squares, sampled = 0, {}, 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        state = Edits(Scene(path), random.Random(seed))
        scene, out = os.path.join(folder, "scene.obj"), os.path.join(folder, "a.umb")
        cache = os.path.join(folder, "cache")
        state.write(scene)
        bake(scene, "-o", out, "--cache", cache, *SETTINGS)
        for _ in range(edits):
            kind = state.edit()
            kinds[kind] = kinds.get(kind, 0) + 1
            state.write(scene)
            edited = bake(scene, "-o", out, "--cache", cache, *SETTINGS)
            full = bake(scene, "-o", out, "--verify", "0", *SETTINGS)
            if edited["asset"] != full["asset"]:
                wrong += 1
                print(f"FAIL {os.path.basename(path)} after {kind}: {edited['asset']} is not {full['asset']}")
            inherited += edited["verify"]["tiles_inherited"]
            squares += edited["verify"]["squares_inherited"]
            sampled += edited["verify"]["sampled"]
    print(f"{'ok  ' if wrong == 0 else 'FAIL'} {os.path.basename(path)}: {edits} edits {kinds}, ids of full "
          f"bakes; a bake inherits {inherited / edits:.1f} of 64 tiles and {squares / edits:.0f} squares; "
          f"{sampled} random checks")
    return wrong


def main():
    edits = int(sys.argv[1])
    scenes = os.environ.get("UMBRAGE_SCENES", "../shared/scenes")
    paths = sys.argv[2:]
    with tempfile.TemporaryDirectory() as folder:
        if not paths:
            city = os.path.join(folder, "city.obj")
            subprocess.run([os.path.join(BUILD, "scenegen"), "city", "--size", "20", "-o", city], check=True)
            paths = [city, os.path.join(scenes, "city_delft/delft_all.obj"),
                     os.path.join(scenes, "garden_sterngarten/Sterngarten_Wien_innerArea-optimized.obj")]
        return 1 if sum(try_edits(path, edits) for path in paths) else 0


if __name__ == "__main__":
    sys.exit(main())
