#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
# run: alone (it measures processor time beside the clock)
"""
A daemon with few descriptors: none left to accept with, fewer than --max-connections, and more
assets than the soft limit lets it map. It must wait without spinning, and lose no client.
"""
import os
import resource
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import raw_http2 as h2  # noqa: E402
import umbrage_test as ut  # noqa: E402

ut.need_grpc()  # for the message classes
test = ut.Test()
QUERY = "/umbrage.v1.Shadows/Query"
OK = 0
SPARE = 6     # descriptors left when the limit is lowered
COMERS = 30   # connections made then
FULL_S = 2.0  # how long the daemon stands full

M = test.messages.shadows
os.mkdir(test.path("store"))
test.bake(test.scene("city", 3), test.path("store", "city.umb"), "--resolution", 256, "--depth",
          "raster", "--verify", 0)
ASK = h2.prefixed(M.QueryRequest(asset="city", points=bytes(96)).SerializeToString())


def descriptors(pid):
    """Numbers that are open."""
    return sorted(int(name) for name in os.listdir(f"/proc/{pid}/fd"))


def cpu_s(pid):
    """Processor time of a process, all threads."""
    with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def limit(pid, count):
    _, hard = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (count, hard))


def answered(connection):
    return connection.call(QUERY, ASK).status == OK


def limited(soft, hard, make):
    """make() with the limits of descriptors that a child inherits; hard None: as it is."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    if before[1] != resource.RLIM_INFINITY and before[1] < 4096:
        ut.skip(f"the hard limit of descriptors is {before[1]}")
    start = subprocess.Popen

    def start_limited(*words, **how):
        return start(*words, preexec_fn=lambda: resource.setrlimit(
            resource.RLIMIT_NOFILE, (soft, hard or before[1])), **how)

    subprocess.Popen = start_limited
    try:
        return make()
    finally:
        subprocess.Popen = start


def comer(daemon):
    """A connection that sent its request before the daemon accepted it. The reply comes after the
    daemon has accepted."""
    connection = h2.Connection(path=daemon.socket_path, timeout=60)
    stream = connection.open(QUERY)
    connection.data(stream, ASK, end=True)
    return connection, stream


for loops in (1, 2):
    daemon = test.daemon("--loops", loops)
    pid = daemon.process.pid
    with test.check(f"{loops} loops without a descriptor left answer on, and serve who waited"):
        first = h2.Connection(path=daemon.socket_path)
        assert answered(first)
        whole = resource.prlimit(pid, resource.RLIMIT_NOFILE)
        numbers = descriptors(pid)
        free = [n for n in range(max(numbers) + SPARE + 2) if n not in numbers]
        limit(pid, free[SPARE])  # so that exactly SPARE numbers below it are free
        comers = [comer(daemon) for _ in range(COMERS)]
        ut.wait_until(lambda: "accept_failed" in daemon.log(), 10, "accepting fails")
        begin, spent = time.monotonic(), cpu_s(pid)
        while time.monotonic() - begin < FULL_S:
            assert answered(first), "a connection that is open"
            time.sleep(0.1)
        spent, took = cpu_s(pid) - spent, time.monotonic() - begin
        print(f"    {spent:.2f} s of processor time in {took:.1f} s")
        assert spent < took / 2, "it spins"
        for connection, stream in comers:
            assert connection.reply(stream, 60).status == OK, "one that had to wait"
            connection.close()
        resource.prlimit(pid, resource.RLIMIT_NOFILE, whole)
        assert answered(first)
        first.close()
        daemon.stop()
with test.check("with fewer descriptors than --max-connections it says so and keeps some for itself"):
    daemon = limited(300, 300, test.daemon)
    assert "descriptors_limited" in daemon.log() and "connections=172" in daemon.log()
    pid = daemon.process.pid
    crowd = [comer(daemon) for _ in range(200)]
    ut.wait_until(lambda: daemon.metric("umbrage_connections_opened_total") +
                  daemon.metric("umbrage_connections_refused_total") >= 200, 20, "all came")
    assert max(descriptors(pid)) < 290, "there are some left for files and the admin port"
    assert "accept_failed" not in daemon.log()
    for connection, _ in crowd:
        connection.close()
    ut.wait_until(lambda: daemon.metric("umbrage_connections") == 0, 20, "all are gone")
    last = h2.Connection(path=daemon.socket_path)
    assert answered(last)
    last.close()
    daemon.stop()
with test.check("a store of more assets than the soft limit has descriptors is mapped at the start"):
    store = test.path("many")
    os.mkdir(store)
    for i in range(120):
        os.link(test.path("store", "city.umb"), os.path.join(store, f"city{i}.umb"))
    daemon = limited(90, None, lambda: test.daemon(store=store))
    assert daemon.metric("umbrage_asset_loaded") == 120
    assert "cache_unavailable" not in daemon.log(), daemon.log()[-2000:]
    daemon.stop()
test.finish()
