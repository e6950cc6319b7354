# SPDX-License-Identifier: Apache-2.0
"""
HTTP/2 by hand, for bytes that no proper client would send: frames from bytes (RFC 9113), header
blocks as literals, and a reader of the daemon's header blocks (RFC 7541, dynamic table included).
The Huffman code is canonical, so the lengths of RFC 7541 appendix B are all that is needed.
"""
import select
import socket
import struct
import time

PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
DATA, HEADERS, PRIORITY, RST_STREAM, SETTINGS = 0, 1, 2, 3, 4
PUSH_PROMISE, PING, GOAWAY, WINDOW_UPDATE, CONTINUATION = 5, 6, 7, 8, 9
END_STREAM = ACK = 1
END_HEADERS = 4

_LENGTHS = [
    13, 23, 28, 28, 28, 28, 28, 28, 28, 24, 30, 28, 28, 30, 28, 28,
    28, 28, 28, 28, 28, 28, 30, 28, 28, 28, 28, 28, 28, 28, 28, 28,
    6, 10, 10, 12, 13, 6, 8, 11, 10, 10, 8, 11, 8, 6, 6, 6,
    5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 7, 8, 15, 6, 12, 10,
    13, 6, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7,
    7, 7, 7, 7, 7, 7, 7, 7, 8, 7, 8, 13, 19, 13, 14, 6,
    15, 5, 6, 5, 6, 5, 6, 6, 6, 5, 7, 7, 6, 6, 6, 5,
    6, 7, 6, 5, 5, 6, 7, 7, 7, 7, 7, 15, 11, 14, 13, 28,
    20, 22, 20, 20, 22, 22, 22, 23, 22, 23, 23, 23, 23, 23, 24, 23,
    24, 24, 22, 23, 24, 23, 23, 23, 23, 21, 22, 23, 22, 23, 23, 24,
    22, 21, 20, 22, 22, 23, 23, 21, 23, 22, 22, 24, 21, 22, 23, 23,
    21, 21, 22, 21, 23, 22, 23, 23, 20, 22, 22, 22, 23, 22, 22, 23,
    26, 26, 20, 19, 22, 23, 22, 25, 26, 26, 26, 27, 27, 26, 24, 25,
    19, 21, 26, 27, 27, 26, 27, 24, 21, 21, 26, 26, 28, 27, 27, 27,
    20, 24, 20, 21, 22, 21, 21, 23, 22, 22, 25, 25, 24, 24, 26, 23,
    26, 27, 26, 26, 27, 27, 27, 27, 27, 28, 27, 27, 27, 27, 27, 26,
    30,
]


def _huffman_codes():
    codes = {}
    code = 0
    length = 0
    for want, symbol in sorted((length, symbol) for symbol, length in enumerate(_LENGTHS)):
        code <<= want - length
        length = want
        codes[(length, code)] = symbol
        code += 1
    if code != 1 << length:
        raise AssertionError("the Huffman lengths are not a full code")
    return codes


_CODES = _huffman_codes()

_STATIC = [(":authority", ""), (":method", "GET"), (":method", "POST"), (":path", "/"),
           (":path", "/index.html"), (":scheme", "http"), (":scheme", "https"),
           (":status", "200"), (":status", "204"), (":status", "206"), (":status", "304"),
           (":status", "400"), (":status", "404"), (":status", "500"), ("accept-charset", ""),
           ("accept-encoding", "gzip, deflate"), ("accept-language", ""), ("accept-ranges", ""),
           ("accept", ""), ("access-control-allow-origin", ""), ("age", ""), ("allow", ""),
           ("authorization", ""), ("cache-control", ""), ("content-disposition", ""),
           ("content-encoding", ""), ("content-language", ""), ("content-length", ""),
           ("content-location", ""), ("content-range", ""), ("content-type", ""), ("cookie", ""),
           ("date", ""), ("etag", ""), ("expect", ""), ("expires", ""), ("from", ""), ("host", ""),
           ("if-match", ""), ("if-modified-since", ""), ("if-none-match", ""), ("if-range", ""),
           ("if-unmodified-since", ""), ("last-modified", ""), ("link", ""), ("location", ""),
           ("max-forwards", ""), ("proxy-authenticate", ""), ("proxy-authorization", ""),
           ("range", ""), ("referer", ""), ("refresh", ""), ("retry-after", ""), ("server", ""),
           ("set-cookie", ""), ("strict-transport-security", ""), ("transfer-encoding", ""),
           ("user-agent", ""), ("vary", ""), ("via", ""), ("www-authenticate", "")]


