#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The npm package `umbrage` in headless Chromium, in a page and in a worker: bits, bounds, budgets, mistakes and damaged
files. tests/web/suite.mjs has the checks. test_web.py tries more damaged files, with the same module.
"""
import json
import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402
import web_browser  # noqa: E402
import web_cases  # noqa: E402

web_cases.need_package()
if web_browser.installed() is None:
    ut.skip("chromium is not installed")
test = ut.Test()
cases = web_cases.Cases(test, ("city", "terrain", "forest"))
for place, config in (("worker", cases.all(rounds=100)), ("page", {**cases.all(rounds=50), "bits": []})):
    with open(test.path(f"{place}.json"), "w", encoding="utf-8") as file:
        json.dump(config, file)
FOLDERS = {"package": web_cases.PACKAGE, "files": test.folder, "web": os.path.join(ut.ROOT, "tests", "web")}
with web_browser.Browser(FOLDERS, test.path("profile")) as browser:
    browser.look("/web/page.html")
    for place in ("worker", "page"):
        checks = browser.result(place, 240)
        web_cases.count_checks(test, [{**one, "name": f"{place}: {one['name']}"} for one in checks])
test.finish()
