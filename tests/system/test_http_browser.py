#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
A page of one origin fetches ranges of an asset from umbraged on another one, in headless Chromium:
with CORS it reads bytes and fields, also several ranges and with a token, which need a preflight;
without it the browser refuses. The second fetch by id comes from the browser's cache.
"""
import functools
import hashlib
import html
import http.server
import json
import os
import re
import shutil
import subprocess
import sys
import threading

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

browser = shutil.which("chromium") or ut.skip("chromium is not installed")
test = ut.Test()
store, pages = test.path("store"), test.path("pages")
os.mkdir(store)
os.mkdir(pages)
TOKEN = "page-0123456789abcdef"
ID = test.bake(test.scene("city", 6), os.path.join(store, "city.umb"), "--resolution", 1024, "--verify", 0)["asset"]
with open(os.path.join(store, "city.umb"), "rb") as file:
    whole = file.read()
tokens = test.path("tokens")
with open(os.open(tokens, os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="ascii") as file:
    file.write(f"page query {TOKEN}\n")

PAGE = """<!doctype html><pre id="out">waiting</pre><script>
const told = [];
async function ask(url, headers) {
  try {
    const reply = await fetch(url, {headers});
    const bytes = await reply.arrayBuffer();
    const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
    told.push({status: reply.status, range: reply.headers.get("content-range"), etag: reply.headers.get("etag"),
               type: reply.headers.get("content-type"), length: bytes.byteLength,
               sha256: [...hash].map(b => b.toString(16).padStart(2, "0")).join("")});
  } catch (error) { told.push({error: String(error)}); }
}
(async () => {
  for (const [url, headers] of CALLS) await ask(url, headers);
  document.getElementById("out").textContent = JSON.stringify(told);
  document.title = "done";
})();
</script>"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A web server for the pages, without a log."""

    def log_message(self, *_):
        pass


server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=pages))
threading.Thread(target=server.serve_forever, daemon=True).start()
ORIGIN = f"http://127.0.0.1:{server.server_address[1]}"


def open_page(name, calls):
    """What a page learns from its fetches."""
    with open(os.path.join(pages, name), "w", encoding="utf-8") as file:
        file.write(PAGE.replace("CALLS", json.dumps(calls)))
    done = subprocess.run([browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
                           "--user-data-dir=" + test.path("profile"), "--virtual-time-budget=20000", "--dump-dom",
                           f"{ORIGIN}/{name}"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, check=False,
                          timeout=120, env={**os.environ, "HOME": test.folder})
    found = re.search(r'<pre id="out">(.*?)</pre>', done.stdout.decode(), re.S)
    assert found, (done.stdout[-500:], done.stderr[-800:])
    return json.loads(html.unescape(found.group(1)))


def is_part(one, first, last):
    assert one.get("status") == 206, one
    assert one["range"] == f"bytes {first}-{last}/{len(whole)}" and one["etag"] == f'"{ID}"', one
    assert one["sha256"] == hashlib.sha256(whole[first:last + 1]).hexdigest(), one


daemon = test.daemon("--http", "tcp:127.0.0.1:0", "--http-origin", ORIGIN, "--token-file", tokens)
base = "http://127.0.0.1:" + daemon.addresses["http+tcp"].rpartition(":")[2]
by_id, bearer = f"{base}/assets/by-id/{ID}.umb", {"Authorization": "Bearer " + TOKEN}

with test.check("a page of an allowed origin reads ranges, their fields, and refusals"):
    told = open_page("good.html", [[by_id, {**bearer, "Range": "bytes=0-99"}],
                                   [base + "/assets/city.umb", {**bearer, "Range": "bytes=100-4999"}],
                                   [by_id, {**bearer, "Range": "bytes=0-9,20-29"}],
                                   [by_id, bearer],
                                   [by_id, {"Range": "bytes=0-9"}],
                                   [base + "/assets/none.umb", bearer]])
    is_part(told[0], 0, 99)
    is_part(told[1], 100, 4999)
    assert told[2]["status"] == 206 and told[2]["type"].startswith("multipart/byteranges"), told[2]
    assert told[3]["status"] == 200 and told[3]["sha256"] == hashlib.sha256(whole).hexdigest(), told[3]
    assert told[4]["status"] == 401 and told[5]["status"] == 404, told[4:]
    assert daemon.metric("umbrage_http_requests_total") > 6  # preflights, too

with test.check("what has an id is fetched once; the browser's cache has it from then on"):
    requests = daemon.metric("umbrage_http_bytes_total")
    told = open_page("again.html", [[by_id, bearer], [by_id, bearer]])
    assert [one["sha256"] for one in told] == [hashlib.sha256(whole).hexdigest()] * 2, told
    assert daemon.metric("umbrage_http_bytes_total") - requests < 1.5 * len(whole)

with test.check("a page of another origin learns nothing"):
    strict = test.daemon("--http", "tcp:127.0.0.1:0", "--http-origin", "https://viewer.example")
    other = "http://127.0.0.1:" + strict.addresses["http+tcp"].rpartition(":")[2]
    told = open_page("bad.html", [[f"{other}/assets/city.umb", {}],
                                  [f"{other}/assets/city.umb", {"Range": "bytes=0-9,20-29"}]])
    assert all("error" in one for one in told), told
test.finish()
