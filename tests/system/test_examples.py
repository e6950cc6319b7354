#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The examples of docs/examples, run as their first lines say, give the answers of `umbrage query`."""
import os
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

ut.need_grpc()
if shutil.which("protoc") is None:
    ut.skip("protoc is not installed")
test = ut.Test()
os.mkdir(test.path("store"))
asset = test.path("store", "city.umb")
test.bake(test.scene("city", 3), asset, "--resolution", 512, "--depth", "raster", "--verify", 0)
values = ut.random_points((-200, -5, -200), (200, 60, 200), 500, 8)
text = "".join("%.9g %.9g %.9g\n" % tuple(values[i:i + 3]) for i in range(0, len(values), 3)).encode()
expected = [float(word) for word in ut.run("umbrage", "query", asset, "--points", "-", "--taps", 9, "--quiet",
                                           stdin=text).stdout.split()]
assert len(set(expected)) > 2, "points that do not test anything"
daemon = test.daemon()
examples = os.path.join(ut.ROOT, "docs", "examples")


def answers(*words, env=None):
    """What an example prints, as numbers."""
    done = subprocess.run(words, input=text, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=test.folder,
                          env={**os.environ, **(env or {})}, timeout=60, check=False)
    assert done.returncode == 0, done.stderr.decode()
    return [float(word) for word in done.stdout.split()]


with test.check("the Python example answers as the file does"):
    subprocess.run(["protoc", "-I" + os.path.join(ut.ROOT, "proto"), "--python_out=" + test.folder,
                    "umbrage/v1/shadows.proto"], check=True)
    assert answers("/usr/bin/python3", os.path.join(examples, "query.py"), daemon.grpc_tcp, "city") == expected
modules = os.environ.get("UMBRAGE_GRPC_JS")
if modules and shutil.which("node"):
    with test.check("the Node example answers as the file does"):
        got = answers("node", os.path.join(examples, "query.js"), daemon.grpc_tcp, "city",
                      env={"NODE_PATH": os.path.join(modules, "node_modules")})
        assert all(abs(a - b) < 1e-7 for a, b in zip(got, expected)) and len(got) == len(expected)
else:
    ut.left_out("the Node example", "UMBRAGE_GRPC_JS names no folder with @grpc/grpc-js")
test.finish()
