#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Three replicas behind the HAProxy configuration that is shipped: by asset, drained, killed."""
import os
import shutil
import signal
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import interop_route  # noqa: E402
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
test = ut.Test()
SEED = 3

asset = test.path("city.umb")
test.bake(test.scene("city", 2), asset, "--resolution", 256, "--depth", "raster", "--verify", 0)
points = ut.floats(ut.random_points((-100, -10, -100), (100, 80, 100), 500, SEED))
truth = test.query_file(asset, points, encoding="u8")
NAMES = [f"city-{i}" for i in range(12)]
replicas = []
for i in range(3):
    store = test.path(f"store{i}")
    os.mkdir(store)
    for name in NAMES:
        shutil.copyfile(asset, os.path.join(store, name + ".umb"))
    replicas.append(test.daemon("--drain-delay", "4s", store=store))
frontend = interop_route.start_haproxy(*(replica.grpc_tcp for replica in replicas))


def ask(client, name):
    """Asks for an asset, naming it to the proxy; a call may be repeated twice, as clients do."""
    request = test.messages.shadows.QueryRequest(asset=name, points=points)
    for attempt in range(3):
        try:
            reply = client.query(request, timeout=60, metadata=(("x-umbrage-asset", name),))
            assert reply.visibility == truth, "a wrong answer"
            return attempt
        except grpc.RpcError as error:
            if attempt == 2 or error.code() != grpc.StatusCode.UNAVAILABLE:
                raise
            time.sleep(1.5)  # by then the proxy has noticed
    return None


def answered():
    return [replica.metric("umbrage_queries_total") for replica in replicas]


def under_load(event):
    """Runs event() while calls go on; returns the numbers of calls and of repeats. A failed call
    fails the check."""
    stopping = threading.Event()
    failures = []
    counts = [0, 0]

    def hammer(index):
        client = test.client(frontend)
        while not stopping.is_set():
            try:
                counts[1] += ask(client, NAMES[(index + counts[0]) % len(NAMES)])
                counts[0] += 1
            except Exception as error:  # pylint: disable=broad-except
                failures.append(str(error))
        client.close()

    threads = [threading.Thread(target=hammer, args=(index,)) for index in range(3)]
    for thread in threads:
        thread.start()
    event()
    stopping.set()
    for thread in threads:
        thread.join()
    assert not failures, failures[:2]
    print(f"    {counts[0]} calls, {counts[1]} repeated")


with test.check("calls through the proxy are answered, an asset always by one replica"):
    client = test.client(frontend)
    ut.wait_until(lambda: test.client(frontend).check(
        test.messages.health.HealthCheckRequest(), timeout=60, wait_for_ready=True).status == 1, 20,
                  "the proxy serves")
    homes = {}
    for name in NAMES:
        for _ in range(3):
            before = answered()
            ask(client, name)
            home = [i for i, (a, b) in enumerate(zip(before, answered())) if b > a]
            assert len(home) == 1 and homes.setdefault(name, home[0]) == home[0], (name, home, homes)
    assert len(set(homes.values())) > 1, homes
with test.check("a replica that drains loses no call"):
    def drain():
        time.sleep(0.5)
        replicas[0].signal(signal.SIGTERM)
        replicas[0].exited()
        time.sleep(0.5)
    under_load(drain)
with test.check("a replica that is killed loses no call that may be repeated twice"):
    def kill():
        time.sleep(0.5)
        replicas[1].kill()
        time.sleep(2.5)
    under_load(kill)
client.close()
test.daemons.remove(replicas[1])
test.finish()
