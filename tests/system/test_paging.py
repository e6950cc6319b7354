#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""umbrage stream: parts of an asset from a file and a web server, over good and bad links."""
import json
import os
import shutil
import socket
import struct
import subprocess
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import link  # noqa: E402
import umbrage_test as ut  # noqa: E402

test = ut.Test()
folder = test.folder
scene, asset = os.path.join(folder, "city.glb"), os.path.join(folder, "city.umb")
subprocess.run([ut.program("scenegen"), "city", "--size", "24", "-o", scene], check=True,
               stderr=subprocess.DEVNULL)
ut.run("umbrage-bake", scene, "-o", asset, "--resolution", "4096", "--sun", "135,45", "--verify", "0", "--quiet")
CAMERA = "eye=1,1.7,1,target=100,1.7,9,fov=60,far=150"
points = os.path.join(folder, "points.f32")
ut.run("umbrage", "points", scene, "-o", points, "--kind", "gbuffer", "--camera",
       "eye=1,1.7,1,target=100,1.7,9,fov=60", "--size", "320x180", "--normals", "--quiet")
whole = os.path.getsize(asset)


def stream(*words, code=0):
    """Runs umbrage stream; returns its JSON, or its complaint."""
    done = ut.run("umbrage", "stream", "--json", *words, code=code)
    return json.loads(done.stdout) if code == 0 else done.stderr.decode()


def checks_steps(told):
    """Figures must only get better, and the bound must be 0 exactly when all is exact."""
    for before, after in zip(told["steps"], told["steps"][1:]):
        assert after["bytes"] > before["bytes"], told
        assert after["exact"] >= before["exact"], told
    for step in told["steps"]:
        assert (step["worst_m"] == 0) == (step["exact"] == told["points"]), step


with test.check("a file's points become exact with a part of its bytes, coarse first"):
    told = stream(asset, "--points", points, "--normals", "--only-points")
    checks_steps(told)
    assert told["steps"][0]["bytes"] <= 65536 and told["steps"][0]["rounds"] == 1
    assert told["steps"][-1]["exact"] == told["points"], told["steps"][-1]
    assert told["steps"][-1]["bytes"] < whole * 0.7, (told["steps"][-1], whole)

with test.check("everything is fetched once without a view, and answers are the file's"):
    told = stream(asset, "--points", points, "--normals")
    checks_steps(told)
    assert told["pages_held"] == told["page_count"]
    # The page in which the first read ended was received once more in whole.
    assert whole <= told["steps"][-1]["bytes"] < whole + 65536, (told["steps"][-1], whole)

server = link.RangeServer(folder)
url = f"http://127.0.0.1:{server.port}/city.umb"

with test.check("a web server gives the same part as the file"):
    part_a, part_b = os.path.join(folder, "a.part"), os.path.join(folder, "b.part")
    from_file = stream(asset, "--camera", CAMERA, "-o", part_a)
    from_url = stream("--from-url", url, "--camera", CAMERA, "-o", part_b)
    assert from_file["steps"][-1]["bytes"] == from_url["steps"][-1]["bytes"]
    with open(part_a, "rb") as one, open(part_b, "rb") as other:
        assert one.read() == other.read()
    with open(part_a, "rb") as file:
        assert ut.run("umbrage", "stream", asset, "--camera", CAMERA, "-o", "-").stdout == file.read()
    assert "--json" in stream(asset, "--camera", CAMERA, "-o", "-", code=2)
    with open("/dev/full", "wb") as full:
        full_stdout = subprocess.run([ut.program("umbrage"), "stream", asset, "--camera", CAMERA, "-q", "-o", "-"],
                                     stdout=full, check=False)
    assert full_stdout.returncode == 74, full_stdout

def query(file, *words, code=0):
    """Runs umbrage query on the points of the view; returns its JSON, or its complaint."""
    done = ut.run("umbrage", "query", file, "--points", points, "--normals", "--format", "f32", "--taps", "9",
                  "--json", *words, code=code)
    return json.loads(done.stdout) if code == 0 else done.stderr.decode()


