#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The long form of test_drain.py and test_store.py: RESTARTS (100) restarts and SWAPS (1000) swaps of an asset
under load. Not part of `make system`: `make soak` runs it.

Restarts: two daemons on fixed sockets, drained and started again in turn. No call may fail with at most
two retries on the other one. Swaps: a link is moved between two versions. An answer is of the wrong version
if it names one that was not current at any moment of its call, or does not have that version's bits.
"""
import os
import random
import signal
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
RESTARTS = int(os.environ.get("RESTARTS", "100"))
SWAPS = int(os.environ.get("SWAPS", "1000"))
SEEN_S = 10  # a move must be seen within this time
CLIENTS = 4
SIZES = (100, 30000)  # answered on the loop, and by the workers
test = ut.Test(limit_s=3600)
SEED = 11
print(f"seed {SEED}")
assert test.messages  # made here, before there are threads that need them
store = test.path("store")
os.mkdir(store)
ids = [test.bake(test.scene("city", 4, seed), os.path.join(store, f"v{seed}.umb"), "--resolution", 1024,
                 "--depth", "raster", "--verify", 0)["asset"] for seed in (1, 2)]
os.symlink("v1.umb", os.path.join(store, "latest.umb"))
points = ut.floats(ut.random_points((-500, -10, -500), (500, 80, 500), max(SIZES), SEED))
truth = {(version, size): test.query_file(os.path.join(store, f"v{i + 1}.umb"), points[:12 * size],
                                          encoding="u8")
         for i, version in enumerate(ids) for size in SIZES}


class Load:
    """Clients that ask all the time; `judge(reply, size, begin)` says what is wrong with an answer."""

    def __init__(self, targets, asset, judge):
        self.targets, self.asset, self.judge = targets, asset, judge
        self.answered = self.retried = 0
        self.wrong = []
        self.stopping = threading.Event()
        self.lock = threading.Lock()
        self.threads = [threading.Thread(target=self.run, args=(i,)) for i in range(CLIENTS)]
        for thread in self.threads:
            thread.start()

    def ask(self, clients, size, first):
        """One call, with at most two retries; the reply, or what the last error was."""
        for attempt in range(3):
            try:
                return clients[(first + attempt) % len(clients)].ask(
                    self.asset, points[:12 * size], timeout=30)
            except grpc.RpcError as error:
                last = f"{error.code()}: {error.details()}"
                if error.code() != Code.UNAVAILABLE:
                    return last
                with self.lock:
                    self.retried += 1
        return last

    def run(self, number):
        # gRPC waits a second and more before it connects again, longer than a daemon is away here.
        options = [("grpc.enable_retries", 0), ("grpc.use_local_subchannel_pool", 1)] + [
            (f"grpc.{which}_reconnect_backoff_ms", 50) for which in ("initial", "min", "max")]
        clients = [test.client(target, options) for target in self.targets]
        turn = number
        while not self.stopping.is_set():
            turn += 1
            size = SIZES[turn % len(SIZES)]
            begin = time.monotonic()
            reply = self.ask(clients, size, turn // 2)
            fault = reply if isinstance(reply, str) else self.judge(reply, size, begin)
            with self.lock:
                self.answered += 1
                if fault:
                    self.wrong.append(fault)
        for client in clients:
            client.close()

    def stop(self):
        self.stopping.set()
        for thread in self.threads:
            thread.join()


def bits_differ(reply, size, _begin):
    version = reply.asset_id.hex()
    return None if reply.visibility == truth[version, size] else f"{size} points: other bits than {version}'s"


with test.check(f"{RESTARTS} restarts under load: no call fails with at most two retries"):
    sockets = [test.path("one.sock"), test.path("two.sock")]
    daemons = [test.daemon("--listen", "unix:" + path) for path in sockets]
    load = Load(["unix:" + path for path in sockets], "v1", bits_differ)
    rng = random.Random(SEED)
    for turn in range(RESTARTS):
        which = turn % 2
        daemons[which].signal(signal.SIGTERM)
        daemons[which].exited()
        test.daemons.remove(daemons[which])
        daemons[which] = test.daemon("--listen", "unix:" + sockets[which])
        time.sleep(rng.uniform(0.2, 0.4))
    load.stop()
    print(f"    {load.answered} calls, {load.retried} retried, {len(load.wrong)} failed")
    assert not load.wrong, load.wrong[:5]
    assert load.answered > 10 * RESTARTS, "no load"
    for daemon in daemons:
        daemon.stop()

with test.check(f"{SWAPS} swaps under load: no answer of a version that was not current during its call"):
    daemon = test.daemon()
    current = [[0.0, ids[0], None]]  # from the move, version, until another was seen in its place

    def judge(reply, size, begin):
        end = time.monotonic()
        version = reply.asset_id.hex()
        allowed = {name for since, name, until in list(current)
                   if since <= end and (until is None or until >= begin)}
        if version not in allowed:
            return f"{version[:8]} is not among {[name[:8] for name in allowed]}"
        return bits_differ(reply, size, begin)

    load = Load([daemon.grpc_tcp], "latest", judge)
    watcher = test.client(daemon.grpc_tcp)
    slowest = 0.0
    for turn in range(SWAPS):
        wanted = (turn + 1) % 2
        os.symlink(f"v{wanted + 1}.umb", os.path.join(store, ".next"))
        moved = time.monotonic()
        current.append([moved, ids[wanted], None])
        os.rename(os.path.join(store, ".next"), os.path.join(store, "latest.umb"))
        ut.wait_until(lambda: watcher.ask("latest", points[:12]).asset_id.hex() == ids[wanted], SEEN_S,
                      f"swap {turn} is seen")
        current[-2][2] = time.monotonic()
        slowest = max(slowest, current[-2][2] - moved)
    load.stop()
    watcher.close()
    print(f"    {load.answered} calls, {len(load.wrong)} wrong, the slowest move was seen after {slowest:.2f} s")
    assert not load.wrong, load.wrong[:5]
    assert load.answered > SWAPS, "no load"
test.finish()
