#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
# run: alone (it measures rates and latencies)
"""
`umbrage load` against a daemon on a Unix socket: its counts must be the daemon's, latencies of an
open loop must count from the time at which calls were due, failures must have their names, and the
page must need no other file.
"""
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
os.mkdir(test.path("store"))
baked = test.bake(test.scene("city", 3), test.path("store/city.umb"), "--resolution", 256, "--depth",
                  "raster", "--verify", 0)
daemon = test.daemon()
UNIX = ("--address", "unix:" + daemon.socket_path)
ADMIN = ("--admin", daemon.addresses["http"])
SHARES = ("p50_ms", "p75_ms", "p90_ms", "p99_ms", "p99.9_ms", "p99.99_ms", "max_ms")
BRIEF = ("--warm-up", 0.1, "--duration", 0.4)


def load(*words, code=0, to=UNIX):
    """Runs a load test; returns the output of --json or, if another exit code is expected, stderr."""
    done = ut.run("umbrage", "load", "city", "--json", *to, *words, code=code, timeout=60)
    return json.loads(done.stdout) if code == 0 else done.stderr.decode()


with test.check("a closed loop's calls and points are those that the daemon counts"):
    before = daemon.metric("umbrage_queries_total")
    told = load("--closed", "--warm-up", "0s", "--duration", "600ms", "--batch", 100, "--in-flight", 3,
                "--connections", 2, *ADMIN)
    counted = daemon.metric("umbrage_queries_total") - before
    latency = told["latency"]
    assert told["loop"] == "closed" and told["calls"] > 20 and told["error_count"] == 0, told
    assert 100 * latency["count"] == counted, (latency, counted)
    assert 0 <= latency["count"] - told["calls"] <= 6  # under way at the end
    assert abs(told["points_s"] - 100 * told["calls_s"]) < 1e-6 * told["points_s"]
    values = [latency["min_ms"]] + [latency[share] for share in SHARES]
    assert values == sorted(values) and values[0] > 0
    assert told["server"]["cpu_s"] > 0
    assert 0.5 < told["server"]["points"] / (100 * told["calls"]) < 2  # its window is a little off
    assert told["server"]["rss_max_bytes"] > 1e6
    assert told["counts"] == (told["generator_cores"] <= 0.7)

with test.check("an open loop makes as many calls as are due, no matter how they are answered"):
    for extra in ((), ("--stream",), ("--points", "random", "--taps", 9, "--encoding", "bit")):
        told = load(*BRIEF, "--rate", 500, *extra)
        assert told["loop"] == "open" and told["error_count"] == 0, told
        assert told["latency"]["count"] == 200, told  # 0.4 s of 500 a second

with test.check("a stall counts for every call that was due in it, also for those not yet sent"):
    before = daemon.metric("umbrage_queries_total")

    def stall():
        ut.wait_until(lambda: daemon.metric("umbrage_queries_total") > before + 50 * 64, 20, "calls")
        daemon.signal(signal.SIGSTOP)
        time.sleep(0.8)
        daemon.signal(signal.SIGCONT)
    stalling = threading.Thread(target=stall, daemon=True)
    stalling.start()
    told = load("--warm-up", 0, "--duration", 2, "--rate", 500, "--connections", 1,
                "--in-flight", 4)
    stalling.join()
    # The daemon stood still for 0.8 of two seconds. With 4 calls under way, a tool that measures
    # from the time of sending would see 4 slow calls of 1000; in truth two fifths of the calls had
    # to wait.
    assert told["latency"]["count"] == 1000 and told["error_count"] == 0, told
    assert told["latency"]["p75_ms"] > 50 and told["latency"]["max_ms"] > 700, told

with test.check("a daemon that is slow to tell its figures does not stretch the window"):
    def tell_slowly():
        while True:
            peer, _ = slow.accept()
            time.sleep(0.3)
            page = daemon.admin("/metrics")[1].encode()
            peer.recv(4096)
            peer.sendall(b"HTTP/1.0 200 OK\r\n\r\n" + page)
            peer.close()
    slow = socket.create_server(("127.0.0.1", 0))
    threading.Thread(target=tell_slowly, daemon=True).start()
    told = load("--warm-up", 0, "--duration", 1, "--rate", 200, "--admin",
                "127.0.0.1:%d" % slow.getsockname()[1])
    # There are 200 calls, except those that are late at the end.
    assert abs(told["seconds"] - 1) < 1e-6 and told["calls_s"] > 150, told
    assert told["latency"]["count"] == 200, told
    assert told["server"]["cpu_s"] >= 0, told

