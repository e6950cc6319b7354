#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the first seeds for the targets of make fuzz-ci: valid messages, files and scripts.

    tests/fuzz/make_gap_seeds.py [FOLDER]

A seed is named by the SHA-256 of its bytes, so that making them again changes nothing. Inputs that
a fuzzer found later (clang's -merge=1) are in the same folders."""

import gzip
import hashlib
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "harness"))
import umbrage_test as ut  # noqa: E402

TOKEN = "0123456789abcdef0123456789abcdef"


def manifest(b, *more):
    manifest = b.Manifest(scene="city.obj", priority=3)
    for name, size in (("city.obj", 100), ("t/a.mtl", 0), *more):
        manifest.files.add(path=name, size=size, sha256=bytes(range(32)))
    for name, value in (("resolution", "256"), ("sun", "140,38"), ("effect", "front=on")):
        manifest.settings.add(name=name, value=value)
    return manifest


def status(b):
    return b.JobStatus(job="0123456789abcdef" * 2, owner="ann", asset=bytes(range(32)))


def bakes(test):
    b, r = test.messages.bakes, test.messages.reflection
    odd = ["../x.mtl", "t/../../x.mtl", "/x.mtl", "./x.mtl", "t//x.mtl", "city.obj", "CITY.obj"]
    messages = [(0, b.SubmitRequest(manifest=manifest(b, (path, 1)))) for path in odd]
    messages += [(0, b.SubmitRequest(manifest=manifest(b))), (0, b.SubmitRequest(data=b"v 0 0 0\n")),
                (1, status(b)), (2, b.ListJobsReply(jobs=[status(b), status(b)])),
                (3, b.SubmitReply(job="0123456789abcdef" * 2)), (3, b.WatchRequest(job="a" * 32)),
                (3, b.FetchRequest(asset="ab" * 32, offset=7)),
                (3, b.FetchReply(size=10, offset=3, data=b"bytes")),
                (4, r.ServerReflectionRequest(list_services="")),
                (4, r.ServerReflectionRequest(file_containing_symbol="umbrage.v1.Shadows")),
                (4, r.ServerReflectionRequest(file_by_filename="umbrage/v1/bakes.proto"))]
    seeds = [bytes([kind]) + message.SerializeToString() for kind, message in messages]
    return seeds + [b"\5" + gzip.compress(b"a text " * 40, mtime=0), b"\5" + bytes(100)]


def reply(test):
    b, regions = test.messages.bakes, test.messages.regions
    piece = b.FetchReply(size=10, offset=0, data=b"bytes").SerializeToString()
    region = regions.RegionReply(asset_id=bytes(32), file_bytes=100,
                                 data=b"data").SerializeToString()
    data = b"\0\0\0\0\3abc"
    good = bytes([64, 0, 0x80, 0, 0x80 + 1, 1, 99 + len(data)]) + data + bytes([0x80 + 2, 2])
    return [b"\0" + good, b"\0" + b"\1" + good[1:], b"\1" + status(b).SerializeToString(),
            b"\1" + b.ListJobsReply(jobs=[status(b)]).SerializeToString(),
            b"\2" + bytes([len(piece)]) + piece + bytes([len(piece)]) + piece,
            b"\3" + bytes([1, len(region)]) + region + bytes([1, len(region)]) + region]


def bundle(_):
    gltf = (b'{"asset":{"version":"2.0"},"extensionsRequired":["KHR_materials_unlit"],"buffers":'
            b'[{"uri":"a.bin","byteLength":3},{"uri":"t%2Fc.png"},{"uri":"../secret"},'
            b'{"uri":"data:,x"}],"images":[{"uri":"a b/e.png"},{"uri":"link"},{"uri":"out/secret"}],'
            b'"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],"meshes":'
            b'[{"primitives":[{"attributes":{"POSITION":0}}]}]}')
    obj = b"# x\nmtllib m.mtl\nmtllib t/../m.mtl\nv 0 0 0\n\0newmtl a\nmap_Kd -o 0 0 0 a b/e.png\n" \
          b"map_d t\\c.png\nmap_bump ../secret\nbump /etc/passwd\n"
    return [b"\0" + obj, b"\1" + gltf, b"\2" + gltf, b"\3" + gltf]


def config(_):
    tokens = f"# who\nann query {TOKEN}\nbob query,submit,admin {TOKEN}x 1000\n".encode()
    settings = (b"; daemon\n[umbraged]\nstore = /srv/a\nstore = /srv/b\nlisten = tcp:127.0.0.1:0\n"
                b"idle-timeout = 5m\nmax-message = 2MiB\nworkers = 3\nlog-level = debug\n"
                b"copy = true\njobs = /srv/jobs\nexecutor = slurm\nowner-jobs = 3\n")
    return [b"\0" + tokens, b"\1" + settings, b"\1store=/x\n"]


def farm(_):
    job = "0123456789abcdef" * 2
    rows = [bytes([0, column, how]) + value for column, how, value in (
        (0, 0, b"--resolution=256\n--closed=on\n"), (0, 0, b"--resolution=256"), (1, 0, b"../x.ply"),
        (2, 0, job.encode()), (5, 2, b"\2"), (6, 1, bytes(32)), (7, 1, bytes(31)), (4, 1, b"cause"))]
    lines = "".join(f"17_{i} {i} {state} umbrage-01020304-{job}.1.tiles.0 {reason}\n" for i, state, reason in (
        (0, "PD", "BeginTime"), (1, "R", "None"), (2, "CG", "None"), (9, "PD", "Priority")))
    merge = f"18 N/A R umbrage-01020304-{job}.1.merge.0 None\n19 N/A R other None\n"
    return rows + [b"\1" + (lines + merge).encode(), b"\2" + bytes(range(150))]


