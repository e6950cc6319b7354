#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The npm package `umbrage` in node: bits, bounds, budgets, mistakes, damaged files, a web server, the guide's example.
tests/web/suite.mjs has the checks. UMBRAGE_POINTS: points a scene (default: 65536).
"""
import json
import os
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import link  # noqa: E402
import umbrage_test as ut  # noqa: E402
import web_cases  # noqa: E402

web_cases.need_package()
if shutil.which("node") is None:
    ut.skip("node is not installed")
test = ut.Test()
cases = web_cases.Cases(test)


def suite(config, *url):
    """Runs the checks of a configuration in node and counts them as checks of this test."""
    with open(test.path("config.json"), "w", encoding="utf-8") as file:
        json.dump(config, file)
    done = subprocess.run(["node", "--no-warnings", os.path.join(ut.ROOT, "tests/web/node.mjs"), web_cases.PACKAGE,
                           test.path("config.json"), test.folder, *url], stdout=subprocess.PIPE, timeout=500, check=True)
    web_cases.count_checks(test, json.loads(done.stdout))


suite(cases.all(rounds=1000))
server = link.RangeServer(test.folder)
suite(cases.some(), f"http://127.0.0.1:{server.port}")
web_cases.check_example(test, cases)
web_cases.check_servers(test)
with test.check("the module is at most 150 KB compressed, and the package at most 400 KB"):
    sizes = web_cases.sizes()
    print(sizes)
    assert sizes["module_gzip"] <= 150_000 and sizes["package"] <= 400_000, sizes
test.finish()
