#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Released versions: their files, ids, answers, messages, jobs, options, metrics and C interface (tests/compat) are this
build's too. The comparison itself is tested on a record of this build, which it accepts whole and refuses with each part changed.
"""
import json
import os
import re
import shutil
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, "..", "harness"), os.path.join(HERE, "..", "compat")]
import compat  # noqa: E402
import umbrage_test as ut  # noqa: E402

ut.need_grpc()
if shutil.which("protoc") is None:
    ut.skip("protoc is not installed")
test = ut.Test()
versions = sorted(name for name in os.listdir(os.path.join(HERE, "..", "compat")) if re.fullmatch(r"\d+\.\d+\.\d+", name))
if not versions:
    ut.left_out("files of released versions", "no version is released yet; `make compat-record` makes the files of one")
for version in versions:
    with test.check(f"what {version} promised is kept"):
        found = list(compat.problems(os.path.join(HERE, "..", "compat", version), test))
        assert not found, found

OWN = test.path("own")
with test.check("a record of this build is accepted, and is small enough for the tree"):
    os.makedirs(OWN)
    compat.record(OWN, test)
    found = list(compat.problems(OWN, test))
    assert not found, found
    size = sum(os.path.getsize(os.path.join(place, name)) for place, _, names in os.walk(OWN) for name in names)
    assert size < 512 << 10, size

# From here on the lists are of the build, not of a record: they are made once.
make_lists, made = compat.lists_now, []


def lists_once(*words):
    if not made:
        made.append(make_lists(*words))
    return made[0]


compat.lists_now = lists_once


def changed(name, change, part):
    """Findings of a part of the comparison when a file of the record is changed by change(bytes)."""
    place = test.path("changed")
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(OWN, place)
    compat.write(change(compat.read(place, name)), place, name)
    return list(compat.problems(place, test, (part,)))


with test.check("each part is compared: one change in it is one finding of its kind"):
    ids = json.loads(compat.read(OWN, "ids.json"))
    part_of = {"format": compat.file_problems, "answers": compat.file_problems, "ids": compat.file_problems,
               "wire": compat.wire_problems, "jobs": compat.state_problems, "configuration": compat.state_problems}
    for name, change, kind in (
            ("assets/sun.umb", lambda data: data[:-1], "format"), ("answers/lamp-taps9.f32", lambda data: b"\0\0\0\x40" + data[4:], "answers"),
            ("ids.json", lambda data: data.replace(b'"220,60"', b'"221,60"'), "ids"),
            ("messages/boxes.reply", lambda data: data[:-1] + bytes([data[-1] ^ 1]), "wire"),
            ("messages/query.request", lambda data: data.replace(b"sun", b"sum"), "wire"),
            ("messages/packed.reply", lambda data: data[:-1] + bytes([data[-1] ^ 1]), "wire"),
            ("messages/region.reply", lambda data: data[:-1] + bytes([data[-1] ^ 1]), "wire"),
            ("jobs.json", lambda data: data.replace(b'"state":"done"', b'"state":"lost"'), "jobs"),
            ("umbraged.conf", lambda data: data + b"no-such-option = 1\n", "configuration"),
            ("options.tsv", lambda data: data.replace(b"--resolution", b"--resolutions", 1), "options"),
            ("metrics.txt", lambda data: data.replace(b"umbrage_queries_total counter", b"umbrage_queries_total gauge"), "metrics"),
            ("json.txt", lambda data: data.replace(b".bound_m number", b".bound_m text", 1), "json"),
            ("python.txt", lambda data: data.replace(b"Asset.query(taps)", b"Asset.query(tabs)", 1), "python"),
            ("proto/umbrage/v1/shadows.proto", lambda data: data.replace(b" taps = ", b" taps = 9", 1), "wire"),
            ("abi.txt", lambda data: data.replace(b"umb_query_run", b"umb_query_walk"), "API")):
        found = changed(name, change, part_of.get(kind, compat.list_problems))
        assert found and all(one.startswith(kind) for one in found), (name, found)

test.finish()
