#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Figures for docs/streaming.md: bytes and seconds until what a camera sees is known, for one asset.

    tests/bench/stream_links.py ASSET.umb POINTS.f32 CAMERA [--up z] [--links [--daemon STORE]] [--modes a,b]

POINTS are those of `umbrage points --kind gbuffer --normals` for the same CAMERA. Prints one JSON object a
line: {"mode", "mbit", "rtt_ms", "first_s", "first_bytes", "within_1m_bytes", "within_10cm_s", ...}.
Modes: camera (everything in the pyramid, exact), pixel (cells down to half a pixel), points (just what the
points miss).
"""
import argparse
import json
import os
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import link  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("asset")
parser.add_argument("points")
parser.add_argument("camera")
parser.add_argument("--up", default="y")
parser.add_argument("--taps", default="9")
parser.add_argument("--daemon", metavar="STORE", help="with --links: by umbraged on that store")
parser.add_argument("--round", default="128K", help="bytes asked for at once, without --links")
parser.add_argument("--links", action="store_true")
parser.add_argument("--modes", default="points,pixel,camera")
options = parser.parse_args()
PROGRAM = os.path.join(os.environ.get("BUILD", "build/release"), "umbrage")


def stream(mode, *source):
    words = [PROGRAM, "stream", "--json", *source, "--points", options.points, "--normals", "--taps",
             options.taps, "--up", options.up, "--camera", options.camera]
    words += {"points": ["--only-points"], "pixel": ["--max-pixels", "0.5"], "camera": []}[mode]
    return json.loads(subprocess.run(words, capture_output=True, check=True).stdout)


def row(mode, told, **link_of):
    result = {"mode": mode, **link_of, "asset_bytes": told["asset_bytes"],
              "head_bytes": told["head_bytes"], "points": told["points"]}
    first, last = told["steps"][0], told["steps"][-1]
    result.update(first_s=round(first["seconds"], 2), first_bytes=first["bytes"],
                  first_exact=round(first["exact"] / told["points"], 4), first_worst_m=first["worst_m"])
    for key in ("within_1m", "within_10cm", "exact"):
        for share in (0.99, 1.0):
            step = next((s for s in told["steps"] if s[key] >= share * told["points"]), None)
            name = key + ("" if share == 1.0 else "_99")
            result[name + "_s"] = step and round(step["seconds"], 2)
            result[name + "_bytes"] = step and step["bytes"]
    result.update(rounds=last["rounds"], requests=last["requests"], last_bytes=last["bytes"])
    print(json.dumps(result), flush=True)


for mode in options.modes.split(","):
    if not options.links:
        row(mode, stream(mode, options.asset, "--round", options.round))
        continue
    folder = os.path.dirname(os.path.abspath(options.asset))
    name = os.path.basename(options.asset)
    if options.daemon:
        addresses = tempfile.mktemp()
        daemon = subprocess.Popen([os.path.join(os.path.dirname(PROGRAM), "umbraged"), "--store",
                                   options.daemon, "--listen", "tcp:127.0.0.1:0", "--address-file",
                                   addresses, "--log-level", "error"])
        while not os.path.exists(addresses):
            time.sleep(0.1)
        with open(addresses, encoding="utf-8") as file:
            port = int(file.read().split()[0].rpartition(":")[2])
    else:
        server = link.RangeServer(folder)
        port = server.port
    for mbit in (1, 5, 20, 100):
        for rtt_ms in (20, 100, 300):
            slow = link.Link(port, mbit, rtt_ms)
            source = (["--from-url", f"http://127.0.0.1:{slow.port}/{name}"] if not options.daemon
                      else [name.removesuffix(".umb"), "--address", f"tcp:127.0.0.1:{slow.port}"])
            row(mode, stream(mode, *source), mbit=mbit, rtt_ms=rtt_ms)
    if options.daemon:
        daemon.terminate()
        daemon.wait()
    else:
        server.close()
