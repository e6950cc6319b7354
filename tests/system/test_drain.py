#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
SIGTERM under load must lose no call. Clients that query all the time must see each call answered,
or refused with UNAVAILABLE before it was processed; with at most two retries against a second
daemon (as a balancer would do it) none fails. Health says NOT_SERVING first; a second signal ends
at once.
"""
import os
import queue
import signal
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import raw_http2 as h2  # noqa: E402
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
test = ut.Test()
os.mkdir(test.path("store"))
test.bake(test.scene("city", 4), test.path("store", "city.umb"), "--resolution", 512, "--depth",
          "raster", "--verify", 0)
M = test.messages.shadows
H = test.messages.health
SEED = 5
points = ut.floats(ut.random_points((-500, -10, -500), (500, 80, 500), 30000, SEED))
SIZES = (1, 100, 3000, 30000)  # on the loop, and on the pool
print(f"seed {SEED}")


class Load:
    """Threads that ask until told to stop; each call may be retried twice on other daemons."""

    def __init__(self, targets, expected):
        self.expected = expected
        self.answered = self.retried = 0
        self.lost = []
        self.stopping = False
        self.lock = threading.Lock()
        self.threads = [threading.Thread(target=self.run, args=(targets, i)) for i in range(6)]
        for thread in self.threads:
            thread.start()

    def run(self, targets, seed):
        # Half of the clients share nothing with the others: a connection each.
        clients = [test.client(target, [("grpc.enable_retries", 0)]) for target in targets]
        turn = 0
        while not self.stopping:
            size = SIZES[(turn + seed) % len(SIZES)]
            turn += 1
            for attempt in range(3):
                client = clients[min(attempt, len(clients) - 1)]
                try:
                    reply = client.ask("city", points[:12 * size], taps=3, timeout=60)
                except grpc.RpcError as error:
                    if error.code() == Code.UNAVAILABLE and attempt < 2:
                        with self.lock:
                            self.retried += 1
                        continue
                    with self.lock:
                        self.lost.append(f"{size} points: {error.code()}: {error.details()}")
                    break
                with self.lock:
                    self.answered += 1
                    if reply.visibility != self.expected[size]:
                        self.lost.append(f"{size} points: other answers")
                break
        for client in clients:
            client.close()

    def stop(self):
        self.stopping = True
        for thread in self.threads:
            thread.join()


second = test.daemon("--workers", 2)
client = test.client(second.grpc_tcp)
expected = {size: client.ask("city", points[:12 * size], taps=3).visibility for size in SIZES}

for name, options in (("a drain without delay", ()),
                      ("a drain with a delay", ("--drain-delay", "500ms")),
                      ("a drain of three loops", ("--loops", 3))):
    with test.check(f"{name} under load loses no call and exits with 0"):
        first = test.daemon("--workers", 2, *options)
        load = Load([first.grpc_tcp, second.grpc_tcp], expected)
        ut.wait_until(lambda: load.answered > 20, 20, "calls under way")
        time.sleep(0.8)
        before = load.answered
        first.signal(signal.SIGTERM)
        begin = time.monotonic()
        first.wait(40)
        took = time.monotonic() - begin
        time.sleep(0.2)
        load.stop()
        assert not load.lost, load.lost[:5]
        first.exited()
        print(f"    {load.answered} calls, {before} before the signal, {load.retried} retried, "
              f"drained in {took:.2f} s")
        assert took < 20
with test.check("health goes to NOT_SERVING at the signal, before listening ends"):
    first = test.daemon("--drain-delay", "4s")
    watcher = test.client(first.grpc_tcp)
    stream = watcher.watch(H.HealthCheckRequest(), timeout=30)
    states = iter(stream)
    assert next(states).status == H.HealthCheckResponse.SERVING
    assert first.admin("/readyz")[0] == 200
    first.signal(signal.SIGTERM)
    assert next(states).status == H.HealthCheckResponse.NOT_SERVING
    late = test.client(first.grpc_unix)  # a new connection is still taken
    state = late.check(H.HealthCheckRequest(), timeout=60).status
    assert state == H.HealthCheckResponse.NOT_SERVING
    assert late.ask("city", points[:1200], taps=3).visibility == expected[100]
    assert first.admin("/readyz")[0] == 503 and first.admin("/livez")[0] == 200
    try:
        next(states)
        raise AssertionError("Watch did not end")
    except (grpc.RpcError, StopIteration):
        assert stream.code() == Code.UNAVAILABLE, stream.code()
    first.exited()
with test.check("after the drain the port is closed and the socket file gone"):
    client.refused(lambda: test.client(first.grpc_tcp).ask("city", timeout=5), Code.UNAVAILABLE)
    assert not os.path.exists(first.socket_path)
with test.check("a call whose upload is under way at the signal is answered"):
    first = test.daemon("--drain-delay", "0")
    raw = h2.Connection(port=first.port)
    raw.settle()
    body = h2.prefixed(M.QueryRequest(asset="city", points=points[:12 * 3000],
                                      taps=3).SerializeToString())
    stream = raw.open("/umbrage.v1.Shadows/Query")
    raw.data(stream, body[:16000])
    first.signal(signal.SIGTERM)
    raw.wait(lambda: raw.goaway is not None, 5)
    assert raw.goaway == 0, raw.goaway
    time.sleep(0.4)  # the final GOAWAY is out
    raw.data(stream, body[16000:32000])
    raw.data(stream, body[32000:], end=True)
    reply = raw.reply(stream)
    assert reply.status == 0, reply
    assert M.QueryReply.FromString(reply.body[5:]).visibility == expected[3000]
    first.exited()
with test.check("a stream gets the replies to what was received, then UNAVAILABLE"):
    first = test.daemon("--loops", 2, "--drain-delay", "3s")  # for all to be received
    requests = queue.Queue()
    streaming = test.client(first.grpc_tcp)
    replies = streaming.stream(iter(requests.get, None), timeout=60)
    for _ in range(5):
        requests.put(M.QueryRequest(asset="city", points=points[:12 * 3000], taps=3))
    assert next(replies).visibility == expected[3000]  # it is connected
    first.signal(signal.SIGTERM)
    for _ in range(4):
        assert next(replies).visibility == expected[3000]
    client.refused(lambda: next(replies), Code.UNAVAILABLE, "shutting down")
    first.exited()
with test.check("a second signal ends at once, with 0"):
    first = test.daemon("--drain-delay", "60s", "--drain-timeout", "60s", "--loops", 2)
    stuck = h2.Connection(port=first.port)
    stuck.settle()
    stuck.open("/umbrage.v1.Shadows/Query")
    first.signal(signal.SIGTERM)
    ut.wait_until(lambda: first.admin("/readyz")[0] == 503, 5, "the drain begins")
    assert first.process.poll() is None
    begin = time.monotonic()
    first.signal(signal.SIGTERM)
    first.exited()
    assert time.monotonic() - begin < 20
with test.check("a call that never ends is given up after --drain-timeout"):
    first = test.daemon("--drain-delay", "0", "--drain-timeout", "1s", "--body-timeout", "60s",
                        "--loops", 2)
    other = h2.Connection(port=first.port)
    other.settle()
    stuck = h2.Connection(port=first.port)
    stuck.settle()
    stuck.open("/umbrage.v1.Shadows/Query")
    ut.wait_until(lambda: first.metric("umbrage_inflight") == 1, 5, "the call has begun")
    begin = time.monotonic()
    first.stop()
    assert 0.5 < time.monotonic() - begin < 10
with test.check("SIGINT drains as SIGTERM does"):
    first = test.daemon()
    first.signal(signal.SIGINT)
    assert first.wait(20) == 0
with test.check("connections go when they are old, and no call is lost"):
    first = test.daemon("--max-age", "1s", "--workers", 2)
    load = Load([first.grpc_tcp, first.grpc_tcp, first.grpc_tcp], expected)
    ut.wait_until(lambda: first.metric("umbrage_connections_retired_total") >= 12, 5, "twice each")
    load.stop()
    assert not load.lost, load.lost[:5]
    print(f"    {load.answered} calls, {load.retried} retried")
    streaming = test.client(first.grpc_tcp)
    replies = streaming.stream(iter(queue.Queue().get, None), timeout=30)
    client.refused(lambda: next(replies), Code.UNAVAILABLE, "shutting down")
    first.exited() if first.process.poll() is not None else first.stop()
client.close()
test.finish()
