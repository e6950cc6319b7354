#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
What the page of `umbrage view` draws in headless Chromium, against `umbrage query` at the points of its pixels: OBJ, PLY and
STL scenes, textures with cut-outs, a point light, and windows by the shader (box, tent) and by the core (gaussian, penumbra).
"""
import base64
import json
import os
import struct
import sys
import zlib

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import devtools  # noqa: E402
import umbrage_test as ut  # noqa: E402
import view_server  # noqa: E402
import web_browser  # noqa: E402
import web_cases  # noqa: E402

web_cases.need_package()
if web_browser.installed() is None:
    ut.skip("chromium is not installed")
if not os.path.exists("/usr/share/javascript/three/build/three.module.js"):
    ut.skip("three.js is not installed: libjs-three")
test = ut.Test()
WAIT_S = 90
EXACT = "umbrageViewer.state.loading === 0 && umbrageViewer.state.points > 0 && " \
    "umbrageViewer.state.exact === umbrageViewer.state.points"
# Shares are bytes where the core answers, and floats else. Places are floats of the GPU: a point on a voxel's border may
# fall to the other side.
STEP, SAME_SHARE = 1.01 / 255, 0.99


def picture(width, height, pixel):
    """A PNG; pixel(x, y) gives red, green, blue, alpha."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + b"".join(bytes(pixel(x, y)) for x in range(width)) for y in range(height))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", width, height, 8, 6, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def quad(y, side):
    return [(-side, y, -side), (-side, y, side), (side, y, side), (side, y, -side)]


