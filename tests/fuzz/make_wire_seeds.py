#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Writes seeds of fuzz_wire: one message of each kind of the Questions service, Limits, and
Sample.

    tests/fuzz/make_wire_seeds.py [FOLDER]

A seed is named by the SHA-256 of its bytes, so that making them again changes nothing. fuzz_wire takes
the number of a reply's records from the message's length modulo 5, so each reply gets as many records."""

import array
import hashlib
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "harness"))
import umbrage_test as ut  # noqa: E402


def floats(count):
    return array.array("f", [0.5 * i - 1 for i in range(count)]).tobytes()


def doubles(count):
    return array.array("d", [0.25 * i - 1 for i in range(count)]).tobytes()


def requests(messages):
    """Both forms of records, with an origin and without."""
    where = {"asset": "city", "light": 1, "want_stats": True}
    return [
        messages.SegmentsRequest(segments=floats(12), max_stretches=4, **where),
        messages.SegmentsRequest(segments_f64=doubles(6), origin=[1e6, -2.5, 3], **where),
        messages.ColumnsRequest(points=floats(9), **where),
        messages.ColumnsRequest(points_f64=doubles(3), origin=[1e6, -2.5, 3], **where),
        messages.BoxesRequest(boxes=floats(12), **where),
        messages.BoxesRequest(boxes_f64=doubles(6), **where),
    ]


def fitting(messages, make):
    """Makes a reply with as many records as its length modulo 5: other counts are tried until the
    length fits."""
    for bits in range(64):
        for count in range(1, 5):
            head = {"asset_id": bytes(range(32)), "stats": messages.QuestionStats(nodes=1 << bits),
                    "ignores_translucent": True}
            reply = make(count, head)
            if len(reply.SerializeToString()) % 5 == count:
                return reply
    raise AssertionError("no length fits")


def replies(messages):
    def integers(kind, count):
        return array.array(kind, range(1, count + 1)).tobytes()
    return [fitting(messages, make) for make in (
        lambda n, head: messages.SegmentsReply(lit=doubles(n), lit_m=doubles(n), stretches=doubles(n * (n + 1)),
                                               stretch_counts=integers("I", n), **head),
        lambda n, head: messages.ColumnsReply(distance_m=doubles(n), lit=integers("I", n), outside=bytes(n), **head),
        lambda n, head: messages.BoxesReply(lit=integers("Q", n), voxels=integers("Q", n), **head))]


def main(folder):
    test = ut.Test()
    questions, shadows = test.messages.questions, test.messages.shadows
    limits = shadows.LimitsReply(max_points=4194304, max_message_bytes=64 << 20, max_targets=256, max_taps=17,
                                 max_streams=100, queue=256, encodings=["identity", "gzip"], version="0.1.0",
                                 max_segments=65536, max_columns=4194304, max_boxes=16384, max_box_steps=1 << 24)
    samples = [shadows.SampleRequest(asset="city", light=1, count=4096, seed=1 << 40, scattered=0.25),
               shadows.SampleReply(asset_id=bytes(range(32)), origin=[1e6, -2.5, 3], points_f64=doubles(6),
                                   note="1 of 3 points were not found")]
    seeds = [message.SerializeToString() for message in (*requests(questions), *replies(questions), limits,
                                                         *samples)]
    assert len(seeds) == 12
    for seed in seeds:
        with open(os.path.join(folder, hashlib.sha256(seed).hexdigest()), "wb") as file:
            file.write(seed)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else os.path.join(HERE, "seeds", "fuzz_wire"))
