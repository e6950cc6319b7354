#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Edges of the viewer's shadows against rays: the table of docs/results/pictures.md. `make view-edges` runs it.

    view_edges.py [WIDTH HEIGHT]

Opens the generated city in the viewer, in headless Chromium, splits the picture, and reads back the pixels' places and what
the cascades say of them. The package in node fetches what the pixels need, up to a limit, and answers with what it has. A pixel that faces the sun with a cosine above 0.2 is wrong if its share of light differs by half or more
from one ray from its surface (tests/bench/ray_shares.c, by Embree). So a pixel of which nothing is known is wrong.
"""
import json
import os
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import devtools  # noqa: E402
import umbrage_test as ut  # noqa: E402
import view_server  # noqa: E402

WAIT_S = 1500  # Chromium may draw in software
MB, ALL = 1_000_000, 1 << 40
# Name, the view; for each asset: voxels a side, texels of the window, most bytes that are fetched.
VIEWS = [("street", "#eye=1,1.7,1&target=100,1.7,9&fov=60", [(16384, 9, MB), (65536, 9, MB), (131072, 9, ALL), (131072, 3, MB)]),
         ("overview", "#eye=-700,500,-600&target=0,0,0&fov=40", [(2048, 1, MB), (4096, 1, MB), (4096, 1, ALL), (16384, 1, ALL)])]
# Splits of the cascades: those of three's add-on, and logarithmic ones, which favour what is near.
# A bias of one texel leaves stripes where light is flat, and two, which the viewer has, more false light.
SETTINGS = {"cascades": {"practical": 0.5, "bias_texels": 1}, "cascades, logarithmic": {"practical": 1.0, "bias_texels": 1},
            "cascades, two texels": {"practical": 0.5, "bias_texels": 2}}
# Answers of the package in node with at most so many bytes: float32 shares of points.
ANSWER = """
    const [, folder, asset, most, taps] = process.argv;
    const { open } = await import(`${folder}/index.js`), { readFileSync, writeFileSync } = await import("node:fs");
    const numbers = new Float32Array(readFileSync(`${asset}.points`).buffer), count = numbers.length / 6;
    const points = new Float32Array(3 * count), normals = new Float32Array(3 * count);
    for (let i = 0; i < count; i++) {
      points.set(numbers.subarray(6 * i, 6 * i + 3), 3 * i);
      normals.set(numbers.subarray(6 * i + 3, 6 * i + 6), 3 * i);
    }
    const one = await open(asset, { memory: 2 ** 31 });
    let answers, before = -1;
    for (;;) {
      answers = await one.query(points, { taps: Number(taps), normals, bounds: true });
      const { received_bytes } = one.held();
      if (answers.exact_count === count || received_bytes === before || received_bytes >= Number(most)) {
        break;
      }
      before = received_bytes;
      await one.want([], { max_bytes: Number(most) - received_bytes });
    }
    writeFileSync(`${asset}.shares`, answers.low.map((low, i) => (low + answers.high[i]) / 2));
    console.log(JSON.stringify({ bytes: one.held().received_bytes, exact: answers.exact_count / count }));
"""


def judge(scene, direction, points):
    """A byte a point: 1 lit, 0 shadowed, 2 not judged."""
    towards = ",".join(str(-each) for each in direction)
    return subprocess.run([ut.program("ray_shares"), scene, towards], input=points, check=True, stdout=subprocess.PIPE).stdout


def wrong(shares, truth):
    """Per cent of the judged pixels."""
    judged = [abs(share - lit) >= 0.5 for share, lit in zip(shares, truth) if lit < 2]
    return 100 * sum(judged) / len(judged), len(judged)


def by_asset(asset, points, taps, most):
    """Shares by the package, and what it fetched."""
    with open(f"{asset}.points", "wb") as file:
        file.write(points)
    done = subprocess.run(["node", "--no-warnings", "--input-type=module", "-e", ANSWER, os.path.join(ut.BUILD, "web", "umbrage"),
                           asset, str(most), str(taps)], check=True, stdout=subprocess.PIPE)
    with open(f"{asset}.shares", "rb") as file:
        return ut.array.array("f", file.read()), json.loads(done.stdout)


def asset_of(folder, scene, voxels):
    path = os.path.join(folder, f"city{voxels}.umb")
    if not os.path.exists(path):
        ut.run("umbrage-bake", scene, "-o", path, "--resolution", voxels, "--sun", "135,45", "--quiet", "--verify", 0)
    return path


def cascades_of(chromium, asset, scene, place, size):
    """The direction of the sun, bytes of the cascades, and for each of SETTINGS what the page reads back."""
    view, page = view_server.View(asset, "--scene", scene), chromium.page(*size)
    page.open(f"{view.address}{place}&taps=1&beside=cascades")
    page.wait("globalThis.umbrageViewer?.state.frames > 0", WAIT_S)
    direction, bytes_of = page.evaluate("[umbrageViewer.asset.info.lights[0].direction, umbrageViewer.parts.cascades.bytes]")
    sides = [view_server.read_sides(page, **settings) for settings in SETTINGS.values()]
    page.open("about:blank")
    view.close()
    return direction, bytes_of, sides


def measure(chromium, folder, scene, view_of, size):
    name, place, assets = view_of
    direction, bytes_of, sides = cascades_of(chromium, asset_of(folder, scene, assets[0][0]), scene, place, size)
    points = sides[0].points.tobytes()
    truth = judge(scene, direction, points)
    errors = [wrong(one.shares[1::2], truth)[0] for one in sides]
    print(f"{name}: {sides[0].width} x {sides[0].height} pixels, {wrong(sides[0].shares[1::2], truth)[1]} judged")
    for label, error in zip(SETTINGS, errors):
        print(f"  {label}: {bytes_of} bytes, {error:.3f} % wrong")
    for voxels, taps, most in assets:
        shares, got = by_asset(asset_of(folder, scene, voxels), points, taps, most)
        error = wrong(shares, truth)[0]
        times = ", ".join(f"{other / max(error, 1e-9):.1f}" for other in errors)
        print(f"  umbrage, {voxels} voxels a side, {taps} x {taps}: {got['bytes']} bytes, {100 * got['exact']:.1f} % exact, "
              f"{error:.3f} % wrong; the cascades have {times} times as many", flush=True)


def main():
    size = [int(word) for word in sys.argv[1:3]] or [976, 480]
    with tempfile.TemporaryDirectory() as own:
        folder = os.environ.get("UMBRAGE_FOLDER", own)  # Keeps the scene and the assets
        scene = os.path.join(folder, "city.glb")
        if not os.path.exists(scene):
            ut.run("scenegen", "city", "--size", 50, "-o", scene)
        for view_of in VIEWS:
            with devtools.Chromium(os.path.join(own, "profile"), timeout=WAIT_S) as chromium:
                measure(chromium, folder, scene, view_of, size)


if __name__ == "__main__":
    main()
