# SPDX-License-Identifier: Apache-2.0
"""
A slow link on loopback, and a small web server that serves ranges.

    server = link.RangeServer(folder)                    # http://127.0.0.1:PORT/NAME
    slow = link.Link(server.port, mbit=20, rtt_ms=100)   # the same at slow.port, as over that link
    ... slow.sent ...                                    # bytes that went to the client

All connections share one link: a byte leaves when those before it have left, and arrives half a round
trip later; a new connection takes a round trip before its first byte, as a TCP handshake does. Congestion
control and loss are not simulated. `cut()` breaks every connection at once; with `cut_after` the link does so
itself, once, when so many bytes have gone to the client.
"""
import asyncio
import http.server
import os
import threading
import time


class RangeServer:
    """GET with one range, of a folder's files or of one file by any name; counts what it was asked for in `ranges`."""

    def __init__(self, folder, serves_ranges=True):
        ranges = self.ranges = []

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            disable_nagle_algorithm = True

            def do_GET(self):
                name = os.path.basename(self.path.partition("?")[0])
                path = folder if os.path.isfile(folder) else os.path.join(folder, name)
                if not os.path.isfile(path):
                    self.send_error(404)
                    return
                size = os.path.getsize(path)
                asked = self.headers.get("Range")
                first, last = 0, size - 1
                if asked and serves_ranges:
                    first, last = asked.removeprefix("bytes=").split("-")
                    first, last = int(first), min(int(last), size - 1)
                    ranges.append((first, last))
                with open(path, "rb") as file:
                    file.seek(first)
                    body = file.read(last - first + 1)
                self.send_response(206 if asked and serves_ranges else 200)
                self.send_header("Content-Length", str(len(body)))
                if asked and serves_ranges:
                    self.send_header("Content-Range", f"bytes {first}-{last}/{size}")
                self.end_headers()
                try:
                    self.wfile.write(body)
                except OSError:
                    pass  # the client went away

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.server.handle_error = lambda *_: None  # clients that go away
        self.port = self.server.server_address[1]
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()


class Link:
    """A proxy in front of a port (or a Unix socket) of this machine."""

    def __init__(self, target, mbit, rtt_ms, cut_after=None):
        self.cut_after = cut_after
        self.target, self.bytes_s, self.half_s = target, mbit * 1e6 / 8, rtt_ms / 2000
        self.sent = self.received = self.connections = 0
        self.free_at = {"up": 0.0, "down": 0.0}
        self.writers = set()
        self.loop = asyncio.new_event_loop()
        ready = threading.Event()
        threading.Thread(target=self._run, args=(ready,), daemon=True).start()
        ready.wait(10)

    def _run(self, ready):
        asyncio.set_event_loop(self.loop)
        server = self.loop.run_until_complete(asyncio.start_server(self._serve, "127.0.0.1", 0))
        self.port = server.sockets[0].getsockname()[1]
        ready.set()
        self.loop.run_forever()

    async def _serve(self, reader, writer):
        self.connections += 1
        self.writers.add(writer)
        try:
            await asyncio.sleep(2 * self.half_s)
            if isinstance(self.target, int):
                far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self.target)
            else:
                far_reader, far_writer = await asyncio.open_unix_connection(self.target)
            self.writers.add(far_writer)
            await asyncio.gather(self._carry(reader, far_writer, "up"),
                                 self._carry(far_reader, writer, "down"))
        except OSError:
            pass
        finally:
            writer.close()

    async def _carry(self, reader, writer, way):
        """Bytes in order, each piece when the link has carried it."""
        queue = asyncio.Queue(64)

        async def deliver():
            while True:
                at, piece = await queue.get()
                await asyncio.sleep(max(0, at - time.monotonic()))
                if not piece:
                    break
                if not writer.is_closing():
                    writer.write(piece)
                    await writer.drain()
            if writer.can_write_eof():
                writer.write_eof()

        task = asyncio.ensure_future(deliver())
        try:
            while piece := await reader.read(4096):
                left_at = max(time.monotonic(), self.free_at[way]) + len(piece) / self.bytes_s
                self.free_at[way] = left_at
                if way == "down":
                    if self.cut_after is not None and self.sent + len(piece) > self.cut_after:
                        self.cut_after = None
                        self.cut()
                        break
                    self.sent += len(piece)
                else:
                    self.received += len(piece)
                await queue.put((left_at + self.half_s, piece))
                await asyncio.sleep(max(0, left_at - time.monotonic() - 0.05))
        except OSError:
            pass
        await queue.put((time.monotonic() + self.half_s, b""))
        try:
            await task
        except OSError:
            pass

    def cut(self):
        """Breaks all connections."""
        def close():
            for writer in list(self.writers):
                if writer.transport:
                    writer.transport.abort()
            self.writers.clear()
        self.loop.call_soon_threadsafe(close)
