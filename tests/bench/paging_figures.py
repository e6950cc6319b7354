#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The tables of docs/results/paging.md: the bytes that a thin client receives until it can answer a view.

    tests/bench/paging_figures.py [--size quick|full] [--keep FOLDER] [--only bytes,memory,links,picture]

Makes the scenes, bakes them (closed, and open for true depths) and prints markdown: bytes until the points
that a camera sees are within 1 m, within 10 cm and exact; beside them depth maps of the same view and the
whole asset; memory over a walk; seconds over links; and the street sharpening, stream.png in FOLDER. quick: 16384 voxels and two links. full adds 65536
and all links: a quarter of an hour. --keep keeps scenes and assets in FOLDER, and uses those it finds there.
"""
import argparse
import json
import os
import struct
import subprocess
import sys
import tempfile
import time
import zlib

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import link  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("--size", default="quick", choices=("quick", "full"))
parser.add_argument("--keep")
parser.add_argument("--only", default="bytes,memory,links,picture")
options = parser.parse_args()
BUILD = os.environ.get("BUILD", "build/release")
folder = options.keep or tempfile.mkdtemp()
os.makedirs(folder, exist_ok=True)
FULL = options.size == "full"
SCENES = {
    "city": {"file": "city.glb", "make": ("city", "--size", "50"), "up": "y",
             "camera": "eye=1,1.7,1,target=100,1.7,9,fov=60"},
    "terrain": {"file": "terrain.ply", "make": ("terrain", "--size", "1024"), "up": "z",
                "camera": "eye=189.255,-10.3028,550,target=-2500,2500,200,fov=60"},
}
TAPS = "9"


def path(name):
    return os.path.join(folder, name)


def run(program, *words):
    done = subprocess.run([os.path.join(BUILD, program), *words], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, check=False)
    if done.returncode != 0:
        sys.exit(f"{program} {' '.join(words)}: {done.stderr.decode()}")
    return done.stdout


def asset(scene, resolution, closed="auto"):
    """The path of a baked asset."""
    out = path(f"{scene}-{resolution}{'' if closed == 'auto' else '-open'}.umb")
    if not os.path.exists(out):
        run("umbrage-bake", path(SCENES[scene]["file"]), "-o", out, "--resolution", str(resolution), "--sun",
            "135,45", "--closed", closed, "--verify", "0", "--quiet")
    return out


def prepare():
    for name, scene in SCENES.items():
        if not os.path.exists(path(scene["file"])):
            run("scenegen", *scene["make"], "-o", path(scene["file"]))
        if not os.path.exists(path(name + ".f32")):
            run("umbrage", "points", path(scene["file"]), "-o", path(name + ".f32"), "--kind", "gbuffer",
                "--camera", scene["camera"], "--up", scene["up"], "--normals", "--size", "320x180", "--quiet")


def stream(scene, mode, *source):
    words = ["--json", *source, "--points", path(scene + ".f32"), "--normals", "--taps", TAPS, "--up",
             SCENES[scene]["up"], "--camera", SCENES[scene]["camera"]]
    words += ["--only-points"] if mode == "points" else ["--round", "128K"]
    return json.loads(run("umbrage", "stream", *words))


def first_step(told, key, share=1.0):
    """The first step at which so many points are known."""
    return next((s for s in told["steps"] if s[key] >= share * told["points"]), None)


def kib(count):
    return f"{count / 1024:.0f}"


def table(head, rows):
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |", flush=True)
    print()


def bytes_rows():
    for resolution in (16384, 65536) if FULL else (16384,):
        for scene in SCENES:
            for mode in ("points", "camera"):
                told = stream(scene, mode, asset(scene, resolution))
                cells = []
                for key in ("within_1m", "within_10cm", "exact"):
                    for share in (0.99, 1.0):
                        step = first_step(told, key, share)
                        cells.append(kib(step["bytes"]) if step else "-")
                last, first = told["steps"][-1], told["steps"][0]
                known = first_step(told, "exact") or last
                yield (f"{scene} {resolution}", kib(told["asset_bytes"]),
                       {"points": "points it sees", "camera": "camera's pyramid"}[mode], kib(first["bytes"]),
                       f"{100 * first['exact'] / told['points']:.1f} %", *cells,
                       f"{100 * known['bytes'] / told['asset_bytes']:.1f} %", last["rounds"])


def map_rows():
    for scene in SCENES:
        for kind, closed in (("closed", "auto"), ("true depths", "off")):
            told = json.loads(run("depth_view", asset(scene, 16384, closed), path(scene + ".f32"), TAPS))
            yield (scene, kind, f"{told['width']} x {told['height']}", kib(told["rectangle_bytes"]),
                   kib(told["blocks_bytes"]))


def walk(steps):
    """A path of cameras through the whole city."""
    with open(path("walk.txt"), "w", encoding="utf-8") as file:
        for i in range(steps):
            x = -400 + 800 * i / (steps - 1)
            print(f"eye={x:.3f},1.7,1,target={x + 100:.3f},1.7,9,fov=60,far=60", file=file)
    return path("walk.txt")


def memory_rows():
    for resolution in (16384, 65536) if FULL else (16384,):
        for limit in ("8M", "32M"):
            told = json.loads(run("umbrage", "stream", "--json", asset("city", resolution), "--path", walk(30),
                                  "--points", path("city.f32"), "--normals", "--taps", TAPS, "--memory", limit))
            first, last = told["steps"][0], told["steps"][-1]
            yield (f"city {resolution}", limit, f"{told['memory_peak_bytes'] / 2 ** 20:.2f} MiB",
                   told["pages_held"], told["pages_dropped"], kib(last["bytes"]),
                   f"{first['worst_m']:.3g} m", f"{last['worst_m']:.3g} m")


def served_by_daemon():
    """Starts a daemon on a folder whose only asset is the city; returns its process and port."""
    store, addresses = tempfile.mkdtemp(), tempfile.mktemp()
    os.link(asset("city", 16384), os.path.join(store, "city.umb"))
    daemon = subprocess.Popen([os.path.join(BUILD, "umbraged"), "--store", store, "--listen", "tcp:127.0.0.1:0",
                               "--address-file", addresses, "--log-level", "error"])
    while not os.path.exists(addresses):
        time.sleep(0.05)
    with open(addresses, encoding="utf-8") as file:
        return daemon, int(file.read().split()[0].rpartition(":")[2])


def link_rows():
    daemon, port = served_by_daemon()
    server = link.RangeServer(folder)
    for mbit in (1, 5, 20, 100) if FULL else (20,):
        for rtt_ms in (20, 100, 300) if FULL else (20, 100):
            cells = []
            for target in (port, server.port):
                slow = link.Link(target, mbit, rtt_ms)
                told = stream("city", "points", *(
                    ["city", "--address", f"tcp:127.0.0.1:{slow.port}"] if target == port else
                    ["--from-url", f"http://127.0.0.1:{slow.port}/city-16384.umb"]))
                for step in (told["steps"][0], first_step(told, "within_10cm", 0.99),
                             first_step(told, "within_10cm")):
                    cells.append(f"{step['seconds']:.2f}")
            yield (mbit, rtt_ms, *cells)
    daemon.terminate()
    daemon.wait()
    server.close()


def read_ppm(name):
    with open(name, "rb") as file:
        file.readline()
        width, height = map(int, file.readline().split())
        file.readline()
        return width, height, file.read()


def write_png(name, width, rows):
    """rows: bytes of RGB pixels each."""
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    with open(name, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, len(rows), 8, 2, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(b"".join(b"\0" + row for row in rows), 9)) + chunk(b"IEND", b""))


def picture():
    """Four steps of the street, two and two; returns the KiB received until each."""
    camera, points, frames = SCENES["city"]["camera"], path("large.f32"), tempfile.mkdtemp()
    run("umbrage", "points", path("city.glb"), "-o", points, "--kind", "gbuffer", "--camera", camera, "--normals",
        "--size", "640x360", "--quiet")
    told = json.loads(run("umbrage", "stream", "--json", asset("city", 16384), "--points", points, "--normals",
                          "--taps", TAPS, "--camera", camera, "--size", "640x360", "--frames", frames, "--only-points",
                          "--round", "24K"))
    steps = told["steps"]
    chosen = [round(i * (len(steps) - 1) / 3) for i in range(4)]
    images = [read_ppm(os.path.join(frames, sorted(os.listdir(frames))[i])) for i in chosen]
    width, height, gap = images[0][0], images[0][1], b"\xff" * 18
    rows = []
    for left, right in (images[:2], images[2:]):
        rows += [b"\xff" * (6 * width + 18)] * 6 if rows else []
        rows += [left[2][3 * width * y:3 * width * (y + 1)] + gap + right[2][3 * width * y:3 * width * (y + 1)]
                 for y in range(height)]
    write_png(path("stream.png"), 2 * width + 6, rows)
    return [kib(steps[i]["bytes"]) for i in chosen]


prepare()
if "bytes" in options.only:
    table(("asset", "its KiB", "client asks", "first KiB", "exact then", "1 m, 99 %", "1 m", "10 cm, 99 %",
           "10 cm", "exact, 99 %", "exact", "of the asset", "rounds"), bytes_rows())
    table(("view", "depths", "texels", "rectangle, KiB", "blocks met, KiB"), map_rows())
if "memory" in options.only:
    table(("asset", "budget", "peak", "pages kept", "dropped", "received, KiB", "bound at first",
           "at the end"), memory_rows())
if "links" in options.only:
    table(("Mbit/s", "round trip ms", "first: daemon", "99 %", "10 cm", "first: HTTP/1.1", "99 %", "10 cm"),
          link_rows())
if "picture" in options.only:
    print("stream.png: the street after", ", ".join(picture()), "KiB")
