#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""umbrage stream --follow: of a new version only pages that changed are read, from a daemon, a web server
and a file. Which pages changed is read from the directories of the files (docs/reference/umb-format.md)."""
import json
import os
import random
import shutil
import struct
import subprocess
import sys
from collections import Counter

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import edits  # noqa: E402
import link  # noqa: E402
import umbrage_test as ut  # noqa: E402

FIRST_EXTRA = 256  # bytes that the first read of a version takes beyond what the old version's head had
RESOLUTION = os.environ.get("UMBRAGE_FOLLOW_RESOLUTION", "4096")
SIZE = os.environ.get("UMBRAGE_FOLLOW_CITY", "24")

test = ut.Test()


class Directory:
    """The directory of a packed file."""

    def __init__(self, path):
        with open(path, "rb") as file:
            data = file.read()
        self.head, canonical = struct.unpack_from("<QQ", data, 24)
        count, first, rest = struct.unpack_from("<IIQ", data, 80)
        self.id = data[48:80].hex()
        self.pages, self.block_bytes, before = [], 0, 0
        for block in range((count + 31) // 32):
            upto, = struct.unpack_from("<Q", data, 128 + canonical + 48 * block + 8)
            at = self.head if block == 0 else rest + before - first
            for page in range(min(32, count - 32 * block)):
                entry = at + 64 * page
                self.pages.append((data[entry + 32:entry + 64], struct.unpack_from("<I", data, entry + 8)[0]))
            before = upto
        self.block_bytes = before


def changed(old, new):
    """Number and stored bytes of the pages of a version that the one before does not have."""
    left = Counter(page for page, _ in old.pages)
    count = size = 0
    for page, stored in new.pages:
        if left[page] > 0:
            left[page] -= 1
        else:
            count, size = count + 1, size + stored
    return count, size


def publish(version, folder):
    shutil.copyfile(test.path(f"{version}.umb"), os.path.join(folder, ".next"))
    os.replace(os.path.join(folder, ".next"), os.path.join(folder, "city.umb"))


class Follower:
    """A running `umbrage stream --follow`."""

    def __init__(self, *words):
        self.process = subprocess.Popen([ut.program("umbrage"), "stream", *words, "--follow", "--json"],
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def told(self):
        line = self.process.stdout.readline()
        if not line:
            raise AssertionError(f"the follower ended: {self.process.stderr.read().decode()}")
        return json.loads(line)

    def ends(self, code):
        out, err = self.process.communicate(timeout=60)
        assert self.process.returncode == code and out == b"", (self.process.returncode, out, err)


def expect(told, before, after, number):
    """Checks what a follower of the whole asset says about a new version; returns its figures."""
    old, new = directories[before], directories[after]
    pages, size = changed(old, new)
    assert told["asset"] == new.id and told["version"] == number, told
    assert told["pages_held"] == told["page_count"] == len(new.pages), told
    assert told["pages_kept"] + told["pages_fetched"] == len(new.pages), told
    # The first read may end behind a small page that is held already.
    assert pages <= told["pages_fetched"] <= pages + 2, (told, pages)
    most = size + new.block_bytes + new.head + old.head - new.head + 2 * FIRST_EXTRA + 4096
    assert size <= told["bytes"] <= most, (told, size, most)
    return told["bytes"], size, told["asset_bytes"]


scene = edits.Scene(test.scene("city", SIZE, form="obj"))
state = edits.Edits(scene, random.Random(5))
directories = {}
for version in ("a", "b", "c"):
    if version != "a":
        height = lambda part: max(scene.vertices[i][1] for f in part for i in scene.faces[f][1])
        middle = sorted((p for p in scene.parts if len(p) <= 2000), key=height)[-(5 if version == "b" else 9)]
        for vertex in {i for f in middle for i in scene.faces[f][1]}:
            state.moved[vertex] = [1.5, 0.0, 0.0]
    state.write(test.path("edited.obj"))
    test.bake(test.path("edited.obj"), test.path(f"{version}.umb"), "--resolution", RESOLUTION, "--sun", "135,45",
              "--verify", "0", "--up", "y")
    directories[version] = Directory(test.path(f"{version}.umb"))
assert len({d.id for d in directories.values()}) == 3

with test.check("a follower of a daemon reads only pages that changed, through a removal too"):
    store = test.path("store")
    os.makedirs(store)
    publish("a", store)
    daemon = test.daemon(store=store)
    follower = Follower("city", "--address", daemon.tcp, "--versions", "3")
    assert follower.told()["asset"] == directories["a"].id
    publish("b", store)
    figures = expect(follower.told(), "a", "b", 1)
    print("    %d bytes were read; changed pages have %d of %d" % figures)
    os.remove(os.path.join(store, "city.umb"))
    ut.wait_until(lambda: subprocess.run([ut.program("umbrage"), "info", "city", "--address", daemon.tcp],
                                         capture_output=True, check=False).returncode, 60, "the asset is gone")
    publish("c", store)
    expect(follower.told(), "b", "c", 2)
    publish("a", store)  # whose other pages the follower kept
    told = follower.told()
    assert told["pages_fetched"] == 0 and told["pages_kept"] == told["page_count"], told
    assert told["asset"] == directories["a"].id and told["bytes"] < 40000, told
    follower.ends(0)

with test.check("a web server and a file are looked at, and give the same"):
    web = test.path("web")
    os.makedirs(web)
    publish("a", web)
    server = link.RangeServer(web)
    followers = [Follower("--from-url", f"http://127.0.0.1:{server.port}/city.umb", "--versions", "1", "--interval", "0.3"),
                 Follower("--from-file", os.path.join(web, "city.umb"), "--versions", "1", "--interval", "0.3")]
    for follower in followers:
        assert follower.told()["asset"] == directories["a"].id
    publish("b", web)
    assert [expect(f.told(), "a", "b", 1) for f in followers] == [figures, figures]
    for follower in followers:
        follower.ends(0)
    server.close()

with test.check("a follower waits no longer than --timeout, and what it saved answers"):
    part = test.path("city.part")
    camera = ["--camera", "eye=1,1.7,1,target=100,1.7,9,fov=60,far=60"]
    follower = Follower("--from-file", os.path.join(web, "city.umb"), *camera, "--timeout", "1", "-o", part)
    assert follower.told()["asset"] == directories["b"].id
    follower.process.wait(timeout=60)
    said = follower.process.stderr.read().decode()
    assert follower.process.returncode != 0 and "--timeout" in said, said
    again = json.loads(ut.run("umbrage", "stream", os.path.join(web, "city.umb"), *camera, "--resume", part,
                              "--json").stdout)
    assert again["steps"][-1]["pages"] == 0, again
    assert "--follow" in ut.run("umbrage", "stream", "x.umb", "--versions", "2", code=2).stderr.decode()

test.finish()