def cut_out(path):
    """A floor, and above it a leaf whose texture has a round hole."""
    corners = quad(0, 4) + quad(2, 1.5)
    image = picture(32, 32, lambda x, y: (40, 160, 40, 0 if (x - 15.5) ** 2 + (y - 15.5) ** 2 < 100 else 255))
    data = b"".join(struct.pack("<3f", *corner) for corner in corners)
    data += struct.pack("<8f", 0, 0, 0, 1, 1, 1, 1, 0) + struct.pack("<6H", 0, 1, 2, 0, 2, 3)
    def accessor(view, kind, count, component=5126, **more):
        return {"bufferView": view, "componentType": component, "type": kind, "count": count, **more}
    def primitive(position, material, **more):
        return {"attributes": {"POSITION": position, **more}, "indices": 3, "material": material}
    gltf = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [primitive(0, 0), primitive(1, 1, TEXCOORD_0=2)]}],
            "materials": [{"doubleSided": True}, {"doubleSided": True, "alphaMode": "MASK", "alphaCutoff": 0.5,
                                                  "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
            "textures": [{"source": 0}], "images": [{"uri": "data:image/png;base64," + base64.b64encode(image).decode()}],
            "buffers": [{"uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(), "byteLength": len(data)}],
            "bufferViews": [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in ((0, 48), (48, 48), (96, 32), (128, 12))],
            "accessors": [accessor(0, "VEC3", 4, min=[-4, 0, -4], max=[4, 0, 4]),
                          accessor(1, "VEC3", 4, min=[-1.5, 2, -1.5], max=[1.5, 2, 1.5]), accessor(2, "VEC2", 4),
                          accessor(3, "SCALAR", 6, 5123)]}
    with open(path, "w", encoding="utf-8") as file:
        json.dump(gltf, file)


def stl(path):
    """A floor and a plate above it, z up."""
    faces = [[(x, z, y) for x, y, z in quad(*one)] for one in ((0, 4), (2, 1))]
    triangles = [[face[i] for i in order] for face in faces for order in ((0, 2, 1), (0, 3, 2))]
    with open(path, "wb") as file:
        file.write(bytes(80) + struct.pack("<I", len(triangles)))
        for triangle in triangles:
            file.write(struct.pack("<12fH", 0, 0, 1, *[number for corner in triangle for number in corner], 0))


def scene(name):
    path = test.path(name)
    {"leaf.gltf": cut_out, "plate.stl": stl}.get(name, lambda _: None)(path)
    return path if os.path.exists(path) else test.scene(*{"houses.obj": ("houses", 2, 1, "obj"), "houses.ply": ("houses", 2, 1, "ply"),
                                                          "hall.glb": ("hall", 2)}[name])


SUN, FLAT = ("--sun", "135,50"), "#eye=5,6,7&target=0,0.5,0&fov=45"
BEHIND = "#eye=-30,30,25&target=0,0,2&fov=50"
# Scene, up axis, options of the bake, the view, filter, taps.
CASES = [
    ("houses.obj", "z", SUN, BEHIND, "tent", 5),
    ("houses.ply", "z", SUN, BEHIND, "gaussian", 5),
    ("plate.stl", "z", SUN, "#eye=5,-7,6&target=0,0,0.5&fov=45", "box", 1),
    ("leaf.gltf", "y", ("--sun", "135,60"), FLAT, "box", 5),
    ("leaf.gltf", "y", ("--sun", "135,60", "--light-size", "4deg", "--effect", "penumbra=on"), FLAT, "penumbra", 1),
    ("hall.glb", "y", ("--point", "3,3,2"), "", "box", 3),
]


def answers(asset, sides, filter_name, taps):
    """What `umbrage query` says of the picture's points."""
    points, out = test.path("points.f32"), test.path("answers.f32")
    with open(points, "wb") as file:
        file.write(sides.points.tobytes())
    ut.run("umbrage", "query", asset, "--points", points, "--format", "f32", "--normals", "--encoding", "f32", "-o", out, "--quiet",
           "--taps", taps, "--filter", filter_name)
    with open(out, "rb") as file:
        return ut.array.array("f", file.read())


def check(chromium, number, case):
    name, up, options = case[:3]
    path, asset = scene(name), test.path(f"{number}.umb")
    test.bake(path, asset, "--resolution", 512, "--up", up, "--verify", 0, *options)
    view = view_server.View(asset, "--scene", path, "--up", up)
    try:
        look(chromium.page(220, 280), view, case, asset, f"{number}-{name}.png")
    finally:
        view.close()


def look(page, view, case, asset, picture_name):
    _, _, _, place, filter_name, taps = case
    page.open(f"{view.address}{place or '#'}&filter={filter_name}&taps={taps}")
    page.wait("globalThis.umbrageViewer?.state.frames > 0 || globalThis.umbrageViewer?.state.error", WAIT_S)
    page.wait(f"umbrageViewer.parts.shadows.settings.filter === '{filter_name}' && {EXACT}", WAIT_S)
    drawn = page.evaluate("umbrageViewer.state.frames")
    page.evaluate("umbrageViewer.draw()")
    page.wait(f"umbrageViewer.state.frames > {drawn}", WAIT_S)
    sides = view_server.read_sides(page)
    if "UMBRAGE_PICTURES" in os.environ:
        page.screenshot(os.path.join(os.environ["UMBRAGE_PICTURES"], picture_name))
    true = answers(asset, sides, filter_name, taps)
    ours, lit = sides.shares[::2], sum(share > 0.5 for share in true)
    equal = sum(abs(one - other) <= STEP for one, other in zip(ours, true))
    assert len(true) > 5000 and 0.02 < lit / len(true) < 0.98, (len(true), lit)
    assert equal >= SAME_SHARE * len(true), f"{equal} of {len(true)} pixels are as umbrage query answers"
    assert page.troubles == [], page.troubles
    page.open("about:blank")


with devtools.Chromium(test.path("profile")) as browser:
    for index, one in enumerate(CASES):
        with test.check(f"{one[0]}, {one[4]} {one[5]} x {one[5]}, {one[2][0]}: the page draws what umbrage query answers"):
            check(browser, index, one)
test.finish()
