#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The shaders in headless Chromium, by WebGL2 and by WebGPU: each count of a picture's pixels is the core's at the core's
voxels; with the shader's own placement it differs within the stated bound of a voxel's border only. tests/web/gpu.mjs has
the checks. The WebGPU example draws a picture. UMBRAGE_PIXELS: pixels of the picture (default: 16384; make test-web: 921600).
"""
import json
import math
import os
import shutil
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402
import web_browser  # noqa: E402
import web_cases  # noqa: E402

PIXELS = int(os.environ.get("UMBRAGE_PIXELS", "16384"))
# Filter, light, taps, level; filter, light, taps, option and its value, the same in radians or metres.
CASES = [("box", 0, 1, 0), ("box", 0, 9, 0), ("box", 1, 17, 0), ("box", 1, 7, 0), ("tent", 1, 9, 0), ("coarse", 0, 1, 3)]
WIDE = [("penumbra", 1, 3, "--light-size", 20, math.radians(20)), ("footprint", 1, 3, "--footprint", 2.5, 2.5)]
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-unsafe-webgpu",
         "--use-webgpu-adapter=swiftshader", "--enable-features=Vulkan"]

web_cases.need_package()
if web_browser.installed() is None:
    ut.skip("chromium is not installed")
test = ut.Test()
size, options, camera = web_cases.SCENES["city"]
scene = test.scene("city", size)
test.bake(scene, test.path("city.umb"), "--verify", 0, *options, "--sun", "200,30", "--closed", "on", "--effect", "front=on")
ut.run("umbrage", "points", scene, "-o", test.path("city.f32"), "--kind", "gbuffer", "--count", PIXELS, "--camera", camera,
       "--normals", "--quiet")
config = {"asset": "city.umb", "points": "city.f32", "camera": web_cases.STREET, "cases": []}
for filter_name, light, taps, level in CASES:
    name = f"{filter_name}-{light}-{taps}-{level}"
    ut.run("gpu_voxels", test.path("city.umb"), test.path("city.f32"), light, taps, level, test.path(f"{name}.places"))
    shape = ["--level", level] if level else ["--taps", taps, "--filter", filter_name]
    ut.run("umbrage", "query", test.path("city.umb"), "--points", test.path("city.f32"), "--format", "f32", "--normals",
           "--encoding", "f32", "-o", test.path(f"{name}.answers"), "--quiet", "--light", light, *shape)
    config["cases"].append({"filter": filter_name, "light": light, "taps": taps, "level": level, "places": f"{name}.places",
                            "expected": f"{name}.answers"})
for filter_name, light, taps, option, value, width in WIDE:
    ut.run("umbrage", "query", test.path("city.umb"), "--points", test.path("city.f32"), "--format", "f32", "--normals",
           "--encoding", "f32", "-o", test.path(f"{filter_name}.answers"), "--quiet", "--light", light, "--taps", taps,
           "--filter", filter_name, option, value)
    config["cases"].append({"filter": filter_name, "light": light, "taps": taps, "level": 0, "width": width,
                            "expected": f"{filter_name}.answers"})
shutil.copy(scene, test.path("scene.glb"))
os.mkdir(test.path("example"))
with open(os.path.join(ut.ROOT, "docs", "examples", "webgpu.html"), encoding="utf-8") as page_file:
    page = page_file.read()
with open(test.path("example", "webgpu.html"), "w", encoding="utf-8") as page_file:
    page_file.write(page.replace("<title>", '<script src="/web/offscreen.js"></script>\n<title>', 1))
FOLDERS = {"package": web_cases.PACKAGE, "umbrage": web_cases.PACKAGE, "files": test.folder,
           "web": os.path.join(ut.ROOT, "tests", "web"), "example": test.path("example")}
with open(test.path("gpu.json"), "w", encoding="utf-8") as file:
    json.dump(config, file)
with web_browser.Browser(FOLDERS, test.path("profile")) as browser:
    browser.look("/web/gpu.html", *FLAGS)
    for engine in ("webgl", "webgpu"):
        checks = browser.result(engine, 240 + PIXELS // 1000)
        if checks[0].get("missing"):
            ut.left_out(f"shaders by {engine}", "this Chromium has none")
        else:
            web_cases.count_checks(test, checks)
    drawn = browser.result("example", 90)
    if "no WebGPU" in drawn["figures"]:
        ut.left_out("the WebGPU example", "this Chromium has none")
    else:
        with test.check("the WebGPU example draws sky, lit surfaces and shadows"):
            print(drawn)
            assert drawn["figures"].endswith("kB fetched"), drawn
            assert sum(pixels > 320 * 240 / 100 for pixels in drawn["colours"].values()) >= 3, drawn
test.finish()