def _huffman_decode(data):
    out = bytearray()
    code = length = 0
    for byte in data:
        for bit in range(7, -1, -1):
            code = code << 1 | byte >> bit & 1
            length += 1
            symbol = _CODES.get((length, code))
            if symbol is not None:
                out.append(symbol)
                code = length = 0
    return bytes(out)


class HeaderReader:
    """Decodes the header blocks of one connection, in order."""

    def __init__(self):
        self.table = []

    @staticmethod
    def _integer(data, at, bits):
        mask = (1 << bits) - 1
        value = data[at] & mask
        at += 1
        shift = 0
        while value >= mask:
            value += (data[at] & 127) << shift
            shift += 7
            at += 1
            if data[at - 1] < 128:
                break
        return value, at

    def _string(self, data, at):
        coded = data[at] & 128
        size, at = self._integer(data, at, 7)
        raw = data[at:at + size]
        return (_huffman_decode(raw) if coded else raw).decode("latin-1"), at + size

    def _entry(self, index):
        return _STATIC[index - 1] if index <= 61 else self.table[index - 62]

    def read(self, data):
        fields = []
        at = 0
        while at < len(data):
            first = data[at]
            if first & 128:
                index, at = self._integer(data, at, 7)
                fields.append(self._entry(index))
                continue
            if first & 0xe0 == 0x20:
                _, at = self._integer(data, at, 5)
                continue
            indexed = first & 64
            index, at = self._integer(data, at, 6 if indexed else 4)
            if index:
                name = self._entry(index)[0]
            else:
                name, at = self._string(data, at)
            value, at = self._string(data, at)
            fields.append((name, value))
            if indexed:
                self.table.insert(0, (name, value))
        return fields


def integer(value, bits, first=0):
    """An HPACK integer."""
    mask = (1 << bits) - 1
    if value < mask:
        return bytes([first | value])
    out = bytearray([first | mask])
    value -= mask
    while value >= 128:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def literal(name, value):
    """A header field as a literal without indexing."""
    name = name.encode("latin-1")
    value = value.encode("latin-1")
    return (b"\0" + integer(len(name), 7) + name + integer(len(value), 7) + value)


def frame(kind, flags, stream, payload=b""):
    return struct.pack(">I", len(payload))[1:] + struct.pack(">BBI", kind, flags, stream) + payload


def prefixed(message, flag=0):
    """A gRPC message with its five bytes."""
    return struct.pack(">BI", flag, len(message)) + message


class Reply:
    """What came back on one stream."""

    def __init__(self):
        self.headers = []
        self.body = b""
        self.ended = False
        self.reset = None  # error code

    def header(self, name):
        for key, value in self.headers:
            if key == name:
                return value
        return None

    @property
    def status(self):
        value = self.header("grpc-status")
        return None if value is None else int(value)

    def __repr__(self):
        return (f"headers={self.headers} body={len(self.body)} bytes ended={self.ended} "
                f"reset={self.reset}")


