#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
An asset several times larger than the memory the daemon may use: right answers, what they cost, and
that calls on an asset that is in memory do not wait for it.

Not part of `make system`: `make larger-than-memory` bakes a large asset (or takes ASSET=FILE) and needs
root and a memory cgroup (version 1 or 2) that can be written; it is skipped where there is none.
"""
import os
import subprocess
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

LIMIT = int(os.environ.get("LIMIT_MIB", "128")) << 20
ut.need_grpc()
test = ut.Test(limit_s=900)
SEED = 7


def make_group():
    """A memory group with the limit; returns its folder. Skips where that cannot be done."""
    for root, name in (("/sys/fs/cgroup/memory", "memory.limit_in_bytes"),
                       ("/sys/fs/cgroup", "memory.max")):
        path = os.path.join(root, f"umbrage-test-{os.getpid()}")
        try:
            os.mkdir(path)
            with open(os.path.join(path, name), "w", encoding="ascii") as file:
                file.write(str(LIMIT))
            return path
        except OSError:
            if os.path.isdir(path):
                os.rmdir(path)
    return ut.skip("no memory cgroup can be made here")


group = make_group()
store = test.path("store")
os.mkdir(store)
asset = os.environ.get("ASSET")
if asset:
    os.symlink(os.path.abspath(asset), os.path.join(store, "big.umb"))
else:
    test.bake(test.scene("terrain", 256), os.path.join(store, "big.umb"), "--resolution", 32768,
              "--sun", "135,45", "--sun", "250,20", "--closed", "off", "--depth", "raster",
              "--verify", 0)
test.bake(test.scene("city", 4), os.path.join(store, "hot.umb"), "--resolution", 1024, "--depth",
          "raster", "--verify", 0)
# The asset is made and proven without the limit; the daemon under the limit knows the asset and
# opens its head only.
test.daemon().stop()
test.daemons.clear()
mapped = max((os.path.join(store, ".umbrage-cache", name)
              for name in os.listdir(os.path.join(store, ".umbrage-cache")) if name.endswith(".umbm")),
             key=os.path.getsize)
size = os.path.getsize(mapped)
os.system("sync")
with open("/proc/sys/vm/drop_caches", "w", encoding="ascii") as file:
    file.write("1")

begin = time.monotonic()
subprocess_popen = subprocess.Popen


def popen_in_group(*args, **named):
    return subprocess_popen(*args, **named, preexec_fn=lambda: open(
        os.path.join(group, "cgroup.procs"), "w", encoding="ascii").write(str(os.getpid())))


subprocess.Popen = popen_in_group
daemon = test.daemon("--scrub-interval", 0)
subprocess.Popen = subprocess_popen
opened = time.monotonic() - begin
info = test.client(daemon.grpc_tcp)
about = info.describe(test.messages.shadows.DescribeRequest(asset="big"), timeout=60)
low = (about.bounds_min[0], about.bounds_min[1], about.bounds_min[2])
high = (about.bounds_max[0], about.bounds_max[1], about.bounds_max[2])

with test.check(f"an asset of {size >> 20} MiB under {LIMIT >> 20} MiB opens within a second"):
    assert size > 3 * LIMIT, "the asset is too small for this test"
    assert "how=known" in daemon.log()
    assert opened < 1 or ut.is_sanitized(), f"{opened:.2f} s"
    print(f"    opened and ready in {opened:.2f} s")
with test.check("answers are right, and their time is stated"):
    times = []
    for i in range(400):
        points = ut.floats(ut.random_points(low, high, 64, SEED + i))
        begin = time.monotonic()
        reply = info.ask("big", points)
        times.append(time.monotonic() - begin)
        if i % 40 == 0:
            assert reply.visibility == test.query_file(mapped, points,
                                                             encoding="u8"), "a wrong answer"
    times.sort()
    print(f"    calls of 64 random points: p50 {times[200] * 1e3:.2f} ms, p99 {times[395] * 1e3:.2f} ms, "
          f"largest {times[-1] * 1e3:.2f} ms; resident {daemon.resident_bytes() >> 20} MiB")


def hot_times(client, count):
    """Seconds of calls of 64 points on the asset that stays in memory, one every 5 ms, sorted."""
    points = ut.floats(ut.random_points((-400, 0, -400), (400, 60, 400), 64, SEED))
    taken = []
    for _ in range(count):
        begin = time.monotonic()
        client.ask("hot", points)
        taken.append(time.monotonic() - begin)
        time.sleep(0.005)
    return sorted(taken)


def said(taken):
    return f"p50 {taken[len(taken) // 2] * 1e3:.2f} ms, p99 {taken[len(taken) * 99 // 100] * 1e3:.2f} ms"


with test.check("calls on an asset in memory do not wait for the cold one"):
    stopping = threading.Event()
    cold_calls = [0, 0]

    def cold(number):
        mine = test.client(daemon.grpc_tcp, [("grpc.use_local_subchannel_pool", 1)])
        while not stopping.is_set():
            # 20000 random points, most on pages that must be read, keep the workers busy for a long
            # time.
            seed = SEED + 1000 * number + cold_calls[number]
            mine.ask("big", ut.floats(ut.random_points(low, high, 20000, seed)), timeout=120)
            cold_calls[number] += 1
        mine.close()

    quiet = hot_times(info, 400)
    threads = [threading.Thread(target=cold, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    busy = hot_times(info, 400)
    stopping.set()
    for thread in threads:
        thread.join()
    print(f"    hot calls alone: {said(quiet)}; beside {sum(cold_calls)} cold calls of 20000 points: {said(busy)}")
    assert sum(cold_calls) > 0
    # A cold batch takes seconds here; hot calls must be far faster.
    assert busy[len(busy) // 2] < 0.05, said(busy)
info.close()
daemon.stop()
test.daemons.clear()
os.rmdir(group)
test.finish()
