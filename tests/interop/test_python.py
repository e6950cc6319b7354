#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The Python module must give the same bits as the command line for every setting, from a file, its ranges, a web
server and a daemon. Also tested: volume queries, lights, derived maps, bakes and jobs; points are not copied, and
other threads run meanwhile.
"""
import http.server
import json
import os
import shutil
import subprocess
import sys
import threading

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

umbrage, np = ut.need_module()
test = ut.Test()
store = test.path("store")
os.mkdir(store)
scene = test.scene("city", 8)
CITY = f"{store}/city.umb"
test.bake(scene, CITY, "--resolution", 1024, "--closed", "off", "--sun", "135,45", "--sun", "200,30", "--verify", 0)
test.bake(scene, f"{store}/lamp.umb", "--resolution", 256, "--point", "10,30,10", "--closed", "off", "--verify", 0)
daemon = test.daemon("--workers", 2, "--jobs", test.path("jobs"))
rng = np.random.default_rng(3)
city = umbrage.open(CITY)
low, high = (np.array(corner) for corner in city.info.bounds)
points = (low + (high - low) * rng.random((3000, 3))).astype(np.float32)
normals = rng.normal(size=(3000, 3)).astype(np.float32)


def by_command(asset, *options, encoding="f32"):
    """Answers of `umbrage query` for the points."""
    return test.query_file(asset, points.tobytes(), *options, encoding=encoding)


SETTINGS = [({}, ()), ({"taps": 9}, ("--taps", 9)), ({"taps": 17, "light": 1}, ("--taps", 17, "--light", 1)),
            ({"taps": 5, "filter": "tent"}, ("--taps", 5, "--filter", "tent")),
            ({"taps": 9, "filter": "gaussian"}, ("--taps", 9, "--filter", "gaussian")),
            ({"filter": "penumbra", "taps": 3}, ("--filter", "penumbra", "--taps", 3)),
            ({"filter": "footprint", "footprint_m": 4.0, "taps": 9},
             ("--filter", "footprint", "--footprint", "4", "--taps", 9)),
            ({"level": 3}, ("--level", 3)), ({"bias": "none"}, ("--bias", "none")),
            ({"bias": 0.5, "taps": 3}, ("--bias", "0.5m", "--taps", 3)),
            ({"bias": 2, "bias_unit": "voxels"}, ("--bias", "2vox"))]

with test.check("the same bits as `umbrage query` for every setting"):
    for words, options in SETTINGS:
        assert city.query(points, **words).tobytes() == by_command(CITY, *options), words
    for form in ("u8", "bit"):
        assert city.query(points, taps=9, format=form).tobytes() == by_command(CITY, "--taps", 9, encoding=form), form

# The web package on the same file: prints the answers of a setting, for each of the settings on stdin.
WEB = os.path.join(ut.BUILD, "web", "umbrage")
WEB_SCRIPT = """
import { readFileSync } from "node:fs";
const [library, file, floats, settings] = process.argv.slice(1);
const umbrage = await import(library);
const asset = await umbrage.open(file);
await asset.want({});
const points = new Float32Array(Uint8Array.from(readFileSync(floats)).buffer);
for (const words of JSON.parse(settings)) {
  const { values } = await asset.query(points, words);
  console.log(Buffer.from(values.buffer, values.byteOffset, values.byteLength).toString("hex"));
}
"""
if shutil.which("node") and os.path.exists(os.path.join(WEB, "umbrage.wasm")):
    with test.check("one file: module, command, daemon and web package answer with the same bits"):
        points.tofile(test.path("web.f32"))
        shared = [(words, options) for words, options in SETTINGS if "bias" not in words and "footprint_m" not in words]
        done = subprocess.run(["node", "--no-warnings", "--input-type=module", "-e", WEB_SCRIPT, os.path.join(WEB, "index.js"), CITY,
                               test.path("web.f32"), json.dumps([words for words, _ in shared])],
                              stdout=subprocess.PIPE, check=True, text=True, timeout=300)
        lines = done.stdout.split()
        assert len(lines) == len(shared) > 5
        with umbrage.connect(daemon.grpc_unix) as there, there.open("city") as far:
            for (words, options), line in zip(shared, lines):
                want = by_command(CITY, *options)
                assert bytes.fromhex(line) == want == city.query(points, **words).tobytes() == far.query(points, **words).tobytes(), words
                assert test.query_file("city", points.tobytes(), *options, "--address", daemon.tcp) == want, words
else:
    ut.left_out("the web package beside the module", "node is not installed, or the package is not built (make web)")

with test.check("the same bits for floats and doubles, shapes, threads, slices and a given array"):
    want = city.query(points, normals, taps=9)
    assert (city.query(points.astype(np.float64), normals, taps=9) == want).all()
    assert (city.query(points.reshape(30, 100, 3), normals.reshape(30, 100, 3), taps=9).ravel() == want).all()
    COPIES = 400
    many = np.tile(points, (COPIES, 1))  # several slices, on one thread and on two also long ones
    out = np.full(len(many), -1, np.float32)
    for threads in (1, 2, 3):
        assert city.query(many, np.tile(normals, (COPIES, 1)), taps=9, threads=threads, out=out) is out
        assert (out == np.tile(want, COPIES)).all()
    result = city.query(many, taps=9, threads=2, stats=True)
    assert result.stats.points == len(many) and result.exact.all() and result.bound_m > 0 and result.taps == 9
    bits = city.query(many, np.tile(normals, (COPIES, 1)), taps=9, format="bit", threads=2)
    assert (np.unpackbits(bits, bitorder="little")[:len(many)] == (np.tile(want, COPIES) >= 0.5)).all()
    origin = np.array([1e6, -2e6, 100.0])
    assert city.query(points.astype(np.float64) - origin, origin=origin).shape == (3000,)

with test.check("several lights put an axis first; a name chooses one"):
    both = city.query(points, light="all", taps=3)
    assert both.shape == (2, 3000)
    for number in range(2):
        assert (both[number] == city.query(points, light=number, taps=3)).all()
    assert (city.query(points, light=[1], taps=3)[0] == both[1]).all()
    results = city.query(points, light=[0, 1], taps=3, stats=True)
    assert [one.stats.points for one in results] == [3000, 3000]

with test.check("the dial chooses as the command does"):
    for limit in (3.0, 4.0, 8.0):
        chosen = city.query(points, max_error=limit, stats=True)
        assert chosen.bound_m <= limit, (limit, chosen.bound_m)
        assert chosen.values.tobytes() == by_command(CITY, "--max-error", limit), limit
    assert city.query(points, budget=1e6, stats=True).taps >= 1

with test.check("info is plain data and agrees with `umbrage info --json`"):
    told = json.loads(ut.run("umbrage", "info", CITY, "--json").stdout)
    plain = json.loads(json.dumps(city.info.as_dict()))
    assert plain["id"] == told["asset"] == city.id and len(plain["lights"]) == len(told["lights"]) == 2
    assert plain["lights"][0]["resolution"] == 1024 and plain["lights"][0]["kind"] == "directional"
    assert len(plain["lights"][0]["curve"]) > 3

with test.check("a range asset answers within its bounds at once, and with the file's bits when a view was fetched"):
    want = city.query(points, taps=9)
    with umbrage.open(CITY, partial=True, id=city.id) as part:
        first = part.query(points, taps=9, stats=True)
        assert (first.low <= want).all() and (want <= first.high).all() and not first.exact.all()
        assert (first.values[first.exact] == want[first.exact]).all() and (first.error_m[~first.exact] > 0).all()
        told = []
        held = part.fetch(umbrage.View(box=(tuple(low), tuple(high)), taps=9), progress=lambda now: told.append(now))
        assert held.pages_held == held.pages > 0 and told
        assert (part.query(points, taps=9) == want).all()
    with umbrage.open(CITY, partial=True) as part:
        while not part.query(points, stats=True).exact.all():
            before = part.held().pages_held
            assert part.fetch().pages_held > before  # what the query missed
        assert (part.query(points) == city.query(points)).all()


class Ranges(http.server.BaseHTTPRequestHandler):
    """A web server with ranges; /moved redirects, /whole ignores ranges, /short cuts them."""
    protocol_version = "HTTP/1.1"

    def do_GET(self):
        if self.path == "/moved":
            self.send_response(302)
            self.send_header("Location", "/city.umb")
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        with open(CITY, "rb") as file:
            data = file.read()
        begin, end = (int(word) for word in self.headers["Range"].removeprefix("bytes=").split("-"))
        part = data[begin:end + 1]
        if self.path == "/lies":
            part = bytes(len(part))
        self.send_response(200 if self.path == "/whole" else 206 if part else 416)
        self.send_header("Content-Length", str(len(part)))
        self.end_headers()
        self.wfile.write(part)

    def log_message(self, *_):
        pass


server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Ranges)
threading.Thread(target=server.serve_forever, daemon=True).start()
SITE = f"http://127.0.0.1:{server.server_port}"

with test.check("over HTTP the same; a server that lies, ignores ranges or has nothing is named"):
    for path in ("/city.umb", "/moved"):
        with umbrage.open(SITE + path, id=city.id) as site:
            site.fetch(umbrage.View(box=(tuple(low), tuple(high)), taps=9))
            assert (site.query(points, taps=9) == want).all()
            assert site.held().requests > 1
    for path, kind, word in (("/whole", OSError, "ignores ranges"), ("/lies", umbrage.FormatError, "magic")):
        try:
            umbrage.open(SITE + path)
            raise AssertionError(path)
        except kind as error:
            assert word in str(error), error

PLACE = daemon.grpc_unix
with test.check("over a daemon the same bits, volume queries too"):
    with umbrage.open(f"{PLACE}/city") as far:
        assert far.info == city.info
        for words, _ in SETTINGS:
            assert (far.query(points, normals, **words) == city.query(points, normals, **words)).all(), words
        for form in ("u8", "bit"):
            assert (far.query(points, taps=9, format=form) == city.query(points, taps=9, format=form)).all()
        told = far.query(points, taps=9, stats=True)
        assert told.stats.points == 3000 and told.asset_id == city.id and told.nanoseconds > 0
        assert far.query(points, max_error=3.0, stats=True).bound_m <= 3.0
        ends = np.stack([points[:200], points[200:400]], 1)
        near, there = city.segments(ends, intervals=6), far.segments(ends, intervals=6)
        assert (near.lit == there.lit).all() and (near.interval_counts == there.interval_counts).all()
        assert np.array_equal(near.intervals, there.intervals, equal_nan=True) and near.interval_counts.max() > 1
        assert (near.lit >= 0).all() and (near.lit <= 1).all() and (near.lit_m >= 0).all()
        assert (city.columns(points).distance_m == far.columns(points).distance_m).all()
        boxes = np.stack([points[:50], points[:50] + np.float32(20)], 1).astype(np.float64)
        assert (city.boxes(boxes).lit == far.boxes(boxes).lit).all() and city.boxes(boxes).voxels.max() > 0
    with umbrage.connect(PLACE) as there:
        assert [one.name for one in there.assets()] == ["city", "lamp"] and there.assets()[0].id == city.id
        with there.open_ranges("city") as part:
            part.fetch(umbrage.View(box=(tuple(low), tuple(high)), taps=9))
            assert (part.query(points, taps=9) == want).all()

TINY = test.daemon("--max-points", 700, store=store).grpc_unix
with test.check("batches larger than the server's limit are cut into calls: the same bits, sums and numbers of bad points"):
    with umbrage.open(f"{TINY}/city") as far:
        for form in ("f32", "u8", "bit"):
            assert (far.query(points, normals, taps=9, format=form) ==
                    city.query(points, normals, taps=9, format=form)).all(), form
        assert (far.query(points.astype(np.float64), taps=3) == city.query(points, taps=3)).all()
        told, whole = (asset.query(points, taps=9, stats=True).stats for asset in (far, city))
        assert told.points == 3000 and told.nodes > 10000, told  # neighbours in a call share nodes
        assert (told.outside, told.before, told.behind) == (whole.outside, whole.before, whole.behind)
        chosen = far.query(points, max_error=3.0, stats=True)
        assert chosen.taps > 0 and (chosen.values == city.query(points, max_error=3.0)).all()
        near, there = city.segments(ends, intervals=6), far.segments(ends, intervals=6)
        assert (near.lit == there.lit).all() and np.array_equal(near.intervals, there.intervals, equal_nan=True)
        near, there = city.segments(ends, intervals=300), far.segments(ends, intervals=300)
        assert np.array_equal(near.intervals, there.intervals, equal_nan=True)
        assert (city.columns(points).distance_m == far.columns(points).distance_m).all()
        assert (city.boxes(boxes).lit == far.boxes(boxes).lit).all()
        bad = points.copy()
        bad[2500, 1] = np.nan
        for call in (lambda: far.query(bad), lambda: far.columns(bad)):
            try:
                call()
                raise AssertionError("not refused")
            except ValueError as error:
                assert "points[2500].y" in str(error), error

with test.check("an interval's sum is the lit share; a column's occluder lies where the segment ends"):
    sums = np.nansum(near.intervals[:, :, 1] - near.intervals[:, :, 0], 1)
    whole = near.interval_counts <= 6
    assert np.allclose(sums[whole], near.lit[whole], atol=1e-12)

with test.check("derived maps are arrays, and a KTX 2.0 file with the same texels"):
    maps = city.derive(128, 64, technique="vsm", mips=False)
    assert maps.levels[0][0].shape == (64, 128, 2) and maps.levels[0][0].dtype == np.float32
    assert maps.ktx2[:7] == b"\xabKTX 20" and maps.levels[0][0].tobytes() in maps.ktx2
    chain = city.derive(64, 64, technique="evsm", format="f16", mips=True)
    assert [level.shape[0] for level in chain.levels[0]] == [64, 32, 16, 8, 4, 2, 1]
    camera = umbrage.Camera(tuple((low + high) / 2), (0.0, 1.0, 0.0))
    parts = city.derive(64, 64, camera=camera, cascades=3)
    assert len(parts.levels) == 3 and len(parts.splits) == 4 and parts.world_to_map.shape == (3, 4, 4)

with test.check("explain tells the answer that query gives"):
    for i in range(20):
        told = city.explain(points[i].astype(float), taps=9)
        assert abs(told["answer"] - float(want[i])) < 1e-6 and told["taps"] == 9 and told["steps"]

with test.check("bake makes the asset that the command makes, and tells its progress"):
    told = []
    report = umbrage.bake(scene, test.path("own.umb"), program=ut.program("umbrage-bake"), progress=told.append,
                          resolution=1024, closed="off", sun=[(135, 45.0), "200,30"], verify=0)
    assert report["asset"] == city.id and report["plan"]
    assert [one.phase for one in told if not one.total][:3] == ["import", "analysis", "bake"]

with test.check("a job is submitted, watched, fetched; the asset answers"):
    with umbrage.connect(PLACE) as there:
        job = there.submit(scene, {"resolution": 512, "sun": "100,50", "verify": 0})
        told = list(there.watch(job))
        assert told[-1].state == "done" and told[-1].is_over, told[-1]
        assert there.submit(scene, {"resolution": 512, "sun": (100, 50), "verify": 0}) == job
        assert any(one.job == job for one in there.jobs())
        there.fetch(told[-1].asset, test.path("fetched.umb"))
        with umbrage.open(test.path("fetched.umb")) as fetched:
            assert fetched.id == told[-1].asset
            with there.open(told[-1].asset) as far:
                assert (far.query(points) == fetched.query(points)).all()
        before = sorted(os.listdir(test.folder))
        try:
            there.fetch(told[-1].asset, test.path("large.umb"), max_bytes=100)
            raise AssertionError("not refused")
        except umbrage.LimitError as error:
            assert "max_bytes is 100" in str(error), error
        assert sorted(os.listdir(test.folder)) == before
        there.delete(told[-1].asset)
        assert there.wait(job).state == "done"

with test.check("points are not copied, and other threads run during a query"):
    import resource
    big = np.tile(points, (700, 1))
    out = np.empty(len(big), np.float32)
    city.query(big, out=out)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    ticks, going = [0], [True]

    def tick():
        while going[0]:
            ticks[0] += 1

    ticker = threading.Thread(target=tick)
    ticker.start()
    city.query(big, taps=9, out=out)
    going[0] = False
    ticker.join()
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < big.nbytes / 1024 / 4, f"{grown} KiB more for {big.nbytes >> 10} KiB of points"
    assert ticks[0] > 100, ticks

city.close()
test.finish()
