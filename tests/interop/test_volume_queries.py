#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Segments, columns and boxes over gRPC: `umbrage query` prints the same from a file and from a daemon,
byte for byte, a foreign client (python3-grpcio) gets those numbers, and every refusal names the field.
"""
import array
import json
import os
import random
import sys
import time
from concurrent import futures

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
test = ut.Test()
store = test.path("store")
os.mkdir(store)
city = store + "/city.umb"
scene = test.scene("city", 8)
baked = test.bake(scene, city, "--resolution", 1024, "--closed", "off", "--verify", 0)
test.bake(scene, store + "/closed.umb", "--resolution", 256, "--closed", "on", "--effect",
          "front=off", "--verify", 0)
test.bake(scene, store + "/lamp.umb", "--resolution", 64, "--point", "10,30,10", "--closed", "off",
          "--verify", 0)
test.bake(scene, store + "/fine.umb", "--resolution", 4096, "--closed", "off", "--verify", 0)
daemon = test.daemon("--workers", 2)
client = test.client(daemon.grpc_unix)
M = test.messages.questions
ask = {name: client.unary(f"/umbrage.v1.Questions/{name}", getattr(M, name + "Reply"))
       for name in ("Segments", "Columns", "Boxes")}
rng = random.Random(5)
bounds = client.describe(test.messages.shadows.DescribeRequest(asset="city"), timeout=60)
low, high = bounds.bounds_min, bounds.bounds_max


def anywhere(count, reach=0.2):
    """Points in and around the casters' box."""
    return [rng.uniform(low[k] - reach * (high[k] - low[k]), high[k] + reach * (high[k] - low[k]))
            for _ in range(count) for k in range(3)]


def boxes(count, side):
    values = []
    for _ in range(count):
        corner = anywhere(1, 0)
        values += corner + [c + rng.uniform(-side, side) for c in corner]
    return values


RECORDS = {"segments": anywhere(2 * 3000), "columns": anywhere(3000), "boxes": boxes(60, 4)}
RECORDS["segments"][6:12] = RECORDS["segments"][6:9] * 2  # of no length
DOUBLES = array.array("d", RECORDS["columns"])


def printed(target, kind, values, *options, form="f64"):
    """What `umbrage query` prints, notes left out."""
    path = test.path("records")
    with open(path, "wb") as file:
        array.array("d" if form == "f64" else "f", values).tofile(file)
    return ut.run("umbrage", "query", target, "--" + kind, path, "--format", form, "--quiet",
                  "--address", daemon.grpc_unix, *options).stdout


def refused(code, words, name, request, **fields):
    client.refused(lambda: ask[name](request, timeout=60, **fields), code, words)


for kind, values in RECORDS.items():
    with test.check(f"{kind}: a daemon's answers are the file's, byte for byte"):
        for options in ((), ("--json",), ("--origin=0.5,-1.25,3", "--batch", "64"), ("--json", "--batch", "8")):
            for form in ("f64", "f32"):
                here = printed(city, kind, values, *options, form=form)
                there = printed("city", kind, values, *options, form=form)
                assert here == there and len(here) > 100, (kind, options, form, len(here), len(there))
        assert printed("city", kind, values) == printed(baked["asset"], kind, values)
        assert printed("city", kind, [], "--json") == printed(city, kind, [], "--json")

with test.check("before a lamp likewise"):
    for kind in ("segments", "columns", "boxes"):
        here = printed(store + "/lamp.umb", kind, RECORDS[kind], "--json")
        assert here == printed("lamp", kind, RECORDS[kind], "--json") and b"inf" not in here

with test.check("segments of more stretches than the command keeps are told whole"):
    told = json.loads(printed("city", "segments", [low[0], low[1] + 1, low[2], high[0], low[1] + 1, high[2]],
                              "--json"))
    long = max(len(s["stretches"]) for s in told["segments"])
    for _ in range(200):
        if long > 16:
            break
        y = rng.uniform(low[1], high[1])
        line = [low[0], y, rng.uniform(low[2], high[2]), high[0], y, rng.uniform(low[2], high[2])]
        told = json.loads(printed("city", "segments", line, "--json"))
        long = max(len(s["stretches"]) for s in told["segments"])
    assert long > 16 and json.loads(printed(city, "segments", line, "--json")) == told, long

def calls(where, method):
    """How many calls of a method a daemon has answered."""
    return sum(float(line.rpartition(" ")[2]) for line in where.admin("/metrics")[1].splitlines()
               if line.startswith("grpc_server_handled_total{") and f'"{method}"' in line)


