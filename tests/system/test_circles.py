#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
tests/lint/circles.py must find a planted call circle of files and one of folders. It must find no circle
where calls go one way, and must count a vector variant and its plain twin as one file. tests/lint/ways.py
must refuse a list with a file that does not belong.
"""
import os
import subprocess
import sys
import tempfile

ROOT = os.path.abspath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
LINT = os.path.join(ROOT, "tests", "lint")
failed = 0


def check(sentence, holds, told=""):
    global failed
    print(("ok " if holds else "FAILED ") + sentence + ("" if holds else f": {told}"))
    failed += not holds


def circles(sources, *folders):
    """Compiles one object for each file of the tree that `sources` names, and looks for circles."""
    with tempfile.TemporaryDirectory() as build:
        for path, text in sources.items():
            target = os.path.join(build, path + ".o")
            os.makedirs(os.path.dirname(target), exist_ok=True)
            subprocess.run([*os.environ.get("CC", "cc").split(), "-x", "c", "-c", "-", "-o", target],
                           input=text, text=True, check=True)
        done = subprocess.run([sys.executable, os.path.join(LINT, "circles.py"), "--build", build, *folders],
                              stdout=subprocess.PIPE, text=True, check=False)
        return done.returncode, done.stdout


POOL, BATCH, CALL = (f"server/daemon/{name}" for name in ("work/pool", "work/batch", "call/call"))
one_way = {POOL: "void f(void) {}", BATCH: "void f(void); void g(void) { f(); }",
           CALL: "void f(void); void g(void); void h(void) { f(); g(); }"}
code, told = circles(one_way)
check("calls that go one way are no circle", code == 0 and "none among 3 files" in told, told)
code, told = circles({**one_way, POOL: "void g(void); void f(void) { g(); }"})
check("two files that call each other are one", code == 1 and "circle of 2 files" in told and
      f"{POOL} -> {BATCH}: g" in told and f"{BATCH} -> {POOL}: f" in told, told)
for one, other in (("client/core/format/node_pool", "client/core/query/query"),
                   ("server/bake/depth/tile", "server/bake/tiles/tile_cache"), (CALL, BATCH)):
    code, told = circles({one: "void b(void); void a(void) { b(); }", other: "void a(void); void b(void) { a(); }"})
    check(f"a circle planted in {one.rsplit('/', 2)[0]} is seen", code == 1 and "circle of 2 files" in told, told)
code, told = circles({**one_way, POOL: "void f(void) {} void i(void); void j(void) { i(); }",
                      "server/daemon/call/call_reply": "void i(void) {}"})
check("folders that call each other are one", code == 1 and "circle of 2 folders" in told and
      "of 2 files" not in told, told)
code, told = circles({**one_way, POOL: "void h(void); void f(void) { h(); }"}, "server/daemon/work")
check("calls out of the named folders do not count", code == 0, told)
code, told = circles({"server/bake/depth/depth_kernels": "void f(void); void g(void) {} void h(void) { f(); }",
                      "server/bake/depth/depth_kernels_avx2": "void g(void); void f(void) { g(); }"})
check("a file and its vector variant are one file", code == 0 and "1 files" in told, told)

sys.path.insert(0, LINT)
import ways  # noqa: E402  pylint: disable=wrong-import-position

title = next(iter(ways.LIMITS))
graph, units = {"a": {"b": {"f"}}}, {"a", "b", "c"}
check("a way along calls holds", not list(ways.faults_of(title, ["a.c", "b.c"], graph, units)))
check("a way with a file that nothing calls fails", len(list(ways.faults_of(title, ["a.c", "c.c"], graph, units))) == 1)
check("a way with a missing file fails", len(list(ways.faults_of(title, ["a.c", "d.c"], graph, units))) == 1)
check("an empty way fails", len(list(ways.faults_of(title, [], graph, units))) == 1)
check("a way that is too long fails",
      len(list(ways.faults_of(title, ["a.c", "b.c"] * 9, graph, units))) == 1)
sys.exit(1 if failed else 0)
