#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
A client that nobody here wrote: python3-grpcio with classes generated from our .proto files asks a
real daemon, over TCP and a Unix socket. The answers are compared bit for bit with `umbrage query`
on the file; every refusal must have the right code and name the field, the value and the limit.
"""
import os
import struct
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
test = ut.Test()
SLOW = ut.is_sanitized()
COUNT = 65536
MAX_POINTS = 300000
MAX_MESSAGE = 8 << 20
SEED = 20261

store = test.path("store")
os.mkdir(store)
baked = test.bake(test.scene("city", 4), store + "/city.umb", "--resolution", 512, "--depth",
                  "raster", "--verify", 0)
city = store + "/city.umb"
daemon = test.daemon("--max-points", MAX_POINTS, "--max-message", f"{MAX_MESSAGE >> 20}MiB",
                     "--workers", 2)
tcp = test.client(daemon.grpc_tcp)
unix = test.client(daemon.grpc_unix)
M = test.messages.shadows
H = test.messages.health

about = tcp.describe(M.DescribeRequest(asset="city"), timeout=60)
points = ut.random_points(about.bounds_min, about.bounds_max, COUNT, SEED)
normals = ut.random_normals(COUNT, SEED)
f32 = ut.floats(points)
f64 = ut.floats(points, "d")
n32 = ut.floats(normals)
print(f"seed {SEED}, sanitized {SLOW}")


def same_answers(client):
    """All formats, precisions, with and without normals."""
    mixed32 = ut.floats(ut.interleave(points, normals))
    for words, fields, data, form in (
            ((), {"points": f32}, f32, "f32"),
            ((), {"points_f64": f64}, f64, "f64"),
            (("--normals",), {"points": f32, "normals": n32}, mixed32, "f32"),
            (("--taps", 9), {"points": f32, "taps": 9}, f32, "f32"),
            (("--taps", 5, "--bias", "1.5vox"),
             {"points": f32, "taps": 5, "bias_mode": M.BIAS_VOXELS, "bias": 1.5}, f32, "f32"),
            (("--taps", 17, "--bias", "none", "--origin", "1.5,-2.25,0.125"),
             {"points": f32, "taps": 17, "bias_mode": M.BIAS_NONE, "origin": [1.5, -2.25, 0.125]},
             f32, "f32")):
        for encoding, answer in (("f32", M.ANSWER_F32), ("u8", M.ANSWER_U8), ("bit", M.ANSWER_BIT)):
            expected = test.query_file(city, data, *words, form=form, encoding=encoding)
            reply = client.query(M.QueryRequest(asset="city", format=answer, **fields), timeout=120)
            assert reply.visibility == expected, f"{words} {encoding} differ"
            assert reply.asset_id.hex() == baked["asset"]
            assert len(expected) == {"f32": 4 * COUNT, "u8": COUNT, "bit": COUNT // 8}[encoding]
    values = set(ut.from_floats(test.query_file(city, f32)))
    assert values == {0.0, 1.0}, f"points that do not test anything: {values}"


with test.check("65536 points over TCP answer with the file's bits in every format"):
    same_answers(tcp)
with test.check("65536 points over a Unix socket answer with the file's bits in every format"):
    same_answers(unix)

with test.check("no points are a valid question with an empty answer"):
    for client in (tcp, unix):
        reply = client.ask("city")
        assert reply.visibility == b"" and reply.asset_id.hex() == baked["asset"]

with test.check("an asset answers by its id as by its name"):
    assert tcp.ask(baked["asset"], f32).visibility == tcp.ask("city", f32).visibility

with test.check("stats come only when asked for and add up"):
    assert not tcp.ask("city", f32).HasField("stats")
    stats = tcp.ask("city", f32, normals=n32, want_stats=True).stats
    assert stats.points == COUNT
    assert 0 < stats.facing_away < COUNT and 0 < stats.outside < COUNT
    assert stats.nodes > 0 and stats.nanoseconds > 0

with test.check("an unknown asset is NOT_FOUND and is named"):
    tcp.refused(lambda: tcp.ask("nowhere", f32), Code.NOT_FOUND, "nowhere")
with test.check("an unknown id is NOT_FOUND"):
    tcp.refused(lambda: tcp.ask("ab" * 32, f32), Code.NOT_FOUND)
with test.check("an asset name beyond ASCII is named, in the escapes that logs use"):
    escaped = "".join(chr(b) if 32 <= b < 127 else f"\\x{b:02x}"
                      for b in "größe 城 100% \n sure".encode())
    tcp.refused(lambda: tcp.ask("größe 城 100% \n sure", f32), Code.NOT_FOUND, escaped)
with test.check("text beyond ASCII and percent survive the status message, on one line"):
    tcp.refused(lambda: tcp.check(H.HealthCheckRequest(service="größe 城 100%\nsure"), timeout=60),
                Code.NOT_FOUND, "größe 城 100% sure")
with test.check("an empty asset name is INVALID_ARGUMENT and the field is named"):
    tcp.refused(lambda: tcp.ask("", f32), Code.INVALID_ARGUMENT, "asset")
with test.check("an asset name of 300 bytes is refused, naming field and limit"):
    tcp.refused(lambda: tcp.ask("x" * 300, f32), Code.INVALID_ARGUMENT, "asset", "255")

with test.check("an unknown light is refused and named"):
    tcp.refused(lambda: tcp.ask("city", f32, light=7), Code.NOT_FOUND, "light", "7")

NAN = struct.pack("<f", float("nan"))
with test.check("a NaN coordinate is INVALID_ARGUMENT naming points[index]"):
    for index in (0, 77, COUNT - 1):
        bad = f32[:12 * index + 4] + NAN + f32[12 * index + 8:]
        tcp.refused(lambda: tcp.ask("city", bad), Code.INVALID_ARGUMENT, f"points[{index}]", "nan")
with test.check("of two bad coordinates the first is named, whatever worker meets it"):
    bad = bytearray(f32)
    for index in (20000, 60000):
        bad[12 * index:12 * index + 4] = NAN
    for _ in range(10):
        tcp.refused(lambda: tcp.ask("city", bytes(bad)), Code.INVALID_ARGUMENT, "points[20000]")
with test.check("an infinite double is INVALID_ARGUMENT"):
    bad = f64[:24] + struct.pack("<d", float("-inf")) + f64[32:]
    tcp.refused(lambda: tcp.query(M.QueryRequest(asset="city", points_f64=bad), timeout=60),
                Code.INVALID_ARGUMENT, "[1]", "inf")

with test.check("lengths that are not whole points are INVALID_ARGUMENT naming the field"):
    for size in (1, 4, 11, 13, 12 * 100 + 8):
        tcp.refused(lambda: tcp.ask("city", f32[:size]), Code.INVALID_ARGUMENT, "points", str(size))
    tcp.refused(lambda: tcp.query(M.QueryRequest(asset="city", points_f64=f64[:36]), timeout=60),
                Code.INVALID_ARGUMENT, "points_f64", "36")
with test.check("normals of another count are INVALID_ARGUMENT"):
    tcp.refused(lambda: tcp.ask("city", f32[:120], normals=n32[:108]), Code.INVALID_ARGUMENT,
                "normals", "108", "120")
with test.check("points and points_f64 together are INVALID_ARGUMENT"):
    tcp.refused(lambda: tcp.ask("city", f32[:120], points_f64=f64[:240]), Code.INVALID_ARGUMENT,
                "points", "points_f64")
with test.check("even and too many taps are INVALID_ARGUMENT naming value and limit"):
    for taps in (2, 16, 19, 4294967295):
        tcp.refused(lambda: tcp.ask("city", f32[:120], taps=taps), Code.INVALID_ARGUMENT, "taps",
                    str(taps), "17")
with test.check("an unknown bias mode or format, and a bad bias or origin, are INVALID_ARGUMENT"):
    for fields, words in (({"bias_mode": 9}, ("bias_mode", "9")), ({"format": 5}, ("format", "5")),
                          ({"bias_mode": M.BIAS_METRES, "bias": -1.0}, ("bias",)),
                          ({"bias_mode": M.BIAS_VOXELS, "bias": 1e7}, ("bias",)),
                          ({"bias_mode": M.BIAS_VOXELS, "bias": float("nan")}, ("bias",)),
                          ({"origin": [1.0, 2.0]}, ("origin", "2")),
                          ({"origin": [1.0, float("inf"), 0.0]}, ("origin",))):
        tcp.refused(lambda: tcp.ask("city", f32[:120], **fields), Code.INVALID_ARGUMENT, *words)

with test.check("too many points are RESOURCE_EXHAUSTED naming the limit"):
    tcp.refused(lambda: tcp.ask("city", bytes(12 * (MAX_POINTS + 1))), Code.RESOURCE_EXHAUSTED,
                "points", str(MAX_POINTS + 1), str(MAX_POINTS))
    assert len(tcp.ask("city", bytes(12 * MAX_POINTS)).visibility) == MAX_POINTS
with test.check("an over-long message is RESOURCE_EXHAUSTED naming the limit, on both transports"):
    for client in (tcp, unix):
        client.refused(lambda: client.ask("city", bytes(MAX_MESSAGE + 1000)),
                       Code.RESOURCE_EXHAUSTED, str(MAX_MESSAGE))
with test.check("a garbage body is INVALID_ARGUMENT"):
    for body in (b"\xff" * 100, b"\x0a\x05ab", b"\x62\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01",
                 b"\x0a\x02\xff\xfe"):
        tcp.refused(lambda: tcp.raw_query(body, timeout=60), Code.INVALID_ARGUMENT)
with test.check("an empty request is INVALID_ARGUMENT"):
    tcp.refused(lambda: tcp.raw_query(b"", timeout=60), Code.INVALID_ARGUMENT, "asset")
with test.check("unknown fields of a newer client are ignored"):
    body = M.QueryRequest(asset="city", points=f32[:1200]).SerializeToString()
    newer = body + b"\xa2\x06\x03abc" + b"\xa8\x06\x07"  # fields 100 and 101
    assert tcp.raw_query(newer, timeout=60) == tcp.raw_query(body, timeout=60)

with test.check("an unknown method and an unknown service are UNIMPLEMENTED"):
    for path in ("/umbrage.v1.Shadows/Nothing", "/umbrage.v2.Shadows/Query", "/a/b", "/x" * 200):
        call = tcp.unary(path, M.QueryReply)
        tcp.refused(lambda: call(M.QueryRequest(), timeout=60), Code.UNIMPLEMENTED)

with test.check("Describe tells lights, bounds, plan, sizes and settings"):
    assert about.summary.name == "city" and about.summary.id.hex() == baked["asset"]
    assert about.summary.packed_bytes == os.path.getsize(city)
    assert about.summary.memory_bytes > 0 and about.summary.light_count == 1 == len(about.lights)
    light = about.lights[0]
    assert light.kind == M.LIGHT_DIRECTIONAL and light.resolution == 512
    assert abs(sum(d * d for d in light.direction) - 1) < 1e-12  # unit length, doubles
    assert len(light.voxel_m) == 3 and all(v > 0 for v in light.voxel_m)
    assert light.closed == baked["closed"] and light.name == baked["lights"][0]["name"]
    assert len(about.origin) == len(about.bounds_min) == len(about.bounds_max) == 3
    assert all(low < high for low, high in zip(about.bounds_min, about.bounds_max))
    assert "effect=closed" in about.plan and "resolution=512" in about.settings
    assert len(about.scene_hash) == 32
    assert tcp.describe(M.DescribeRequest(asset=baked["asset"]), timeout=60) == about
with test.check("Describe of an unknown asset is NOT_FOUND, of none INVALID_ARGUMENT"):
    tcp.refused(lambda: tcp.describe(M.DescribeRequest(asset="q"), timeout=60), Code.NOT_FOUND, "q")
    tcp.refused(lambda: tcp.describe(M.DescribeRequest(), timeout=60), Code.INVALID_ARGUMENT,
                "asset")
with test.check("List names the assets"):
    assets = unix.list(M.ListRequest(), timeout=60).assets
    assert [a.name for a in assets] == ["city"] and assets[0] == about.summary

SERVING = H.HealthCheckResponse.SERVING
with test.check("health Check says SERVING for the server and the service, NOT_FOUND for others"):
    for service in ("", "umbrage.v1.Shadows"):
        assert tcp.check(H.HealthCheckRequest(service=service), timeout=60).status == SERVING
    tcp.refused(lambda: tcp.check(H.HealthCheckRequest(service="other"), timeout=60),
                Code.NOT_FOUND, "other")
with test.check("health Watch sends the state at once and stays open"):
    for service, state in (("", SERVING), ("umbrage.v1.Shadows", SERVING),
                           ("other", H.HealthCheckResponse.SERVICE_UNKNOWN)):
        stream = tcp.watch(H.HealthCheckRequest(service=service), timeout=60)
        assert next(iter(stream)).status == state
        time.sleep(0.1)
        assert stream.is_active()
        stream.cancel()

BIG = bytes(12 * MAX_POINTS)
with test.check("a deadline that passes is DEADLINE_EXCEEDED, and the daemon answers on"):
    tcp.refused(lambda: tcp.ask("city", BIG, taps=17, timeout=0.002), Code.DEADLINE_EXCEEDED)
    assert len(tcp.ask("city", f32).visibility) == COUNT
with test.check("a cancelled call is CANCELLED, and the daemon answers on"):
    for _ in range(5):
        future = tcp.query.future(M.QueryRequest(asset="city", points=BIG, taps=17), timeout=60)
        time.sleep(0.003)
        future.cancel()
        assert future.cancelled() or future.code() in (Code.CANCELLED, Code.OK)
    assert len(tcp.ask("city", f32).visibility) == COUNT
    ut.wait_until(lambda: daemon.metric("umbrage_buffered_bytes") == 0, 20, "nothing is buffered")

with test.check("200 calls at once all get their own answers"):
    expected = [tcp.ask("city", f32[12 * i:12 * (i + 300)], taps=5).visibility for i in range(200)]
    clients = [tcp, unix] + [test.client(daemon.grpc_tcp) for _ in range(2)]
    futures = [clients[i % 4].query.future(
        M.QueryRequest(asset="city", points=f32[12 * i:12 * (i + 300)], taps=5), timeout=120)
        for i in range(200)]
    assert [future.result().visibility for future in futures] == expected
with test.check("large calls from eight threads at once agree"):
    expected = tcp.ask("city", f32, taps=3).visibility
    wrong = []

    def hammer(client):
        for _ in range(4):
            if client.ask("city", f32, taps=3, timeout=120).visibility != expected:
                wrong.append(client)

    threads = [threading.Thread(target=hammer, args=(clients[i % 4],)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong

with test.check("a gzip request is UNIMPLEMENTED and says what is supported"):
    request = M.QueryRequest(asset="city", points=f32)
    tcp.refused(lambda: tcp.query(request, timeout=60, compression=grpc.Compression.Gzip),
                Code.UNIMPLEMENTED, "grpc-encoding", "identity")
with test.check("a client of default settings gets its reply; metadata is ignored"):
    reply = tcp.query(M.QueryRequest(asset="city", points=f32[:120]), timeout=60,
                      metadata=(("x-many", "y" * 1000), ("trace-bin", b"\0\1\2\xff")))
    assert len(reply.visibility) == 10
with test.check("request metadata over the header limit is refused, and the daemon answers on"):
    tcp.refused(lambda: tcp.query(M.QueryRequest(asset="city", points=f32[:120]), timeout=20,
                                  metadata=(("x-many", "y" * 20000),)), Code.RESOURCE_EXHAUSTED)
    assert len(unix.ask("city", f32).visibility) == COUNT

for client in (tcp, unix, *clients[2:]):
    client.close()
test.finish()