with test.check("long segments are asked again together, in their order"):
    mixed = [value for i in range(400) for value in
             (line if i % 3 else RECORDS["segments"][6 * i:6 * i + 6])]
    before = calls(daemon, "Segments")
    there = printed("city", "segments", mixed)
    assert there == printed(city, "segments", mixed)
    assert calls(daemon, "Segments") - before < 20, calls(daemon, "Segments") - before

with test.check("a server that takes less is asked for less at once"):
    for option, most in (("--max-points", 6400), ("--max-message", 2000)):  # 100 or 31 segments, 25 or 31 boxes
        small = test.daemon(option, most)
        for kind, values in (("segments", RECORDS["segments"][:6 * 900] + mixed), ("columns", anywhere(7000)),
                             ("boxes", RECORDS["boxes"])):
            there = printed("city", kind, values, "--address", small.grpc_unix)
            assert there == printed(city, kind, values), kind
        small.stop()
        test.daemons.remove(small)

with test.check("a box that takes too much is bad data, not bad usage"):
    done = ut.run("umbrage", "query", "fine", "--boxes", "-", "--address", daemon.grpc_unix, code=65,
                  stdin=b"-450 -20 -450 450 5 450\n")
    assert b"boxes[0]: takes more than 16777216 steps" in done.stderr, done.stderr


class Liar(grpc.GenericRpcHandler):
    """A server whose segments have 20 intervals, and many more when they are requested again."""

    def service(self, details):
        answer = self.limits if details.method.endswith("/Limits") else self.segments
        return grpc.unary_unary_rpc_method_handler(answer)

    def limits(self, _, context):
        return test.messages.shadows.LimitsReply(max_points=1 << 22, max_segments=1 << 16).SerializeToString()

    def segments(self, message, context):
        request = M.SegmentsRequest.FromString(message)
        count = 20 if request.max_stretches < 20 else 200000000
        return M.SegmentsReply(asset_id=bytes(32), lit=bytes(8), lit_m=bytes(8),
                               stretch_counts=array.array("I", [count]).tobytes(),
                               stretches=bytes(16 * request.max_stretches)).SerializeToString()


with test.check("a server that contradicts itself is told so, and nothing beyond its answer is read"):
    liar = grpc.server(futures.ThreadPoolExecutor(1), handlers=[Liar()])
    port = liar.add_insecure_port("127.0.0.1:0")
    liar.start()
    done = ut.run("umbrage", "query", "city", "--segments", "-", "--address", f"tcp:127.0.0.1:{port}",
                  stdin=b"0 0 0 1 1 1\n", code=None)
    liar.stop(None)
    assert done.returncode == 70 and b"at most 64 intervals, and then sent 200000000" in done.stderr, \
        (done.returncode, done.stderr)

with test.check("a foreign client gets the same numbers, as arrays"):
    told = json.loads(printed(city, "segments", RECORDS["segments"], "--json"))["segments"]
    request = M.SegmentsRequest(asset="city", max_stretches=3, want_stats=True,
                                segments_f64=array.array("d", RECORDS["segments"]).tobytes())
    reply = ask["Segments"](request, timeout=60)
    lit, counts = array.array("d", reply.lit), array.array("I", reply.stretch_counts)
    stretches = array.array("d", reply.stretches)
    assert reply.asset_id.hex() == baked["asset"] and not reply.ignores_translucent
    assert reply.stats.nodes > 0 and reply.stats.nanoseconds > 0
    assert [f"{v:.9g}" for v in lit] == [f"{s['lit']:.9g}" for s in told]
    assert list(counts) == [len(s["stretches"]) for s in told]
    at = 0
    for segment in told:
        kept = segment["stretches"][:3]
        assert [round(v, 7) for v in stretches[2 * at:2 * (at + len(kept))]] == [
            round(v, 7) for pair in kept for v in pair]
        at += len(kept)
    assert at * 2 == len(stretches)
    none = ask["Segments"](M.SegmentsRequest(asset="city", segments_f64=request.segments_f64), timeout=60)
    assert none.lit == reply.lit and none.lit_m == reply.lit_m and not none.stretches and not none.HasField("stats")
    told = json.loads(printed(city, "columns", DOUBLES, "--json"))["columns"]
    reply = ask["Columns"](M.ColumnsRequest(asset="city", points_f64=DOUBLES.tobytes()), timeout=60)
    assert list(array.array("I", reply.lit)) == [c["lit"] for c in told]
    assert [bool(b) for b in reply.outside] == [c["outside"] for c in told]
    assert sum(reply.outside) > 100 and sum(c["distance_m"] is None for c in told) > 100
    told = json.loads(printed(city, "boxes", RECORDS["boxes"], "--json"))["boxes"]
    reply = ask["Boxes"](M.BoxesRequest(asset="city", boxes_f64=array.array("d", RECORDS["boxes"]).tobytes()),
                         timeout=60)
    assert list(array.array("Q", reply.lit)) == [b["lit"] for b in told]
    assert list(array.array("Q", reply.voxels)) == [b["voxels"] for b in told]

