#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
umbrage fetch must leave the old file or the new one. Each call on the output's folder fails in
turn, while a test server serves an asset. The file must be synced before its rename, and the folder
after it. The bytes that arrived stay as FILE.part, from which the next fetch continues.
"""
import os

import fault_sweep as fs
from fault_sweep import ut
import fake_bakes

test = ut.Test(limit_s=900)
sweep = fs.Sweep(test)
WAYS = ("EIO", "short", "kill") if fs.SHORT else ("EIO", "ENOSPC", "EINTR", "EMFILE", "short", "kill", "tear")
CALLS = "write,pwrite,fsync,fdatasync,rename,renameat,open,openat,mmap,ftruncate,close"
CODES = {66, 73, 74, 75}

city = test.path("city.umb")
asset = test.bake(test.scene("city", 2, form="ply"), city, "--resolution", 128, "--verify", 100)["asset"]
with open(city, "rb") as file:
    whole = file.read()
server = fake_bakes.Server(test.messages)
server.fetch = server.file(whole, piece=4096)
out = test.path("out")
os.mkdir(out)
path = os.path.join(out, "got.umb")
WORDS = ["umbrage", "fetch", asset, "--address", server.address, "--quiet", "-o", path]


def content(name):
    if not os.path.exists(name):
        return None
    with open(name, "rb") as got:
        return got.read()


def try_point(way, at, function, keep=False):
    for name in os.listdir(out):
        os.remove(os.path.join(out, name))
    with open(path, "wb") as old:
        old.write(b"old")
    end = sweep.run(WORDS, CALLS, way, at, keep=keep, under=out)
    assert end.faults >= 1, "the call was not made"
    assert content(path) in (b"old", whole), "neither the old file nor the new one"
    part = content(path + ".part")
    assert part is None or whole.startswith(part) or way == "tear", "the part is not the file's front"
    if way in ("kill", "tear"):
        assert end.code == fs.KILLED, f"not killed: {end}"
    else:
        assert not end.died(), str(end)
        fs.failed_fsyncs_are_final(end.trace)
        assert end.code in CODES or (end.code == 0 and content(path) == whole), str(end)
        if end.code != 0:
            fs.one_sentence(end.err, "umbrage")
        assert end.code != 0 or function != "fsync" or not way.startswith("E") or way == "EINTR", f"a failed fsync is no success; {end}"
    ut.run(*WORDS)
    assert content(path) == whole and os.listdir(out) == ["got.umb"], os.listdir(out)


with test.check("umbrage fetch shows the old file or the new one, and goes on after every fault"):
    failures = fs.Failures()
    whole_run = sweep.run(WORDS, CALLS, "EIO", 0, under=out)
    assert whole_run.code == 0 and content(path) == whole, str(whole_run)
    functions = [function for function, _, _ in whole_run.trace]
    named = functions.index("rename")
    assert "fsync" in functions[:named] and "fsync" in functions[named:], functions
    synced = [name for function, _, name in whole_run.trace if function == "fsync"]
    assert synced[-1].rstrip("/") == out, synced
    for way in WAYS:
        for at in sweep.points(whole_run.calls):
            with failures.point(way, "at call", at, functions[at - 1]):
                try_point(way, at, functions[at - 1])
    print(f"    {whole_run.calls} calls ({', '.join(sorted(set(functions)))}), {failures.done} runs with a fault")
    failures.end()

server.close()
test.finish()
