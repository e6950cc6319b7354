#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Peers that wait: they take their replies very slowly, only connect, or only ping. Each must be held
to its timer, and other clients must be answered meanwhile. test_hostile_peers.py has the peers
whose effect is measured.
"""
import gzip
import os
import socket
import struct
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import hostile_peer  # noqa: E402
import raw_http2 as h2  # noqa: E402
import umbrage_test as ut  # noqa: E402
from hostile_peer import OK, QUERY, WIDE, WIDER  # noqa: E402

ut.need_grpc()  # for the message classes
test = ut.Test()
peers = hostile_peer.Peers(test)
connect, query, upload, well = peers.connect, peers.query, peers.upload, peers.well
M = peers.messages

# --- replies ---------------------------------------------------------------------------------

with test.check("what waits for a socket counts as memory until it is taken"):
    daemon = test.daemon("--workers", 2)
    connection = h2.Connection(path=daemon.socket_path, settings=WIDE)
    connection.settle()
    connection.send(WIDER)
    # The reply has 252 kB. It is made in one go, and is more than a Unix socket takes; for the
    # daemon the call is then over.
    stream = upload(connection, query(63000, format=M.ANSWER_F32))
    ut.wait_until(lambda: daemon.metric("umbrage_queries_total") >= 63000, 10, "the answer is made")
    time.sleep(0.2)
    assert daemon.metric("umbrage_buffered_bytes") > 10000
    assert connection.reply(stream).status == OK
    ut.wait_until(lambda: daemon.metric("umbrage_buffered_bytes") == 0, 5, "all is given back")
    connection.close()
    daemon.stop()
with test.check("a peer that takes a few bytes now and then is cut as one that takes none"):
    daemon = test.daemon("--workers", 2, "--stall-timeout", "2s")
    connection = h2.Connection(path=daemon.socket_path, settings=struct.pack(">HI", 4, 0))
    connection.settle()
    stream = upload(connection, query(1000000))
    begin = time.monotonic()
    got = 0
    while time.monotonic() - begin < 15 and daemon.metric("umbrage_connections") > 0:
        time.sleep(0.2)
        # Reads 5 kB a second. pump() cannot be used: it would open the window again for each byte.
        connection.send(h2.frame(h2.WINDOW_UPDATE, 0, stream, struct.pack(">I", 1000)))
        try:
            got += len(connection.socket.recv(65536))
        except OSError:
            pass
    assert daemon.metric("umbrage_connections") == 0, "it is still served"
    assert daemon.metric('umbrage_h2_abuse_total{kind="timeout"}') == 1
    print(f"    cut after {time.monotonic() - begin:.1f} s and {got} bytes")
    connection.close()
    fast = connect(daemon)  # and one that reads is not, however long it takes in all
    for _ in range(30):
        assert fast.call(QUERY, query(1000)).status == OK
        time.sleep(0.1)
    daemon.stop()

# --- connections -----------------------------------------------------------------------------

with test.check("PINGs do not keep a connection without calls open"):
    daemon = test.daemon("--idle-timeout", "1s")
    pinging = connect(daemon)
    calling = connect(daemon)
    begin = time.monotonic()
    while time.monotonic() - begin < 4 and not pinging.closed:
        pinging.send(h2.frame(h2.PING, 0, 0, b"12345678"))
        pinging.pump(0.1)
        time.sleep(0.1)
        assert calling.call(QUERY, query(8)).status == OK
    assert pinging.goaway == 0, "it is still open"
    assert not calling.closed
    daemon.stop()
with test.check("a call that meets the end of an idle connection is answered"):
    daemon = test.daemon("--idle-timeout", "500ms")
    late = h2.Connection(port=daemon.port)
    late.settle()
    assert late.wait(lambda: late.goaway is not None, 5) and late.goaway == 0
    reply = late.call("/umbrage.v1.Shadows/Limits", h2.prefixed(b""))  # sent before it could be read
    assert reply.status == 0, reply
    assert late.wait(lambda: late.closed, 5), "it stays open"
    daemon.stop()
with test.check("peers who only connect do not lock others out"):
    daemon = test.daemon("--max-connections", 8)
    busy = connect(daemon)
    half = busy.open(QUERY)
    squatters = [connect(daemon) for _ in range(7)]
    time.sleep(1.2)
    for _ in range(3):
        well(daemon)
    assert daemon.metric("umbrage_connections_evicted_total") >= 1
    busy.data(half, query(8), end=True)
    assert busy.reply(half).status == OK, "a connection with a call was closed"
    for connection in squatters:
        connection.pump(0.1)
    assert any(connection.goaway == 0 for connection in squatters)
    daemon.stop()
with test.check("a newcomer that its address's limit refuses closes no connection of others"):
    daemon = test.daemon("--max-connections", 8, "--loops", 1, "--max-address-connections", 1)
    only = h2.Connection(port=daemon.port)  # not a stranger, which would make room for its address
    assert only.call(QUERY, query(8)).status == OK
    others = [connect(daemon) for _ in range(7)]
    for _ in range(3):
        socket.create_connection(("127.0.0.1", daemon.port)).close()
    ut.wait_until(lambda: daemon.metric("umbrage_connections_refused_total") == 3, 10,
                  "the newcomers to be refused")
    assert daemon.metric("umbrage_connections_evicted_total") == 0
    for connection in others:
        assert connection.call(QUERY, query(8)).status == OK
    daemon.stop()
with test.check("a newcomer replaces a connection of its address that another loop has"):
    daemon = test.daemon("--loops", 2, "--max-address-connections", 2)
    proven = h2.Connection(port=daemon.port)
    assert proven.call(QUERY, query(8)).status == OK
    stranger = h2.Connection(port=daemon.port)  # on the other loop: each has as many as any other
    stranger.settle()
    for turn in range(3):
        comer = h2.Connection(port=daemon.port)
        comer.settle()
        assert proven.call(QUERY, query(8)).status == OK
        assert daemon.metric("umbrage_connections_evicted_total") == turn + 1
        assert daemon.metric("umbrage_connections_refused_total") == 0
        assert stranger.wait(lambda: stranger.closed, 5), "it stays open"
        stranger = comer
    assert stranger.call(QUERY, query(8)).status == OK  # now it has shown its right, too
    socket.create_connection(("127.0.0.1", daemon.port)).close()
    ut.wait_until(lambda: daemon.metric("umbrage_connections_refused_total") == 1, 10,
                  "a newcomer to an address without strangers is refused")
    assert proven.call(QUERY, query(8)).status == stranger.call(QUERY, query(8)).status == OK
    daemon.stop()

# --- compressed messages ---------------------------------------------------------------------

with test.check("a peer that sends gzip bombs does not hold up the calls of others"):
    bombed = test.daemon()
    attacker = h2.Connection(port=bombed.port, timeout=120)
    attacker.settle()
    # Well-formed, of an asset that is not there, and 4 MB of the unknown field 1000.
    zeros = 4 * 10 ** 6
    message = (M.QueryRequest(asset="none").SerializeToString()
               + b"\xc2\x3e" + bytes([zeros & 127 | 128, zeros >> 7 & 127 | 128,
                                      zeros >> 14 & 127 | 128, zeros >> 21]) + bytes(zeros))
    packed = h2.prefixed(gzip.compress(message), 1)
    BOMBS = 120
    burst = b""
    for number in range(1, 2 * BOMBS, 2):
        burst += h2.frame(h2.HEADERS, h2.END_HEADERS, number, attacker.request_headers(
            QUERY, extra=[("grpc-encoding", "gzip")]))
        burst += h2.frame(h2.DATA, h2.END_STREAM, number, packed)
    other = h2.Connection(port=bombed.port, timeout=120)
    other.settle()
    attacker.send(burst)
    calls = 0
    while attacker.pump() and sum(r.ended for r in attacker.replies.values()) < BOMBS:
        assert other.call("/grpc.health.v1.Health/Check", h2.prefixed(b"")).status == OK
        calls += 1
    assert attacker.replies[1].status == 5, attacker.replies[1]
    print(f"    {calls} calls meanwhile")
    assert calls >= 10, calls  # one a turn of the loop: it depends on no clock
    attacker.socket.close()
    other.socket.close()
test.finish()