def derive(test):
    r = test.messages.regions
    request = r.DeriveMapRequest(asset="city", width=16, height=16)
    fields = [field.name for field in request.DESCRIPTOR.fields]
    seeds = [request.SerializeToString()]
    for field in request.DESCRIPTOR.fields:
        other = r.DeriveMapRequest(asset="city", width=8, height=8)
        fill(other, field)
        seeds.append(other.SerializeToString())
    assert "width" in fields
    view = r.CascadeView(eye=[1, 2, 3], right=[1, 0, 0], up=[0, 1, 0], forward=[0, 0, 1], tan_x=0.5,
                         tan_y=0.5, near_m=0.1, far_m=50, count=3, weight=0.5)
    for technique in range(5):
        for mips in (False, True):
            seeds.append(r.DeriveMapRequest(asset="city", width=16, height=16, technique=technique,
                                            mips=mips, view=view).SerializeToString())
            seeds.append(r.DeriveMapRequest(asset="city", width=16, height=16, technique=technique,
                                            blur=3, rect=[1, 2, 50, 60]).SerializeToString())
    return seeds


def fill(message, field):
    """Sets one field, and all below it, to something small."""
    many = field.label == field.LABEL_REPEATED
    if field.message_type is not None:
        below = getattr(message, field.name).add() if many else getattr(message, field.name)
        below.SetInParent()
        for inner in field.message_type.fields:
            fill(below, inner)
    elif field.cpp_type in (field.CPPTYPE_DOUBLE, field.CPPTYPE_FLOAT):
        if many:
            getattr(message, field.name).extend([1.0, 2.0, 3.0])
        else:
            setattr(message, field.name, 1.5)
    elif field.cpp_type in (field.CPPTYPE_STRING, field.CPPTYPE_BOOL):
        pass
    elif not many and field.name not in ("width", "height"):
        setattr(message, field.name, 1)


def conn(test):
    """Scripts: fuzz_conn.c says what their bytes mean."""
    s, h, q = test.messages.shadows, test.messages.health, test.messages.questions
    r, regions = test.messages.reflection, test.messages.regions
    points = ut.floats([0.5 * i for i in range(24)])
    calls = [(0, s.QueryRequest(asset="city", points=points)), (2, s.DescribeRequest(asset="city")),
             (1, s.QueryRequest(asset="city", points=points, want_stats=True)),
             (3, s.ListRequest()), (4, s.LimitsRequest()), (5, h.HealthCheckRequest()),
             (6, h.HealthCheckRequest(service="umbrage.v1.Shadows")),
             (16, q.SegmentsRequest(asset="city", segments=points)),
             (17, q.ColumnsRequest(asset="city", points=points)),
             (18, q.BoxesRequest(asset="city", boxes=points)),
             (15, regions.DeriveMapRequest(asset="city", width=16, height=16)),
             (19, r.ServerReflectionRequest(list_services="")),
             (7, test.messages.bakes.SubmitRequest(manifest=manifest(test.messages.bakes))),
             (10, test.messages.bakes.ListJobsRequest()),
             (22, s.SampleRequest(asset="city", count=64, seed=3, scattered=0.5))]

    def script(path, message, how=0, ends=1):
        body = message.SerializeToString()
        return (bytes([0, path, how, 100, ends | 0x40, len(body) & 255, len(body) >> 8]) + body +
                bytes([221, 221]))
    seeds = [b"\0\0" + script(*call) for call in calls]
    seeds += [b"\0\0" + b"".join(script(*call) for call in calls),
              b"\0\0" + script(*calls[0], how=2) + script(*calls[0], how=4) + script(*calls[5], how=4),
              b"\0\0" + script(*calls[2], ends=0) + script(*calls[2]) + bytes([190, 0, 0, 0, 0, 0, 8, 0]),
              b"\0\0" + script(*calls[0], how=16) + bytes([190, 1, 0, 0, 1, 0, 0, 190, 2, 3, 0, 0, 0, 1])]
    preface = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
    frames = bytes([0, 0, 0, 4, 0, 0, 0, 0, 0, 0, 0, 4, 3, 0, 0, 0, 0, 1, 0, 0, 0, 8,
                    0, 0, 2, 1, 4, 0, 0, 0, 1, 9, 9, 0, 0, 3, 0, 1, 0, 0, 0, 1, 1, 2, 3])
    return seeds + [b"\7" + bytes([1, 5, 9, 2, 3, 30, 7, 8]) + preface + frames]


def main(folder):
    test = ut.Test()
    for make in (bakes, bundle, config, conn, derive, farm, reply):
        path = os.path.join(folder, "fuzz_" + make.__name__)
        os.makedirs(path, exist_ok=True)
        for seed in make(test):
            with open(os.path.join(path, hashlib.sha256(seed).hexdigest()), "wb") as file:
                file.write(seed)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else os.path.join(HERE, "seeds"))
