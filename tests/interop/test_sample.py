#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Shadows.Sample: `umbrage sample` draws the same points from a file and from a daemon, a foreign client
(python3-grpcio) gets their bits, they lie near shadow boundaries, and queries and load tests take them.
"""
import array
import json
import math
import os
import random
import sys
from concurrent import futures

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
POINTS = 400
AROUND = 300  # points asked around each of them

test = ut.Test()
store = test.path("store")
os.mkdir(store)
scene = test.scene("city", 8)
LIGHTS = {"open": ("--resolution", 1024, "--closed", "off"),
          "closed": ("--resolution", 1024, "--closed", "on", "--sun", "200,30", "--sun", "20,60"),
          "lamp": ("--resolution", 256, "--point", "10,30,10", "--closed", "off"),
          "spot": ("--resolution", 256, "--spot", "10,60,10,0.1,-1,0.2,70", "--closed", "off")}
VOXELS = {}  # edges of the frusta of each light; those of lamps are the largest of each frustum
for name, options in LIGHTS.items():
    test.bake(scene, f"{store}/{name}.umb", "--verify", 0, *options)
    told = json.loads(ut.run("umbrage", "info", f"{store}/{name}.umb", "--json").stdout)
    VOXELS[name] = [[frustum["voxel_m"] for frustum in light["frusta"]] for light in told["lights"]]
test.bake(scene, store + "/static.umb", "--resolution", 1024, "--static", "--verify", 0)
daemon = test.daemon("--workers", 2)
client = test.client(daemon.grpc_unix)
M = test.messages.shadows
sample = client.unary("/umbrage.v1.Shadows/Sample", M.SampleReply)
rng = random.Random(9)


def drawn(target, *options, code=0):
    """The file that `umbrage sample` writes."""
    done = ut.run("umbrage", "sample", target, "-o", "-", "--quiet", "--address", daemon.grpc_unix, *options,
                  code=code)
    return done.stdout


def answers(asset, light, points, origin, taps=1):
    return client.query(M.QueryRequest(asset=asset, light=light, points_f64=points.tobytes(), origin=origin,
                                       taps=taps, bias_mode=M.BIAS_NONE), timeout=60).visibility


def ball(centre, radius):
    """Draws a point within `radius` of another. Near a lamp voxels are smaller, so some radii are
    smaller."""
    radius *= 2 ** -rng.uniform(0, 3)
    while True:
        offset = [rng.uniform(-radius, radius) for _ in range(3)]
        if math.hypot(*offset) <= radius:
            return [a + b for a, b in zip(centre, offset)]


def mixed_share(asset, light, points, origin, radius):
    """Share of points with a lit and a shadowed point within `radius`."""
    mixed = 0
    for i in range(0, len(points), 3):
        around = [value for _ in range(AROUND) for value in ball(points[i:i + 3], radius)]
        mixed += len(set(answers(asset, light, array.array("d", around), origin))) > 1
    return mixed / (len(points) // 3)


with test.check("a daemon draws the file's points, byte for byte, and others with another seed or light"):
    for name in (*LIGHTS, "static"):
        for options in (("--seed", "7"), ("--count", "333", "--format", "f64", "--scattered", "0.25")):
            here = drawn(f"{store}/{name}.umb", *options)
            assert here == drawn(name, *options) and len(here) >= 333 * 24, (name, options, len(here))
        assert drawn(name, "--seed", "7").split(b"\n", 1)[1] != drawn(name, "--seed", "8").split(b"\n", 1)[1]
    assert drawn("closed", "--format", "f64") != drawn("closed", "--format", "f64", "--light", "1")

with test.check("a foreign client gets these points, relative to an origin"):
    reply = sample(M.SampleRequest(asset="open", count=POINTS, seed=3), timeout=60)
    points = array.array("d", reply.points_f64)
    told = array.array("d", drawn("open", "--count", str(POINTS), "--seed", "3", "--format", "f64"))
    assert len(points) == 3 * POINTS and reply.note == ""
    assert [reply.origin[i % 3] + p for i, p in enumerate(points)] == list(told)
    assert reply.asset_id == client.describe(M.DescribeRequest(asset="open"), timeout=60).summary.id
    lit = array.array("d", points)
    visible = answers("open", 0, lit, reply.origin)
    assert POINTS * 0.4 < sum(v == 255 for v in visible) < POINTS * 0.6, "lit and shadowed, about as many"

with test.check("each point has a shadow boundary within a voxel's diagonal; few other points have"):
    for name in LIGHTS:
        for light in range(len(VOXELS[name])):
            radius = max(math.hypot(*frustum) for frustum in VOXELS[name][light])
            found = sample(M.SampleRequest(asset=name, light=light, count=POINTS, seed=light), timeout=60)
            near = mixed_share(name, light, array.array("d", found.points_f64), found.origin, radius)
            found = sample(M.SampleRequest(asset=name, light=light, count=POINTS, scattered=1), timeout=60)
            far = mixed_share(name, light, array.array("d", found.points_f64), found.origin, radius)
            print(f"  {name} {light}: {near:.4f} of the points, {far:.4f} of scattered ones")
            assert near > 0.99 and far < 0.9 * near, (name, light, near, far)

with test.check("points of a static asset are defined"):
    found = sample(M.SampleRequest(asset="static", count=4096), timeout=60)
    stats = client.query(M.QueryRequest(asset="static", points_f64=found.points_f64, origin=found.origin,
                                        bias_mode=M.BIAS_NONE, want_stats=True), timeout=60).stats
    assert stats.points > 4000 and stats.undefined == stats.outside == stats.before == 0, stats

with test.check("each refusal names the field"):
    for code, words, fields in (
            (Code.INVALID_ARGUMENT, "count: 0, must be 1 to 65536", {"count": 0}),
            (Code.INVALID_ARGUMENT, "count: 65537, must be 1 to 65536", {"count": 65537}),
            (Code.INVALID_ARGUMENT, "scattered", {"scattered": 1.5}),
            (Code.INVALID_ARGUMENT, "scattered", {"scattered": float("nan")}),
            (Code.INVALID_ARGUMENT, "asset", {"asset": ""}),
            (Code.NOT_FOUND, "light: 9", {"light": 9}),
            (Code.NOT_FOUND, "nowhere", {"asset": "nowhere"})):
        request = M.SampleRequest(**{"asset": "open", "count": 1, **fields})
        client.refused(lambda: sample(request, timeout=60), code, words)
    assert b"--count" in ut.run("umbrage", "sample", "open", "-o", "-", "--count", "65537", code=2).stderr
    assert ut.run("umbrage", "sample", "open", code=2).stderr
    assert b"light" in ut.run("umbrage", "sample", "open", "-o", "-", "--light", "9", "--address",
                              daemon.grpc_unix, code=None).stderr

with test.check("most points of one request, its price, and its deadline hold"):
    assert len(sample(M.SampleRequest(asset="open", count=65536), timeout=60).points_f64) == 65536 * 24
    small = test.daemon("--max-points", 100, "--address-rate", 100000)
    one = test.client(small.grpc_tcp)
    ask = one.unary("/umbrage.v1.Shadows/Sample", M.SampleReply)
    one.refused(lambda: ask(M.SampleRequest(asset="open", count=101), timeout=60), Code.RESOURCE_EXHAUSTED,
                "count: 101, the limit is 100")
    assert len(ask(M.SampleRequest(asset="open", count=100), timeout=60).points_f64) == 2400
    for _ in range(20):  # each is paid as 20000 points
        try:
            ask(M.SampleRequest(asset="open", count=100), timeout=60)
        except grpc.RpcError as error:
            assert error.code() == Code.RESOURCE_EXHAUSTED and "rate" in error.details(), error
            break
    else:
        raise AssertionError("twenty samples were free")
    one.close()
    small.stop()
    test.daemons.remove(small)
    tight = test.daemon("--max-message", "1MiB", "--connection-buffer", "4MiB")
    one = test.client(tight.grpc_tcp)  # 3 MiB are the points and their message, each charged once
    ask = one.unary("/umbrage.v1.Shadows/Sample", M.SampleReply)
    assert len(ask(M.SampleRequest(asset="open", count=65536), timeout=60).points_f64) == 65536 * 24
    one.close()
    tight.stop()
    test.daemons.remove(tight)
    for name in ("spot", "lamp"):  # a sample is paid as 16384 points for each frustum of its light
        grids = len(VOXELS[name][0])
        slow = test.daemon("--address-rate", 1000)
        one = test.client(slow.grpc_tcp)
        ask = one.unary("/umbrage.v1.Shadows/Sample", M.SampleReply)
        ask(M.SampleRequest(asset=name, count=1), timeout=60)
        try:
            ask(M.SampleRequest(asset=name, count=1), timeout=60)
            raise AssertionError(f"the second sample of {name} was free")
        except grpc.RpcError as error:
            wait = int(dict(error.trailing_metadata())["grpc-retry-pushback-ms"])
            assert abs(wait - 16384 * grids) < 4000, (name, grids, wait)
        one.close()
        slow.stop()
        test.daemons.remove(slow)
    for _ in range(20):
        client.refused(lambda: sample(M.SampleRequest(asset="open", count=65536), timeout=0.01),
                       Code.DEADLINE_EXCEEDED)
    assert sample(M.SampleRequest(asset="open", count=10), timeout=60).points_f64

with test.check("queries and load tests take the file"):
    path = test.path("points.txt")
    report = json.loads(ut.run("umbrage", "sample", "open", "-n", "2000", "-o", path, "--json", "--address",
                               daemon.grpc_unix).stdout)
    assert report["points"] == 2000 and report["note"] == "" and len(report["asset"]) == 64
    shares = ut.run("umbrage", "query", store + "/open.umb", "--points", path, "--taps", "9").stdout.split()
    assert len(shares) == 2000 and sum(0 < float(share) < 1 for share in shares) > 1000
    figures = json.loads(ut.run("umbrage", "load", "open", "--trace", path, "--duration", "0.3", "--warm-up", "0.1",
                                "--json", "--quiet", "--address", daemon.grpc_unix).stdout)
    assert figures, figures


class Liar(grpc.GenericRpcHandler):
    """A server whose samples are not what they should be."""

    replies = []

    def service(self, details):
        return grpc.unary_unary_rpc_method_handler(lambda message, context: self.replies[0])


with test.check("a server that sends what was not asked for is told so"):
    liar = grpc.server(futures.ThreadPoolExecutor(1), handlers=[Liar()])
    port = liar.add_insecure_port("127.0.0.1:0")
    liar.start()
    for fields, words in (({"points_f64": bytes(72)}, b"3 points, 2 were asked for"),
                          ({"points_f64": bytes(47)}, b"multiple of 24"),
                          ({"origin": [1, 2]}, b"origin"), ({"origin": [1, 2, math.nan]}, b"origin"),
                          ({"note": "x" * 256}, b"note"), ({"asset_id": b"short"}, b"asset_id")):
        Liar.replies[:] = [M.SampleReply(**{"asset_id": bytes(32), **fields}).SerializeToString()]
        done = ut.run("umbrage", "sample", "x", "-n", "2", "-o", "-", "--address", f"tcp:127.0.0.1:{port}", code=None)
        assert done.returncode == 70 and words in done.stderr, (fields, done.returncode, done.stderr)
    Liar.replies[:] = [M.SampleReply(asset_id=bytes(32), note="none \x1b[31m here").SerializeToString()]
    done = ut.run("umbrage", "sample", "x", "-n", "2", "-o", test.path("none"), "--address",
                  f"tcp:127.0.0.1:{port}", code=1)
    assert b"none  [31m here" in done.stderr and not os.path.exists(test.path("none")), done.stderr
    liar.stop(None)
with test.check("the metrics count its calls"):
    page = daemon.admin("/metrics")[1]
    assert any('"Sample"' in line for line in page.splitlines() if line.startswith("grpc_server_handled_total")), page
client.close()
test.finish()
