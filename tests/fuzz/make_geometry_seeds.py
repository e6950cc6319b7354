#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Seeds of fuzz_geometry: small scenes as umbrage-bake import leaves them, behind two bytes of options.

    BUILD=build/release tests/fuzz/make_bake_seeds.py FOLDER
"""
import hashlib
import json
import os
import struct
import subprocess
import sys
import tempfile
import zlib

BUILD = os.environ.get("BUILD", "build/release")
HEAD = 16  # of a scene file: magic and checksum

BOX = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(size):
    """A chequered alpha channel."""
    rows = b"".join(b"\0" + b"".join(bytes((255, 255, 255, 255 * ((x ^ y) & 1))) for x in range(size))
                    for y in range(size))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", size, size, 8, 6, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def write_obj(folder, holes):
    """A box on a plate; with holes its sides have a texture."""
    path = os.path.join(folder, "scene.obj")
    lines = [f"v {x} {y} {z}" for x, y, z in BOX]
    lines += ["v -3 -3 -0.5", "v 4 -3 -0.5", "v 4 4 -0.5", "v -3 4 -0.5"]
    lines += ["vt 0 0", "vt 2 0", "vt 2 2", "vt 0 2", "f 9 10 11 12"]
    if holes:
        lines.insert(0, "mtllib scene.mtl")
        lines.append("usemtl holes")
        with open(os.path.join(folder, "scene.mtl"), "w", encoding="ascii") as file:
            file.write("newmtl holes\nmap_d holes.png\n")
        with open(os.path.join(folder, "holes.png"), "wb") as file:
            file.write(png(8))
    lines += ["f " + " ".join(f"{corner + 1}/{k + 1}" for k, corner in enumerate(face))
              for face in FACES]
    with open(path, "w", encoding="ascii") as file:
        file.write("\n".join(lines) + "\n")
    return path


def write_gltf(folder, mode):
    """One pane, masked or blended, twice, and a lamp."""
    path = os.path.join(folder, "pane.gltf")
    corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0.5), (0, 2, 0.5)]
    data = b"".join(struct.pack("<3f", *corner) for corner in corners)
    data += b"".join(struct.pack("<2f", *uv) for uv in ((0, 0), (1, 0), (1, 1), (0, 1)))
    data += struct.pack("<6H", 0, 1, 2, 0, 2, 3)
    with open(os.path.join(folder, "pane.bin"), "wb") as file:
        file.write(data)
    with open(os.path.join(folder, "pane.png"), "wb") as file:
        file.write(png(4))
    views = [{"buffer": 0, "byteOffset": at, "byteLength": count}
             for at, count in ((0, 48), (48, 32), (80, 12))]
    scene = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"mesh": 0}, {"mesh": 0, "translation": [0, 1, 1.5]},
                  {"translation": [1, 4, 1], "extensions": {"KHR_lights_punctual": {"light": 0}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2,
                                    "material": 0}]}],
        "materials": [{"alphaMode": mode, "pbrMetallicRoughness": {
            "baseColorFactor": [1, 1, 1, 0.5], "baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}], "images": [{"uri": "pane.png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3",
             "min": [0, 0, 0], "max": [2, 2, 0.5]},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"}],
        "bufferViews": views, "buffers": [{"uri": "pane.bin", "byteLength": len(data)}],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "spot", "intensity": 5, "spot": {}}]}}}
    with open(path, "w", encoding="ascii") as file:
        json.dump(scene, file)
    return path


def main():
    target = sys.argv[1]
    os.makedirs(target, exist_ok=True)
    number = 0
    for make, how in ((write_obj, False), (write_obj, True), (write_gltf, "MASK"), (write_gltf, "BLEND")):
        with tempfile.TemporaryDirectory() as folder:
            once = os.path.join(folder, "once")
            subprocess.run([os.path.join(BUILD, "umbrage-bake"), "import", make(folder, how), "-o", once,
                            "--quiet"], check=True)
            with open(once, "rb") as file:
                scene = file.read()[HEAD:]
        for options in (number, number + 4):
            data = bytes(((options + number) % 8, options)) + scene
            with open(os.path.join(target, hashlib.sha256(data).hexdigest()), "wb") as file:
                file.write(data)
        number += 1


main()
