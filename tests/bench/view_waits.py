#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
How long a browser waits for the street of the generated city, and what reloads cost: docs/results/paging.md. `make
view-waits` runs it.

Headless Chromium reads the asset from `umbrage view` over 20 Mbit/s with 100 ms for each request, as its DevTools emulate
them. The points are those of 320 x 180 pixels; the module is there already, and nothing is drawn: without a GPU pictures
take longer than pages. Then the viewer is reloaded twenty times, and the ranges are counted that reach the asset's server.
"""
import base64
import json
import os
import statistics
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import devtools  # noqa: E402
import link  # noqa: E402
import umbrage_test as ut  # noqa: E402
import view_server  # noqa: E402

MBIT, LATENCY_MS, RUNS, RELOADS, WAIT_S = 20, 100, 5, 20, 300
CAMERA = "eye=1,1.7,1,target=100,1.7,9,fov=60"
WAITED = """(async (asset_address, points) => {
  const { open } = await import("./index.js"), wasm = await WebAssembly.compileStreaming(fetch("./umbrage.wasm"));
  const numbers = new Float32Array(Uint8Array.from(atob(points), (one) => one.charCodeAt(0)).buffer), count = numbers.length / 6;
  const places = new Float32Array(3 * count), normals = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) {
    places.set(numbers.subarray(6 * i, 6 * i + 3), 3 * i);
    normals.set(numbers.subarray(6 * i + 3, 6 * i + 6), 3 * i);
  }
  await fetch("./index.js", { cache: "no-store" }); // The connection is open
  const begun = performance.now(), asset = await open(asset_address, { wasm, apart: true });
  let answers = await asset.query(places, { taps: 9, normals });
  const first = performance.now() - begun, at_first = answers.exact_count / count;
  while (answers.exact_count < count) {
    await asset.want();
    answers = await asset.query(places, { taps: 9, normals });
  }
  const exact = performance.now() - begun, { received_bytes, requests, rounds, held_bytes } = asset.held();
  await asset.close();
  return { first, at_first, exact, received_bytes, requests, rounds, held_bytes };
})"""


def waits(folder, asset, scene):
    points = os.path.join(folder, "street.f32")
    ut.run("umbrage", "points", scene, "-o", points, "--kind", "gbuffer", "--size", "320x180", "--camera", CAMERA, "--normals", "--quiet")
    with open(points, "rb") as file:
        words = json.dumps(base64.b64encode(file.read()).decode())
    view, results, again = view_server.View(asset), [], []
    for run in range(RUNS):
        with devtools.Chromium(os.path.join(folder, f"profile{run}"), timeout=WAIT_S) as chromium:
            page = chromium.page(640, 360)
            page.open(view.address + "config.json")
            page.wait("document.readyState === 'complete' && location.href.endsWith('config.json')", WAIT_S)
            name = json.loads(page.evaluate("document.body.textContent"))["asset"]
            page.open(view.address + "umbrage/index.js")
            page.wait("document.readyState === 'complete' && location.href.endsWith('index.js')", WAIT_S)
            page.call("Network.emulateNetworkConditions", offline=False, latency=LATENCY_MS, downloadThroughput=MBIT * 125_000,
                      uploadThroughput=MBIT * 125_000)
            results.append(page.evaluate(f"{WAITED}({json.dumps(view.address + name)}, {words})"))
            again.append(page.evaluate(f"{WAITED}({json.dumps(view.address + name)}, {words})"))  # From the browser's cache
    view.close()
    one, middle = results[0], lambda rows, name: statistics.median(row[name] for row in rows)
    print(f"{MBIT} Mbit/s, {LATENCY_MS} ms, medians of {RUNS}: first answers after {middle(results, 'first'):.0f} ms "
          f"({100 * one['at_first']:.1f} % exact), exact after {middle(results, 'exact'):.0f} ms; from the browser's cache "
          f"{middle(again, 'first'):.0f} and {middle(again, 'exact'):.0f} ms; {one['received_bytes']} bytes in {one['requests']} "
          f"requests and {one['rounds']} rounds, {one['held_bytes']} of them pages")


def reloads(folder):
    scene, asset = os.path.join(folder, "small.glb"), os.path.join(folder, "small.umb")
    ut.run("scenegen", "city", "--size", 6, "-o", scene)
    ut.run("umbrage-bake", scene, "-o", asset, "--resolution", 2048, "--verify", 0, "--quiet")
    web = link.RangeServer(folder)
    view = view_server.View(f"http://127.0.0.1:{web.port}/small.umb", "--scene", scene)
    with devtools.Chromium(os.path.join(folder, "profile"), timeout=WAIT_S) as chromium:
        page, counts = chromium.page(320, 240), []
        page.open(view.address)
        for _ in range(RELOADS + 1):
            page.wait("globalThis.umbrageViewer?.state.frames > 0 && umbrageViewer.state.loading === 0 && "
                      "umbrageViewer.state.points > 0 && umbrageViewer.state.exact === umbrageViewer.state.points", WAIT_S)
            counts.append(len(web.ranges))
            page.evaluate("globalThis.umbrageViewer = undefined")
            page.call("Page.reload")
    view.close()
    web.close()
    print(f"{RELOADS} reloads: {counts[-1] - counts[0]} ranges fetched anew, after {counts[0]} of the first visit")


def main():
    with tempfile.TemporaryDirectory() as own:
        folder = os.environ.get("UMBRAGE_FOLDER", own)
        scene, asset = os.path.join(folder, "city.glb"), os.path.join(folder, "city16384.umb")
        if not os.path.exists(scene):
            ut.run("scenegen", "city", "--size", 50, "-o", scene)
        if not os.path.exists(asset):
            ut.run("umbrage-bake", scene, "-o", asset, "--resolution", 16384, "--sun", "135,45", "--quiet", "--verify", 0)
        waits(own, asset, scene)
        reloads(own)


if __name__ == "__main__":
    main()
