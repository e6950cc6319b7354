# SPDX-License-Identifier: Apache-2.0
"""
A web server with ranges that takes results, and a headless Chromium that looks at it.

    with web_browser.Browser({"files": folder, "package": folder}, profile) as browser:   # /files/NAME, /package/NAME
        browser.look("/web/page.html")
        checks = browser.result("worker", 240)   # what the page has sent by POST to /result/worker
"""
import http.server
import json
import os
import shutil
import subprocess
import threading

TYPES = {".html": "text/html", ".js": "text/javascript", ".mjs": "text/javascript", ".json": "application/json"}


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_GET(self):
        _, folder, name = (self.path.split("?")[0].split("/") + ["", ""])[:3]
        folders = self.server.folders
        path = os.path.join(folders.get(folder, ""), os.path.basename(name))
        if folder not in folders or not os.path.isfile(path):
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
        with self.server.arrived:
            self.server.results[os.path.basename(self.path)] = json.loads(body)
            self.server.arrived.notify_all()

    def log_message(self, *_):
        pass


def installed():
    """Path of Chromium, or None."""
    return shutil.which("chromium") or shutil.which("chromium-browser")


class Browser:
    def __init__(self, folders, profile):
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.server.folders, self.server.results, self.server.arrived = folders, {}, threading.Condition()
        self.profile, self.process = profile, None
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def __enter__(self):
        os.makedirs(self.profile)
        return self

    def look(self, path, *flags):
        with open(os.path.join(self.profile, "log"), "wb") as log:
            self.process = subprocess.Popen(
                [installed(), "--headless=new", "--no-sandbox", "--no-first-run", "--disable-dev-shm-usage",
                 *(flags or ["--disable-gpu"]), f"--user-data-dir={self.profile}",
                 f"http://127.0.0.1:{self.server.server_address[1]}{path}"], stdout=log, stderr=log)

    def result(self, name, timeout):
        with self.server.arrived:
            if not self.server.arrived.wait_for(lambda: name in self.server.results, timeout):
                with open(os.path.join(self.profile, "log"), encoding="utf-8", errors="replace") as log:
                    raise SystemExit(f"the {name} reports nothing; the browser says:\n{log.read()[-2000:]}")
            return self.server.results.pop(name)

    def __exit__(self, *_):
        if self.process is not None:
            self.process.terminate()
            self.process.wait(20)
        self.server.shutdown()
        self.server.server_close()
