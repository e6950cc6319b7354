#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Output files appear whole or not at all. For umbrage-bake, umbrage pack and umbrage unpack, each
call on the output's folder (open, write, fsync, rename, close, map) fails in turn in every way we
know, with an old output there and without. Afterwards:

- under the output's name is the old asset, byte for byte, or the new one, complete and verified;
- exit code 0 goes with the new one; any other code comes with one sentence on stderr;
- unless the process was killed, nothing else is in the folder;
- a file whose fsync failed is never synced again and never gets the name;
- interrupted and short writes are gone on with.
"""
import errno
import os

import fault_sweep as fs
from fault_sweep import ut

test = ut.Test(limit_s=1500)
sweep = fs.Sweep(test)
WAYS = ("EIO", "ENOSPC", "EINTR", "EMFILE", "short", "kill", "tear")
SHORT_WAYS = ("EIO", "EINTR", "short", "tear")
# Unlink never fails here: if it did, a temporary would stay, as expected, and the test would prove
# nothing.
CALLS = "write,pwrite,fsync,fdatasync,rename,renameat,open,openat,mmap,ftruncate,close,mkdir"
# umbrage's outputs are streams of the C library, which count an interrupted write as a failure;
# umbrage catches no signals, so none is interrupted.
GONE_ON_WITH = {"umbrage-bake": ("short", "EINTR"), "umbrage": ("short",)}
CODES = {73, 74, 75}  # cannot create, input or output, temporary: docs/reference/operations.md

out = test.path("out")
scene = test.scene("city", 2, form="ply")
new_asset = test.path("new.umb")
new_id = test.bake(scene, new_asset, "--resolution", 128, "--verify", 100)["asset"]
old_asset = test.path("old.umb")
test.bake(test.scene("box", 4, form="ply"), old_asset, "--resolution", 64, "--verify", 0)
mapped = test.path("new.umbm")
ut.run("umbrage", "unpack", new_asset, "-o", mapped)
with open(old_asset, "rb") as old_file:
    OLD = old_file.read()

COMMANDS = {
    "bake": ["umbrage-bake", scene, "--resolution", 128, "--verify", 100, "--quiet", "--threads",
             1, "-o"],
    "pack": ["umbrage", "pack", mapped, "--quiet", "-o"],
    "unpack": ["umbrage", "unpack", new_asset, "--quiet", "-o"],
}


def prepare(with_old):
    """The output's folder, fresh; returns the output's path."""
    os.makedirs(out, exist_ok=True)
    for name in os.listdir(out):
        os.remove(os.path.join(out, name))
    path = os.path.join(out, "asset.umb")
    if with_old:
        with open(path, "wb") as file:
            file.write(OLD)
    return path


def state(path, with_old):
    """Returns 'old' (also if there was no old file and there is none now) or 'new'; fails for any
    other content."""
    if not os.path.exists(path):
        assert not with_old, "the old output is gone"
        return "old"
    with open(path, "rb") as file:
        data = file.read()
    if data == OLD:
        assert with_old, "an output from nowhere"
        return "old"
    info = ut.run("umbrage", "verify", path, "--json", code=None)
    assert info.returncode == 0 and new_id.encode() in info.stdout, \
        f"neither the old output nor the new one: {info.stdout!r} {info.stderr!r}"
    return "new"


def try_point(words, with_old, way, at, function, keep=False):
    """One run with that call failing; function is what the undisturbed run calls there."""
    path = prepare(with_old)
    end = sweep.run(words + [path], CALLS, way, at, keep=keep, under=out)
    seen = state(path, with_old)
    strays = sorted(set(os.listdir(out)) - {"asset.umb"})
    if way in ("kill", "tear") and end.faults:
        assert end.code == fs.KILLED, f"not killed: {end}"
        assert all(s.startswith(".tmp.") for s in strays), f"nobody sweeps {strays}"
        return
    assert end.faults >= 1, "the call was not made"
    assert not end.died(), str(end)
    assert not strays, f"left behind: {strays}; {end}"
    fs.failed_fsyncs_are_final(end.trace)
    if end.code == 0:
        assert seen == "new" and not end.err, f"exit code 0 with the {seen} output; {end}"
    else:
        # A bake that cannot open its own temporary to check it says "no input".
        assert end.code in CODES or (end.code == 66 and function == "open"), str(end)
        fs.one_sentence(end.err, words[0])
        if function in ("write", "fsync") and words[0] == "umbrage":
            assert os.strerror(getattr(errno, way)) in end.err.decode(), f"no cause: {end}"
    if function == "write" and not keep and way in GONE_ON_WITH[words[0]]:
        assert end.code == 0, f"a write that can be gone on with failed the run: {end}"


for name, words in COMMANDS.items():
    for with_old in (True,) if fs.SHORT else (False, True):
        failures = fs.Failures()
        kind = "replacing an old output" if with_old else "with no output before"
        with test.check(f"umbrage {name}, {kind}, shows the old output or the new one"):
            path = prepare(with_old)
            whole = sweep.run(words + [path], CALLS, "EIO", 0, under=out)
            assert whole.code == 0 and state(path, with_old) == "new", str(whole)
            functions = [function for function, _, _ in whole.trace]
            assert {"open", "write", "fsync", "rename"} <= set(functions), functions
            # The file is synced before it gets the name, the folder after.
            named = functions.index("rename")
            assert "fsync" in functions[:named] and "fsync" in functions[named:], functions
            for way in SHORT_WAYS if fs.SHORT else WAYS:
                for at in sweep.points(whole.calls):
                    with failures.point(way, "at call", at, functions[at - 1]):
                        try_point(words, with_old, way, at, functions[at - 1])
            for way in ("EIO",) if fs.SHORT else ("EIO", "ENOSPC"):
                for at in sweep.points(whole.calls):
                    with failures.point(way, "from call", at, functions[at - 1]):
                        try_point(words, with_old, way, at, functions[at - 1], keep=True)
            print(f"    {whole.calls} calls ({', '.join(sorted(set(functions)))}), "
                  f"{failures.done} runs with a fault")
            failures.end()

test.finish()