with test.check("a partial file is described and answers as an asset does, with bounds"):
    told = json.loads(ut.run("umbrage", "info", part_a, "--json").stdout)
    of_asset = json.loads(ut.run("umbrage", "info", asset, "--json").stdout)
    assert told["asset"] == of_asset["asset"] and told["lights"] == of_asset["lights"]
    assert 0 < told["pages_held"] < told["page_count"], told
    assert "pages          %d of %d" % (told["pages_held"], told["page_count"]) in \
        ut.run("umbrage", "info", part_a).stdout.decode()
    truth, part = query(asset), query(part_a)
    assert 0 < part["exact"] < part["points"] and part["worst_error_m"] > 0, part["exact"]
    exact = 0
    for true, (value, low, high) in zip(truth["answers"], part["answers"]):
        assert low <= true <= high and low <= value <= high, (low, true, high)
        exact += low == high
    assert exact == part["exact"]
    ut.run("umbrage", "stream", asset, "--points", points, "--normals", "--only-points", "--taps", "17",
           "-o", part_b, "--quiet")
    part = query(part_b, "--taps", "17")
    assert part["exact"] == part["points"] and part["worst_error_m"] == 0, part["exact"]
    assert [a[0] for a in part["answers"]] == query(asset, "--taps", "17")["answers"]
    assert "--explain" in query(part_a, "--explain", code=2)
    assert "--encoding" in query(part_a, "--encoding", "u8", "-o", os.path.join(folder, "x"), code=2)
    with open(part_a, "rb") as file:
        damaged = bytearray(file.read())
    damaged[-1] ^= 1
    bad = os.path.join(folder, "bad.umb")
    with open(bad, "wb") as file:
        file.write(damaged)
    assert "checksum" in query(bad, code=65) and "checksum" in ut.run("umbrage", "info", bad, code=65).stderr.decode()

with test.check("pages are listed with hashes, levels and bytes"):
    of_file = json.loads(ut.run("umbrage", "info", asset, "--pages", "--json").stdout)
    of_part = json.loads(ut.run("umbrage", "info", part_a, "--pages", "--json").stdout)
    assert len(of_file["pages"]) == of_file["page_count"] and of_file["pages_held"] == 0
    assert sum(p["stored_bytes"] for p in of_file["pages"]) < whole
    assert len({p["hash"] for p in of_file["pages"]}) == of_file["page_count"]
    assert all(3 <= p["level_low"] <= p["level_high"] <= 12 and p["nodes"] > 0 for p in of_file["pages"])
    by_number = {p["page"]: p for p in of_file["pages"]}
    for page in of_part["pages"]:
        assert {**page, "held": False} == by_number[page["page"]], page
    assert sum(p["held"] for p in of_part["pages"]) == of_part["pages_held"] == told["pages_held"]
    listed = ut.run("umbrage", "info", asset, "--pages").stdout.decode()
    assert all(p["hash"] in listed for p in of_file["pages"])
    mapped = os.path.join(folder, "city.umbm")
    ut.run("umbrage", "unpack", asset, "-o", mapped, "--quiet")
    assert "no pages" in ut.run("umbrage", "info", mapped, "--pages", code=69).stderr.decode()
    ut.run("umbrage", "info", "city", "--pages", code=2)

with test.check("over a path of 20 reconnects no byte comes twice"):
    part, seen = os.path.join(folder, "path.part"), []
    for i in range(20):
        del server.ranges[:]
        camera = f"eye={-60 + 6 * i},1.7,1,target={40 + 6 * i},1.7,9,fov=60,far=60"
        resume = ["--resume", part] if i > 0 else []
        stream("--from-url", url, "--camera", camera, "-o", part, *resume)
        seen += server.ranges
    assert len(seen) > 20, len(seen)
    seen.sort()
    for before, after in zip(seen, seen[1:]):
        # The first read ends inside a page, which is then received again in whole.
        assert before[1] < after[0] or before[0] == 0, (before, after)

def held_pages(part):
    """Numbers of the pages in a partial file (docs/reference/umb-format.md, section 7)."""
    with open(part, "rb") as file:
        data = file.read()
    count, head = struct.unpack_from("<I", data, 12)[0], struct.unpack_from("<Q", data, 16)[0]
    return list(struct.unpack_from(f"<{count}I", data, 40 + head))


def page_places():
    """Where each page of the city stands: (first byte, one behind the last)."""
    with open(asset, "rb") as file:
        data = file.read()
    head, pages = struct.unpack_from("<Q", data, 24)[0], struct.unpack_from("<I", data, 80)[0]
    blocks = struct.unpack_from("<Q", data, 88)[0]
    for page in range(pages):
        entry = head + 64 * page if page < 64 else blocks + 64 * (page - 64)
        offset, length = struct.unpack_from("<QI", data, entry)
        yield offset, offset + length


