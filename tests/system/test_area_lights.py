#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Penumbras of lamps and area lights differ from rays to the light's points by 0.01 in the mean (area_lights.py has the
full form), voxels and boxes of area lights agree with rays, and every reader says what an area light is.
"""
import base64
import json
import os
import shutil
import struct
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import area_lights  # noqa: E402
import umbrage_test as ut  # noqa: E402

area_lights.BUILD = ut.BUILD
test = ut.Test(limit_s=580)

RESOLUTION, WIDTH, SAMPLES = 1024, 160, 12  # a quarter of the full form's voxels a side
LIGHTS = (0, 1)  # a rectangle and a disc; of the room a sphere, too

for name, words, camera, lights in area_lights.SCENES:
    with test.check(f"penumbras in the {name} are those of rays to the light"):
        scene = area_lights.make_scene(name, words, test.folder)
        for i in LIGHTS + ((3,) if name == "room" else ()):
            figures = area_lights.compare(scene, lights[i], camera, RESOLUTION, WIDTH, SAMPLES, test.folder)
            print(f"{' '.join(lights[i])}: mean {figures['mean_difference']:.4f} of {figures['judged']}")
            assert figures["judged"] > 2000 and figures["mean_difference"] <= area_lights.MOST, figures
            assert figures["false_shadow"] <= 0.01 and figures["false_light"] <= 0.01, figures

with test.check("boxes and segments of an area light agree with rays"):
    scene = area_lights.make_scene("room", None, test.folder)
    asset = test.path("room.umb")
    ut.run("umbrage-bake", scene, "-o", asset, "--resolution", 1024, "--area", "0,0,2.7,0,0,-1,1.2,0.6", "--verify", 20000, "--quiet")
    for kind in ("boxes", "segments"):
        ut.run("umbrage", "verify", asset, "--scene", scene, "--ask", kind, "--points", 20000)


def gltf(path, lights):
    """A floor and a plate above it, y up, with nodes of lights: (light, extras, direction's rotation)."""
    square = [(-1, 0, -1), (1, 0, 1), (1, 0, -1), (-1, 0, -1), (-1, 0, 1), (1, 0, 1)]
    data = b"".join(struct.pack("<3f", *v) for v in square)
    nodes = [{"mesh": 0, "scale": [4, 1, 4]}, {"mesh": 0, "translation": [0, 1, 0], "scale": [0.3, 1, 0.3]}]
    nodes += [{"name": name, "translation": [0, 2, 0], "rotation": [-0.5 ** 0.5, 0, 0, 0.5 ** 0.5], "extras": extras,
               "extensions": {"KHR_lights_punctual": {"light": kind}}} for name, kind, extras in lights]
    with open(path, "w", encoding="ascii") as file:
        json.dump({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes,
            "extensionsUsed": ["KHR_lights_punctual"],
            "extensions": {"KHR_lights_punctual": {"lights": [{"type": "directional"}, {"type": "point"}]}},
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3", "min": [-1, 0, -1],
                           "max": [1, 0, 1]}],
            "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
            "buffers": [{"byteLength": len(data), "uri": "data:application/octet-stream;base64," +
                         base64.b64encode(data).decode()}]}, file)


def lights_of(target, *words):
    return json.loads(ut.run("umbrage", "info", target, "--json", *words).stdout)["lights"]


scene = test.path("lights.gltf")
gltf(scene, [("sun", 0, {}), ("wide", 0, {"umbrage_angle": 0.1}),
             ("panel", 1, {"umbrage_shape": "rectangle", "umbrage_width": 2, "umbrage_height": 0.5}),
             ("dish", 1, {"umbrage_shape": "disc", "umbrage_diameter": 0.75}), ("bulb", 1, {"umbrage_diameter": 0.1})])
asset = test.path("lights.umb")
plan = ut.run("umbrage-bake", scene, "-o", asset, "--resolution", 256, "--verify", 20000).stdout.decode()
found = lights_of(asset)

with test.check("lights of a glTF have the extents of its extras, suns the sun's without"):
    assert [light["kind"] for light in found] == ["directional", "directional", "rectangle", "disc", "point"], found
    assert abs(found[0]["extent"] - 0.53 * 3.141592653589793 / 180) < 1e-12, found[0]
    assert [light["extent"] for light in found[1:]] == [0.1, 0.5, 0.75, 0.1], found
    assert max(abs(a - b) for a, b in zip(found[2]["side"], (2, 0, 0))) < 1e-12, found[2]
    assert "side" not in found[3] and max(abs(a - b) for a, b in zip(found[2]["direction"], (0, -1, 0))) < 1e-7, found
    text = ut.run("umbrage", "info", asset).stdout.decode()
    assert "rectangle 'panel'" in text and "extent 2 x 0.5 m" in text and "disc 'dish'" in text, text

with test.check("a daemon describes and answers them as the file does"):
    store = test.path("store")
    os.makedirs(store)
    shutil.copy(asset, os.path.join(store, "lights.umb"))
    daemon = ut.Daemon(test.folder, store)
    told = lights_of("lights", "--address", daemon.tcp)
    for a, b in zip(found, told):
        assert all(a[key] == b[key] for key in ("name", "kind", "direction", "position", "extent")), (a, b)
        assert a.get("side") == b.get("side"), (a, b)
    points = "\n".join(f"{0.02 * i - 1} 0 {0.013 * i - 0.6}" for i in range(100)).encode()
    for light in range(5):
        for words in (("--filter", "penumbra"), ("--level", "3"), ("--taps", "5")):
            answers = [ut.run("umbrage", "query", *target, "--points", "-", "--light", light, "--quiet", *words,
                              stdin=points).stdout for target in ((asset,), ("lights", "--address", daemon.tcp))]
            assert answers[0] == answers[1] and answers[0], (light, words)
    daemon.stop()

with test.check("without penumbras area lights are kept as points that shine to one side"):
    ut.run("umbrage-bake", scene, "-o", asset, "--resolution", 256, "--effect", "penumbra=off", "--verify", 20000, "--quiet")
    bare = lights_of(asset)
    assert [light["kind"] for light in bare] == [light["kind"] for light in found], bare
    assert all(light["extent"] == 0 for light in bare) and bare[2]["side"] == [0, 0, 0], bare

test.finish()
