#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Files of the store that others cut, overwrite, delete and replace while calls run on them: the daemon
lives, other assets answer as ever, no answer is wrong, and what was damaged is made anew by itself.
"""
import os
import random
import shutil
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import raw_http2 as h2  # noqa: E402
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
SEED = 5
ROUNDS = int(os.environ.get("ROUNDS", "6" if ut.is_sanitized() else "24"))
test = ut.Test(limit_s=200 + 10 * ROUNDS)
SOON = 20
rng = random.Random(SEED)
print(f"seed {SEED}")

store = test.path("store")
os.mkdir(store)
ids = {}
for name, seed in (("victim", 1), ("other", 2)):
    path = os.path.join(store, name + ".umb")
    ids[name] = test.bake(test.scene("city", 5, seed), path, "--resolution", 2048, "--depth",
                          "raster", "--verify", 0)["asset"]
# Small batches are answered on the loop, large ones by the workers.
few = ut.floats(ut.random_points((-500, -10, -500), (500, 80, 500), 100, SEED))
many = ut.floats(ut.random_points((-500, -10, -500), (500, 80, 500), 20000, SEED + 1))
truth = {(name, data): test.query_file(os.path.join(store, name + ".umb"), data, encoding="u8")
         for name in ids for data in (few, many)}


def cache_path(name):
    return os.path.join(store, ".umbrage-cache", ids[name] + ".umbm")


class Load:
    """Calls on both assets from several threads, each answer compared."""

    def __init__(self, daemon):
        self.stopping = threading.Event()
        self.answered = {"victim": 0, "other": 0}
        self.refused = 0
        self.wrong = []
        self.lock = threading.Lock()
        self.threads = [threading.Thread(target=self.run, args=(daemon, name, data))
                        for name in ids for data in (few, many)]
        for thread in self.threads:
            thread.start()

    def run(self, daemon, name, data):
        client = test.client(daemon.grpc_tcp)
        while not self.stopping.is_set():
            try:
                right = client.ask(name, data).visibility == truth[name, data]
                with self.lock:
                    self.answered[name] += 1
                    if not right:
                        self.wrong.append(f"{name}: a wrong answer")
            except grpc.RpcError as error:
                with self.lock:
                    self.refused += 1
                    if name != "victim" or error.code() != Code.DATA_LOSS:
                        self.wrong.append(f"{name}: {error.code()} {error.details()}")
        client.close()

    def stop(self):
        self.stopping.set()
        for thread in self.threads:
            thread.join()
        assert not self.wrong, self.wrong[:3]
        print(f"    {self.answered} answered, {self.refused} refused")


def cut(path):
    os.truncate(path, rng.randrange(os.path.getsize(path)))


def overwrite(path):
    with open(path, "r+b") as file:
        size = os.path.getsize(path)
        file.seek(rng.randrange(size // 2))
        file.write(rng.randbytes(size // 2))


def delete(path):
    os.remove(path)


def replace(path):
    with open(path + ".new", "wb") as file:
        file.write(rng.randbytes(5000))
    os.rename(path + ".new", path)


def heals(client):
    """True once the victim answers again."""
    try:
        return client.ask("victim", few).visibility == truth["victim", few]
    except grpc.RpcError as error:
        assert error.code() == Code.DATA_LOSS, error
        return False


def damage(daemon, client, how):
    for _ in range(ROUNDS // 2 if how in (cut, overwrite) else max(3, ROUNDS // 8)):
        if os.path.exists(cache_path("victim")):
            how(cache_path("victim"))
        time.sleep(rng.uniform(0.01, 0.1))
        ut.wait_until(lambda: heals(client), SOON, "the victim answers again\n" + daemon.log()[-2000:])


daemon = test.daemon()
client = test.client(daemon.grpc_tcp)
for how in (cut, overwrite):
    with test.check(f"{how.__name__} under load: DATA_LOSS for that asset at most, never a wrong answer"):
        before = daemon.metric("umbrage_sigbus_total")
        load = Load(daemon)
        damage(daemon, client, how)
        load.stop()
        assert load.answered["other"] > 0 and load.answered["victim"] > 0
        assert daemon.metric("umbrage_sigbus_total") > before
        assert "event=asset_quarantined asset=victim" in daemon.log()
        assert "asset_quarantined asset=other" not in daemon.log()


QUERY, STREAM = "/umbrage.v1.Shadows/Query", "/umbrage.v1.Shadows/QueryStream"


def ask_at_once(asked):
    """Sends each (path, asset, repeats) as a call of its own, all requests in one write; returns
    the replies."""
    wire = h2.Connection(daemon.port)
    wire.settle()
    pieces = []
    wire.send, send = lambda data: pieces.append(data) or True, wire.send
    streams = []
    for path, asset, times in asked:
        request = test.messages.shadows.QueryRequest(asset=asset, points=few)
        streams.append(wire.open(path))
        wire.data(streams[-1], h2.prefixed(request.SerializeToString()) * times, end=True)
    wire.send = send
    wire.send(b"".join(pieces))
    replies = [wire.reply(stream) for stream in streams]
    wire.close()
    return replies


def visibilities(reply):
    """Parts of every message of a body."""
    body, found = reply.body, []
    while body:
        size = int.from_bytes(body[1:5], "big")
        found.append(test.messages.shadows.QueryReply.FromString(body[5:5 + size]).visibility)
        body = body[5 + size:]
    return found


# Answers of one event share one check of the file (server/daemon/call/optimistic_reads.h).
with test.check("of requests in one packet those on the damaged asset fail, and no answer of it leaves"):
    asked = [(STREAM, "victim", 5), (QUERY, "other", 1), (QUERY, "victim", 1), (STREAM, "other", 5)]
    for _ in range(3):
        ut.wait_until(lambda: heals(client), SOON, "the victim answers again")
        for (_, asset, times), reply in zip(asked, ask_at_once(asked)):
            assert reply.status == 0 and visibilities(reply) == [truth[asset, few]] * times, reply
        # A file made again a moment later may have the same time: file systems count in ticks.
        made = os.stat(cache_path("victim")).st_mtime_ns
        ut.wait_until(lambda: time.time_ns() - made > 50_000_000, SOON, "a later time")
        overwrite(cache_path("victim"))
        for (_, asset, times), reply in zip(asked, ask_at_once(asked)):
            if asset == "victim":
                assert reply.status == Code.DATA_LOSS.value[0] and not reply.body, reply
            else:
                assert reply.status == 0 and visibilities(reply) == [truth[asset, few]] * times, reply
    ut.wait_until(lambda: heals(client), SOON, "the victim answers again")
for how in (delete, replace):
    with test.check(f"{how.__name__} under load: nobody notices"):
        load = Load(daemon)
        damage(daemon, client, how)
        load.stop()
        assert load.refused == 0
with test.check("the daemon drains, exits with 0, and no sanitizer complains"):
    client.close()
    daemon.stop()
with test.check("with --copy no call fails whatever happens to the cache"):
    shutil.rmtree(os.path.join(store, ".umbrage-cache"))
    daemon = test.daemon("--copy")
    client = test.client(daemon.grpc_tcp)
    load = Load(daemon)
    for how in (overwrite, cut, replace, delete):
        how(cache_path("victim"))
        assert heals(client)
    load.stop()
    assert load.refused == 0
    client.close()
test.finish()
