# SPDX-License-Identifier: Apache-2.0
"""
Shared by tests of hostile peers: an asset "city" in the test's store, and requests for it by bare
HTTP/2.

    peers = hostile_peer.Peers(ut.Test())
    daemon = peers.test.daemon()
    connection = peers.connect(daemon)
    reply = connection.reply(peers.upload(connection, peers.query(8)))
"""
import os
import struct
import time

import raw_http2 as h2
import umbrage_test as ut

QUERY = "/umbrage.v1.Shadows/Query"
OK, EXHAUSTED = 0, 8
# A stream window and a connection window so large that they never limit: the peer alone decides
# what is not taken.
WIDE = struct.pack(">HI", 4, 0x7fffffff)
WIDER = h2.frame(h2.WINDOW_UPDATE, 0, 0, struct.pack(">I", 0x7fffffff - (65 << 20)))


class Peers:
    """The store's asset and the requests."""

    def __init__(self, test):
        self.test = test
        self.messages = test.messages.shadows
        os.mkdir(test.path("store"))
        test.bake(test.scene("city", 3), test.path("store", "city.umb"), "--resolution", 256,
                  "--depth", "raster", "--verify", 0)

    def query(self, points, **fields):
        return h2.prefixed(self.messages.QueryRequest(asset="city", points=bytes(12 * points),
                                          **fields).SerializeToString())

    def heavy(self, points):
        """Some 0.6 us a point, so that a batch takes thirty times as long to answer as to send."""
        scattered = ut.floats(ut.random_points((-500, -10, -500), (500, 80, 500), 1000, 5))
        return h2.prefixed(self.messages.QueryRequest(
            asset="city", points=(scattered * (points // 1000 + 1))[:12 * points], taps=1,
            filter=self.messages.FILTER_FOOTPRINT, footprint_m=30).SerializeToString())

    @staticmethod
    def upload(connection, body, end=True):
        """Opens a call and sends its body in frames; the stream."""
        stream = connection.open(QUERY)
        for at in range(0, len(body), 16000):
            connection.data(stream, body[at:at + 16000], end=end and at + 16000 >= len(body))
        return stream

    @staticmethod
    def connect(daemon, **how):
        connection = h2.Connection(path=daemon.socket_path, **how)
        connection.settle()
        return connection

    def well(self, daemon, seconds=5):
        """Checks that a small call on a new connection is answered within that time."""
        begin = time.monotonic()
        connection = self.connect(daemon)
        assert connection.call(QUERY, self.query(8)).status == OK
        connection.close()
        took = time.monotonic() - begin
        assert took < seconds * (5 if ut.is_sanitized() else 1), f"it took {took:.1f} s"
