#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The examples in the comments of the installed headers, as they stand: each is compiled and run within
a function of tests/headers that declares what it uses and checks what it did.

An example is a block of lines that begin with " *     " and follow an empty line of a comment.
"""
import os
import re
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

HEADERS = os.path.join(ut.ROOT, "client", "include", "umbrage")
AROUND = os.path.join(ut.ROOT, "tests", "headers")


def read(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


def examples(header):
    """Blocks of code of a header's comments, and other lines of them that look like code."""
    blocks, strays, inside, before = [], [], False, ""
    for line in read(header).splitlines():
        if line.startswith(" *     ") and (inside or before == " *"):
            if not inside:
                blocks.append("")
            inside = True
            blocks[-1] += line[7:] + "\n"
        else:
            inside = False
            if re.match(r" \*.*\bumb_\w+\(.*\);", line):
                strays.append(line)
        before = line
    return blocks, strays


if ut.is_sanitized():
    ut.skip("the examples are compiled without sanitizers")
test = ut.Test()
os.mkdir(test.path("store"))
asset = test.path("store", "city.umb")
scene = test.scene("city", 3, form="ply")
test.bake(scene, asset, "--resolution", 2048, "--closed", "off", "--depth", "raster", "--verify", 0)
os.symlink(asset, test.path("city.umb"))
daemon = test.daemon("--jobs", test.path("bakes"))
compiler = os.environ.get("CC", "gcc").split()
libraries = [os.path.join(ut.BUILD, f"lib{name}.a") for name in ("umbrage", "umbrage-maps", "umbrage-core")]
system = subprocess.run(["pkg-config", "--libs", "libuv", "libnghttp2", "libprotobuf-c", "libssl", "libcrypto",
                         "libxxhash", "libzstd"], stdout=subprocess.PIPE, check=True).stdout.decode().split()
total = 0
for name in sorted(os.listdir(HEADERS)):
    blocks, strays = examples(os.path.join(HEADERS, name))
    stem = name[:-2]
    around = os.path.join(AROUND, f"example_{stem}.c")
    with test.check(f"{name}: every line of code is in an example, every example is run"):
        assert not strays, strays
        used = re.findall(r'#include "(\w+\.\d+)"', read(around)) if os.path.exists(around) else []
        assert used == [f"{stem}.{i + 1}" for i in range(len(blocks))], used
    if not blocks:
        continue
    total += len(blocks)
    for i, block in enumerate(blocks):
        with open(test.path(f"{stem}.{i + 1}"), "w", encoding="utf-8") as file:
            file.write(f'#line 1 "example {i + 1} of {name}"\n'
                       + block.replace("tcp:127.0.0.1:7420", daemon.tcp))
    with test.check(f"{name}: {len(blocks)} compiled and run"):
        subprocess.run([*compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", "-g",
                        "-I" + os.path.join(ut.ROOT, "client", "include"), "-I" + AROUND, "-I" + test.folder,
                        around, *libraries, *system, "-lm", "-pthread", "-o", test.path(stem)], check=True)
        done = subprocess.run([test.path(stem), scene, daemon.grpc_unix], cwd=test.folder, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, timeout=60, check=False)
        assert done.returncode == 0, done.stdout.decode(errors="replace")
with test.check("there are examples"):
    assert total >= 14, total
test.finish()
