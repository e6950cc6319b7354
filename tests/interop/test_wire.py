#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Every message, in both directions, is compared with Python's protobuf: wire_echo decodes what Python
wrote and encodes it again, and Python must read the same message. Then the same messages with their
fields in other orders, unpacked numbers, unknown fields, two messages joined, and flipped bytes: a
message that wire_echo accepts must be what Python reads.

MESSAGES=1000000 SEED=7 test_wire.py runs longer.
"""
import os
import random
import struct
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

ut.need_grpc()  # for the message classes
from google.protobuf.message import DecodeError  # noqa: E402

test = ut.Test()
ECHO = ut.program("interop/wire_echo")
MESSAGES = int(os.environ.get("MESSAGES", "30000"))
DECODED, REFUSED, NOT_ENCODED = 0, 1, 2
BATCH = 2000

names = subprocess.run([ECHO, "--list"], stdout=subprocess.PIPE, check=True, text=True).stdout.split()
kinds = [getattr(getattr(test.messages, name.split(".")[0]), name.split(".")[1]) for name in names]
rng = random.Random(int(os.environ.get("SEED", "1")))

IDS = {"id", "asset_id", "scene_hash", "sha256"}
# The encoder writes these even if all three are 0, and leaves those out.
ALWAYS = {"direction", "position", "voxel_m", "bounds_min", "bounds_max", "right", "up", "forward"}
SPARSE = {"rect"}


def number(field):
    if field.type in (field.TYPE_DOUBLE, field.TYPE_FLOAT):
        return rng.choice([rng.uniform(-1e3, 1e3), float(rng.randrange(5)), 1e300, 0.0])
    if field.type == field.TYPE_BOOL:
        return rng.random() < 0.5
    if field.type == field.TYPE_ENUM:
        return rng.choice(field.enum_type.values).number
    bits = 31 if field.type == field.TYPE_INT32 else 32 if field.type == field.TYPE_UINT32 else \
        63 if field.type == field.TYPE_INT64 else 64
    value = rng.getrandbits(rng.randrange(bits + 1))
    return -value if field.type in (field.TYPE_INT32, field.TYPE_INT64) and rng.random() < 0.5 else value


def text():
    return "".join(rng.choice("abcé/.ü0") for _ in range(rng.randrange(1, 12)))


def fill(message):
    """Sets most fields at random, those with a length or a range to what they may be."""
    for field in message.DESCRIPTOR.fields:
        name = field.name
        if rng.random() < 0.2 and name not in IDS | {"asset", "summary"}:
            continue
        if field.label == field.LABEL_REPEATED:
            values = getattr(message, name)
            if field.type == field.TYPE_MESSAGE:
                for _ in range(rng.randrange(4)):
                    fill(values.add())
            elif field.type == field.TYPE_DOUBLE:
                values.extend(number(field) for _ in range(4 if name == "rect" else 3))
            elif field.type == field.TYPE_STRING:
                values.extend(text() for _ in range(2))
        elif field.type == field.TYPE_MESSAGE:
            getattr(message, name).SetInParent()
            fill(getattr(message, name))
        elif field.type == field.TYPE_STRING:
            setattr(message, name, text())
        elif field.type == field.TYPE_BYTES:
            setattr(message, name, rng.randbytes(32 if name in IDS or name == "asset" else rng.randrange(300)))
        else:
            setattr(message, name, number(field))


def fit_query(m):
    """A request that a server takes: its settings within their ranges, one kind of points."""
    count = rng.randrange(4)
    m.ClearField("targets")
    for name in ("points", "points_f64", "depth", "normals", "footprints"):
        m.ClearField(name)
    m.taps = rng.choice([0, 1, 3, 17])
    m.bias, m.light_extent = rng.uniform(0, 1e6), rng.random()
    for name in ("max_error_m", "max_visibility", "budget_ns"):
        setattr(m, name, 0)
    if m.taps == 0 and rng.random() < 0.5:
        m.level, m.max_error_m, m.budget_ns = 0, rng.random(), 40
    picture = m.HasField("picture") and rng.random() < 0.5
    if picture:
        m.ClearField("origin")
        p = m.picture
        for name, values in (("eye", [1, 2, 3]), ("forward", [0, 0, 1]), ("up", [0, 1, 0])):
            p.ClearField(name)
            getattr(p, name).extend(values)
        p.fov_y, p.width, p.height = 0.5, 2, 2
        count, m.depth = 4, bytes(16)
    else:
        m.ClearField("picture")
        m.points = rng.randbytes(12 * count) if rng.random() < 0.5 else b""
        m.points_f64 = b"" if m.points else rng.randbytes(24 * count)
    m.normals = rng.randbytes(12 * count) if rng.random() < 0.5 else b""
    if m.filter == 3 and not picture:
        m.footprints, m.footprint_m = rng.randbytes(4 * count), 2.5
        if m.pixel_rad == 0:
            m.ClearField("eye")
    else:
        m.filter = m.filter % 3
        m.footprint_m = m.pixel_rad = 0
        m.ClearField("eye")


def fit(m):
    name = m.DESCRIPTOR.name
    if name == "QueryRequest":
        fit_query(m)
    elif name == "QueryReply":
        m.ClearField("asset_ids")
    elif name == "SubmitRequest" and m.HasField("manifest"):
        m.ClearField("data")
    elif name == "WatchRequest":
        m.job = rng.randbytes(16).hex()
    elif name == "ListJobsRequest":
        m.limit = rng.randrange(1001)
    elif name == "RegionRequest":
        count = rng.randrange(1, 129)
        m.offsets.extend(rng.getrandbits(40) for _ in range(count))
        m.lengths.extend(rng.randrange(1, 8192) for _ in range(count))
    elif name == "SampleRequest":
        m.count, m.scattered = rng.randrange(1, 65537), rng.random()
    elif name == "SampleReply":
        m.points_f64 = rng.randbytes(24 * rng.randrange(4))
    elif name == "DeriveMapRequest" and m.HasField("view"):
        m.view.count = rng.randrange(1, 9)
    elif name in ("SegmentsRequest", "ColumnsRequest", "BoxesRequest"):
        each, first = (12 if name[0] == "C" else 24), m.DESCRIPTOR.fields_by_number[5].name
        wide = rng.random() < 0.5
        setattr(m, first, b"" if wide else rng.randbytes(each * rng.randrange(4)))
        setattr(m, first + "_f64", rng.randbytes(2 * each * rng.randrange(4)) if wide else b"")
    elif name in ("SegmentsReply", "ColumnsReply", "BoxesReply"):
        count = rng.randrange(1, 5)
        sizes = {"S": (8, 8, 4, 16), "C": (8, 4, 1), "B": (8, 8)}[name[0]]
        for i, size in enumerate(sizes):
            setattr(m, m.DESCRIPTOR.fields_by_number[4 + i].name, rng.randbytes(size * count))
    return m


def canonical(m):
    """What a message means to the server: defaults filled in, ignored fields left out."""
    m.DiscardUnknownFields()
    for field in m.DESCRIPTOR.fields:
        value = getattr(m, field.name)
        if field.type == field.TYPE_MESSAGE:
            for part in value if field.label == field.LABEL_REPEATED else \
                    [value] if m.HasField(field.name) else []:
                canonical(part)
        elif field.label == field.LABEL_REPEATED and field.type == field.TYPE_DOUBLE:
            in_view = m.DESCRIPTOR.name in ("Picture", "CascadeView") and field.name == "eye"
            always = field.name in ALWAYS or in_view or m.DESCRIPTOR.name == "DescribeReply"
            if always and not value:
                value.extend([0, 0, 0])
            elif not always and field.name != "eye" and not any(value):
                m.ClearField(field.name)
        elif field.type == field.TYPE_DOUBLE and value == 0:
            m.ClearField(field.name)  # -0
    name = m.DESCRIPTOR.name
    if name == "QueryRequest" and m.taps == 0 and not (m.max_error_m or m.max_visibility or m.budget_ns):
        m.taps = 1
    if name == "QueryRequest" and not any(m.eye):
        m.ClearField("eye")
        m.eye.extend([0, 0, 0] if m.pixel_rad > 0 else [])
    elif name == "LimitsReply":
        m.ClearField("encodings")
    elif hasattr(m, "stats") and name != "QueryReply" and m.HasField("stats") and not m.stats.ByteSize():
        m.ClearField("stats")
    return m


def looks_through(m):
    """Footprints of a picture's pixels are filled in by the decoder."""
    return m.DESCRIPTOR.name == "QueryRequest" and m.HasField("picture") and m.filter == 3


