#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The same query gives the same answers everywhere: 100 000 points give the same bits from the packed
and the mapped file, from the daemon in calls of 1, 7, 1024 and 65536 points, and after splitting in
any way. A window of n x n is exactly the mean of n x n single look-ups.
"""
import os
import random
import sys
import threading

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
test = ut.Test()
M = test.messages.shadows
SEED = 77
COUNT = 100000
print(f"seed {SEED}")

store = test.path("store")
os.mkdir(store)
packed = store + "/city.umb"
mapped = test.path("city.umbm")
baked = test.bake(test.scene("city", 20), packed, "--resolution", 1024, "--verify", 0)
opened = test.bake(test.scene("arch", 3), store + "/arch.umb", "--resolution", 1024, "--verify", 0)
ut.run("umbrage", "unpack", packed, "-o", mapped, "--quiet")
daemon = test.daemon("--workers", 3)
client = test.client(daemon.grpc_unix)
about = client.describe(M.DescribeRequest(asset="city"), timeout=30)
points = ut.random_points(about.bounds_min, about.bounds_max, COUNT, SEED)
normals = ut.random_normals(COUNT, SEED)
data = ut.floats(points)
ndata = ut.floats(normals)
mixed = ut.floats(ut.interleave(points, normals))
TAPS = 5
expected = test.query_file(packed, mixed, "--taps", TAPS, "--normals")
assert len(expected) == 4 * COUNT, f"{len(expected)} bytes for {COUNT} answers"
assert len(set(ut.from_floats(expected))) > 10, "too even to test"


def part(first, count, **how):
    """Answers of the daemon for some of the points."""
    request = M.QueryRequest(asset="city", points=data[12 * first:12 * (first + count)],
                             normals=ndata[12 * first:12 * (first + count)], taps=TAPS,
                             format=M.ANSWER_F32)
    return client.query.future(request, timeout=60, **how)


def in_calls(size, total):
    """Answers of the daemon in calls of that many points, 64 under way at once."""
    out = []
    waiting = []
    for first in range(0, total, size):
        waiting.append(part(first, min(size, total - first)))
        if len(waiting) == 64:
            out.append(waiting.pop(0).result().visibility)
    return b"".join(out + [call.result().visibility for call in waiting])


with test.check("packed and mapped file agree"):
    assert test.query_file(mapped, mixed, "--taps", TAPS, "--normals") == expected
    for taps in (1, 17):
        assert test.query_file(mapped, data, "--taps", taps) == test.query_file(packed, data,
                                                                                "--taps", taps)
with test.check("the mapped form has the packed form's id and packs to the same bytes"):
    again = test.path("again.umb")
    ut.run("umbrage", "pack", mapped, "-o", again, "--quiet")
    with open(packed, "rb") as one, open(again, "rb") as other:
        assert one.read() == other.read()
with test.check("batches of the command line do not change the file's answers"):
    for batch in (8, 1000, 65536, 1 << 20):
        assert test.query_file(packed, mixed, "--taps", TAPS, "--normals", "--batch",
                               batch) == expected
with test.check("the daemon agrees in calls of 65536, 1024 and 7 points"):
    for size, total in ((65536, COUNT), (1024, COUNT), (7, 30000)):
        assert in_calls(size, total) == expected[:4 * total], f"calls of {size}"
with test.check("the daemon agrees in calls of one point"):
    assert in_calls(1, 2000) == expected[:8000]
with test.check("the daemon agrees after splitting in any way, asked from several threads"):
    rng = random.Random(SEED)
    cuts = sorted({0, COUNT, *(rng.randrange(COUNT) for _ in range(60))})
    wrong = []

    def ask(pairs):
        for first, end in pairs:
            if part(first, end - first).result().visibility != expected[4 * first:4 * end]:
                wrong.append((first, end))

    pairs = list(zip(cuts, cuts[1:]))
    rng.shuffle(pairs)
    threads = [threading.Thread(target=ask, args=(pairs[i::4],)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong, wrong
with test.check("`umbrage query` gives the daemon's answers with the file's bits"):
    for words in ((), ("--batch", 1024)):
        got = test.query_file("city", mixed, "--taps", TAPS, "--normals", "--address", daemon.tcp,
                              *words)
        assert got == expected, words
with test.check("the daemon agrees on tents, penumbras and footprints"):
    sides = ut.floats([0.001 * (i % 4000) for i in range(4000)])
    sides_file = test.path("sides.f32")
    with open(sides_file, "wb") as file:
        file.write(sides)
    near = client.describe(M.DescribeRequest(asset="arch"), timeout=30)
    some = ut.random_points(near.bounds_min, near.bounds_max, 4000, SEED)
    single = ut.floats(some)
    for words, fields in ((("--filter", "tent"), {"filter": M.FILTER_TENT}),
                          (("--filter", "gaussian"), {"filter": M.FILTER_GAUSSIAN}),
                          (("--filter", "penumbra"), {"filter": M.FILTER_PENUMBRA}),
                          (("--filter", "penumbra", "--light-size", 11.25),
                           {"filter": M.FILTER_PENUMBRA,
                            "light_extent": 11.25 * 0.017453292519943295}),
                          (("--filter", "footprint", "--footprint", 1.5),
                           {"filter": M.FILTER_FOOTPRINT, "footprint_m": 1.5}),
                          (("--filter", "footprint", "--eye", "20,30,40", "--pixel", 0.03),
                           {"filter": M.FILTER_FOOTPRINT, "eye": (20, 30, 40), "pixel_rad": 0.03}),
                          (("--filter", "footprint", "--footprints", sides_file),
                           {"filter": M.FILTER_FOOTPRINT, "footprints": sides})):
        from_file = test.query_file(store + "/arch.umb", single, "--taps", 3, *words)
        assert len(set(ut.from_floats(from_file))) > 5, words
        for count in (16, 4000):
            cut = dict(fields)
            if "footprints" in cut:
                cut["footprints"] = sides[:4 * count]
            request = M.QueryRequest(asset="arch", points=single[:12 * count], taps=3,
                                     format=M.ANSWER_F32, **cut)
            assert client.query(request, timeout=60).visibility == from_file[:4 * count], words
        assert test.query_file("arch", single, "--taps", 3, "--address", daemon.tcp,
                               *words) == from_file, words
with test.check("text points and answers lose nothing that floats hold"):
    lines = "".join(" ".join(f"{v:.9g}" for v in ut.from_floats(data[12 * i:12 * i + 12])) + " "
                    + " ".join(f"{v:.9g}" for v in ut.from_floats(ndata[12 * i:12 * i + 12])) + "\n"
                    for i in range(20000))
    done = ut.run("umbrage", "query", packed, "--points", "-", "--taps", TAPS, "--quiet",
                  stdin=lines.encode())
    want = ["%.9g" % v for v in ut.from_floats(expected[:80000])]
    # The command reads text as doubles and converts floats to doubles. The numbers would be the
    # same only if %.9g were exact: the nearest decimal moves a point by 1e-9 of its coordinate, so
    # a few points may fall into another voxel.
    got = done.stdout.decode().split()
    different = sum(a != b for a, b in zip(want, got))
    assert len(got) == 20000 and different <= 20, different
with test.check("text points with all digits give the same answers"):
    lines = "".join("%.17g %.17g %.17g\n" % tuple(ut.from_floats(data[12 * i:12 * i + 12]))
                    for i in range(20000))
    done = ut.run("umbrage", "query", packed, "--points", "-", "--quiet", stdin=lines.encode())
    want = test.query_file(packed, data[:240000])
    assert [float(v) for v in done.stdout.split()] == list(ut.from_floats(want))
with test.check("floats beside an origin and the same doubles agree"):
    origin = (84616.468, 447422.999, -3.25)
    wide = [a + b for a, b in zip(ut.from_floats(data), origin * COUNT)]
    moved = [-v for v in origin]
    # The daemon adds the origin in doubles, and so does the reader of files: both compute the same
    # sums.
    text = ",".join(repr(v) for v in moved)
    one = test.query_file(packed, ut.floats(wide, "d"), "--origin", text, form="f64")
    other = client.query(M.QueryRequest(asset="city", points_f64=ut.floats(wide, "d"), origin=moved,
                                        format=M.ANSWER_F32), timeout=60).visibility
    assert one == other


def mean_of_lookups(name, path, count):
    """Compares n x n windows with n x n single look-ups, moved by whole voxels and by no bias."""
    frame = voxel_frame(path)
    rng = random.Random(SEED)
    size = frame["size"]
    tried = [[rng.randrange(-4, size + 4) for _ in range(2)] + [rng.randrange(size)]
             for _ in range(20 * count)]

    def at(cell, dx=0, dy=0):
        u = [cell[0] + dx + 0.5, cell[1] + dy + 0.5, cell[2] + 0.5]
        return [frame["corner"][k] + sum(u[a] * frame["step"][a][k] for a in range(3))
                for k in range(3)]

    def lookup(values, taps):
        wide = ut.floats([v for point in values for v in point], "d")
        return ut.from_floats(test.query_file(path, wide, "--taps", taps, "--bias", "none",
                                              form="f64"))

    # Half of the points have a boundary within the window, half are anywhere.
    seen = lookup([at(cell) for cell in tried], 9)
    cells = [cell for cell, value in zip(tried, seen) if 0 < value < 1][:count // 2]
    cells += tried[:count - len(cells)]
    rng.shuffle(cells)
    for taps in (3, 9, 17):
        half = taps // 2
        chosen = cells if taps < 17 else cells[:count // 4]
        windows = lookup([at(cell) for cell in chosen], taps)
        totals = [0.0] * len(chosen)
        for dy in range(-half, half + 1):
            singles = lookup([p for cell in chosen
                              for p in (at(cell, dx, dy) for dx in range(-half, half + 1))], 1)
            for i in range(len(chosen)):
                totals[i] += sum(singles[taps * i:taps * (i + 1)])
        # Counts are whole numbers; the answer is the float nearest to count / n^2.
        want = ut.from_floats(ut.floats(total / (taps * taps) for total in totals))
        bad = [i for i in range(len(chosen)) if want[i] != windows[i]]
        assert not bad, f"{name} {taps} x {taps}: {len(bad)} of {len(chosen)}, cell " \
                        f"{chosen[bad[0]]}: {windows[bad[0]]}, mean {want[bad[0]]}"
        inner = sum(0 < w < 1 for w in windows)
        assert inner > len(chosen) // 20, f"only {inner} windows see a boundary"


def voxel_frame(path):
    """Finds where voxels lie: --explain prints a point's voxel coordinates, and four points give
    the frame."""
    import json
    info = json.loads(ut.run("umbrage", "info", path, "--json").stdout)
    bounds = info["bounds"]
    low, high = bounds["min"], bounds["max"]
    size = 1024
    probes = [[(a + b) / 2 for a, b in zip(low, high)]]
    for axis in range(3):
        probes.append(list(probes[0]))
        probes[-1][axis] += (high[axis] - low[axis]) / 4
    done = ut.run("umbrage", "query", path, "--points", "-", "--bias", "none", "--explain",
                  "--json", stdin="".join("%.17g %.17g %.17g\n" % tuple(p) for p in probes).encode())
    voxels = [item["voxel"] for item in json.loads(done.stdout)["explanations"]]
    # Linear map world -> voxel: columns from differences, then inverted.
    forward = [[(voxels[1 + axis][k] - voxels[0][k]) / ((high[axis] - low[axis]) / 4)
                for axis in range(3)] for k in range(3)]
    inverse = invert(forward)
    corner = [probes[0][k] - sum(inverse[k][a] * voxels[0][a] for a in range(3)) for k in range(3)]
    return {"corner": corner, "size": size,
            "step": [[inverse[k][a] for k in range(3)] for a in range(3)]}


def invert(m):
    cofactors = [[m[(r + 1) % 3][(c + 1) % 3] * m[(r + 2) % 3][(c + 2) % 3]
                  - m[(r + 1) % 3][(c + 2) % 3] * m[(r + 2) % 3][(c + 1) % 3]
                  for c in range(3)] for r in range(3)]
    det = sum(m[0][c] * cofactors[0][c] for c in range(3))
    return [[cofactors[c][r] / det for c in range(3)] for r in range(3)]


with test.check("a window of n x n is the mean of n x n look-ups (closed city)"):
    assert baked["closed"]
    mean_of_lookups("city", packed, 2000)
with test.check("a window of n x n is the mean of n x n look-ups (open architecture)"):
    assert not opened["closed"]
    mean_of_lookups("arch", store + "/arch.umb", 2000)
client.close()
test.finish()