with test.check("points at the borders of shadows, and recorded ones, can be asked"):
    assert load(*BRIEF, "--points", "boundary", "--rate", 100)["error_count"] == 0
    trace = test.path("trace.f32")
    with open(trace, "wb") as file:
        file.write(ut.floats(ut.random_points((0, 0, 0), (100, 100, 50), 1000, 3)))
    told = load(*BRIEF, "--trace", trace, "--format", "f32", "--rate", 100, "--batch", 333)
    assert told["points"] == trace and told["error_count"] == 0
    with open(trace, "wb") as file:
        file.write(b"")
    assert "no points" in load("--trace", trace, "--format", "f32", code=65)

with test.check("a sweep ends at the highest rate that kept the bound, or says that there is none"):
    sweep = load("--sweep", "--rate", 200, "--warm-up", 0, "--duration", 0.1, "--bound", 1000,
                 "--in-flight", 8)["sweep"]
    kept = [step["rate"] for step in sweep["steps"] if step["kept"]]
    missed = [step["rate"] for step in sweep["steps"] if not step["kept"]]
    assert sweep["knee"] == max(kept) and sweep["knee"] >= 200, sweep
    assert not missed or max(missed) <= 2.0 * 1e6
    done = ut.run("umbrage", "load", "city", *UNIX, "--sweep", "--rate", 1000, "--warm-up", 0,
                  "--duration", 0.1, "--bound", 0.000001, code=1)
    assert b"no knee" in done.stdout, done

with test.check("a sweep goes on without the daemon's figures where it does not tell them"):
    def tell_once():
        peer, _ = fickle.accept()
        page = daemon.admin("/metrics")[1].encode()
        peer.recv(4096)
        peer.sendall(b"HTTP/1.0 200 OK\r\n\r\n" + page)
        peer.close()
        fickle.close()
    fickle = socket.create_server(("127.0.0.1", 0))
    threading.Thread(target=tell_once, daemon=True).start()
    done = ut.run("umbrage", "load", "city", *UNIX, "--sweep", "--rate", 1000, "--warm-up", 0,
                  "--duration", 0.1, "--bound", 0.000001, "--admin",
                  "127.0.0.1:%d" % fickle.getsockname()[1], code=1)
    assert b"no knee" in done.stdout, done

with test.check("failures in the middle of a run are counted by their names"):
    victim = test.daemon()

    def kill_in_the_middle():
        while victim.metric("umbrage_queries_total") < 30 * 64:
            time.sleep(0.01)
        victim.kill()
    threading.Thread(target=kill_in_the_middle).start()
    told = load("--warm-up", 0, "--duration", 1.2, "--rate", 200, "--connections", 2,
                "--admin", victim.addresses["http"], to=("--address", "unix:" + victim.socket_path))
    test.daemons.remove(victim)
    assert "server" not in told
    assert told["errors"].get("E_UNAVAILABLE", 0) > 20 and told["calls"] > 20, told
    assert sum(told["errors"].values()) == told["error_count"], told

with test.check("a test that cannot begin or gets no answer at all says why"):
    assert "nowhere" in load(code=69, to=("--address", "unix:/nowhere/s.sock"))
    done = ut.run("umbrage", "load", "village", *UNIX, code=66)
    assert b"village" in done.stderr
    assert "light" in load("--light", 7, code=66)
    assert "--admin" in load(*BRIEF, "--admin", "127.0.0.1:1", code=69)
    assert "no call was answered" in load(*BRIEF, "--batch", 100, code=2, to=(
        "--address", "unix:" + test.daemon("--max-points", 16).socket_path))
    for wrong in (("--rate", 0), ("--rate", 1e-12), ("--taps", 2), ("--batch", 0),
                  ("--connections", 1000), ("--bound", 1),
                  ("--points", "nice"), ("--trace", "a", "--points", "random"), ("--duration", 0), ("--duration", "10h"), ("--duration", "ms"), ("--closed", "--rate", 5),
                  ("--normals",), ("--encoding", "png"), ("--warm-up", -1), ("--seed", "x")):
        assert "load:" in load(*wrong, code=2), wrong


