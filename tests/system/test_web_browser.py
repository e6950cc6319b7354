#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The npm package `umbrage` in headless Chromium, in a page and in a worker: bits, bounds, budgets, mistakes and damaged
files. tests/web/suite.mjs has the checks.
"""
import http.server
import json
import os
import shutil
import subprocess
import sys
import threading

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402
import web_cases  # noqa: E402

web_cases.need_package()
browser = shutil.which("chromium") or shutil.which("chromium-browser")
if browser is None:
    ut.skip("chromium is not installed")
test = ut.Test()
results, arrived = {}, threading.Condition()
FOLDERS = {"package": web_cases.PACKAGE, "files": test.folder, "web": os.path.join(ut.ROOT, "tests", "web")}
TYPES = {".html": "text/html", ".js": "text/javascript", ".mjs": "text/javascript", ".json": "application/json"}


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_GET(self):
        _, folder, name = (self.path.split("/") + ["", ""])[:3]
        path = os.path.join(FOLDERS.get(folder, ""), os.path.basename(name))
        if folder not in FOLDERS or not os.path.isfile(path):
            self.send_error(404)
            return
        with open(path, "rb") as file:
            body = file.read()
        asked, size = self.headers.get("Range"), len(body)
        if asked:
            first, last = (int(number) for number in asked.removeprefix("bytes=").split("-"))
            body = body[first:last + 1]
        self.send_response(206 if asked else 200)
        self.send_header("Content-Type", TYPES.get(os.path.splitext(path)[1], "application/octet-stream"))
        self.send_header("Content-Length", str(len(body)))
        if asked:
            self.send_header("Content-Range", f"bytes {first}-{first + len(body) - 1}/{size}")
        self.end_headers()
        self.wfile.write(body)

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(204)
        self.end_headers()
        with arrived:
            results[os.path.basename(self.path)] = json.loads(body)
            arrived.notify_all()

    def log_message(self, *_):
        pass


cases = web_cases.Cases(test, ("city", "terrain", "forest"))
for place, config in (("worker", cases.all(rounds=1000)), ("page", {**cases.all(rounds=50), "bits": []})):
    with open(test.path(f"{place}.json"), "w", encoding="utf-8") as file:
        json.dump(config, file)
server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
server.daemon_threads = True
threading.Thread(target=server.serve_forever, daemon=True).start()
with open(test.path("browser.log"), "wb") as log:
    process = subprocess.Popen([browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run",
                                f"--user-data-dir={test.path('profile')}", "--disable-dev-shm-usage",
                                f"http://127.0.0.1:{server.server_address[1]}/web/page.html"], stdout=log, stderr=log)
try:
    with arrived:
        for place in ("worker", "page"):
            if not arrived.wait_for(lambda: place in results, timeout=240):
                with open(test.path("browser.log"), encoding="utf-8", errors="replace") as log:
                    raise SystemExit(f"the {place} reports nothing; the browser says:\n{log.read()[-2000:]}")
            web_cases.count_checks(test, [{**one, "name": f"{place}: {one['name']}"} for one in results[place]])
finally:
    process.terminate()
    process.wait(20)
test.finish()
