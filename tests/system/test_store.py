#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The store folder of a running daemon: assets are added, changed, damaged and removed without a
restart, and no answer may be wrong. Each reply must name the version that answered, and hold that
version's answers.
"""
import os
import shutil
import signal
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
test = ut.Test()
M = test.messages.shadows
SOON = 20 if ut.is_sanitized() else 8  # seconds; files are seen at once, load takes a moment
SEED = 11
print(f"seed {SEED}")

ids = {}
for name, size, seed in (("a", 3, 1), ("b", 3, 2), ("c", 4, 3)):
    ids[name] = test.bake(test.scene("city", size, seed), test.path(name + ".umb"), "--resolution",
                          512, "--depth", "raster", "--verify", 0)["asset"]
points = ut.floats(ut.random_points((-500, -10, -500), (500, 80, 500), 5000, SEED))
answers = {ids[name]: test.query_file(test.path(name + ".umb"), points, "--taps", 3, encoding="u8")
           for name in ids}
assert len(set(answers.values())) == 3, "the versions must differ to tell them apart"

store = test.path("store")
os.mkdir(store)
daemon = test.daemon()
client = test.client(daemon.grpc_tcp)


def publish(source, name):
    """Replaces a file as bakes and people should: written beside it, then renamed."""
    part = os.path.join(store, ".part." + name.replace("/", "."))
    shutil.copyfile(test.path(source + ".umb"), part)
    os.rename(part, os.path.join(store, name))


def ask(name):
    reply = client.ask(name, points, taps=3)
    return reply.asset_id.hex(), reply.visibility


def state(name):
    """Id that answers, or the code of the refusal."""
    try:
        asset, visibility = ask(name)
        assert visibility == answers[asset], "answers of another version"
        return asset
    except grpc.RpcError as error:
        return error.code()


def becomes(name, wanted):
    ut.wait_until(lambda: state(name) == wanted, SOON, f"{name} is {wanted}, now {state(name)}")


def cached():
    folder = os.path.join(store, ".umbrage-cache")
    return sorted(n for n in os.listdir(folder) if n.endswith(".umbm")) if os.path.isdir(folder) else []


with test.check("an empty store serves, and knows nothing"):
    assert not client.list(M.ListRequest(), timeout=60).assets
    assert state("one") == Code.NOT_FOUND
with test.check("a file renamed into the store answers within seconds"):
    publish("a", "one.umb")
    becomes("one", ids["a"])
    assert [x.name for x in client.list(M.ListRequest(), timeout=60).assets] == ["one"]
    assert cached() == [ids["a"] + ".umbm"]
with test.check("a file copied slowly into the store answers when it is whole, never before"):
    with open(test.path("b.umb"), "rb") as file:
        data = file.read()
    with open(os.path.join(store, "slow.umb"), "wb") as file:
        step = len(data) // 12 + 1
        for at in range(0, len(data), step):
            file.write(data[at:at + step])
            file.flush()
            assert state("slow") in (Code.NOT_FOUND, Code.DATA_LOSS) or at + step >= len(data)
            time.sleep(0.08)
    becomes("slow", ids["b"])
with test.check("names that are no asset's are not served"):
    for name in ("one two.umb", ".hidden.umb", "x.umb.part", "größe.umb"):
        shutil.copyfile(test.path("a.umb"), os.path.join(store, name))
    os.symlink("/nowhere", os.path.join(store, "broken.umb"))
    os.mkdir(os.path.join(store, "folder.umb"))
    daemon.signal(signal.SIGHUP)
    publish("c", "three.umb")
    becomes("three", ids["c"])
    names = [x.name for x in client.list(M.ListRequest(), timeout=60).assets]
    assert names == ["one", "slow", "three"], names
with test.check("replacing a file under load gives each call one version, whole"):
    stopping = threading.Event()
    seen = {}
    wrong = []

    def hammer():
        mine = test.client(daemon.grpc_tcp)
        while not stopping.is_set():
            try:
                reply = mine.ask("one", points, taps=3)
                asset = reply.asset_id.hex()
                seen[asset] = seen.get(asset, 0) + 1
                if asset not in (ids["a"], ids["b"]) or reply.visibility != answers[asset]:
                    wrong.append(asset)
            except grpc.RpcError as error:
                wrong.append(str(error))
        mine.close()

    threads = [threading.Thread(target=hammer) for _ in range(4)]
    for thread in threads:
        thread.start()
    for version in ("b", "a", "b", "a", "b"):
        before = seen.get(ids[version], 0)
        publish(version, "one.umb")
        becomes("one", ids[version])
        ut.wait_until(lambda: seen.get(ids[version], 0) > before + 3, SOON, "calls meet it")
    stopping.set()
    for thread in threads:
        thread.join()
    assert not wrong, wrong[:3]
    print("   ", sum(seen.values()), "calls")
with test.check("damaged files are DATA_LOSS for their own calls, the others answer on"):
    with open(test.path("c.umb"), "rb") as file:
        good = file.read()
    damages = {"cut": good[:len(good) // 2], "flip": bytearray(good), "empty": b"", "old": good[:8] + b"\1" + good[9:],
               "text": b"this is not an asset\n" * 100, "tail": good + b"x"}
    damages["flip"][len(good) - 100] ^= 1
    for name, data in damages.items():
        with open(os.path.join(store, ".part"), "wb") as file:
            file.write(data)
        os.rename(os.path.join(store, ".part"), os.path.join(store, name + ".umb"))
    for name in damages:
        becomes(name, Code.DATA_LOSS)
        client.refused(lambda: ask(name), Code.DATA_LOSS, name)
    assert state("one") == ids["b"] and state("three") == ids["c"]
    client.refused(lambda: ask("old"), Code.DATA_LOSS, "made by an earlier version: bake the scene again")
    assert "event=asset_unreadable asset=old" in daemon.log()
    assert daemon.metric("umbrage_asset_damaged") >= len(damages)
    names = [x.name for x in client.list(M.ListRequest(), timeout=60).assets]
    assert names == ["one", "slow", "three"], names
with test.check("a good file in place of a damaged one answers"):
    publish("c", "flip.umb")
    becomes("flip", ids["c"])
with test.check("a damaged file in place of a good one is DATA_LOSS, under its own name only"):
    shutil.copyfile(os.path.join(store, "cut.umb"), os.path.join(store, ".part"))
    os.rename(os.path.join(store, ".part"), os.path.join(store, "flip.umb"))
    becomes("flip", Code.DATA_LOSS)
    assert state("three") == ids["c"]
with test.check("a link in a folder further down is an alias that moves in one step"):
    os.mkdir(os.path.join(store, "city"))
    publish("a", "city/v1.umb")
    publish("c", "city/v2.umb")
    os.symlink("v1.umb", os.path.join(store, "city", "latest.umb"))
    becomes("city/latest", ids["a"])
    os.symlink("v2.umb", os.path.join(store, "city", ".next"))
    os.rename(os.path.join(store, "city", ".next"), os.path.join(store, "city", "latest.umb"))
    becomes("city/latest", ids["c"])
    assert ut.run("umbrage", "info", "city/latest", "--quiet", "--address",
                  daemon.tcp).stdout.decode().strip() == ids["c"], "as people type it"
    shutil.rmtree(os.path.join(store, "city"))
    becomes("city/latest", Code.NOT_FOUND)
with test.check("a removed file is NOT_FOUND"):
    os.remove(os.path.join(store, "slow.umb"))
    becomes("slow", Code.NOT_FOUND)
    assert state(ids["c"]) == ids["c"] and state(ids["a"]) == Code.NOT_FOUND
with test.check("SIGHUP rescans and nothing else"):
    publish("a", "hup.umb")
    daemon.signal(signal.SIGHUP)
    becomes("hup", ids["a"])
    for _ in range(20):
        daemon.signal(signal.SIGHUP)
    assert state("hup") == ids["a"] and state("one") == ids["b"]
with test.check("a cache removed under a running daemon changes no answer"):
    os.rename(os.path.join(store, ".umbrage-cache"), test.path("gone"))  # the daemon may write there now
    shutil.rmtree(test.path("gone"), ignore_errors=True)
    for name, asset in (("one", "b"), ("three", "c"), ("hup", "a")):
        assert state(name) == ids[asset]
with test.check("the daemon drains, exits with 0, and no sanitizer complains"):
    client.close()
    daemon.stop()

for name in ("cut", "empty", "text", "tail", "flip"):
    os.remove(os.path.join(store, name + ".umb"))


def restarted_well():
    """A new daemon on the store must answer all three assets right; returns its log."""
    global client
    started = test.daemon()
    client = test.client(started.grpc_tcp)
    for name, asset in (("one", "b"), ("three", "c"), ("hup", "a")):
        becomes(name, ids[asset])
    client.close()
    started.stop()
    assert len(cached()) == 3, cached()
    return started.log()


with test.check("a missing cache is rebuilt at the start"):
    shutil.rmtree(os.path.join(store, ".umbrage-cache"), ignore_errors=True)
    restarted_well()
with test.check("a damaged, cut, empty or foreign cache is rebuilt, never believed"):
    folder = os.path.join(store, ".umbrage-cache")
    paths = [os.path.join(folder, name) for name in cached()]
    good = {path: open(path, "rb").read() for path in paths}
    for damage in ("flip", "cut", "empty", "swap"):
        for i, path in enumerate(paths):
            data = bytearray(good[path])
            if damage == "flip":
                data[len(data) * 2 // 3] ^= 16
            elif damage == "cut":
                data = data[:len(data) // 2]
            elif damage == "empty":
                data = b""
            else:
                data = good[paths[(i + 1) % len(paths)]]
            with open(path, "wb") as file:
                file.write(data)
        restarted_well()
        for path in paths:
            with open(path, "rb") as file:
                assert file.read() == good[path], f"{damage}: not the same cache again"
with test.check("a store whose cache cannot be written still answers"):
    shutil.rmtree(os.path.join(store, ".umbrage-cache"))
    with open(os.path.join(store, ".umbrage-cache"), "w", encoding="ascii") as file:
        file.write("in the way")
    started = test.daemon()
    client = test.client(started.grpc_tcp)
    for name, asset in (("one", "b"), ("three", "c"), ("hup", "a")):
        becomes(name, ids[asset])
    client.close()
    started.stop()
with test.check("a store that is missing or a file is refused at the start with 66"):
    for bad in (test.path("nowhere"), test.path("a.umb")):
        done = ut.run("umbraged", "--store", bad, "--listen", "tcp:127.0.0.1:0", code=66)
        assert done.stderr.count(b"\n") == 1 and bad.encode() in done.stderr, done.stderr
test.finish()