def fields_of(data):
    """The fields of a message, as byte strings."""
    at, parts = 0, []

    def varint():
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value
    while at < len(data):
        start = at
        kind = varint() & 7
        if kind == 0:
            varint()
        elif kind == 1:
            at += 8
        elif kind == 5:
            at += 4
        else:
            size = varint()
            at += size
        parts.append(data[start:at])
    return parts


def unpacked(message, data):
    """The same message, with its repeated doubles of fields below 16 not packed."""
    parts = []
    for part in fields_of(data):
        field = message.DESCRIPTOR.fields_by_number.get(part[0] >> 3) if part[0] < 128 else None
        if field and field.label == field.LABEL_REPEATED and field.type == field.TYPE_DOUBLE:
            tag = bytes([part[0] >> 3 << 3 | 1])
            parts.extend(tag + part[at:at + 8] for at in range(2, len(part), 8))
        else:
            parts.append(part)
    return b"".join(parts)


def changed(message, data):
    """Bytes that mean something related, or nothing."""
    way = rng.randrange(6)
    if way == 0:
        return unpacked(message, data)
    if way == 1:  # order between fields is free; repeated ones change their order
        parts = fields_of(data)
        rng.shuffle(parts)
        return b"".join(parts)
    if way == 2:  # unknown fields
        return data + b"\xa0\x06\x05" + b"\xa2\x06\x02ab" + b"\xa5\x06abcd" + b"\xa1\x06abcdefgh"
    if way == 3:  # the later one counts, parts are joined
        return data + fit_new(type(message)).SerializeToString()
    if way == 4 and data:
        at = rng.randrange(len(data))
        return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1:]
    return data[:rng.randrange(len(data) + 1)]


