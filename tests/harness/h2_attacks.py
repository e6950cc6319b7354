#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Attacks on an HTTP/2 server by hand-made frames, as a module (ATTACKS) and as a program of its own, so that
attackers share no interpreter with the victim:

    h2_attacks.py NAME PORT COUNT SECONDS BODY_FILE      prints [[seconds, was cut], ...] as JSON

COUNT attackers connect, attack until they are cut, and come back until the time is over.
"""
import gzip
import json
import os
import struct
import sys
import threading
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import raw_http2 as h2  # noqa: E402

QUERY = "/umbrage.v1.Shadows/Query"
PATIENCE_S = 3      # longer than the timers of the daemon under test
GRACE_S = 30        # after so long nobody will be cut any more
BODY = b""          # one valid request with its prefix


def flood(block, opens_stream=False, reads=True):
    """Sends the block again and again until the connection goes."""
    def attack(connection, until):
        if opens_stream:
            connection.open(QUERY)
        while time.monotonic() < until and connection.send(block):
            if reads and not connection.pump(0):
                return
    return attack


def each_stream(make, per_send=50):
    """Sends make(connection, stream) for stream after stream."""
    def attack(connection, until):
        stream = 1
        while time.monotonic() < until:
            block = b"".join(make(connection, number) for number in range(stream, stream + 2 * per_send, 2))
            stream += 2 * per_send
            if not connection.send(block) or not connection.pump(0):
                return
    return attack


def headers(connection, stream, flags=h2.END_HEADERS):
    return h2.frame(h2.HEADERS, flags, stream, connection.request_headers(QUERY))


def rapid_reset(connection, stream):
    return headers(connection, stream) + h2.frame(h2.RST_STREAM, 0, stream, struct.pack(">I", 8))


def overflown_window(connection, stream):
    return headers(connection, stream) + h2.frame(h2.WINDOW_UPDATE, 0, stream, struct.pack(">I", 0x7fffffff))


def data_after_end(connection, stream):
    return headers(connection, stream, h2.END_HEADERS | h2.END_STREAM) + h2.frame(h2.DATA, 0, stream, b"x")


def header_bomb(connection, stream):
    table = b"\x40" + h2.integer(6, 7) + b"x-bomb" + h2.integer(400, 7) + b"y" * 400 if stream == 1 else b""
    block = connection.request_headers(QUERY) + table + b"\xbe" * 4000
    return h2.frame(h2.HEADERS, h2.END_HEADERS, stream, block)


def endless_headers(payload):
    def attack(connection, until):
        connection.send(headers(connection, 1, 0))
        flood(h2.frame(h2.CONTINUATION, 0, 1, payload))(connection, until)
    return attack


def silence(connection, until):
    """Sends not even a preface, and does not answer what the server sends."""
    connection.socket.settimeout(max(0.1, until - time.monotonic()))
    try:
        while connection.socket.recv(4096):
            pass
        connection.closed = True
    except OSError as error:
        connection.closed = not isinstance(error, TimeoutError)


def dribble(connection, until):
    """A byte of a request now and then."""
    connection.settle()
    stream = connection.open(QUERY)
    for i in range(len(BODY)):
        if time.monotonic() > until or not connection.data(stream, BODY[i:i + 1]) or connection.closed:
            return
        reply = connection.replies[stream]
        connection.wait(lambda: reply.ended or reply.reset is not None, 0.1)
        if reply.ended or reply.reset is not None:
            connection.cut_stream = True
            return


def takes_nothing(connection, until):
    """Opens ninety replies that wait for a window which is never opened."""
    connection.settle()
    for _ in range(90):
        stream = connection.open(QUERY)
        connection.data(stream, BODY, end=True)
    connection.wait(lambda: any(reply.reset is not None for reply in connection.replies.values()),
                    until - time.monotonic())
    connection.cut_stream = any(reply.reset is not None for reply in connection.replies.values())


def gzip_bombs(connection, until):
    # A message that states its size is refused before it is inflated; this one states the limit.
    bomb = h2.prefixed(gzip.compress(bytes(8 << 20), 9)[:-4] + (4 << 20).to_bytes(4, "little"), 1)
    connection.settle()
    while time.monotonic() < until:
        stream = connection.open(QUERY, extra=[("grpc-encoding", "gzip")])
        connection.data(stream, bomb, end=True)
        reply = connection.replies[stream]
        connection.wait(lambda: reply.ended or reply.reset is not None, until - time.monotonic())
        if connection.closed:
            return


class Attack:
    """counter: the kind of umbrage_h2_abuse_total that must rise, or None; cut: it must be cut; slow: by a
    timer."""

    def __init__(self, name, run, counter, settings=b"", start=True, cut=True, slow=False):
        self.name, self.run, self.counter = name, run, counter
        self.settings, self.start, self.cut, self.slow = settings, start, cut, slow


PING = h2.frame(h2.PING, 0, 0, b"12345678")
SETTING = h2.frame(h2.SETTINGS, 0, 0, struct.pack(">HI", 4, 65535))
ATTACKS = [
    Attack("rapid reset", each_stream(rapid_reset), "control"),
    Attack("windows that overflow", each_stream(overflown_window), "control"),
    Attack("window updates of 0", each_stream(lambda c, s: headers(c, s) + h2.frame(
        h2.WINDOW_UPDATE, 0, s, bytes(4))), "library"),
    Attack("DATA after the end", each_stream(data_after_end), "library"),
    Attack("empty CONTINUATION frames", endless_headers(b""), "library"),
    Attack("long CONTINUATION frames", endless_headers(h2.literal("x", "y" * 8000)), None),
    Attack("header bombs", each_stream(header_bomb, 4), "headers"),
    Attack("PINGs that are read", flood(PING * 100), "control"),
    Attack("PINGs that are not", flood(PING * 100, reads=False), None),
    Attack("SETTINGS that are read", flood(SETTING * 100), "control"),
    Attack("SETTINGS that are not", flood(SETTING * 100, reads=False), None),
    Attack("empty DATA", flood(h2.frame(h2.DATA, 0, 1) * 100, opens_stream=True), "control"),
    Attack("window updates of 1", flood(h2.frame(h2.WINDOW_UPDATE, 0, 1, struct.pack(">I", 1)) * 100,
                                        opens_stream=True), "control"),
    Attack("PRIORITY", flood(h2.frame(h2.PRIORITY, 0, 1, struct.pack(">IB", 0, 5)) * 100), "control"),
    Attack("unknown frames", flood(h2.frame(99, 0, 0, b"?") * 100), "control"),
    Attack("silence", silence, "timeout", start=False, slow=True),
    Attack("a body of a byte now and then", dribble, None, slow=True),
    Attack("a window of 0", takes_nothing, "timeout", settings=struct.pack(">HI", 4, 0), slow=True),
    Attack("gzip bombs", gzip_bombs, None, cut=False),
]


def attacker(attack, port, until, results):
    """Connects, attacks until cut, and comes back; notes how long each connection lived."""
    while time.monotonic() < until:
        begin = time.monotonic()
        try:
            connection = h2.Connection(port=port, start=attack.start, settings=attack.settings, timeout=PATIENCE_S)
        except OSError:
            time.sleep(0.02)  # refused: also a way to be cut
            continue
        connection.cut_stream = False
        try:
            # An attacker that must be cut goes on until then, on a busy machine later than `until`.
            attack.run(connection, begin + GRACE_S if attack.cut else min(until, begin + 2 * PATIENCE_S))
        except (AssertionError, OSError):
            pass  # it was cut before it knew the settings
        was_cut = connection.closed or connection.send_failed or connection.goaway is not None or connection.cut_stream
        results.append((time.monotonic() - begin, bool(was_cut)))
        connection.close()


def main(name, port, count, seconds, body_file):
    global BODY
    with open(body_file, "rb") as file:
        BODY = file.read()
    attack = next(attack for attack in ATTACKS if attack.name == name)
    results = []
    until = time.monotonic() + float(seconds)
    threads = [threading.Thread(target=attacker, args=(attack, int(port), until, results))
               for _ in range(int(count))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(json.dumps(results))


if __name__ == "__main__":
    main(*sys.argv[1:])