def walk_with_cuts(source_of, target, check):
    """
    Walks, each without any pages at first, over a link that breaks 20 times in all during transfers; `check` gets the
    pages held before each try. Returns the bytes that the link carried, those of the pages kept, and how many were
    kept.
    """
    part, places, cuts, step, sent, kept, pages = test.path("cut.part"), list(page_places()), 0, 0, 0, 0, 0
    for tries in range(300):
        before = held_pages(part) if os.path.exists(part) else []
        cut_after = 6000 + 7919 * tries % 30000 if cuts < 20 else None
        slow = link.Link(target, 200, 2, cut_after=cut_after)
        camera = f"eye={-60 + 12 * step},1.7,1,target={40 + 12 * step},1.7,9,fov=60,far=60"
        resume = ["--resume", part] if before else []
        done = ut.run("umbrage", "stream", *source_of(slow.port), "--camera", camera, "--round", "32K", "-o", part,
                      *resume, "--quiet", code=None)
        assert done.returncode in (0, 69), done.stderr
        check(before, places)
        after = held_pages(part) if os.path.exists(part) else []
        assert set(before) <= set(after) and len(after) == len(set(after)), (before, after)
        cuts += slow.cut_after is None and cut_after is not None
        step += done.returncode == 0
        sent += slow.sent
        if step == 12:
            kept += sum(places[page][1] - places[page][0] for page in after)
            pages += len(after)
            os.remove(part)
            if cuts == 20:
                return sent, kept, pages
            step = 0
    raise AssertionError(f"{cuts} cuts, {step} steps")


def never_again(before, places):
    """No range requested from the web server may overlap a page that was already received."""
    for first, last in server.ranges:
        if first > 0:
            again = [page for page in before if places[page][0] <= last and first < places[page][1]]
            assert not again, (first, last, again)
    del server.ranges[:]


with test.check("20 connections cut in mid-transfer: what came is kept, and never asked for again"):
    del server.ranges[:]
    _, _, pages = walk_with_cuts(lambda port: ["--from-url", f"http://127.0.0.1:{port}/city.umb"], server.port,
                                 never_again)
    assert pages > 12, pages

with test.check("the same from a daemon, whose replies carry many pages each"):
    os.mkdir(test.path("store"))
    shutil.copy(asset, test.path("store/city.umb"))
    daemon = test.daemon("--workers", 2)
    sent, kept, pages = walk_with_cuts(lambda port: ["city", "--address", f"tcp:127.0.0.1:{port}"],
                                       daemon.grpc_unix.removeprefix("unix:"), lambda *_: None)
    # Bytes lost with a connection: the replies under way (a round of 32 KiB, and blocks), received
    # twice.
    assert pages > 12 and sent < kept + 22 * (2 * (64 << 10)), (sent, kept, pages)
    daemon.stop()

with test.check("a memory budget holds over a path, and every point is still answered"):
    path = os.path.join(folder, "path.txt")
    with open(path, "w", encoding="utf-8") as file:
        for i in range(6):
            print(f"eye={-60 + 20 * i},1.7,1,target={40 + 20 * i},1.7,9,fov=60,far=60", file=file)
    told = stream(asset, "--path", path, "--points", points, "--normals", "--memory", "1200K")
    assert told["memory_peak_bytes"] <= 1200 << 10, told["memory_peak_bytes"]
    assert told["pages_dropped"] > 0, told
    assert told["steps"][-1]["worst_m"] > 0, told["steps"][-1]

with test.check("a slow link carries the first answers in two round trips"):
    slow = link.Link(server.port, 20, 100)
    told = stream("--from-url", f"http://127.0.0.1:{slow.port}/city.umb", "--camera", CAMERA,
                  "--points", points, "--normals")
    checks_steps(told)
    assert told["steps"][0]["seconds"] > 0.2, told["steps"][0]  # handshake, request: the link is real
    assert told["steps"][0]["bytes"] <= 65536 and told["steps"][0]["rounds"] == 1

with test.check("a part goes on from its own asset only"):
    box, other = os.path.join(folder, "box.glb"), os.path.join(folder, "other.umb")
    subprocess.run([ut.program("scenegen"), "box", "-o", box], check=True, stderr=subprocess.DEVNULL)
    ut.run("umbrage-bake", box, "-o", other, "--resolution", "256", "--sun", "135,45", "--verify", "0", "--quiet")
    for source in ((other,), ("--from-url", url.replace("city", "other"))):
        said = stream(*source, "--resume", part_a, "-o", part_b, code=65)
        assert "another asset than what was saved" in said, said
    del server.ranges[:]
    stream("--from-url", url, "--resume", part_a, "--camera", CAMERA)
    assert server.ranges == [(0, 127)], server.ranges  # the source was looked at, no more