def fit_new(kind):
    message = kind()
    fill(message)
    return fit(message)


def echo(records):
    data = b"".join(struct.pack("<BI", kind, len(message)) + message for kind, message in records)
    out = subprocess.run([ECHO], input=data, stdout=subprocess.PIPE, check=True).stdout
    at, answers = 0, []
    while at < len(out):
        status, size = struct.unpack_from("<BI", out, at)
        answers.append((status, out[at + 5:at + 5 + size]))
        at += 5 + size
    assert len(answers) == len(records), (len(answers), len(records))
    return answers


def same(kind, data, out):
    expected, got = kinds[kind](), kinds[kind]()
    try:
        expected.ParseFromString(data)
    except DecodeError:  # texts that are not read may be none: encodings, and all but the last
        tags = [part[0] for part in fields_of(data)]
        assert names[kind] == "shadows.LimitsReply" or len(tags) > len(set(tags)), (names[kind], data.hex())
        return
    if looks_through(expected):
        return
    got.ParseFromString(out)
    canonical(expected)
    a, b = (m.SerializeToString(deterministic=True) for m in (expected, canonical(got)))
    assert a == b, (names[kind], data.hex(), str(expected), str(got))


def run(count, make):
    taken = [0] * len(kinds)
    for _ in range(count // BATCH):
        records = [(kind, make(kinds[kind])) for kind in (rng.randrange(len(kinds)) for _ in range(BATCH))]
        for (kind, data), (status, out) in zip(records, echo(records)):
            if status == DECODED:
                taken[kind] += 1
                same(kind, data, out)
            elif make is plain:
                assert status == NOT_ENCODED, (names[kind], data.hex())
    return taken


def plain(kind):
    return fit_new(kind).SerializeToString()


def other(kind):
    message = fit_new(kind)
    return changed(message, message.SerializeToString())


with test.check("what Python writes is taken and comes back as the same message"):
    taken = run(MESSAGES // 3, plain)
    assert all(taken), [name for name, count in zip(names, taken) if not count]
    print(f"  {sum(taken)} messages of {len(kinds)} kinds")

with test.check("what is taken of changed messages is what Python reads"):
    taken = run(MESSAGES - MESSAGES // 3, other)
    assert all(taken), [name for name, count in zip(names, taken) if not count]
    print(f"  {sum(taken)} messages were taken")

test.finish()
