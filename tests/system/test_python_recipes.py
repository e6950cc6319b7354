#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The Python guide: its code blocks run in their order, and each script of docs/examples makes what it says, with figures
that follow from the scene.
"""
import csv
import json
import os
import re
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

umbrage, np = ut.need_module()
test = ut.Test()
os.mkdir(test.path("store"))
GUIDE = os.path.join(ut.ROOT, "docs", "guide", "python.md")
EXAMPLES = os.path.join(ut.ROOT, "docs", "examples")
os.environ["PATH"] = os.pathsep.join([ut.BUILD, os.environ["PATH"]])
os.environ["PYTHONPATH"] = os.path.join(ut.BUILD, "python")
daemon = test.daemon("--workers", 1, "--jobs", test.path("jobs"))

with test.check("the guide's code blocks run one after the other"):
    with open(GUIDE, encoding="utf-8") as file:
        blocks = re.findall(r"<!-- python: ([a-z-]+) -->\n```python\n(.*?)```", file.read(), re.DOTALL)
    assert [name for name, _ in blocks] == ["five-minutes", "views", "jobs"]
    os.rename(test.scene("city", 8), test.path("city.glb"))
    os.chdir(test.folder)
    place = {"address": daemon.grpc_unix}
    for name, text in blocks:
        exec(compile(text, name, "exec"), place)  # noqa: S102
    assert place["status"].state == "done" and os.path.exists("fetched.umb")

try:
    import matplotlib  # noqa: F401
    HAS_PICTURES = True
except ImportError:
    HAS_PICTURES = False
    ut.left_out("the recipes that draw", "python3-matplotlib is not installed")

# A wall along y = 0, 10 m high and 100 m long, on a large floor: its shadows are known.
WALL = ("o floor\nv -200 -200 0\nv 200 -200 0\nv 200 200 0\nv -200 200 0\nf 1 2 3 4\n"
        "o wall\nv -50 0 0\nv 50 0 0\nv 50 0 10\nv -50 0 10\nf 5 6 7 8\n")
with open("wall.obj", "w", encoding="ascii") as file:
    file.write(WALL)
with open("bare.obj", "w", encoding="ascii") as file:
    file.write(WALL[:WALL.index("o wall")])


def script(name, *words):
    done = subprocess.run([sys.executable, os.path.join(EXAMPLES, name), *words], stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0, done.stdout
    return done.stdout


def is_png(path):
    with open(path, "rb") as file:
        return file.read(8) == b"\x89PNG\r\n\x1a\n" and os.path.getsize(path) > 5000


OPTIONS = ("--up", "z", "--resolution", "2048", "--verify", "0", "--closed", "off", "--quiet")
for asset, scene in (("wall.umb", "wall.obj"), ("bare.umb", "bare.obj")):
    ut.run("umbrage-bake", scene, "-o", asset, "--sun", "180,45", *OPTIONS)

with test.check("face_shares: the floor's shade is the wall's shadow"):
    script("face_shares.py", "wall.umb", "wall.obj", "faces.csv")
    with open("faces.csv", encoding="utf-8") as file:
        rows = {row["building"]: row for row in csv.DictReader(file)}
    shade = float(rows["floor"]["in_shade"]) * float(rows["floor"]["area_m2"])
    assert abs(float(rows["floor"]["area_m2"]) - 160000) < 1 and abs(float(rows["wall"]["area_m2"]) - 1000) < 1
    # 10 m high under a sun 45 degrees high: 10 x 100 m; samples are 4000 of 160000 m2, one in 40 m2 at most
    assert 500 < shade < 1500, shade

if HAS_PICTURES:
    with test.check("compare_versions: the wall brings its shadow and takes nothing"):
        said = script("compare_versions.py", "bare.umb", "wall.umb", "change.png", " -100,-100", "100,100", "0.01")
        new_shade, new_light = (float(number) for number in re.findall(r"([\d.]+) m2", said))
        assert abs(new_shade - 1000) < 100 and new_light < 20, said
        assert is_png("change.png")

    with test.check("sun_hours and path_shade: the wall's north side has less sun than its south side"):
        ut.run("umbrage-bake", "wall.obj", "-o", "day.umb", "--sun-path", "48,16,2026-03-20,60", *OPTIONS)
        script("sun_hours.py", "day.umb", "hours.png", " -40,-20", "40,20", "0.01", "1")
        hours = np.load("hours.npy")
        south, north = hours[:18].mean(), hours[22:26].mean()
        assert 10 < south < 13 and north < south - 2, (south, north)  # an equinox's day has 12 hours
        said = script("path_shade.py", "day.umb", "path.png", " -40,3,0.01", "40,3,0.01")
        shares = [float(number) for number in re.findall(r" ([\d.]+) %", said)]
        assert len(shares) >= 11 and shares[len(shares) // 2] > 90, said  # at noon all of it
        assert is_png("hours.png") and is_png("path.png")

if HAS_PICTURES:
    with test.check("plot_study: the settings on the front are those that no other beats"):
        # a lamp's study has the same rows and no techniques, which the script does not read
        ut.run("umbrage-study", "city.glb", "-o", "study", "--quick", "--max-resolution", "512", "--points", "1000", "--truth",
               "2", "--point", "10,40,-10")
        said = script("plot_study.py", "study", "study.png").splitlines()
        with open("study/report.json", encoding="utf-8") as file:
            study = json.load(file)
        rows = [row for row in study["results"] if row["rms"] is not None and row["ns_view"]]
        kept = [row for row in rows if not any(
            other["ns_view"] <= row["ns_view"] and other["rms"] < row["rms"] or
            other["ns_view"] < row["ns_view"] and other["rms"] <= row["rms"] for other in rows)]
        assert {f"{row['method']} {study['bakes'][row['bake']]['resolution']} voxels, {row['taps']} taps, level {row['level']}"
                for row in kept} == {line.split(":")[0] for line in said}, (kept, said)
        assert is_png("study.png") and script("plot_study.py", "study/report.json", "again.png").splitlines() == said

test.finish()
