#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Transmittance of baked hair and glass equals the brute-force product over all surfaces before a point, in long double,
within 1e-6, at 10^5 points of each scene and more: generated ones, and the real ones where they are (UMBRAGE_SCENES).
tests/agreement/light_products.c compares; its lists are complete down to 0.001 of the light, as a bake states.
"""
import json
import os
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import translucent_scenes  # noqa: E402
import umbrage_test as ut  # noqa: E402

SCENES = os.environ.get("UMBRAGE_SCENES", os.path.join(ut.ROOT, "..", "shared", "scenes"))
test = ut.Test()


def products(scene, sun, resolution, asset):
    """The result of light_products for a bake."""
    subprocess.run([ut.program("umbrage-bake"), scene, "-o", asset, "--sun", sun, "--resolution", resolution,
                    "--closed", "off", "--verify", "0", "--quiet"], check=True)
    run = subprocess.run([ut.program("light_products"), scene, asset], capture_output=True, text=True)
    assert run.returncode in (0, 1), run.stderr
    return json.loads(run.stdout), run


def compare(name, scene, sun="135,45", resolution="2048"):
    with test.check(f"{name}, sun {sun}, at {resolution}"):
        found, run = products(scene, sun, resolution, test.path("a.umb"))
        print(run.stdout, end="")
        assert run.returncode == 0 and found["wrong"] == 0, run.stderr
        assert found["compared"] >= 100000 and found["behind"] >= 20000, found
        assert found["worst"] <= 1e-6 and found["worst_ended"] < 0.001, found


for kind in ("hair", "glass"):
    generated = test.path(f"{kind}.obj")
    getattr(translucent_scenes, kind)(generated)
    compare(f"generated {kind}", generated)
compare("generated glass", test.path("glass.obj"), "27,80", "1024")

for real in ("hair_long01/long01_blend.glb", "helmet_flight/FlightHelmet.gltf"):
    path = os.path.join(SCENES, *real.split("/"))
    if os.path.exists(path):
        compare(real, path)
    else:
        print(f"SKIP {real}: not there")

with test.check("it can fail: the products of another scene"):
    translucent_scenes.hair(test.path("other.obj"), 300)
    subprocess.run([ut.program("umbrage-bake"), test.path("hair.obj"), "-o", test.path("a.umb"), "--resolution", "512",
                    "--closed", "off", "--verify", "0", "--quiet"], check=True)
    run = subprocess.run([ut.program("light_products"), test.path("other.obj"), test.path("a.umb")],
                         capture_output=True, text=True)
    assert run.returncode == 1 and json.loads(run.stdout)["wrong"] > 1000, run.stdout

test.finish()
