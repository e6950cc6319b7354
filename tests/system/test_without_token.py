#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
What callers without rights can use of a daemon with a token file (and single addresses of a daemon
without one): memory, connections, streams, Watches, processor and drain time. Whatever they do, from
one address or many, a new client with a good token connects and is answered.
"""
import os
import signal
import socket
import struct
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import raw_http2 as h2  # noqa: E402
import umbrage_test as ut  # noqa: E402

ut.need_grpc()  # for the message classes
test = ut.Test()
QUERY = "/umbrage.v1.Shadows/Query"
CHECK, WATCH = "/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch"
REFLECT = "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo"
OK, NOT_FOUND, EXHAUSTED, UNAUTHENTICATED = 0, 5, 8, 16
LATE, UNAVAILABLE, REFUSED_STREAM, CALM = 4, 14, 7, 11
GOOD, OTHER = "studio-0123456789abcdef", "robot-0123456789abcdef"
MANY = [f"127.0.{i // 200}.{2 + i % 200}" for i in range(400)]  # addresses of attackers

os.mkdir(test.path("store"))
test.bake(test.scene("city", 3), test.path("store", "city.umb"), "--resolution", 256, "--depth",
          "raster", "--verify", 0)
M, H = test.messages.shadows, test.messages.health
R = test.messages.reflection
tokens = test.path("tokens")


def write_tokens(*lines):
    with open(os.open(tokens, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="ascii") as file:
        file.write("".join(line + "\n" for line in lines))


write_tokens(f"studio query,submit {GOOD}", f"robot submit {OTHER}")


def bearer(token):
    return [("authorization", "Bearer " + token)]


def body(points=10):
    return h2.prefixed(M.QueryRequest(asset="city", points=bytes(12 * points)).SerializeToString())


def health(service=""):
    return h2.prefixed(H.HealthCheckRequest(service=service).SerializeToString())


def connect(daemon, source=None):
    connection = h2.Connection(port=daemon.port, source=source, timeout=60)
    connection.settle()
    return connection


def upload(connection, payload, **how):
    """A Query whose body is sent in frames; its reply."""
    stream = connection.open(QUERY, **how)
    for at in range(0, len(payload), 1 << 19):
        connection.data(stream, payload[at:at + (1 << 19)], end=at + (1 << 19) >= len(payload))
        connection.pump(0)
    return connection.reply(stream)


def serves_the_good(daemon, times=3, token=GOOD, source=None):
    """Checks that new clients with a good token (None: without) are answered, each on a connection
    of its own."""
    for _ in range(times):
        connection = connect(daemon, source)
        reply = connection.call(QUERY, body(), extra=bearer(token) if token else ())
        assert reply.status == OK, reply
        connection.close()


def pump_all(connections, seconds=0.0):
    for connection in connections:
        connection.pump(seconds)
        seconds = 0.0


def open_alive(connections):
    for _ in range(3):  # a GOAWAY, then the end
        pump_all(connections, 0.1)
    return [connection for connection in connections if not connection.closed]


def close_all(connections):
    for connection in connections:
        connection.close()


# --- one call -----------------------------------------------------------------------------------

daemon = test.daemon("--token-file", tokens)
with test.check("a health request has little room, whatever --max-message says"):
    connection = connect(daemon)
    for path, most in ((CHECK, 1024), (WATCH, 1024)):
        stream = connection.open(path)
        connection.data(stream, struct.pack(">BI", 0, most + 1))
        reply = connection.reply(stream)
        assert reply.status == EXHAUSTED and str(most) in reply.header("grpc-message"), reply
    assert connection.call(CHECK, health("x" * 255)).status == NOT_FOUND
    assert daemon.metric("umbrage_buffered_bytes") <= 4 * 5120
with test.check("requests that are a name or an id have little room, with a token too"):
    for path in ("/umbrage.v1.Shadows/Describe", "/umbrage.v1.Shadows/List", "/umbrage.v1.Shadows/Limits",
                 "/umbrage.v1.Bakes/Watch", "/umbrage.v1.Bakes/Cancel", "/umbrage.v1.Bakes/List",
                 "/umbrage.v1.Bakes/Fetch", "/umbrage.v1.Bakes/Delete", REFLECT):
        stream = connection.open(path, extra=bearer(GOOD))
        connection.data(stream, struct.pack(">BI", 0, 4097))
        reply = connection.reply(stream)
        assert reply.status == EXHAUSTED and "4096" in reply.header("grpc-message"), (path, reply)
    connection.close()
with test.check("a health request that does not end is given up after two seconds, not --body-timeout"):
    connection = connect(daemon)
    begin = time.monotonic()
    stream = connection.open(CHECK)
    connection.data(stream, struct.pack(">BI", 0, 100) + b"x")
    get = connection.open(QUERY, method="GET")  # neither does what is no gRPC
    replies = [connection.reply(one) for one in (stream, get)]
    assert [reply.status for reply in replies] == [LATE, LATE], replies
    assert time.monotonic() - begin < 20  # --body-timeout is 30 s
    connection.close()
with test.check("a balancer's probe on a connection of its own is answered, whatever others of its address ask"):
    # Behind a balancer all clients have its address, and calls without rights share connections
    # with calls that have rights.
    balancer = "127.0.9.9"
    flood, stop, refused = connect(daemon, balancer), threading.Event(), []
    assert flood.call(QUERY, body(), extra=bearer(GOOD)).status == OK

    def ask_on():
        while not stop.is_set():
            streams = []
            for _ in range(50):
                streams.append(flood.open(CHECK))
                flood.data(streams[-1], health(), end=True)
            refused.append(sum(flood.reply(stream).status == EXHAUSTED for stream in streams))
            flood.replies.clear()
    asking = threading.Thread(target=ask_on)
    asking.start()
    ut.wait_until(lambda: sum(refused) > 0, 60, "the address is at its rate")
    probes = []
    for _ in range(25):
        connection = connect(daemon, balancer)
        probes.append(connection.call(CHECK, health()).status)
        connection.close()
    stop.set()
    asking.join()
    flood.close()
    assert probes == [OK] * 25, probes
    assert refused[-1] > 0, "the rate was not at its limit all the time"
with test.check("health tells callers without rights nothing of assets, by Check or Watch"):
    job = "0" * 64
    for extra, known in (([], False), (bearer("x" * 20), False), (bearer(OTHER), False), (bearer(GOOD), True)):
        answers = []
        for name in ("city", "nope", job):
            connection = connect(daemon)
            service = "umbrage.v1.Shadows/" + name
            check = connection.call(CHECK, health(service), extra=extra)
            watch = connection.open(WATCH, extra=extra)
            connection.data(watch, health(service), end=True)
            assert connection.wait(lambda: connection.replies[watch].body, 10)
            answers.append((check.status, check.body, connection.replies[watch].body,
                            (check.header("grpc-message") or "").replace(name, "NAME")))
            connection.close()
        assert answers[1] == answers[2] and answers[1][0] == NOT_FOUND, answers
        assert (answers[0] != answers[1]) == known, (extra, answers)
    connection = connect(daemon)
    for service in ("", "umbrage.v1.Shadows"):
        assert connection.call(CHECK, health(service)).status == OK
    connection.close()
with test.check("a Watch that named an asset forgets it when its token is taken back"):
    connection = connect(daemon)
    watch = connection.open(WATCH, extra=bearer(GOOD))
    connection.data(watch, health("umbrage.v1.Shadows/city"), end=True)
    assert connection.wait(lambda: connection.replies[watch].body, 10)
    serving = connection.replies[watch].body
    write_tokens(f"robot submit {OTHER}")
    daemon.signal(signal.SIGHUP)
    assert connection.wait(lambda: len(connection.replies[watch].body) > len(serving), 10)
    assert connection.replies[watch].body[len(serving):] == h2.prefixed(b"\x08\x03")  # SERVICE_UNKNOWN
    write_tokens(f"studio query,submit {GOOD}", f"robot submit {OTHER}")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: daemon.log().count("event=reloaded what=tokens") == 2, 10, "the reload")
    connection.close()

# --- rates --------------------------------------------------------------------------------------

with test.check("health calls of an address have a rate of their own, told from others' and from rights"):
    crowd = [connect(daemon, "127.0.0.9") for _ in range(20)]
    statuses, deadline = set(), time.monotonic() + 60
    while EXHAUSTED not in statuses and time.monotonic() < deadline:
        asked = []
        for connection in crowd:
            block = connection.request_headers(CHECK)
            streams = range(connection.next_stream, connection.next_stream + 24, 2)
            connection.next_stream += 24
            connection.send(b"".join(h2.frame(h2.HEADERS, h2.END_HEADERS, stream, block)
                                     + h2.frame(h2.DATA, h2.END_STREAM, stream, health()) for stream in streams))
            asked.append((connection, streams[-1]))
        for connection, last in asked:
            connection.wait(lambda: last in connection.replies and connection.replies[last].ended, 30)
            statuses |= {reply.status for reply in connection.replies.values()}
    assert statuses == {OK, EXHAUSTED}, statuses
    refused = next(reply for connection in crowd for reply in connection.replies.values()
                   if reply.status == EXHAUSTED)
    assert int(refused.header("grpc-retry-pushback-ms")) > 0 and "200" in refused.header("grpc-message")
    assert connect(daemon, "127.0.0.10").call(CHECK, health()).status == OK
    serves_the_good(daemon, source="127.0.0.9")
    close_all(crowd)
with test.check("a connection that goes on being refused is not read from for a moment"):
    connection = connect(daemon, "127.0.0.11")
    begin, asked = time.monotonic(), 0
    while time.monotonic() - begin < 2.0:
        assert connection.call("/no.such/Method", body()).status == 12
        asked += 1
    assert asked < 1000, f"{asked} refusals in 2 s: the rate of 200 a second does not hold"
    connection.close()
with test.check("streams that had to be refused end their connection after a thousand"):
    before = daemon.metric('umbrage_h2_abuse_total{kind="reset_sent"}')
    connection = connect(daemon, "127.0.0.12")
    block = connection.request_headers(CHECK)
    stream, deadline = 1, time.monotonic() + 30
    while connection.goaway is None and not connection.closed and time.monotonic() < deadline:
        connection.send(b"".join(h2.frame(h2.HEADERS, h2.END_HEADERS, stream + 2 * i, block) for i in range(50)))
        stream += 100
        connection.pump(0.02)
    resets = [reply for reply in connection.replies.values() if reply.reset == REFUSED_STREAM]
    assert connection.goaway == CALM, (connection.goaway, len(resets))
    assert 1000 <= len(resets) < 6000, len(resets)
    assert daemon.metric('umbrage_h2_abuse_total{kind="reset_sent"}') == before + 1
    connection.close()

# --- shares -------------------------------------------------------------------------------------

with test.check("a connection without rights holds a few streams and 64 KiB at most, one with rights 256"):
    connection = connect(daemon)
    streams = [connection.open(CHECK) for _ in range(40)]
    connection.wait(lambda: connection.replies[streams[-1]].reset is not None, 5)
    refused = [stream for stream in streams if connection.replies[stream].reset == REFUSED_STREAM]
    assert 20 <= len(refused) < 40, len(refused)
    assert daemon.metric("umbrage_buffered_bytes") <= 65536
    connection.close()
    connection = connect(daemon)
    streams = [connection.open(QUERY, extra=bearer(GOOD)) for _ in range(250)]
    connection.pump(0.3)
    assert not [stream for stream in streams if connection.replies[stream].reset is not None]
    connection.close()
    ut.wait_until(lambda: daemon.metric("umbrage_buffered_bytes") == 0, 10, "all is given back")
with test.check("a token taken back makes its connections strangers again"):
    connection = connect(daemon)
    assert connection.call(QUERY, body(), extra=bearer(GOOD)).status == OK
    strangers = daemon.metric("umbrage_connections_without_rights")
    write_tokens(f"robot submit {OTHER}")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: daemon.log().count("event=reloaded what=tokens") == 3, 10, "the reload")
    assert connection.call(QUERY, body(), extra=bearer(GOOD)).status == UNAUTHENTICATED
    assert daemon.metric("umbrage_connections_without_rights") == strangers + 1
    write_tokens(f"studio query,submit {GOOD}", f"robot submit {OTHER}")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: daemon.log().count("event=reloaded what=tokens") == 4, 10, "the reload")
    connection.close()
daemon.stop()

small = test.daemon("--token-file", tokens, "--max-buffer", "8MiB", "--connection-buffer", "8MiB",
                    "--max-message", "6MiB", "--max-connections", 400)
with test.check("bodies without end, of many addresses without a token, leave --max-buffer to rights"):
    attackers = []
    for source in MANY[:200]:
        connection = connect(small, source)
        for _ in range(14):
            stream = connection.open(CHECK)
            connection.data(stream, struct.pack(">BI", 0, 1024) + bytes(1000))
        attackers.append(connection)
    held = small.metric("umbrage_buffered_bytes")
    assert 1 << 20 < held <= (2 << 20) + 65536, held  # a quarter of it
    serves_the_good(small)
    connection = connect(small)  # and there is room for much
    assert upload(connection, body(150000), extra=bearer(GOOD)).status == OK
    connection.close()
    close_all(attackers)
    ut.wait_until(lambda: small.metric("umbrage_connections") == 0, 20, "all connections go")
with test.check("one Watch a connection, --max-watches in all, for those without rights"):
    attackers = [connect(small, source) for source in MANY[:80]]
    for connection in attackers:
        for _ in range(2):
            stream = connection.open(WATCH)
            connection.data(stream, health(), end=True)
    for connection in attackers:
        connection.wait(lambda: all(r.body or r.ended for r in connection.replies.values()), 20)
    watching = [sum(bool(r.body) for r in c.replies.values()) for c in attackers]
    assert max(watching) == 1 and sum(watching) == 64, watching
    refused = [r for c in attackers for r in c.replies.values() if not r.body]
    assert {r.status for r in refused} == {EXHAUSTED}, refused[:3]
    assert any("--max-watches" in r.header("grpc-message") for r in refused)
    connection = connect(small)  # a connection with rights is not one of the 64
    assert connection.call(QUERY, body(), extra=bearer(GOOD)).status == OK
    for expected in (True, False):
        stream = connection.open(WATCH)
        connection.data(stream, health(), end=True)
        reply = connection.replies[stream]
        connection.wait(lambda: reply.body or reply.ended, 20)
        assert bool(reply.body) == expected, reply
    close_all(attackers + [connection])
    ut.wait_until(lambda: small.metric("umbrage_connections") == 0, 20, "all connections go")
    connection = connect(small)  # none was lost count of
    stream = connection.open(WATCH)
    connection.data(stream, health(), end=True)
    assert connection.wait(lambda: connection.replies[stream].body, 20)
    connection.close()
with test.check("Watches of many addresses do not keep connections from those with rights"):
    working = connect(small)
    half = working.open(QUERY, extra=bearer(GOOD))
    attackers = []
    for source in MANY:
        connection = connect(small, source)
        stream = connection.open(WATCH)
        connection.data(stream, health(), end=True)
        attackers.append(connection)
    assert len(open_alive(attackers)) <= 300  # three quarters of --max-connections
    assert small.metric("umbrage_connections_evicted_total") >= 100
    serves_the_good(small, 10)
    working.data(half, body(), end=True)
    assert working.reply(half).status == OK, "a connection with work was closed"
    close_all(attackers + [working])
with test.check("an address that has all its connections gives the oldest one without rights up"):
    # A quarter of --max-connections by default.
    crowd = [connect(small, "127.0.0.77") for _ in range(100)]
    crowd[0].call(QUERY, body(), extra=bearer(GOOD))
    serves_the_good(small, 5, source="127.0.0.77")
    assert 95 <= len(open_alive(crowd)) < 100 and not crowd[0].closed and crowd[1].closed
    close_all(crowd)
with test.check("while strangers come and go as fast as they can, a good token is answered"):
    stop = []

    def come_and_go(source):
        while not stop:
            try:
                mine = [h2.Connection(port=small.port, source=source, timeout=5) for _ in range(8)]
                for one in mine:
                    one.open(WATCH)
                close_all(mine)
            except OSError:
                pass
    threads = [threading.Thread(target=come_and_go, args=(source,)) for source in MANY[:4]]
    for thread in threads:
        thread.start()
    try:
        serves_the_good(small, 20)
    finally:
        stop.append(1)
        for thread in threads:
            thread.join()
small.stop()

with test.check("a drain waits for no call without rights"):
    waiting = test.daemon("--token-file", tokens, "--drain-timeout", "100s")
    held = [connect(waiting) for _ in range(5)]
    stream = held[0].open(CHECK)  # a body without end
    held[0].data(stream, struct.pack(">BI", 0, 100) + b"x")
    watch = held[1].open(WATCH)
    held[1].data(watch, health(), end=True)
    get = held[2].open(QUERY, method="GET")
    held[3].send(h2.frame(h2.HEADERS, 0, 1, held[3].request_headers(CHECK)))  # a header block without end
    closed = h2.Connection(port=waiting.port, settings=struct.pack(">HI", 4, 0))  # it takes no reply
    closed.settle()
    closed.data(closed.open(CHECK), health(), end=True)
    held[1].wait(lambda: held[1].replies[watch].body, 10)
    refused = held[4].open(QUERY)  # no token, and a body without end
    held[4].reply(refused)
    begin = time.monotonic()
    waiting.signal(signal.SIGTERM)
    while waiting.process.poll() is None and time.monotonic() - begin < 60:
        pump_all(held + [closed], 0.02)
    waiting.exited(60)
    assert not open_alive(held)
    assert time.monotonic() - begin < 8, time.monotonic() - begin  # one of its timers, then: 10 s, 30 s, 100 s
    assert held[0].replies[stream].status == UNAVAILABLE, held[0].replies
    assert held[1].replies[watch].status == UNAVAILABLE, held[1].replies
    close_all(held + [closed])

with test.check("connections that ask the admin port nothing do not keep a probe out"):
    probed = test.daemon()
    host, _, port = probed.addresses["http"].rpartition(":")
    silent = [socket.create_connection((host, int(port))) for _ in range(100)]
    for _ in range(3):
        assert probed.admin("/livez")[0] == 200
    close_all(silent)
    probed.stop()

# --- without a token file everybody has rights: what is kept is kept from single addresses -------

anybody = test.daemon("--max-buffer", "16MiB", "--connection-buffer", "16MiB", "--max-message", "16MiB",
                      "--max-connections", 40)
with test.check("without a token file no address holds all of --max-buffer"):
    hogs = []
    for source in MANY[:6]:
        connection = connect(anybody, source)
        for size, count in ((1000000, 14), (100000, 12), (5000, 30)):  # the gaps, too
            for _ in range(count):
                stream = connection.open(QUERY)
                connection.data(stream, struct.pack(">BI", 0, 15 << 20) + bytes(size))
                connection.pump(0)
        connection.pump(0.05)
        if not hogs:  # alone: 9/16 of all, and what every connection has
            assert 8 << 20 < anybody.metric("umbrage_buffered_bytes") <= (9 << 20) + (128 << 10)
        hogs.append(connection)
    ut.wait_until(lambda: anybody.metric("umbrage_buffered_bytes") > 8 << 20, 20, "much is held")
    serves_the_good(anybody, 3, None, "127.0.0.99")
    reply = connect(anybody, "127.0.0.98").call(QUERY, body(4000))
    assert reply.status == OK, reply
    close_all(hogs)
    ut.wait_until(lambda: anybody.metric("umbrage_buffered_bytes") == 0, 20, "all is given back")
with test.check("what an address gave back it may have again"):
    connection = connect(anybody, "127.0.0.99")
    for _ in range(20):
        assert upload(connection, body(600000)).status == OK  # near half of all
    connection.close()
with test.check("without a token file an address has a quarter of the connections"):
    hogs = []
    for _ in range(14):
        connection = h2.Connection(port=anybody.port, source="127.0.0.50", timeout=10)
        if connection.wait(lambda: connection.settled, 5):
            half = connection.open(QUERY)
            connection.pump(0.05)
        hogs.append(connection)
    assert len(open_alive(hogs)) == 10, len(open_alive(hogs))
    serves_the_good(anybody, 3, None)
    close_all(hogs)
anybody.stop()
test.finish()