with test.check("the wrong asset, damaged pages, no ranges, no file, nobody there: said clearly"):
    assert "another asset" in stream("--from-url", url, "--id", "0" * 64, code=65)
    with open(asset, "rb") as file:
        spoilt = bytearray(file.read())
    spoilt[-1] ^= 1
    with open(os.path.join(folder, "spoilt.umb"), "wb") as file:
        file.write(spoilt)
    said = stream("--from-url", url.replace("city", "spoilt"), code=65)
    assert "page " in said and "checksum" in said, said
    assert "404" in stream("--from-url", url.replace("city", "none"), code=66)
    plain = link.RangeServer(folder, serves_ranges=False)
    said = stream("--from-url", f"http://127.0.0.1:{plain.port}/city.umb", code=69)
    assert "does not serve ranges" in said, said
    plain.close()
    server.close()
    stream("--from-url", url, code=69)
    assert "http" in stream("--from-url", "ftp://x/y", code=2)

with test.check("an answer without an end: an error is told at once, what is no part is not read"):
    def endless(head):
        """A server of one answer that never ends; returns its URL."""
        listener = socket.create_server(("127.0.0.1", 0))

        def serve(one):
            try:
                one.recv(4096)
                one.sendall(head + b"\r\n\r\n")
                while True:
                    one.sendall(b"x" * 1000)
                    time.sleep(0.02)
            except OSError:
                pass  # the client has heard enough

        def accept():
            while True:
                threading.Thread(target=serve, args=listener.accept()[:1], daemon=True).start()
        threading.Thread(target=accept, daemon=True).start()
        return f"http://127.0.0.1:{listener.getsockname()[1]}/city.umb"

    for head, code, words in ((b"HTTP/1.1 404 Not Found", 66, "says 404"),
                              (b"HTTP/1.1 503 Busy\r\nContent-Length: 99999999999", 69, "says 503"),
                              (b"HTTP/1.1 302 Found\r\nLocation: /there", 69, "redirects"),
                              (b"HTTP/1.1 200 OK", 69, "does not serve ranges"),
                              (b"HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 0-127/9999", 69,
                               "does not serve ranges")):
        started = time.monotonic()
        assert words in stream("--from-url", endless(head), code=code), head
        assert time.monotonic() - started < 5, head

if shutil.which("nginx") or os.path.exists("/usr/sbin/nginx"):
    with test.check("nginx serves the same part"):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        conf = os.path.join(folder, "nginx.conf")
        with open(conf, "w", encoding="utf-8") as file:
            file.write(f"daemon off; master_process off; pid {folder}/nginx.pid; error_log stderr crit;"
                       "events {} http { access_log off; "
                       f"client_body_temp_path {folder}/b; proxy_temp_path {folder}/p; "
                       f"fastcgi_temp_path {folder}/f; uwsgi_temp_path {folder}/u; "
                       f"scgi_temp_path {folder}/s; "
                       f"server {{ listen 127.0.0.1:{port}; root {folder}; }} }}")
        nginx = subprocess.Popen([shutil.which("nginx") or "/usr/sbin/nginx", "-c", conf],
                                 stderr=subprocess.DEVNULL)
        try:
            def answers():
                with socket.socket() as one:
                    return one.connect_ex(("127.0.0.1", port)) == 0
            ut.wait_until(answers, 20, "nginx answers")
            part_c = os.path.join(folder, "c.part")
            stream("--from-url", f"http://127.0.0.1:{port}/city.umb", "--camera", CAMERA, "-o", part_c)
            with open(part_a, "rb") as one, open(part_c, "rb") as other:
                assert one.read() == other.read()
        finally:
            nginx.terminate()
            nginx.wait()
else:
    ut.left_out("nginx", "it is not installed")

with test.check("frames show the shadows sharpening"):
    frames = os.path.join(folder, "frames")
    told = stream(asset, "--camera", CAMERA, "--points", points, "--normals", "--frames", frames,
                  "--size", "320x180")
    pictures = sorted(os.listdir(frames))
    assert len(pictures) == len(told["steps"]), (pictures, len(told["steps"]))
    orange = []
    for name in pictures:
        with open(os.path.join(frames, name), "rb") as file:
            assert file.readline() == b"P6\n" and file.readline() == b"320 180\n"
            file.readline()
            body = file.read()
        assert len(body) == 320 * 180 * 3
        pixels = [body[i:i + 3] for i in range(0, len(body), 3)]
        orange.append(sum(1 for p in pixels if p[0] > p[2]))
    assert orange[0] > orange[-1], orange

test.finish()