class Connection:
    """A raw connection. Writes never block for ever; reads have a limit of time."""

    def __init__(self, port=None, path=None, start=True, settings=b"", timeout=10, source=None,
                 wrap=None):
        """source: the address to come from, as 127.0.0.2; wrap: makes a TLS socket of the plain one."""
        if path is not None:
            self.socket = socket.socket(socket.AF_UNIX)
            self.socket.settimeout(timeout)
            self.socket.connect(path)
        else:
            self.socket = socket.create_connection(("127.0.0.1", port), timeout=timeout,
                                                   source_address=source and (source, 0))
            self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if wrap is not None:
            self.socket = wrap(self.socket)
        self.timeout = timeout
        self.buffer = b""
        self.headers = HeaderReader()
        self.block = b""
        self.replies = {}
        self.goaway = None  # error code
        self.pings = 0
        self.closed = False      # the peer's end is over
        self.send_failed = False
        self.settled = False     # the peer's settings are in force and ours with it
        self.next_stream = 1
        if start:
            self.send(PREFACE + frame(SETTINGS, 0, 0, settings)
                      + frame(WINDOW_UPDATE, 0, 0, struct.pack(">I", 64 << 20)))

    def send(self, data):
        """Sends bytes. Returns False if the peer has closed or takes nothing; bytes that the peer
        sent may still be read."""
        try:
            self.socket.sendall(data)
            return True
        except OSError:
            self.send_failed = True
            return False

    def settle(self):
        """Waits until both sides know the other's settings: then the peer's windows are open."""
        if not self.wait(lambda: self.settled):
            raise AssertionError("no settings from the peer")

    def request_headers(self, path, method="POST", content_type="application/grpc", extra=()):
        fields = [(":method", method), (":scheme", "http"), (":path", path),
                  (":authority", "localhost")]
        if content_type is not None:
            fields.append(("content-type", content_type))
        fields.append(("te", "trailers"))
        fields.extend(extra)
        # Any block may begin with a smaller table (RFC 7541 section 4.2); the tests need few entries.
        return integer(512, 5, 0x20) + b"".join(literal(name, value) for name, value in fields)

    def open(self, path, end=False, **how):
        """Sends HEADERS of a new stream; returns its number."""
        stream = self.next_stream
        self.next_stream += 2
        self.replies[stream] = Reply()
        self.send(frame(HEADERS, END_HEADERS | (END_STREAM if end else 0), stream,
                        self.request_headers(path, **how)))
        return stream

    def data(self, stream, payload, end=False):
        return self.send(frame(DATA, END_STREAM if end else 0, stream, payload))

    def _take(self, kind, flags, stream, payload):
        if kind == SETTINGS and not flags & ACK:
            self.send(frame(SETTINGS, ACK, 0))
        elif kind == SETTINGS:
            self.settled = True
        elif kind == PING and flags & ACK:
            self.pings += 1
        elif kind == PING:
            self.send(frame(PING, ACK, 0, payload))
        elif kind == GOAWAY:
            self.goaway = struct.unpack(">I", payload[4:8])[0]
        elif kind in (HEADERS, CONTINUATION):
            self.block += payload
            if flags & END_HEADERS:
                fields = self.headers.read(self.block)
                self.block = b""
                self.replies.setdefault(stream, Reply()).headers.extend(fields)
            if kind == HEADERS and flags & END_STREAM:
                self.replies.setdefault(stream, Reply()).ended = True
        elif kind == DATA:
            reply = self.replies.setdefault(stream, Reply())
            reply.body += payload
            if flags & END_STREAM:
                reply.ended = True
            elif payload:
                self.send(frame(WINDOW_UPDATE, 0, stream, struct.pack(">I", len(payload))))
            if payload:
                self.send(frame(WINDOW_UPDATE, 0, 0, struct.pack(">I", len(payload))))
        elif kind == RST_STREAM:
            reply = self.replies.setdefault(stream, Reply())
            reply.reset = struct.unpack(">I", payload)[0]

    def pump(self, seconds=0.0):
        """Reads what has arrived, waiting at most that long; False at the end of the connection."""
        ready, _, _ = select.select([self.socket], [], [], seconds)
        if ready:
            try:
                got = self.socket.recv(1 << 18)
            except OSError:
                got = b""
            if not got:
                self.closed = True
            self.buffer += got
        while len(self.buffer) >= 9:
            size = int.from_bytes(self.buffer[:3], "big")
            if len(self.buffer) < 9 + size:
                break
            kind, flags, stream = struct.unpack(">BBI", self.buffer[3:9])
            payload = self.buffer[9:9 + size]
            self.buffer = self.buffer[9 + size:]
            self._take(kind, flags, stream & 0x7fffffff, payload)
        return not self.closed

    def wait(self, done, seconds=None):
        """Reads until done() is true, the connection ends or time is up; returns done()."""
        deadline = time.monotonic() + (self.timeout if seconds is None else seconds)
        while not done() and not self.closed and time.monotonic() < deadline:
            self.pump(min(0.2, max(0.0, deadline - time.monotonic())))
        return done()

    def reply(self, stream, seconds=None):
        """The whole reply of a stream."""
        reply = self.replies[stream]
        if not self.wait(lambda: reply.ended or reply.reset is not None, seconds):
            raise AssertionError(f"stream {stream}: no whole reply: {reply}, connection closed "
                                 f"{self.closed}, goaway {self.goaway}")
        return reply

    def call(self, path, body, **how):
        """A whole unary call; body already has its prefix."""
        stream = self.open(path, **how)
        self.data(stream, body, end=True)
        return self.reply(stream)

    def close(self):
        self.socket.close()
