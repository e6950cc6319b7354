#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The Python module's refusals: every bad argument must be named in the exception, and nothing may crash or leak.
Also tested: closed assets, interrupts, wrong threads, servers that are gone.
"""
import gc
import math
import os
import signal
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

umbrage, np = ut.need_module()
test = ut.Test()
ASSET = test.path("city.umb")
test.bake(test.scene("city", 8), ASSET, "--resolution", 1024, "--closed", "off", "--sun", "135,45", "--verify", 0)
asset = umbrage.open(ASSET)
low, high = (np.array(corner) for corner in asset.info.bounds)
P = (low + (high - low) * np.random.default_rng(1).random((64, 3))).astype(np.float32)
NAN, INF = float("nan"), float("inf")


def refused(call, *words, kinds=(TypeError, ValueError)):
    """The call must raise one of the kinds of exception, with the words in its message."""
    try:
        answer = call()
    except kinds as error:
        for word in words:
            assert word in str(error), (word, str(error))
        return error
    raise AssertionError(f"not refused: {words}: {answer!r:.100}")


BAD_QUERIES = [
    (dict(points=P.astype(int)), "points", "dtype int64"), (dict(points=P.astype(np.float16)), "points", "float16"),
    (dict(points=P.astype(">f4")), "points", "dtype"), (dict(points=P[:, :2]), "points", "(64, 2)"),
    (dict(points=P[::2]), "points", "contiguous"), (dict(points=np.asfortranarray(P)), "points", "contiguous"),
    (dict(points=np.float32(3)), "points"), (dict(points="abc"), "points"), (dict(points=None), "points"),
    (dict(points=[[1, 2]]), "points"), (dict(points=[[1, 2, "x"]]), "points"), (dict(points={}), "points"),
    (dict(points=[[1, 2, NAN]]), "points[0].z", "nan"), (dict(points=[[INF, 2, 3]]), "points[0].x", "inf"),
    (dict(normals=P[:5]), "normals", "(5, 3)"), (dict(normals=P.astype(float)), "normals", "float64"),
    (dict(normals=5), "normals"), (dict(footprints=P[:, 0].copy() * NAN, filter="footprint"), "footprint"),
    (dict(footprints=P), "footprints"), (dict(origin=(1, 2)), "origin"), (dict(origin=(1, 2, INF)), "origin"),
    (dict(origin="abc"), "origin"), (dict(taps=4), "taps"), (dict(taps=19), "taps", "17"), (dict(taps=-1), "taps"),
    (dict(taps=2.5), "taps"), (dict(taps="9"), "taps"), (dict(taps=[9]), "taps"), (dict(taps=2**40), "taps"),
    (dict(light=-1), "light"), (dict(light=1.5), "light"), (dict(light=None), "light"), (dict(filter="blur"), "filter"),
    (dict(filter=3), "filter"), (dict(bias="much"), "bias"), (dict(bias=-1), "bias"), (dict(bias=NAN), "bias"),
    (dict(bias=[1]), "bias"), (dict(bias=1, bias_unit="feet"), "bias_unit"), (dict(format="f64"), "format"),
    (dict(level=4), "level"), (dict(level=3, taps=3), "level"), (dict(eye=(1, 2)), "eye"),
    (dict(pixel_rad=-1), "pixel_rad"), (dict(pixel_rad="x"), "pixel_rad"), (dict(max_error=-1), "max_error"),
    (dict(max_error=1e-9), "max_error"), (dict(max_error=3, taps=9), "taps"), (dict(light_extent=9), "light_extent"),
    (dict(out=np.empty(3, np.float32)), "out", "(3,)"), (dict(out=np.empty(64)), "out", "float64"),
    (dict(out=[0] * 64), "out"), (dict(out=np.empty(128, np.float32)[::2]), "out", "contiguous"),
    (dict(threads=0), "threads"), (dict(threads=1.5), "threads"), (dict(threads=10**6), "threads"),
]

with test.check(f"{len(BAD_QUERIES)} bad queries are refused, and the exception names the argument"):
    for words, *said in BAD_QUERIES:
        refused(lambda: asset.query(**{"points": P, **words}), *said)
    fixed = np.empty(64, np.float32)
    fixed.flags.writeable = False
    refused(lambda: asset.query(P, out=fixed), "out", "read-only")
    refused(lambda: asset.query(P, tap=9), "tap", kinds=TypeError)

with test.check("a bad point in the middle of a large batch is named by its number, with threads too"):
    many = np.tile(P, (4000, 1))
    many[200001, 1] = NAN
    for threads in (1, 3):
        refused(lambda: asset.query(many, threads=threads), "points[200001].y")

with test.check("errors have a status and the class of their group"):
    missing = refused(lambda: asset.query(P, light=7), "light: 7", kinds=LookupError)
    assert isinstance(missing, umbrage.NotFoundError) and missing.status == "E_NOT_FOUND"
    refused(lambda: asset.query(P, light="moon"), "moon", kinds=umbrage.NotFoundError)
    assert refused(lambda: umbrage.open(test.path("none.umb")), "none.umb", kinds=OSError).status == "E_NO_INPUT"
    with open(test.path("bad.umb"), "wb") as file:
        file.write(b"no asset" * 1000)
    refused(lambda: umbrage.open(test.path("bad.umb")), kinds=umbrage.FormatError)
    for wrong in (None, 5, b"a\0b", "a\0b"):
        refused(lambda: umbrage.open(wrong))
    for words in (dict(token="x"), dict(headers={"a": "b"}), dict(id="00"), dict(bogus=1)):
        refused(lambda: umbrage.open(ASSET, **words), next(iter(words)), kinds=TypeError)
    refused(lambda: umbrage.open(ASSET, partial=True, id="zz"), "id")
    refused(lambda: umbrage.open(ASSET, partial=True, id="00" * 32), kinds=umbrage.FormatError)
    refused(lambda: umbrage.open(ASSET, partial=True, memory=10), kinds=umbrage.LimitError)
    refused(lambda: umbrage.open("tcp:127.0.0.1:1/city"), "127.0.0.1:1", kinds=ConnectionError)
    refused(lambda: umbrage.open("tcp:127.0.0.1:1"), "NAME")
    refused(lambda: umbrage.open("http://127.0.0.1:1/city.umb"), kinds=OSError)
    refused(lambda: umbrage.connect("carrier pigeon"), kinds=umbrage.ArgumentError)
    refused(lambda: umbrage.connect("tcp:h:1", timeout=NAN), "timeout")

with test.check("volume queries and maps refuse bad arguments by their names"):
    refused(lambda: asset.segments(P[:5]), "ends")
    refused(lambda: asset.segments(np.zeros((2, 2, 3)) * NAN), "nan")
    refused(lambda: asset.segments(np.zeros((2, 2, 3)), intervals=-1), "intervals")
    refused(lambda: asset.segments(np.zeros((2, 2, 3)), light=5), "light", kinds=LookupError)
    refused(lambda: asset.columns(P[:, :2]), "points")
    refused(lambda: asset.boxes(np.zeros((2, 3))), "boxes")
    refused(lambda: asset.boxes(np.array([[[1.0, 1, 1], [0, 2, 2]]])), "boxes[0]")
    refused(lambda: asset.derive(0, 16), "width")
    refused(lambda: asset.derive(16, 16, technique="magic"), "technique")
    refused(lambda: asset.derive(16, 16, rect=(1, 2)), "rect")
    refused(lambda: asset.derive(16, 16, cascades=2), "camera")
    refused(lambda: asset.explain((1, 2)), "point")
    refused(lambda: asset.explain((1, 2, 3), taps=4), "taps")
    refused(lambda: asset.fetch("x"), "views")
    refused(lambda: asset.fetch(progress=5), "progress")
    refused(lambda: asset.fetch(max_bytes=-1), "max_bytes")
    with umbrage.open(ASSET, partial=True) as part:
        refused(lambda: part.fetch(umbrage.View(box=((0, 0, 0),))), "box")
        refused(lambda: part.fetch(umbrage.View(eye=(0, 0, 0), fov_y=9.0)), "fov_y")
        refused(lambda: part.query(P, format="bit"), "format", kinds=umbrage.UnsupportedError)
        refused(lambda: part.boxes(np.zeros((1, 2, 3))), kinds=umbrage.UnsupportedError)

# Functions that take arrays: a call, the argument's name, a good array, and the word that C has for its records.
ENDS, BOXES = np.stack([P[:32], P[32:]], 1), np.stack([P[:32], P[:32] + np.float32(5)], 1).astype(np.float64)
ARRAYS = (("points", P, lambda on, array: on.query(array)), ("normals", P, lambda on, array: on.query(P, array)),
          ("footprints", np.abs(P[:, 0]), lambda on, array: on.query(P, footprints=array, filter="footprint")),
          ("points", P, lambda on, array: on.columns(array)), ("ends", ENDS, lambda on, array: on.segments(array)),
          ("boxes", BOXES, lambda on, array: on.boxes(array)))


def spoiled(good):
    """(array, words of its refusal): wrong dtypes, shapes, strides, and what is no array."""
    yield from ((good.astype(kind), "dtype") for kind in (np.int64, np.float16, ">f4", complex, bool))
    yield from ((bad, "") for bad in (5, "abc", object(), [["x"] * 3], [good.astype(object).tolist(), 1], {}))
    yield np.ma.masked_less(good, 0), "masked"
    yield from ((bad, "") for bad in (good[::2], good[..., None], good[..., :2] if good.ndim > 1 else good[:5]))
    if good.ndim > 1:
        yield np.asfortranarray(good), "contiguous"


with test.check("every function that takes arrays refuses wrong dtypes, shapes and strides by the argument's name"):
    for name, good, call in ARRAYS:
        call(asset, good)
        for bad, word in spoiled(good):
            refused(lambda: call(asset, bad), name, word)

with test.check("NaN and infinity are named by record and axis; a normal that is NaN is none"):
    for name, good, call in ARRAYS:
        for number in (NAN, INF, -INF):
            bad = good.copy()
            bad.reshape(-1)[7] = number
            if name == "normals":
                assert (call(asset, np.full_like(good, number)) == asset.query(P)).all()
            else:
                refused(lambda: call(asset, bad), name, "[", "nan" if number != number else "inf")

with test.check("arrays that may only be read are taken, and stay as they are"):
    for name, good, call in ARRAYS:
        fixed = good.copy()
        fixed.flags.writeable = False
        call(asset, fixed)
        assert (fixed == good).all(), name

with test.check("explain takes one light and settings of a query"):
    for words in (dict(bogus=1), dict(max_error=3.0), dict(stats=True), dict(light=[]), dict(light="all")):
        refused(lambda: asset.explain((1, 2, 3), **words), next(iter(words)))
    for bad in ((1, 2), (1, 2, NAN), "123", 5, None):
        refused(lambda: asset.explain(bad), "point")
    refused(lambda: asset.explain((1, 2, 3), (1, 2)), "normal")

with test.check("empty batches have empty answers"):
    none = np.empty((0, 3), np.float32)
    assert asset.query(none).shape == (0,) and asset.query(none, stats=True).exact.all()
    assert asset.segments(np.empty((0, 2, 3))).lit.shape == (0,) and asset.columns(none).lit.shape == (0,)
    assert asset.boxes(np.empty((0, 2, 3))).lit.shape == (0,)

with test.check("a closed asset refuses; closing twice and in a with statement is allowed; close waits for no query"):
    for kind in (lambda: umbrage.open(ASSET), lambda: umbrage.open(ASSET, partial=True)):
        gone = kind()
        with gone:
            gone.query(P)
        gone.close()
        for call in (lambda: gone.query(P), lambda: gone.query(P, max_error=9.0), lambda: gone.segments(ENDS), lambda: gone.columns(P),
                     lambda: gone.boxes(BOXES), lambda: gone.derive(16, 16), lambda: gone.explain((1, 2, 3)),
                     lambda: gone.fetch(umbrage.View()), gone.held):
            try:
                refused(call, "closed")
            except umbrage.UnsupportedError:
                assert isinstance(gone, umbrage.RangeAsset)  # it has no such answers, open or closed
    held = umbrage.open(ASSET)
    large = np.tile(P, (100000, 1))
    want, found = held.query(large, taps=17), []
    thread = threading.Thread(target=lambda: found.append(held.query(large, taps=17)))
    thread.start()
    time.sleep(0.02)
    held.close()
    was_busy = thread.is_alive()
    refused(lambda: held.query(P), "closed")
    thread.join()
    assert was_busy and (found[0] == want).all()

with test.check("Ctrl-C ends a long batch and a bake at once; the asset stays usable"):
    def interrupted(call, after_s=0.3):
        pid = os.getpid()
        threading.Timer(after_s, lambda: os.kill(pid, signal.SIGINT)).start()
        begin = time.monotonic()
        try:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            call()
        except KeyboardInterrupt:
            return time.monotonic() - begin
        raise AssertionError("ended before the interrupt")

    def long_query(threads):
        while True:  # batches as long as the machine needs to be met in the middle of one
            asset.query(large, taps=17, threads=threads)

    for threads in (1, 2):
        assert interrupted(lambda: long_query(threads)) < 60
    folder = sorted(os.listdir(test.folder))
    interrupted(lambda: umbrage.bake(test.scene("city", 8), test.path("never.umb"), program=ut.program("umbrage-bake"),
                                     resolution=1024, verify=10**9))
    assert sorted(os.listdir(test.folder)) == folder
    assert asset.query(P).shape == (64,)

with test.check("Ctrl-C ends volume queries, maps and the choice by a budget too"):
    def repeated(call):
        end = time.monotonic() + 20
        while time.monotonic() < end:
            call()

    ends, boxes = np.tile(np.stack([P[:32], P[32:]], 1), (3000, 1, 1)), np.tile(np.array([[low, high]]), (50, 1, 1))
    for call in (lambda: asset.segments(ends), lambda: asset.columns(large), lambda: asset.boxes(boxes),
                 lambda: asset.derive(2048, 2048), lambda: asset.query(large[:200000], budget=1e6)):
        for _ in range(3):
            assert interrupted(lambda: repeated(call), 0.1) < 10

with test.check("what a callback raises reaches the caller"):
    class Mine(Exception):
        pass

    def fail(*_):
        raise Mine("mine")

    box = umbrage.View(box=(tuple(low), tuple(high)))
    with umbrage.open(ASSET, partial=True) as part:
        refused(lambda: part.fetch(box, progress=fail), "mine", kinds=Mine)
        assert part.fetch(box).pages_held > 0
    refused(lambda: umbrage.bake(test.scene("city", 8), test.path("no.umb"), program=ut.program("umbrage-bake"),
                                 resolution=256, verify=10**9, progress=fail), "mine", kinds=Mine)
    refused(lambda: umbrage.bake(test.path("none.obj"), test.path("no.umb"), program=ut.program("umbrage-bake")),
            "none.obj", kinds=umbrage.FileError)
    refused(lambda: umbrage.bake("x", "y", program="/nonexistent"), "nonexistent", kinds=OSError)
    path, os.environ["PATH"] = os.environ["PATH"], "/nonexistent"
    refused(lambda: umbrage.bake("x", "y"), "install the package umbrage-bake", kinds=umbrage.FileError)
    os.environ["PATH"] = path
    refused(lambda: umbrage.bake(test.scene("city", 8), test.path("no.umb"), program=ut.program("umbrage-bake"),
                                 resolution=100), "resolution", kinds=umbrage.Error)
    assert not os.path.exists(test.path("no.umb"))

with test.check("nothing leaks: memory stands still over a thousand assets and failures"):
    def resident():
        gc.collect()
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    def round_of(number):
        for _ in range(number):
            one = umbrage.open(ASSET)
            one.query(P, taps=9, stats=True)
            for bad in (dict(taps=4), dict(points=P[:, :2]), dict(points=[[NAN, 0, 0]])):
                refused(lambda: one.query(**{"points": P, **bad}))
            one.derive(16, 16)
            del one  # without close
            with umbrage.open(ASSET, partial=True) as part:
                part.query(P, stats=True)

    round_of(100)
    before = resident()
    round_of(500)
    grown = resident() - before
    assert grown < 8 << 20, f"{grown >> 10} KiB more"
    assert math.isfinite(asset.info.lights[0].extent)

test.finish()