def draw(report):
    """What a report's scripts draw: the element of each id (tests/harness/draw_page.js)."""
    done = subprocess.run(["node", os.path.join(ut.ROOT, "tests/harness/draw_page.js"), report],
                          capture_output=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    return json.loads(done.stdout)["ids"]


def below(node):
    """The node and all below it."""
    yield node
    for child in node["children"]:
        yield from below(child)


def plots(ids):
    """(caption, texts, paths, marks) of each chart."""
    found = []
    for figure in ids["charts"]["children"]:
        nodes = list(below(figure))
        found.append((next(n["text"] for n in nodes if n["tag"] == "figcaption"),
                      [n["text"] for n in nodes if n["tag"] == "text"],
                      [n["attributes"]["d"] for n in nodes if n["tag"] == "path"],
                      [n for n in nodes if n["tag"] == "circle"]))
    return found


with test.check("the page holds its data and loads nothing"):
    report = test.path("report.html")
    load("--rate", 300, *BRIEF, *ADMIN, "--report", report)
    with open(report, encoding="utf-8") as file:
        text = file.read()
    assert not re.search(r"\s(src|href)=", text) and "http" not in text.replace("http://www.w3.org/2000/svg", "")
    assert "prefers-color-scheme: dark" in text and "width=device-width" in text
    assert not re.search("@[A-Z]+@", text)
    data = json.loads(re.search(r'<script id="data"[^>]*>(.*?)</script>', text, re.S)[1])
    assert data["calls"] > 0 and len(data["curve"]) == 121 and data["moments"], data
    shares, times = zip(*data["curve"])
    assert shares[0] == 0 and sorted(times) == list(times) and times[-1] <= data["latency"]["max_ms"]

if shutil.which("node") is None:
    ut.left_out("pages of load tests", "node is not installed")
else:
    with test.check("the page draws its plots, figures and tables"):
        ids = draw(report)
        charts = plots(ids)
        assert [c[0].split(".")[0] for c in charts] == ["Latency by percentile", "Throughput",
                                                        "Latency over time", "Memory of the daemon"]
        for caption, texts, paths, _ in charts:
            assert len(texts) >= 5 and paths, caption
            for path in paths:
                assert re.fullmatch(r"([ML]-?\d+\.\d -?\d+\.\d)+", path), path
        assert "300asked, calls a second" in ids["figures"]["text"], ids["figures"]["text"]
        assert "daemon, ns a point" in ids["figures"]["text"] and ids["sweep"]["hidden"]
        assert f"{data['latency']['count']}" in ids["latency"]["text"], ids["latency"]["text"]

    with test.check("a sweep's page has a mark a step"):
        swept = load("--sweep", "--rate", 200, "--warm-up", 0, "--duration", 0.1, "--bound", 1000,
                     "--in-flight", 8, "--report", report)["sweep"]
        ids = draw(report)
        marks = plots(ids)[0][3]
        assert len(marks) == sum(step["p99_ms"] > 0 for step in swept["steps"]), (marks, swept)
        kept = [mark for mark in marks if mark["attributes"]["class"].startswith("dot")]
        assert len(kept) == sum(step["kept"] for step in swept["steps"]), (kept, swept)
        assert not ids["sweep"]["hidden"]

with test.check("names in the page are text, whatever they hold"):
    trace = test.path("<b>&\".txt")
    with open(trace, "w", encoding="ascii") as file:
        file.write("1 2 3\n")
    load("--trace", trace, "--rate", 100, *BRIEF, "--report", report)
    with open(report, encoding="utf-8") as file:
        text = file.read()
    assert "\\u003cb>&\\\".txt" in text and "<b>&" not in text

with test.check("a page that cannot be made is known before the run, and one that stands is replaced whole"):
    done = ut.run("umbrage", "load", "city", *UNIX, *BRIEF, "--report", "/nowhere/x.html", code=73)
    assert "/nowhere/x.html': No such" in done.stderr.decode() and not done.stdout, done
    ut.run("umbrage", "load", "city", *UNIX, *BRIEF, "--report", "/dev/full", code=74)
    ut.run("umbrage", "load", "city", *UNIX, *BRIEF, "--report", "-", code=2)
    before = os.stat(report).st_ino
    other = test.path("link")
    os.link(report, other)  # keeps the number
    load("--rate", 100, *BRIEF, "--report", report)
    assert os.stat(report).st_ino != before and os.stat(other).st_ino == before
test.finish()
