#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
A folder of tiles that fails. Each call on it (make, open, write, fsync, rename, close) fails in turn in every
way we know, for a bake that only caches there and for `umbrage-bake tile`, with the folder empty and full. Afterwards:

- a bake that caches has made its asset, the right one, unless the folder could not be opened at all;
- tile ends with 0 or with a code and one sentence;
- so does a bake that begins with the merged octree that the folder keeps;
- the next run with the same folder makes the right asset, whatever the fault left there;
- unless the process was killed, no temporary is in the folder.
"""
import json
import os
import shutil

import fault_sweep as fs
from fault_sweep import ut

test = ut.Test(limit_s=1500)
sweep = fs.Sweep(test)
WAYS = ("EIO", "ENOSPC", "EINTR", "EMFILE", "short", "kill", "tear")
SHORT_WAYS = ("EIO", "tear")
LIMIT = 8 if fs.SHORT else fs.LIMIT
CALLS = "write,pwrite,fsync,fdatasync,rename,renameat,open,openat,ftruncate,close,mkdir"
CODES = {73, 74, 75}

scene = test.scene("city", 2, form="ply")
SETTINGS = ["--resolution", 128, "--tile", 64, "--verify", 0, "--quiet", "--threads", 1]
asset = test.path("asset.umb")
right = test.bake(scene, asset, *SETTINGS)["asset"]
tiles = test.path("tiles")
full = test.path("full")
ut.run("umbrage-bake", "tile", scene, "-o", full, *SETTINGS)
CHECKED = [1000 if word == 0 else word for word in SETTINGS]  # only a bake with a self-check keeps a base
based = test.path("based")
ut.run("umbrage-bake", scene, "-o", asset, "--cache", based, *CHECKED)

COMMANDS = {
    "bake --cache": ["umbrage-bake", scene, "-o", asset, "--cache", tiles, "--json", *SETTINGS],
    "bake with a base": ["umbrage-bake", scene, "-o", asset, "--cache", tiles, "--json", *CHECKED],
    "tile": ["umbrage-bake", "tile", scene, "-o", tiles, *SETTINGS],
}


def prepare(name, with_tiles):
    shutil.rmtree(tiles, ignore_errors=True)
    if with_tiles:
        shutil.copytree(based if name == "bake with a base" else full, tiles)
    if os.path.exists(asset):
        os.remove(asset)


def try_point(name, words, with_tiles, way, at, keep=False):
    prepare(name, with_tiles)
    end = sweep.run(words, CALLS, way, at, keep=keep, under=tiles)
    entries = os.listdir(tiles) if os.path.isdir(tiles) else []
    strays = [entry for entry in entries if entry.startswith(".tmp.")]
    if way in ("kill", "tear") and end.faults:
        assert end.code == fs.KILLED, f"not killed: {end}"
    else:
        assert end.faults >= 1, "the call was not made"
        assert not end.died(), str(end)
        assert not strays, f"left behind: {strays}; {end}"
        fs.failed_fsyncs_are_final(end.trace)
        if end.code != 0:
            assert end.code in CODES, str(end)
            fs.one_sentence(end.err, "umbrage-bake")
            assert name == "tile" or "cannot" in end.err.decode(), \
                f"a cache that fails is no reason to fail: {end}"
        elif name != "tile":
            assert json.loads(end.out)["asset"] == right, "another asset"
    settings = CHECKED if name == "bake with a base" else SETTINGS
    again = ut.run("umbrage-bake", scene, "-o", asset, "--cache", tiles, "--json", *settings)
    assert json.loads(again.stdout)["asset"] == right, "another asset from what was left"


for name, words in COMMANDS.items():
    for with_tiles in (False, True):
        failures = fs.Failures()
        kind = "in a full folder" if with_tiles else "in an empty folder"
        with test.check(f"{name} {kind} survives faults of the folder"):
            prepare(name, with_tiles)
            whole = sweep.run(words, CALLS, "EIO", 0, under=tiles)
            assert whole.code == 0, str(whole)
            functions = [function for function, _, _ in whole.trace]
            assert json.loads(whole.out)["tiles_of_base"] > 0 or not with_tiles if "base" in name else True, whole
            assert {"open" if with_tiles else "write"} <= set(functions), functions
            for way in SHORT_WAYS if fs.SHORT else WAYS:
                for at in sweep.points(whole.calls, LIMIT):
                    with failures.point(way, "at call", at, functions[at - 1]):
                        try_point(name, words, with_tiles, way, at)
            for at in sweep.points(whole.calls, LIMIT):
                with failures.point("EIO from call", at, functions[at - 1]):
                    try_point(name, words, with_tiles, "EIO", at, keep=True)
            print(f"    {whole.calls} calls ({', '.join(sorted(set(functions)))}), "
                  f"{failures.done} runs with a fault")
            failures.end()

test.finish()
