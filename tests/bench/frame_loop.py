#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Figures of frame loops for docs/results/paging.md: a walk through a scene with a depth picture for each step.

    tests/bench/frame_loop.py SCENE.glb STORE NAME CAMERA [--size 1280x720] [--frames 8] [--step M] [--taps 9]

A daemon of its own on STORE answers asset NAME. CAMERA is that of the first frame ("eye=X,Y,Z,target=X,Y,Z,fov=DEG",
y up); each further one has eye and target moved by --step metres along the view. Depths are those of `umbrage points
--kind gbuffer`. Prints one JSON object a line: packed and plain, one bit and one byte a pixel.
"""
import argparse
import array
import json
import math
import os
import subprocess
import tempfile
import time

parser = argparse.ArgumentParser()
parser.add_argument("scene")
parser.add_argument("store")
parser.add_argument("name")
parser.add_argument("camera")
parser.add_argument("--size", default="1280x720")
parser.add_argument("--frames", type=int, default=8)
parser.add_argument("--step", type=float, default=0.05)
parser.add_argument("--taps", default="9")
options = parser.parse_args()
BUILD = os.environ.get("BUILD", "build/release")
WIDTH, HEIGHT = map(int, options.size.split("x"))
folder = tempfile.mkdtemp()


def scaled(v, length):
    norm = math.sqrt(sum(x * x for x in v))
    return [x * length / norm for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def parse(text):
    words, values = text.split(","), {}
    for word in words:
        if "=" in word:
            name, _, word = word.partition("=")
            values[name] = []
        values[name].append(float(word))
    return values["eye"], values["target"], values.get("fov", [60.0])[0]


def depths(camera, eye, target, fov):
    """A float a pixel, 0 where the scene is not seen."""
    path = os.path.join(folder, "points")
    subprocess.run([f"{BUILD}/umbrage", "points", options.scene, "-o", path, "--kind", "gbuffer", "--camera", camera,
                    "--size", options.size, "--quiet"], check=True)
    points = array.array("f")
    with open(path, "rb") as file:
        points.frombytes(file.read())
    tall = math.tan(math.radians(fov) / 2)
    f = scaled([t - e for t, e in zip(target, eye)], 1)
    r = scaled(cross(f, [0, 1, 0]), 1)
    u = cross(r, f)
    wide, result = tall * WIDTH / HEIGHT, array.array("f", bytes(4 * WIDTH * HEIGHT))
    for i in range(0, len(points), 3):
        a, b, c = points[i] - eye[0], points[i + 1] - eye[1], points[i + 2] - eye[2]
        z = a * f[0] + b * f[1] + c * f[2]
        x = (a * r[0] + b * r[1] + c * r[2]) / (z * wide)
        y = (a * u[0] + b * u[1] + c * u[2]) / (z * tall)
        result[int((1 - y) / 2 * HEIGHT) * WIDTH + int((x + 1) / 2 * WIDTH)] = z
    return result.tobytes()


eye, target, fov = parse(options.camera)
along = scaled([t - e for t, e in zip(target, eye)], options.step)
along[1] = 0.0
with open(os.path.join(folder, "walk"), "w", encoding="utf-8") as walk, \
        open(os.path.join(folder, "depth"), "wb") as depth:
    for step in range(options.frames):
        at, to = ([p + step * d for p, d in zip(v, along)] for v in (eye, target))
        camera = f"eye={at[0]},{at[1]},{at[2]},target={to[0]},{to[1]},{to[2]},fov={fov}"
        print(camera, file=walk)
        depth.write(depths(camera, at, to, fov))
socket = os.path.join(folder, "socket")
daemon = subprocess.Popen([f"{BUILD}/umbraged", "--store", options.store, "--listen", "unix:" + socket, "--log-level",
                           "error"])
while not os.path.exists(socket):
    time.sleep(0.1)
for encoding in ("bit", "u8"):
    for extra in ((), ("--plain",)):
        told = json.loads(subprocess.run(
            [f"{BUILD}/umbrage", "frames", options.name, "--address", "unix:" + socket, "--path",
             os.path.join(folder, "walk"), "--depth", os.path.join(folder, "depth"), "--size", options.size, "--taps",
             options.taps, "--format", encoding, "--json", *extra], check=True, capture_output=True).stdout)
        frames = told["frames"]
        later = sorted(frames[1:], key=lambda frame: frame["ms"])
        middle = later[len(later) // 2]
        print(json.dumps({"size": options.size, "format": encoding, "packed": not extra,
                          "request_bytes": told["request_bytes_a_frame"], "first_bytes": frames[0]["bytes"],
                          "bytes": sum(f["bytes"] for f in later) // len(later), "ms": round(middle["ms"], 2),
                          "server_ms": round(middle["server_ms"], 2)}), flush=True)
daemon.terminate()
daemon.wait()
