#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
HTTP/2 frames that no proper client sends, on raw sockets: odd but legal framing must work, broken
calls must fail with the right status, abuse must cost its connection and nothing else. After each
abuse a normal call is answered and the daemon's memory has not grown beyond a bound.
"""
import gzip
import os
import socket
import struct
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import raw_http2 as h2  # noqa: E402
import umbrage_test as ut  # noqa: E402

ut.need_grpc()  # for the message classes
test = ut.Test()
SLOW = ut.is_sanitized()
QUERY = "/umbrage.v1.Shadows/Query"
CHECK = "/grpc.health.v1.Health/Check"
OK, INVALID, DEADLINE, EXHAUSTED = 0, 3, 4, 8
UNIMPLEMENTED, INTERNAL = 12, 13
CALM = 11  # HTTP/2 ENHANCE_YOUR_CALM
# After an attack only memory that malloc keeps may stay: the daemon keeps up to 128 MiB of freed
# pages on purpose (its trim threshold). One connection may buffer 16 MiB here, so 48 MiB is room
# for three such heaps. Without limits, any of these attacks would take twenty times as much.
GROWTH = 48 << 20

os.mkdir(test.path("store"))
test.bake(test.scene("city", 3), test.path("store", "city.umb"), "--resolution", 256, "--depth",
          "raster", "--verify", 0)
daemon = test.daemon("--handshake-timeout", "1s", "--body-timeout", "2s", "--stall-timeout", "2s",
                     "--max-message", "8MiB", "--connection-buffer", "16MiB", "--workers", 2)
M = test.messages.shadows
points = ut.floats(ut.random_points((-500, -10, -500), (500, 60, 500), 40, 7))
request = M.QueryRequest(asset="city", points=points).SerializeToString()
message = h2.prefixed(request)


def connect(settled=True, **how):
    connection = h2.Connection(port=daemon.port, **how)
    if settled and how.get("start", True):
        connection.settle()
    return connection


def ask(connection, body=message, **how):
    return connection.call(QUERY, body, **how)


def visibility(reply):
    assert reply.status == OK, reply
    assert reply.header(":status") == "200" and reply.header("content-type") == "application/grpc"
    flag, size = struct.unpack(">BI", reply.body[:5])
    assert flag == 0 and size == len(reply.body) - 5
    return M.QueryReply.FromString(reply.body[5:]).visibility


# These are opened now and checked at the end, since they may stay for ten seconds.
lingering = connect()
lingering.send(h2.frame(h2.HEADERS, 0, 1, lingering.request_headers(QUERY)[:40]))
lingering_since = time.monotonic()

normal = connect()
EXPECTED = visibility(ask(normal))
assert len(EXPECTED) == 40
BASE = daemon.resident_bytes()


def still_well():
    """A normal call on an old and on a new connection, and bounded memory."""
    global normal
    if not normal.socket or normal.closed:
        normal = connect()
    assert visibility(ask(normal)) == EXPECTED
    fresh = connect()
    assert visibility(ask(fresh)) == EXPECTED
    fresh.close()
    assert daemon.process.poll() is None
    growth = daemon.resident_bytes() - BASE
    if not SLOW:
        assert growth < GROWTH, f"resident memory grew by {growth >> 20} MiB"


def cut(connection, seconds=10):
    """The peer ends the connection."""
    assert connection.wait(lambda: connection.closed, seconds), "the connection is still open"
    return connection.goaway


# --- framing that is legal -------------------------------------------------------------------

with test.check("a message in DATA frames of one byte is answered"):
    connection = connect()
    stream = connection.open(QUERY)
    for i, byte in enumerate(message):
        connection.data(stream, bytes([byte]), end=i == len(message) - 1)
    assert visibility(connection.reply(stream)) == EXPECTED
with test.check("the prefix and the message cut at every place are answered"):
    connection = connect()
    for at in list(range(0, 12)) + [len(message) // 2, len(message) - 1, len(message)]:
        stream = connection.open(QUERY)
        connection.data(stream, message[:at])
        connection.data(stream, message[at:], end=True)
        assert visibility(connection.reply(stream)) == EXPECTED, f"cut at {at}"
with test.check("END_STREAM on an empty DATA frame ends the request"):
    connection = connect()
    stream = connection.open(QUERY)
    connection.data(stream, message)
    connection.pump(0.1)
    assert not connection.replies[stream].ended
    connection.data(stream, b"", end=True)
    assert visibility(connection.reply(stream)) == EXPECTED
with test.check("many calls in one write are all answered"):
    connection = connect()
    block = b""
    streams = range(1, 101, 2)
    for stream in streams:
        connection.replies[stream] = h2.Reply()
        block += h2.frame(h2.HEADERS, h2.END_HEADERS, stream, connection.request_headers(QUERY))
    for stream in streams:
        block += h2.frame(h2.DATA, h2.END_STREAM, stream, message)
    connection.send(block)
    for stream in streams:
        assert visibility(connection.reply(stream)) == EXPECTED
with test.check("preface and first call cut into single bytes are answered"):
    connection = connect(start=False)
    for byte in (h2.PREFACE + h2.frame(h2.SETTINGS, 0, 0)
                 + h2.frame(h2.HEADERS, h2.END_HEADERS, 1, connection.request_headers(QUERY))):
        connection.send(bytes([byte]))
    connection.replies[1] = h2.Reply()
    connection.data(1, message, end=True)
    assert visibility(connection.reply(1)) == EXPECTED
with test.check("a header block over CONTINUATION frames, padding and trailers are taken"):
    connection = connect()
    connection.replies[1] = h2.Reply()
    block = connection.request_headers(QUERY)
    connection.send(h2.frame(h2.HEADERS, 0, 1, block[:10])
                    + h2.frame(h2.CONTINUATION, 0, 1, block[10:50])
                    + h2.frame(h2.CONTINUATION, h2.END_HEADERS, 1, block[50:]))
    connection.send(h2.frame(h2.DATA, 8, 1, bytes([200]) + message + bytes(200)))
    connection.send(h2.frame(h2.HEADERS, h2.END_HEADERS | h2.END_STREAM, 1,
                             h2.literal("x-trailer", "late")))
    assert visibility(connection.reply(1)) == EXPECTED
with test.check("a window of seven bytes still gets the whole reply"):
    connection = connect(settings=struct.pack(">HI", 4, 7))
    assert visibility(ask(connection)) == EXPECTED

# --- calls that must fail --------------------------------------------------------------------

with test.check("grpc-timeout 1n is DEADLINE_EXCEEDED and no work is begun"):
    connection = connect()
    before = daemon.metric("umbrage_batches_started_total")
    reply = ask(connection, extra=[("grpc-timeout", "1n")])
    assert reply.status == DEADLINE, reply
    assert daemon.metric("umbrage_batches_started_total") == before
    assert visibility(ask(connection, extra=[("grpc-timeout", "1H")])) == EXPECTED
    assert daemon.metric("umbrage_batches_started_total") == before + 1
with test.check("a large batch with grpc-timeout 1n is never begun either"):
    connection = connect()
    before = daemon.metric("umbrage_batches_started_total")
    body = h2.prefixed(M.QueryRequest(asset="city", points=bytes(1200000)).SerializeToString())
    stream = connection.open(QUERY, extra=[("grpc-timeout", "1n")])
    for at in range(0, len(body), 16000):
        connection.data(stream, body[at:at + 16000], end=at + 16000 >= len(body))
    assert connection.reply(stream).status == DEADLINE
    assert daemon.metric("umbrage_batches_started_total") == before
with test.check("a grpc-timeout that is none is INVALID_ARGUMENT"):
    connection = connect()
    for text in ("1x", "123456789n", "", "n", "-1S", "1.5S", " 1S"):
        reply = ask(connection, extra=[("grpc-timeout", text)])
        assert reply.status in (INVALID, INTERNAL) or reply.reset is not None, (text, reply)
        assert reply.status != OK
with test.check("flag 1 without grpc-encoding is INTERNAL"):
    connection = connect()
    assert ask(connection, h2.prefixed(request, 1)).status == INTERNAL
    assert ask(connection, h2.prefixed(request, 1),
               extra=[("grpc-encoding", "identity")]).status == INTERNAL
with test.check("flag 1 with an unknown encoding is UNIMPLEMENTED and says which are taken"):
    connection = connect()
    for name in ("deflate", "snappy", "zz"):
        reply = ask(connection, h2.prefixed(request, 1), extra=[("grpc-encoding", name)])
        assert reply.status == UNIMPLEMENTED, reply
        assert reply.header("grpc-accept-encoding") == "identity,gzip", reply
with test.check("flag 1 with gzip takes one whole gzip stream and nothing else"):
    connection = connect()
    gzip_field = [("grpc-encoding", "gzip")]
    packed = gzip.compress(request)
    assert ask(connection, h2.prefixed(packed, 1), extra=gzip_field).status == OK
    assert ask(connection, h2.prefixed(request, 0), extra=gzip_field).status == OK
    for body in (request, packed + bytes(4), packed + packed, b""):
        assert ask(connection, h2.prefixed(body, 1), extra=gzip_field).status == INVALID
    # The last four bytes are read as the size, which may be over the limit.
    for body in (packed[:-1], packed + b"x"):
        assert ask(connection, h2.prefixed(body, 1), extra=gzip_field).status in (INVALID, EXHAUSTED)
with test.check("flag 2 is INTERNAL"):
    assert ask(connect(), h2.prefixed(request, 2)).status == INTERNAL
with test.check("a message cut off by END_STREAM is INTERNAL"):
    connection = connect()
    for at in (1, 4, 5, len(message) - 1):
        assert ask(connection, message[:at]).status == INTERNAL, at
with test.check("a stream of thousands of tiny requests, a frame each, is no abuse"):
    connection = connect()
    stream = connection.open("/umbrage.v1.Shadows/QueryStream")
    tiny = h2.prefixed(M.QueryRequest(asset="city", points=bytes(12)).SerializeToString())
    connection.send(h2.frame(h2.DATA, 0, stream, tiny) * 4000)
    connection.data(stream, b"", end=True)
    reply = connection.reply(stream, 30)
    assert reply.status == OK, reply
    size = struct.unpack(">I", reply.body[1:5])[0] + 5
    assert len(reply.body) == 4000 * size and reply.body == reply.body[:size] * 4000
with test.check("request data with scraps between long frames, as proxies cut it, is no abuse"):
    connection = connect()
    stream = connection.open("/umbrage.v1.Shadows/QueryStream")
    large = h2.prefixed(M.QueryRequest(asset="city", points=bytes(12 << 16),
                                       format=M.ANSWER_BIT).SerializeToString())
    for count in range(6):
        for at in range(0, len(large), 4098):
            for part in (large[at:at + 4096], large[at + 4096:at + 4097], large[at + 4097:at + 4098]):
                connection.data(stream, part)
        until = time.monotonic() + 20
        while len(connection.replies[stream].body if stream in connection.replies else b"") <= count << 13:
            assert time.monotonic() < until, "a request is answered before the next is sent"
            connection.pump(0.1)
    connection.data(stream, b"", end=True)
    reply = connection.reply(stream, 20)
    assert reply.status == OK, reply
with test.check("two messages or none in a unary call are refused"):
    connection = connect()
    assert ask(connection, message + message).status in (INTERNAL, UNIMPLEMENTED)
    assert ask(connection, message + b"\0").status == INTERNAL
    stream = connection.open(QUERY, end=True)
    assert connection.reply(stream).status in (INTERNAL, UNIMPLEMENTED)
with test.check("a length over the limit is RESOURCE_EXHAUSTED before any of it is stored"):
    for size in ((8 << 20) + 1, 0xffffffff):
        connection = connect()
        stream = connection.open(QUERY)
        connection.data(stream, struct.pack(">BI", 0, size))
        reply = connection.reply(stream)
        assert reply.status == EXHAUSTED and "8388608" in reply.header("grpc-message"), reply
with test.check("other content types are 415, gRPC ones with parameters are taken"):
    connection = connect()
    for kind in ("application/json", "text/plain", "application/grpc+json", "application/grpcx",
                 None):
        reply = ask(connection, content_type=kind)
        assert reply.header(":status") == "415" and reply.status is None, (kind, reply)
    for kind in ("application/grpc+proto", "application/grpc;charset=utf-8"):
        assert visibility(ask(connection, content_type=kind)) == EXPECTED
with test.check("GET, PUT and HEAD are 405"):
    connection = connect()
    for method in ("GET", "PUT", "HEAD"):
        stream = connection.open(QUERY, end=True, method=method)
        assert connection.reply(stream).header(":status") == "405"
with test.check("long, empty and strange paths are UNIMPLEMENTED"):
    connection = connect()
    for path in ("/" + "x" * 3000, "/", "/umbrage.v1.Shadows/Query/", "/umbrage.v1.Shadows/query"):
        reply = connection.call(path, message)
        assert reply.status == UNIMPLEMENTED, (path[:40], reply)
still_well()

# --- abuse -----------------------------------------------------------------------------------


def bomb(fields):
    """A small block that decodes to a large list: one entry of 400 bytes, named again and again."""
    connection = connect()
    block = (connection.request_headers(QUERY) + b"\x40" + h2.integer(6, 7) + b"x-bomb"
             + h2.integer(400, 7) + b"y" * 400 + b"\xbe" * fields)
    return connection, block


with test.check("a header bomb is refused without being stored"):
    before = daemon.resident_bytes()
    for fields in (100, 5000, 15000):
        connection, block = bomb(fields)
        connection.replies[1] = h2.Reply()
        connection.send(h2.frame(h2.HEADERS, h2.END_HEADERS, 1, block))
        connection.data(1, message, end=True)
        connection.wait(lambda: connection.closed or connection.replies[1].reset is not None
                        or connection.replies[1].status is not None)
        assert connection.replies[1].status != OK
        assert connection.closed or connection.replies[1].reset is not None \
            or connection.replies[1].status in (EXHAUSTED,), connection.replies[1]
    still_well()
with test.check("a connection that goes on sending header bombs is cut"):
    connection, block = bomb(15000)
    for stream in range(1, 41, 2):
        if not connection.send(h2.frame(h2.HEADERS, h2.END_HEADERS, stream, block)):
            break
        block = connection.request_headers(QUERY) + b"\xbe" * 15000
        connection.pump(0.01)
    goaway = cut(connection)
    assert goaway == CALM, goaway
    still_well()
with test.check("a header frame of a megabyte is cut before it is decoded"):
    connection, block = bomb(1000000)
    connection.send(h2.frame(h2.HEADERS, h2.END_HEADERS, 1, block))
    cut(connection)
    still_well()
with test.check("a peer that keeps its own header table, as HAProxy 2.6 does, is understood"):
    connection = connect()
    block = connection.request_headers(QUERY)
    block = block[len(h2.integer(512, 5, 0x20)):]
    connection.replies[1] = h2.Reply()
    connection.settle()
    connection.send(h2.frame(h2.HEADERS, h2.END_HEADERS, 1, block))
    connection.data(1, message, end=True)
    assert visibility(connection.reply(1)) == EXPECTED
with test.check("an endless header block is cut"):
    connection = connect()
    connection.send(h2.frame(h2.HEADERS, 0, 1, connection.request_headers(QUERY)))
    for i in range(2000):
        if not connection.send(h2.frame(h2.CONTINUATION, 0, 1, h2.literal(f"x-{i}", "y" * 8000))):
            break
    cut(connection)
    still_well()
with test.check("3000 calls reset at once end in GOAWAY"):
    connection = connect()
    headers = connection.request_headers(QUERY)
    for stream in range(1, 6001, 2):
        if not connection.send(h2.frame(h2.HEADERS, h2.END_HEADERS, stream, headers)
                               + h2.frame(h2.RST_STREAM, 0, stream, struct.pack(">I", 8))):
            break
    cut(connection)
    assert connection.goaway not in (None, 0), connection.goaway
    still_well()


def flood(name, block, count, opens_stream=False):
    with test.check(f"{count} {name} end the connection and nothing else"):
        connection = connect()
        if opens_stream:
            connection.open(QUERY)
        chunk = block * 1000
        for _ in range(count // 1000):
            if not connection.send(chunk):
                break
            connection.pump(0)
        goaway = cut(connection)
        assert goaway in (None, CALM), goaway  # none if the reset was faster than its arrival
        still_well()


flood("empty DATA frames", h2.frame(h2.DATA, 0, 1), 100000, opens_stream=True)
flood("DATA frames of one byte", h2.frame(h2.DATA, 0, 1, b"\0"), 100000, opens_stream=True)
flood("PINGs", h2.frame(h2.PING, 0, 0, b"12345678"), 100000)
flood("PING answers", h2.frame(h2.PING, h2.ACK, 0, b"12345678"), 100000)
flood("SETTINGS", h2.frame(h2.SETTINGS, 0, 0, struct.pack(">HI", 4, 65535)), 100000)
flood("PRIORITY frames", h2.frame(h2.PRIORITY, 0, 1, struct.pack(">IB", 0, 5)), 100000)
flood("WINDOW_UPDATEs", h2.frame(h2.WINDOW_UPDATE, 0, 1, struct.pack(">I", 1)), 100000,
      opens_stream=True)
flood("unknown frames", h2.frame(99, 0, 0, b"?"), 100000)

with test.check("PINGs, twenty to a long frame of request data, end the connection"):
    connection = connect()
    stream = connection.open(QUERY)
    connection.data(stream, struct.pack(">BI", 0, 4 << 20))
    for _ in range(500):
        connection.data(stream, bytes(4096))
        if not connection.send(h2.frame(h2.PING, 0, 0, b"12345678") * 20):
            break
    goaway = cut(connection)
    assert goaway in (None, CALM), goaway
    still_well()

with test.check("a peer that PINGs and never reads is cut"):
    connection = connect()
    connection.socket.settimeout(1)
    for _ in range(3000):
        if not connection.send(h2.frame(h2.PING, 0, 0, b"12345678") * 50):
            break
    cut(connection)
    still_well()
with test.check("streams beyond the limit are refused, those within are answered"):
    # In one write, before the daemon's limit can be known: RFC 9113 section 5.1.2.
    connection = connect(settled=False)
    streams = range(1, 801, 2)
    block = b""
    for stream in streams:
        connection.replies[stream] = h2.Reply()
        block += h2.frame(h2.HEADERS, h2.END_HEADERS, stream, connection.request_headers(QUERY))
    connection.send(block)
    connection.wait(lambda: sum(connection.replies[s].reset is not None for s in streams) >= 144)
    refused = [s for s in streams if connection.replies[s].reset is not None]
    assert 0 < len(refused) < 400 and all(connection.replies[s].reset == 7 for s in refused)
    for stream in streams:
        if stream not in refused:
            connection.data(stream, message, end=True)
    for stream in streams:
        if stream not in refused:
            assert visibility(connection.reply(stream)) == EXPECTED
    still_well()
with test.check("silence, half a preface and a wrong preface are cut, in time"):
    silent = connect(start=False)
    half = connect(start=False)
    half.send(h2.PREFACE[:10])
    unsettled = connect(start=False)
    unsettled.send(h2.PREFACE)
    http1 = connect(start=False)
    http1.send(b"GET / HTTP/1.1\r\nHost: a\r\n\r\n")
    noise = connect(start=False)
    noise.send(os.urandom(5000))
    begin = time.monotonic()
    for connection in (http1, noise, silent, half, unsettled):
        cut(connection, 5)
    assert time.monotonic() - begin < 5  # the limit is 1 s; the rest is a slow machine
    still_well()
with test.check("a body that never comes is DEADLINE_EXCEEDED"):
    connection = connect()
    stream = connection.open(QUERY)
    connection.data(stream, message[:50])
    reply = connection.reply(stream, 8)
    assert reply.status == DEADLINE, reply
    still_well()
with test.check("a peer that asks for much and takes nothing is given up"):
    connection = connect(settings=struct.pack(">HI", 4, 0))  # a window of nothing
    connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    body = M.QueryRequest(asset="city", points=bytes(120000)).SerializeToString()
    streams = []
    for _ in range(30):
        stream = connection.open(QUERY)
        for at in range(0, len(body) + 5, 16000):
            connection.data(stream, h2.prefixed(body)[at:at + 16000],
                            end=at + 16000 >= len(body) + 5)
        streams.append(stream)
    connection.wait(lambda: connection.closed or
                    all(connection.replies[s].reset is not None for s in streams), 12)
    assert connection.closed or all(connection.replies[s].reset is not None for s in streams)
    still_well()
with test.check("a thousand peers that vanish in the middle of a call leave nothing behind"):
    for i in range(1000):
        connection = connect()
        stream = connection.open(QUERY)
        connection.data(stream, message[:5 + i % 100], end=False)
        if i % 2:  # an RST instead of a FIN
            connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER,
                                         struct.pack("ii", 1, 0))
        elif i % 3 == 0:
            connection.data(stream, message[5 + i % 100:], end=True)
            connection.socket.shutdown(socket.SHUT_WR)
        connection.close()
    ut.wait_until(lambda: daemon.metric("umbrage_connections") <= 4, 15, "connections are gone")
    ut.wait_until(lambda: daemon.metric("umbrage_buffered_bytes") == 0, 15, "bytes are given back")
    still_well()
with test.check("200 prefixes that promise 8 MiB and send nothing cost no memory"):
    connections = []
    for _ in range(4):
        connection = connect()
        for _ in range(50):
            connection.data(connection.open(QUERY), struct.pack(">BI", 0, 8 << 20))
        connections.append(connection)
    time.sleep(0.3)
    still_well()
    for connection in connections:
        connection.close()
with test.check("a connection that holds more than its budget is refused, the others are not"):
    connection = connect()
    shed = 0
    for _ in range(5):  # 5 x 4 MiB against 16 MiB
        stream = connection.open(QUERY)
        connection.data(stream, struct.pack(">BI", 0, 5 << 20))
        for _ in range(256):
            connection.data(stream, bytes(16000))
        connection.pump(0)
        shed = [r.status for r in connection.replies.values()].count(EXHAUSTED)
    connection.wait(lambda: any(r.status == EXHAUSTED for r in connection.replies.values()), 5)
    refused = [r for r in connection.replies.values() if r.status == EXHAUSTED]
    assert refused and "--connection-buffer" in refused[0].header("grpc-message"), refused
    still_well()
    connection.close()
with test.check("half a header block is cut after its ten seconds"):
    left = max(0.0, 15 - (time.monotonic() - lingering_since))
    cut(lingering, left + 1)
    still_well()
with test.check("the attacks are counted"):
    assert daemon.metric("umbrage_h2_abuse_total") > 8
    print("   ", [line for line in daemon.admin("/metrics")[1].splitlines()
                  if line.startswith("umbrage_h2_abuse_total")])
print(f"open at the end: {daemon.metric('umbrage_connections')} connections")
print(f"resident: {BASE >> 20} MiB before, {daemon.resident_bytes() >> 20} MiB after")
normal.close()
test.finish()
