#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The Python module under valgrind with Debian's python3: files, ranges, volume queries, maps, refusals, a daemon and its
jobs leave no leak and no bad access in a stack of ours. What valgrind says of Python and numpy alone is not counted.
"""
import os
import re
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

if shutil.which("valgrind") is None:
    ut.skip("valgrind is not installed")
umbrage, np = ut.need_module()
test = ut.Test()
os.mkdir(test.path("store"))
ASSET = test.path("store", "city.umb")
test.bake(test.scene("city", 4), ASSET, "--resolution", 256, "--closed", "off", "--effect", "front=on", "--sun", "135,45", "--verify", 0)
daemon = test.daemon("--workers", 1, "--max-points", 3000, "--jobs", test.path("jobs"))
SCRIPT = f'''
import gc, os, sys
sys.path.insert(0, {os.path.join(ut.BUILD, "python")!r})
import numpy as np
import umbrage
ASSET, PLACE, SCENE = {ASSET!r}, {daemon.grpc_unix!r}, {test.scene("city", 4)!r}


def refused(call):
    try:
        call()
    except (ValueError, TypeError, LookupError, umbrage.Error):
        return
    raise AssertionError("not refused")


def use(asset, whole):
    low, high = asset.info.bounds
    points = np.random.default_rng(1).uniform(low, high, (10000, 3)).astype(np.float32)
    for words in (dict(taps=9), dict(taps=5, filter="tent"), dict(stats=True), dict(format="bit"), dict(max_error=20.0, stats=True)):
        if whole or not words.keys() & {{"format", "max_error"}}:
            asset.query(points, **words)
    asset.query(points.astype(float), origin=(1, 2, 3), threads=2 if whole else 1)
    for words in (dict(taps=4), dict(light=9), dict(filter="x"), dict(points=points[:, :2]), dict(points=points * np.nan)):
        refused(lambda: asset.query(**{{"points": points, **words}}))
    if whole:
        asset.segments(np.stack([points[:50], points[50:100]], 1), intervals=3)
        asset.columns(points[:100])
        asset.boxes(np.stack([points[:5], points[:5] + np.float32(9)], 1).astype(float))


for turn in range(2):
    with umbrage.open(ASSET) as asset:
        use(asset, True)
        asset.derive(16, 16, technique="vsm")
        asset.explain((0, 0, 0))
        refused(lambda: asset.derive(0, 0))
    with umbrage.open(ASSET, partial=True) as part:
        part.fetch(umbrage.View(box=part.info.bounds))
        use(part, False)
    refused(lambda: umbrage.open("none.umb"))
    refused(lambda: umbrage.open(sys.executable))
    with umbrage.connect(PLACE) as there:
        with there.open("city") as far:
            use(far, True)
        there.assets()
        there.jobs()
        refused(lambda: there.open("none"))
        refused(lambda: there.fetch("00" * 32, "none.umb"))
        with there.open_ranges("city") as part:
            part.fetch(umbrage.View(box=part.info.bounds))
        job = there.submit(SCENE, {{"resolution": 256, "sun": f"{{turn}},45", "verify": 0}}, progress=lambda sent, total: None)
        status = there.wait(job)
        there.fetch(status.asset, os.path.join({test.folder!r}, "fetched.umb"))
        there.delete(status.asset)
        refused(lambda: there.submit("none.glb"))
        refused(lambda: there.cancel("0" * 32))
        next(there.watch(job))
    gc.collect()
# A block that nothing frees, which must be found.
lost = umbrage._library.ffi.new("struct umb_asset **")
assert umbrage._library.core.umb_asset_open_file(ASSET.encode(), umbrage._library.ffi.NULL, lost, umbrage._library.new_error()) == 0
lost[0] = umbrage._library.ffi.NULL
'''


def findings():
    """Records of valgrind whose stack has a function of ours."""
    log = test.path("valgrind.log")
    done = subprocess.run(["valgrind", "--leak-check=full", "--show-leak-kinds=definite", "--num-callers=40", f"--log-file={log}",
                           sys.executable, "-c", SCRIPT], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                          check=False, timeout=500, env={**os.environ, "PYTHONMALLOC": "malloc"})
    assert done.returncode == 0, done.stdout[-2000:]
    with open(log, encoding="utf-8", errors="replace") as text:
        records = re.split(r"^==\d+== *\n", text.read(), flags=re.MULTILINE)
    return [one for one in records if re.search(r"(?:at|by) 0x.*(?:libumbrage|umb_[a-z]|umb__)", one)]


found = findings()

with test.check("a leak is seen: the block that is lost on purpose"):
    wanted = [one for one in found if "in 1 blocks are definitely lost" in one and "(asset.c:" in one]
    assert len(wanted) == 1, "\n".join(found)[:4000]

with test.check("no other leak and no bad access in a stack of ours"):
    assert len(found) == 1, "\n".join(found)[:4000]

test.finish()
