#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The Python module under hostile use, each case in a process of its own: closes while calls run and from callbacks,
interrupts at any moment, forks, exits with open handles; web servers that stall, redirect or cut; readers that lie.
"""
import os
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

umbrage, np = ut.need_module()
test = ut.Test()
store = test.path("store")
os.mkdir(store)
ASSET = f"{store}/city.umb"
test.bake(test.scene("city", 8), ASSET, "--resolution", 1024, "--closed", "off", "--sun", "135,45", "--sun", "200,30",
          "--verify", 0)
daemon = test.daemon("--workers", 1, "--jobs", test.path("jobs"))
HEAD = f'''
import faulthandler, gc, http.server, os, signal, sys, threading, time
faulthandler.enable()
faulthandler.dump_traceback_later(100, exit=True)
sys.path.insert(0, {os.path.join(ut.BUILD, "python")!r})
import numpy as np
import umbrage
ASSET, PLACE, SCENE, BAKE = {ASSET!r}, {daemon.grpc_unix!r}, {test.scene("city", 8)!r}, {ut.program("umbrage-bake")!r}
with umbrage.open(ASSET) as first:
    ID, (low, high) = first.id, first.info.bounds
P = np.random.default_rng(1).uniform(low, high, (64, 3)).astype(np.float32)
BOX = umbrage.View(box=(low, high))


def refused(call, word, kinds=(TypeError, ValueError, umbrage.Error)):
    try:
        answer = call()
    except kinds as error:
        assert word in str(error), (word, repr(error))
        return error
    raise AssertionError(f"not refused: {{word}}: {{answer!r:.100}}")


def serve(do_get):
    """A web server; returns its port, and the list of what it was asked."""
    asked = []
    class Handler(http.server.BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        def do_GET(self):
            asked.append((self.path, dict(self.headers)))
            try:
                do_get(self)
            except OSError:
                self.close_connection = True
        def log_message(self, *_):
            pass
        def handle(self):
            try:
                super().handle()
            except OSError:
                pass
        def part(self):
            begin, end = (int(word) for word in self.headers["Range"].removeprefix("bytes=").split("-"))
            with open(ASSET, "rb") as file:
                return file.read()[begin:end + 1]
        def reply(self, status, data=b"", **headers):
            self.send_response(status)
            for name, value in {{"Content-Length": str(len(data)), **headers}}.items():
                self.send_header(name.replace("_", "-"), value)
            self.end_headers()
            self.wfile.write(data)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server.server_port, asked
'''


def runs(sentence, body, limit=120):
    """The script ends well, and says nothing."""
    with test.check(sentence):
        done = subprocess.run([sys.executable, "-c", HEAD + body], cwd=test.folder, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, timeout=limit)
        assert done.returncode == 0 and not done.stdout, (done.returncode, done.stdout[-1500:])


runs("one point and several lights; an axis of one light", '''
asset = umbrage.open(ASSET)
both = asset.query(P[0], light="all")
assert both.shape == (2,) and both[1] == asset.query(P[0], light=1)
assert asset.query(P[0], light=[1], stats=True)[0].values == both[1]
assert asset.explain(P[0], light=asset.lights[1].name)["answer"] == both[1]
''')

runs("arguments that Python itself would refuse are named too", '''
asset = umbrage.open(ASSET)
asset.query(P, taps=9)
huge = 10**400
for words, word in (
        (dict(taps=9.0), "taps"), (dict(taps=np.array([9])), "taps"), (dict(taps=int), "taps"), (dict(level=0.0), "level"),
        (dict(eye=5), "eye"), (dict(eye="123"), "eye"), (dict(origin="123"), "origin"), (dict(origin=(0, 0, huge)), "origin"),
        (dict(bias=huge), "bias"), (dict(pixel_rad="1"), "pixel_rad"), (dict(light_extent=huge), "light_extent"),
        (dict(light=np.array(0.5)), "light"), (dict(light={}), "light"), (dict(light=2**64), "light"),
        (dict(max_error=np.array([1, 2])), "max_error"), (dict(budget="x"), "budget"), (dict(max_visibility=huge), "max_visibility"),
        (dict(max_error=4.0, taps=1), "taps"), (dict(budget=1e6, points=P * np.nan), "points[0].x"),
        (dict(threads=1.0), "threads"), (dict(points=np.ma.masked_less(P, 0)), "points"),
        (dict(format=np.array([1])), "format"), (dict(filter=[]), "filter"), (dict(points=[["1", "2", "3"]]), "points")):
    refused(lambda: asset.query(**{"points": P, **words}), word)
assert (asset.query(P, bias=np.array(0.5)) == asset.query(P, bias=0.5)).all()
odd = np.empty(64 * 4 + 1, np.uint8)[1:].view(np.float32)
refused(lambda: asset.query(P, out=odd), "out")
large = np.tile(P, (2000, 1))
refused(lambda: asset.query(large, out=large.reshape(-1)[:len(large)]), "out")
for shape in ((4, 3), (2, 3, 6, 1), (3, 2)):
    refused(lambda: asset.segments(np.zeros(shape)), "ends")
assert asset.segments(np.zeros((6,))).lit.shape == (1,) and asset.segments(np.zeros((2, 3))).lit.shape == (1,)
refused(lambda: asset.derive(16, 16, rect=5), "rect")
refused(lambda: asset.derive(16, 16, cascades=2, camera=5), "camera")
refused(lambda: asset.derive(16, 16, camera=umbrage.Camera((0, 0, 0), (0, 1, 0))), "cascades")
refused(lambda: umbrage.open(ASSET, memory=-1), "memory: -1")
with umbrage.open(ASSET, partial=True) as part:
    refused(lambda: part.fetch("x"), "views")
    refused(lambda: part.fetch(umbrage.View(box=5)), "box")
    refused(lambda: part.fetch(BOX, progress=5), "progress")
refused(lambda: umbrage.open(7, partial=True), "path")
assert refused(lambda: umbrage.open("none.umb", partial=True), "none.umb").status == "E_NO_INPUT"
refused(lambda: umbrage.connect(PLACE, timeout="x"), "timeout")
refused(lambda: umbrage.connect(PLACE + chr(0) + "x"), "address")
for headers in ({"a": 5}, {"a": "b" + chr(10) + "c: d"}, {5: "a"}, "abc"):
    refused(lambda: umbrage.open("http://127.0.0.1:1/x", headers=headers), "headers")
for url in ("http://h:99999/x", "http://user:pw@h/x", "http://", "http://[::1/x"):
    refused(lambda: umbrage.open(url), "url")
with umbrage.connect(PLACE) as there:
    refused(lambda: there.open_ranges(5), "asset")
    refused(lambda: there.submit(SCENE, priority=2**40), "priority")
    refused(lambda: there.submit(SCENE, 5), "settings")
    refused(lambda: there.submit(SCENE, files=5), "files")
    refused(lambda: list(there.watch(5)), "job")
    refused(lambda: there.fetch("zz", "out.umb"), "asset_id")
    assert not [name for name in os.listdir(".") if "out.umb" in name]
''')

runs("an asset is copied, kept in a cycle, and left open at exit", '''
import copy
asset = umbrage.open(ASSET)
twin = copy.copy(asset)
asset.close()
twin.query(P)
del twin
for _ in range(50):
    loop = [umbrage.open(ASSET), umbrage.open(ASSET, partial=True), umbrage.open(PLACE + "/city")]
    loop.append(loop)
del loop
gc.collect()
left, part, far = umbrage.open(ASSET), umbrage.open(ASSET, partial=True), umbrage.open(PLACE + "/city")
far.query(P)
far._daemon.submit(SCENE, {"resolution": 1024, "sun": "1,45"})
watch = far._daemon.watch(far._daemon.submit(SCENE, {"resolution": 2048, "sun": "1,46"}))
next(watch)
''')

runs("interrupts at any moment leave an asset that closes", '''
asset, stop, armed, pid = umbrage.open(ASSET), [], [], os.getpid()
far = umbrage.open(PLACE + "/city")
large = np.tile(P, (3000, 1))


def interrupt(*_):
    """Raises once for each time that it is armed."""
    if armed:
        armed.pop()
        raise KeyboardInterrupt


def strike():
    while not stop:
        time.sleep(0.0007)
        os.kill(pid, signal.SIGINT)


def endure(call, times):
    for _ in range(times):
        try:
            armed.append(1)
            while True:
                call()
        except KeyboardInterrupt:
            pass


signal.signal(signal.SIGINT, interrupt)
thread = threading.Thread(target=strike)
thread.start()
endure(lambda: asset.query(P), 500)
endure(lambda: asset.query(large, threads=3), 100)
endure(lambda: far.query(P), 300)
endure(lambda: far.columns(P), 300)
stop.append(1)
thread.join()
assert asset.query(large, threads=3).shape == (len(large),)
far.query(P)
far.close()
asset.close()
''')

runs("close while another thread queries: an answer or a ValueError, never a crash", '''
large = np.tile(P, (2000, 1))
for number in range(60):
    for open_one in (lambda: umbrage.open(ASSET), lambda: umbrage.open(PLACE + "/city")):
        asset, bad = open_one(), []

        def ask():
            try:
                while True:
                    asset.query(large if number % 2 else P)
            except (ValueError, umbrage.CancelledError):
                pass
            except BaseException as problem:
                bad.append(problem)

        threads = [threading.Thread(target=ask) for _ in range(3)]
        for thread in threads:
            thread.start()
        time.sleep(0.003)
        while True:
            try:
                asset.close()
                break
            except RuntimeError:
                pass
        for thread in threads:
            thread.join()
        assert not bad, bad
''')

runs("a daemon is closed under its assets, ranges, watches and generators", '''
there = umbrage.connect(PLACE)
asset, part = there.open("city"), there.open_ranges("city")
watch = there.watch(there.submit(SCENE, {"resolution": 4096, "sun": "7,45"}))
next(watch)
abandoned = there.watch(there.submit(SCENE, {"resolution": 4096, "sun": "8,45"}))
next(abandoned)
never = there.watch("0" * 32)
begin = time.monotonic()
there.close()
refused(lambda: asset.query(P), "closed")
try:
    list(watch)
except (umbrage.CancelledError, ValueError):
    pass
del abandoned
refused(lambda: next(never), "closed")
try:
    part.fetch(BOX)
except (umbrage.Error, ValueError):
    pass
part.query(P)
part.close()
assert time.monotonic() - begin < 30
''')

runs("callbacks that close their own asset are refused", '''
part = umbrage.open(ASSET, partial=True)
refused(lambda: part.fetch(BOX, progress=lambda held: part.close()), "fetch", RuntimeError)
part = umbrage.open(ASSET, partial=True)
refused(lambda: part.fetch(BOX, progress=lambda held: part.fetch(BOX)), "fetch", RuntimeError)
shapes = []
part = umbrage.open(ASSET, partial=True)
part.fetch(BOX, progress=lambda held: shapes.append(part.query(P).shape))
assert shapes
part.close()
''')

runs("a reader that gives too much, too little or nonsense fails its call alone", '''
from umbrage.range_asset import RangeAsset
with open(ASSET, "rb") as file:
    data = file.read()


def reader(change):
    turn = [0]
    def read(ranges):
        turn[0] += 1
        good = [data[offset:offset + length] for offset, length in ranges]
        return change(good) if turn[0] > 1 else good
    return read


for change, kinds in ((lambda good: good + [b"x"] * 1000, ValueError), (lambda good: good[:-1], ValueError),
                      (lambda good: [5] * len(good), TypeError), (lambda good: 5, TypeError),
                      (lambda good: ["x"] * len(good), TypeError), (lambda good: [b""] * len(good), umbrage.Error),
                      (lambda good: [one * 3 for one in good], (ValueError, umbrage.Error)),
                      (lambda good: [np.frombuffer(one, np.uint8)[::-1] for one in good], (ValueError, BufferError))):
    closed = []
    asset = RangeAsset.of_reader(reader(change), lambda: closed.append(1))
    try:
        asset.fetch(BOX)
        raise AssertionError("not refused")
    except kinds:
        pass
    asset.query(P)
    asset.close()
    assert closed == [1]
''')

runs("many threads with many settings, and pools that grow", '''
asset, bad = umbrage.open(ASSET), []
large = np.tile(P, (3000, 1))


def ask(number):
    try:
        for i in range(400):
            asset.query(P, bias=(i * 7 + number) % 300 / 100)
        for i in range(6):
            asset.query(large, threads=1 + (number + i) % 5)
    except BaseException as problem:
        bad.append(problem)


sys.setswitchinterval(1e-6)
threads = [threading.Thread(target=ask, args=(number,)) for number in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
assert not bad, bad
''')

runs("a child after fork queries with threads", '''
asset = umbrage.open(ASSET)
large = np.tile(P, (3000, 1))
want = asset.query(large, threads=3)
child = os.fork()
if child == 0:
    signal.alarm(20)
    os._exit(0 if (asset.query(large, threads=3) == want).all() else 3)
assert os.waitpid(child, 0)[1] == 0
''')

runs("a token stays with its server, in any letter case", '''
other, asked = serve(lambda h: h.reply(206, h.part()))
port, _ = serve(lambda h: h.reply(302, Location=f"http://127.0.0.1:{other}/city.umb"))
umbrage.open(f"http://127.0.0.1:{port}/", headers={"authorization": "Bearer secret", "Cookie": "a=secret",
                                                    "X-Api-Key": "secret"}).close()
assert asked and not any("secret" in str(headers) for _, headers in asked), asked
''')

runs("a web server that drips, stalls, cuts, compresses or never ends fails within bounded time", '''
from umbrage import range_asset
range_asset.TIMEOUT_S, range_asset.BYTES_A_S = 1.0, 1 << 20
def drip(h):
    h.send_response(206)
    h.send_header("Content-Length", "40000")
    h.end_headers()
    for _ in range(600):
        h.wfile.write(b"x")
        time.sleep(0.1)
def header_drip(h):
    h.wfile.write(b"HTTP/1.1 206 x\\r\\n")
    for _ in range(600):
        h.wfile.write(b"x: y\\r\\n"[_ % 6:][:1])
        time.sleep(0.1)
def cut(h):
    h.send_response(206)
    h.send_header("Content-Length", str(len(h.part())))
    h.end_headers()
    h.wfile.write(h.part()[:100])
    h.close_connection = True
def endless(h):
    h.send_response(206)
    h.send_header("Transfer-Encoding", "chunked")
    h.end_headers()
    while True:
        h.wfile.write(b"1000\\r\\n" + bytes(4096) + b"\\r\\n")
for name, answer, word in (("drip", drip, "seconds"), ("header_drip", header_drip, "seconds"),
                           ("stall", lambda h: time.sleep(60), "seconds"), ("cut", cut, "cut"),
                           ("gzip", lambda h: h.reply(206, h.part(), Content_Encoding="gzip"), "gzip"),
                           ("endless", endless, "more bytes"),
                           ("loop", lambda h: h.reply(302, Location="/"), "redirections"),
                           ("bad port", lambda h: h.reply(302, Location="http://127.0.0.1:99999/"), "99999"),
                           ("no scheme", lambda h: h.reply(302, Location="file:///etc/passwd"), "file:"),
                           ("404", lambda h: h.reply(404), "404"), ("401", lambda h: h.reply(401), "401")):
    port, _ = serve(answer)
    begin = time.monotonic()
    try:
        umbrage.open(f"http://127.0.0.1:{port}/x")
        raise AssertionError(name)
    except umbrage.Error as error:
        assert word in str(error), (name, error)
        assert word not in ("404", "401") or isinstance(error, (umbrage.NotFoundError, umbrage.RightsError))
    assert time.monotonic() - begin < 15, name
assert threading.active_count() < 60
''')

runs("Ctrl-C ends a fetch from a server that stalls, and so does the process", '''
signal.signal(signal.SIGINT, signal.default_int_handler)
turn = [0]
def answer(h):
    turn[0] += 1
    if turn[0] > 2:
        time.sleep(90)
    h.reply(206, h.part())
port, _ = serve(answer)
asset = umbrage.open(f"http://127.0.0.1:{port}/x")
threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
begin = time.monotonic()
try:
    asset.fetch(BOX)
    raise AssertionError("not interrupted")
except KeyboardInterrupt:
    assert time.monotonic() - begin < 5
asset.query(P)
asset.close()
''', 25)

runs("a bake leaves no descriptor, and hears every exception of its callback", '''
def number():
    return len(os.listdir("/proc/self/fd"))
before = number()
for words, kinds in ((dict(scene="a" + chr(0)), ValueError), (dict(scene=5), TypeError), (dict(program="/nonexistent"), OSError),
                     (dict(program="true"), umbrage.Error), (dict(program="false"), umbrage.Error),
                     (dict(scene=b"none.obj"), umbrage.FileError), (dict(progress=5), TypeError)):
    try:
        umbrage.bake(**{"scene": SCENE, "output": "no.umb", "program": BAKE, **words})
        raise AssertionError(words)
    except kinds:
        pass
    assert number() == before, words
def leave(_):
    raise SystemExit(3)
refused(lambda: umbrage.bake(SCENE, "no.umb", program=BAKE, resolution=256, verify=10**9, progress=leave), "3", SystemExit)
assert number() == before and not os.path.exists("no.umb")
''')

runs("what a callback of a daemon's call raises reaches the caller; a list repeats an option", '''
class Mine(Exception):
    pass
def fail(*_):
    raise Mine("mine")
with umbrage.connect(PLACE) as there:
    refused(lambda: there.submit(SCENE, {"resolution": 256, "sun": "3,45"}, progress=fail), "mine", Mine)
    status = there.wait(there.submit(SCENE, {"resolution": 256, "sun": ["3,45", "4,50"], "verify": 0, "quick": False,
                                             "closed": None}))
    assert status.state == "done", status
    refused(lambda: there.fetch(status.asset, "out.umb", progress=fail), "mine", Mine)
    assert not [name for name in os.listdir(".") if "out.umb" in name]
    with there.open(status.asset) as asset:
        assert len(asset.lights) == 2
    there.fetch(status.asset, b"out.umb")
    assert os.path.exists("out.umb")
    os.unlink("out.umb")
''')

runs("an asset of a daemon, and a daemon, refuse by the argument's name, also closed", '''
ends, boxes = np.stack([P[:32], P[32:]], 1), np.stack([P[:32], P[:32] + np.float32(5)], 1).astype(float)
far, there = umbrage.open(PLACE + "/city"), umbrage.connect(PLACE)
calls = (("points", P, lambda array: far.query(array)), ("normals", P, lambda array: far.query(P, array)),
         ("points", P, lambda array: far.columns(array)), ("ends", ends, lambda array: far.segments(array)),
         ("boxes", boxes, lambda array: far.boxes(array)))
for name, good, call in calls:
    for bad in (good.astype(int), good.astype(">f4"), good[..., :2], good[::2], np.asfortranarray(good), "abc", None, 5):
        if bad is not None or name != "normals":
            refused(lambda: call(bad), name)
    bad = good.copy()
    bad.reshape(-1)[7] = np.nan
    if name != "normals":
        assert "nan" in str(refused(lambda: call(bad), name)), name
for words in (dict(taps=4), dict(light=9), dict(light="moon"), dict(filter="x"), dict(bias=-1), dict(max_error=-1.0)):
    refused(lambda: far.query(P, **words), next(iter(words)))
refused(lambda: far.derive(16, 16), "file", umbrage.UnsupportedError)
refused(lambda: there.open("none"), "none", umbrage.NotFoundError)
refused(lambda: there.jobs(limit=-1), "limit")
refused(lambda: there.jobs(limit=1001), "limit")
refused(lambda: there.cancel("0" * 32), "0" * 32, umbrage.NotFoundError)
refused(lambda: there.wait("0" * 32), "0" * 32, umbrage.NotFoundError)
refused(lambda: there.delete("zz"), "asset_id")
refused(lambda: there.delete("0" * 64), "", umbrage.NotFoundError)
refused(lambda: there.fetch("0" * 64, "none.umb"), "", umbrage.NotFoundError)
refused(lambda: there.fetch("0" * 64, "none.umb", max_bytes=-1), "max_bytes")
far.close()
there.close()
for _, good, call in calls:
    refused(lambda: call(good), "closed", ValueError)
for call in (there.assets, there.jobs, lambda: there.open("city"), lambda: there.open_ranges("city"), lambda: there.submit(SCENE),
             lambda: next(there.watch("0" * 32)), lambda: there.wait("0" * 32), lambda: there.cancel("0" * 32),
             lambda: there.fetch("0" * 64, "none.umb"), lambda: there.delete("0" * 64), far.held, far.fetch):
    refused(call, "closed", ValueError)
assert not [name for name in os.listdir(".") if "none.umb" in name]
''')

runs("Ctrl-C ends a wait for a job, a watch and a large batch of a daemon, and the daemon answers again", '''
signal.signal(signal.SIGINT, signal.default_int_handler)
large = np.tile(P, (20000, 1))
with umbrage.connect(PLACE) as there, there.open("city") as far:
    job = there.submit(SCENE, {"resolution": 2048, "sun": "9,45", "verify": 10**9})
    for call in (lambda: there.wait(job), lambda: list(there.watch(job)), lambda: [far.query(large, taps=17) for _ in range(10**6)]):
        threading.Timer(0.4, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        begin = time.monotonic()
        try:
            call()
            raise AssertionError("not interrupted")
        except KeyboardInterrupt:
            assert time.monotonic() - begin < 10
        assert far.query(P).shape == (64,)
    there.cancel(job)
    assert there.wait(job).state == "failed"
''')

runs("threads that share an asset of ranges take turns: bounds hold, and a close ends the others by an exception", '''
with umbrage.open(ASSET) as whole:
    want = whole.query(P, taps=9)
part, bad, done = umbrage.open(ASSET, partial=True), [], []


def ask(number):
    try:
        while True:
            part.fetch(BOX, max_bytes=20000) if number == 0 else None
            told = part.query(P, taps=9, stats=True)
            assert (told.low <= want).all() and (want <= told.high).all() and (told.values[told.exact] == want[told.exact]).all()
            done.append(number)
    except ValueError as problem:
        assert "closed" in str(problem)
    except BaseException as problem:
        bad.append(problem)


threads = [threading.Thread(target=ask, args=(number,)) for number in range(4)]
for thread in threads:
    thread.start()
while len(done) < 200 and not bad:
    time.sleep(0.01)
part.close()
for thread in threads:
    thread.join()
assert not bad, bad
''')

test.finish()
