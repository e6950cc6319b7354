#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Compares penumbras of lamps with rays to their points: `make area-lights`, or area_lights.py [RESOLUTION [WIDTH
[SAMPLES]]].

Five scenes, each with a rectangle, a disc, a narrow strip, and a sphere. A bake's answers at the pixels of a view that
face the light are compared with SAMPLES squared rays from the surface to the light (server/study/traced_shadow.c).
"""
import json
import os
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from lamps import box, level  # noqa: E402

BUILD = os.environ.get("BUILD", "build/release")
MOST = 0.01  # mean difference of a scene's lights; narrow strips near the receiver reach 0.011

# Name, scenegen's words or None, camera, lights: options of umbrage-bake.
SCENES = [
    ("hall", ("hall", "--size", "3"), "eye=8,-8,4,target=0,0,0,fov=70",
     [("--area", "0,0,5,0,0,-1,2,1"), ("--area", "1,-2,4,0.3,0.2,-1,0.8"), ("--area", "-1,0,6,0,0,-1,3,0.05"),
      ("--point", "2,2,4", "--light-size", "0.4m")]),
    ("arch", ("arch", "--size", "3"), "eye=7,-7,2.4,target=0,0,1,fov=75",
     [("--area", "0,0,2.6,0.2,0.3,-1,1,0.5"), ("--area", "2,1,2.4,-1,0.2,-0.5,0.6"), ("--area", "0,1,2.5,0,0,-1,1.5,0.03,1,1,0"),
      ("--spot", "0,0,2.6,0.2,0.1,-1,90", "--light-size", "0.3m")]),
    ("city", ("city", "--size", "8"), None,
     [("--area", "0,0,120,0.3,0.2,-1,30,20"), ("--area", "100,50,150,0,0,-1,25"), ("--area", "0,0,100,0,0,-1,60,2"),
      ("--point", "0,0,140", "--light-size", "15m")]),
    ("forest", ("forest", "--size", "3", "--format", "ply"), None,
     [("--area", "-3,-3,11,0.1,0.2,-1,1.5,1"), ("--area", "-3,-3,11,0.1,0.2,-1,1.5"), ("--area", "0,-3,12,0,0,-1,4,0.1"),
      ("--point", "-3,-3,12", "--light-size", "1m")]),
    ("room", None, "eye=3.6,-3.6,2.4,target=0,0,0.6,fov=75",
     [("--area", "0,0,2.7,0,0,-1,1.2,0.6"), ("--area", "1,1,2.5,-0.3,-0.3,-1,0.5"), ("--area", "0,0,2.6,0,0,-1,1.5,0.05"),
      ("--point", "0.2,0.1,2", "--light-size", "0.15m")]),
]


def room():
    """A room with a table, shelves and posts, open at the top."""
    triangles = level(8, 0) + box([-1, -0.6, 0.7], [1, 0.6, 0.75])
    for x in (-0.95, 0.9):
        for y in (-0.55, 0.5):
            triangles += box([x, y, 0], [x + 0.05, y + 0.05, 0.7])
    for i in range(4):
        triangles += box([-3.9, -2, 0.3 + 0.5 * i], [-3.5, 2, 0.33 + 0.5 * i])
    for i in range(6):
        triangles += box([2 + 0.1 * i, 2 - 0.7 * i, 0], [2.1 + 0.1 * i, 2.08 - 0.7 * i, 0.4 + 0.3 * i])
    return triangles


def write_room(path):
    with open(path, "w", encoding="ascii") as file:
        for number, (_, *corners) in enumerate(room()):
            for corner in corners:
                file.write("v %.17g %.17g %.17g\n" % tuple(corner))
            file.write("f %d %d %d\n" % tuple(3 * number + k for k in (1, 2, 3)))


def make_scene(name, words, folder):
    path = os.path.join(folder, name + (".ply" if "ply" in (words or ()) else ".obj"))
    if words is None:
        write_room(path)
    else:
        subprocess.run([os.path.join(BUILD, "scenegen"), *words, "-o", path], check=True, stderr=subprocess.DEVNULL)
    return path


def compare(scene, light, camera, resolution, width, samples, folder):
    """The figures of umbrage render --compare for one light of a scene."""
    asset = os.path.join(folder, "lamp.umb")
    subprocess.run([os.path.join(BUILD, "umbrage-bake"), scene, "-o", asset, "--resolution", str(resolution), *light,
                    "--effect", "penumbra=on", "--verify", "20000", "--quiet"], check=True)
    words = [os.path.join(BUILD, "umbrage"), "render", scene, "--asset", asset, "--filter", "penumbra", "--compare",
             "--size", f"{width}x{width * 3 // 4}", "--aa", "1", "--samples", str(samples), "--json", "--quiet"]
    done = subprocess.run(words + (["--camera", camera] if camera else []), check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def run(resolution, width, samples, each):
    """Calls each(scene, light, figures) for all scenes and lights."""
    with tempfile.TemporaryDirectory() as folder:
        for name, words, camera, lights in SCENES:
            scene = make_scene(name, words, folder)
            for light in lights:
                each(name, " ".join(light), compare(scene, light, camera, resolution, width, samples, folder))


def main():
    numbers = [int(word) for word in sys.argv[1:]]
    resolution, width, samples = (numbers + [4096, 480, 16][len(numbers):])[:3]
    means = {}  # of the lights of each scene

    def show(name, light, figures):
        means.setdefault(name, []).append(figures["mean_difference"])
        print(f"| {name} | `{light}` | {figures['judged']} | {figures['mean_difference']:.4f} | "
              f"{100 * figures['false_shadow']:.2f} | {100 * figures['false_light']:.2f} |", flush=True)

    print("| scene | light | points | mean difference | false shadow, % | false light, % |\n|---|---|---|---|---|---|")
    run(resolution, width, samples, show)
    of_scene = {name: sum(one) / len(one) for name, one in means.items()}
    print("\nmeans of the scenes: " + ", ".join(f"{name} {mean:.4f}" for name, mean in of_scene.items()))
    sys.exit(max(of_scene.values()) > MOST)


if __name__ == "__main__":
    main()
