#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Tests the daemon with @grpc/grpc-js, over TCP, a Unix socket and TLS: tests/interop/node/suite.js.
Opt-in: UMBRAGE_GRPC_JS names a folder where `npm install @grpc/grpc-js @grpc/proto-loader` was run.
"""
import json
import os
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

modules = os.environ.get("UMBRAGE_GRPC_JS")
if not modules:
    ut.skip("UMBRAGE_GRPC_JS names no folder with @grpc/grpc-js")
if shutil.which("node") is None or shutil.which("openssl") is None:
    ut.skip("node or openssl is not installed")
COUNT = 65536
TAPS = 3
SEED = 9
test = ut.Test()
os.mkdir(test.path("store"))
asset = test.path("store", "city.umb")
made = test.bake(test.scene("city", 4), asset, "--resolution", 512, "--depth", "raster", "--verify", 0)
points = ut.floats(ut.random_points((-500, -10, -500), (500, 80, 500), COUNT, SEED))
for name, data in (("points", points),
                   ("expected", test.query_file(asset, points, "--taps", TAPS, encoding="u8"))):
    with open(test.path(name), "wb") as file:
        file.write(data)
subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
                "-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1", "-keyout",
                test.path("key.pem"), "-out", test.path("ca.pem")], check=True, stderr=subprocess.DEVNULL)
daemon = test.daemon("--listen", "tls:127.0.0.1:0", "--tls-cert", test.path("ca.pem"), "--tls-key",
                     test.path("key.pem"))
with open(test.path("suite.json"), "w", encoding="utf-8") as file:
    json.dump({"proto": os.path.join(ut.ROOT, "proto"), "points": test.path("points"),
               "expected": test.path("expected"), "count": COUNT, "taps": TAPS, "asset": made["asset"],
               "tcp": daemon.grpc_tcp, "unix": daemon.grpc_unix, "tls": daemon.addresses["tls"],
               "ca": test.path("ca.pem")}, file)
with test.check("the suite of @grpc/grpc-js passes"):
    done = subprocess.run(["node", os.path.join(ut.ROOT, "tests", "interop", "node", "suite.js")],
                          env={**os.environ, "SUITE": test.path("suite.json")}, timeout=200, check=False,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    print(done.stdout.decode())
    assert done.returncode == 0, f"exit code {done.returncode}"
test.finish()