with test.check("what cannot be is refused with the field's name, the value and the limit"):
    limits = client.limits(test.messages.shadows.LimitsRequest(), timeout=60)
    assert limits.max_columns == limits.max_points and limits.max_segments == limits.max_points // 64
    assert limits.max_boxes == limits.max_points // 256 and limits.max_box_steps == 1 << 24
    bad = array.array("f", [0.0] * 6000)
    bad[5991] = float("nan")
    for words, name, request in (
            ("segments[998].x1: nan, must be finite", "Segments", M.SegmentsRequest(asset="city", segments=bad.tobytes())),
            ("points[1997].x: nan, must be finite", "Columns", M.ColumnsRequest(asset="city", points=bad.tobytes())),
            ("boxes[998].x1: nan, must be finite", "Boxes", M.BoxesRequest(asset="city", boxes=bad.tobytes())),
            ("segments: length is 13 bytes, must be a multiple of 24", "Segments",
             M.SegmentsRequest(asset="city", segments=bytes(13))),
            ("boxes_f64: length is 47 bytes, must be a multiple of 48", "Boxes",
             M.BoxesRequest(asset="city", boxes_f64=bytes(47))),
            ("give only one", "Columns", M.ColumnsRequest(asset="city", points=bytes(12), points_f64=bytes(24))),
            ("origin: number 1 is inf", "Columns", M.ColumnsRequest(asset="city", origin=[0, float("inf"), 0])),
            ("origin", "Boxes", M.BoxesRequest(asset="city", origin=[1, 2])),
            ("asset", "Boxes", M.BoxesRequest())):
        refused(Code.INVALID_ARGUMENT, words, name, request)
    refused(Code.NOT_FOUND, "nope", "Columns", M.ColumnsRequest(asset="nope"))
    refused(Code.NOT_FOUND, "light: 7", "Segments", M.SegmentsRequest(asset="city", light=7))
    refused(Code.UNIMPLEMENTED, "closed rule", "Columns", M.ColumnsRequest(asset="closed", points=bytes(12)))
    refused(Code.RESOURCE_EXHAUSTED, "segments: 65537, each counts as 64 points; the limit is 4194304 points",
            "Segments", M.SegmentsRequest(asset="city", segments=bytes(24 * 65537)))
    refused(Code.RESOURCE_EXHAUSTED, "segments: 2, each counts as 4194304 points", "Segments",
            M.SegmentsRequest(asset="city", segments=bytes(48), max_stretches=4194304))
    refused(Code.RESOURCE_EXHAUSTED, "boxes: 16385", "Boxes", M.BoxesRequest(asset="city", boxes=bytes(24 * 16385)))

with test.check("a deadline ends the work, a cancelled call stops it, and the server is well"):
    many = M.SegmentsRequest(asset="city", max_stretches=16,
                             segments_f64=array.array("d", anywhere(2 * 65536)).tobytes())
    refused_by_deadline = 0
    try:
        ask["Segments"](many, timeout=0.003)
    except grpc.RpcError as error:
        assert error.code() == Code.DEADLINE_EXCEEDED, error
        refused_by_deadline = 1
    assert refused_by_deadline
    for _ in range(10):
        call = ask["Segments"].future(many, timeout=60)
        ut.wait_until(lambda: call.done() or daemon.metric("umbrage_buffered_bytes") > 0, 20, "it is asked")
        call.cancel()
    assert len(ask["Columns"](M.ColumnsRequest(asset="city", points=bytes(1200)), timeout=60).lit) == 400

with test.check("what was asked is counted"):
    text = daemon.admin("/metrics")[1]
    for kind in ("segments", "columns", "boxes"):
        line, = [x for x in text.splitlines() if x.startswith(f'umbrage_volume_queries_total{{kind="{kind}"}}')]
        assert int(line.split()[1]) > 0, line
    assert 'grpc_server_handled_total{grpc_service="umbrage.v1.Questions",grpc_method="Boxes"' in text

test.finish()
