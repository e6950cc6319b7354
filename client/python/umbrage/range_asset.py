# SPDX-License-Identifier: Apache-2.0
"""
An asset of which only the pages that views need are read: from a file, a web server with ranges, or a daemon.
"""
from __future__ import annotations

import http.client
import ssl
import threading
import urllib.parse
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Callable, Iterable, Iterator, Optional

import numpy as np

from . import _library as lib
from ._arrays import FLOAT
from ._library import check, core, ffi, rpc
from ._settings import Dial, Settings, c_settings, count
from .assets import Asset, Result, stats_of
from .errors import ArgumentError, UnsupportedError
from .info import read_info
from .views import Held, View

TIMEOUT_S = 30.0
REDIRECTS = 5
AT_ONCE = 8  # requests under way


class HttpSource:
    """Byte ranges of a file on a web server, over connections that stay open, a few at a time."""

    def __init__(self, url: str, headers: Optional[dict[str, str]] = None, timeout: float = TIMEOUT_S) -> None:
        self._headers, self._timeout = dict(headers or {}), timeout
        self._own = threading.local()  # a connection for each thread
        self._connections: list[Any] = []
        self._threads = ThreadPoolExecutor(AT_ONCE, "umbrage-http")
        self._place = self._parse(url)
        self._follow()

    @staticmethod
    def _parse(url: str) -> tuple[str, str, Optional[int], str]:
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ArgumentError(f"url: {url[:200]!r}, must begin with http:// or https:// and a host", "E_ARGUMENT")
        target = urllib.parse.quote(parts.path or "/", safe="/%:@!$&'()*+,;=~-._") + (
            "?" + parts.query if parts.query else "")
        return parts.scheme, parts.hostname, parts.port, target

    def _follow(self) -> None:
        """Follows redirections once, when the file is opened."""
        for _ in range(REDIRECTS):
            answer = self._ask(0, 1)
            if answer.status not in (301, 302, 303, 307, 308):
                answer.read(1)
                return
            scheme, host, port, target = self._place
            self._drop()
            there = urllib.parse.urljoin(f"{scheme}://{host}{':%d' % port if port else ''}{target}",
                                         answer.headers.get("Location", ""))
            place = self._parse(there)
            if place[:3] != self._place[:3]:  # another server gets no token, and no text in the clear
                self._headers.pop("Authorization", None)
                if scheme == "https" and place[0] == "http":
                    raise OSError(f"{host}: redirects from https to http")
            self._place = place
        raise OSError(f"{self._place[1]}: more than {REDIRECTS} redirections")

    def _ask(self, offset: int, length: int) -> Any:
        scheme, host, port, target = self._place
        for attempt in (0, 1):  # the server may have closed an idle connection
            try:
                if getattr(self._own, "connection", None) is None:
                    self._own.connection = (
                        http.client.HTTPConnection(host, port, timeout=self._timeout) if scheme == "http" else
                        http.client.HTTPSConnection(host, port, timeout=self._timeout,
                                                    context=ssl.create_default_context()))
                    self._connections.append(self._own.connection)
                self._own.connection.request("GET", target, headers={
                    **self._headers, "Range": f"bytes={offset}-{offset + length - 1}", "Accept-Encoding": "identity"})
                return self._own.connection.getresponse()
            except (http.client.HTTPException, ConnectionError) as problem:
                self._drop()
                if attempt:
                    raise OSError(f"{host}: {problem or 'the connection was closed'}") from problem
        return None

    def _drop(self) -> None:
        connection, self._own.connection = getattr(self._own, "connection", None), None
        if connection is not None:
            connection.close()

    def _read(self, wanted: tuple[int, int]) -> bytes:
        offset, length = wanted
        host = self._place[1]
        answer = self._ask(offset, length)
        if answer.status == 416:  # behind the end of the file
            self._drop()
            return b""
        if answer.status != 206:
            self._drop()
            known = "it ignores ranges" if answer.status == 200 else answer.reason
            raise OSError(f"{host}: HTTP {answer.status}: {known}")
        try:
            data = bytes(answer.read(length + 1))
        except (http.client.HTTPException, OSError) as problem:
            self._drop()
            raise OSError(f"{host}: {problem}") from problem
        if len(data) > length:
            self._drop()
            raise OSError(f"{host}: more bytes than the range has")
        return data

    def read(self, ranges: list[tuple[int, int]]) -> Iterator[bytes]:
        """The bytes of (offset, length) ranges, in their order; shorter only at the end of the file."""
        return self._threads.map(self._read, ranges)

    def close(self) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)
        for connection in self._connections:
            connection.close()


class RangeAsset(Asset):
    """
    An asset of which only some pages are held; `umbrage.open` makes it of an address, and of a file with
    `partial=True`.

    Every point is answered at once, with bounds: `query(..., stats=True)` says where the answer is exact. `fetch`
    reads what a view needs. Each page is proven against the id.

    Threads: one at a time.
    """

    def __init__(self, source: Any, close_source: Callable[[], None], asset_id: Optional[str] = None,
                 memory: int = 0) -> None:
        self._region, self._lock = None, threading.RLock()
        self._source, self._close_source = source, close_source
        options, out, error = ffi.new("struct umb_region_options *"), ffi.new("struct umb_region **"), lib.new_error()
        expected = None if asset_id is None else lib.asset_id(asset_id, "id")
        options.id = ffi.NULL if expected is None else expected
        options.max_memory_bytes = count(memory, "memory", 2**64 - 1)
        self._check(rpc.umb_region_open(source, options, out, error), error)
        self._region = out[0]
        self.info = read_info(core.umb_partial_lower(rpc.umb_region_partial(self._region)))

    @classmethod
    def of_reader(cls, read: Callable[[list[tuple[int, int]]], Iterable[bytes]], close: Callable[[], None],
                  **options: Any) -> "RangeAsset":
        """
        An asset behind read([(offset, length), ...]), which gives the bytes of each range in their order and may raise
        any exception. `close` is called once.
        """
        problems: list[Any] = []

        def ranges(_user: Any, wanted: Any, number_: int, got: Any, got_user: Any, _error: Any) -> int:
            for i, data in enumerate(read([(wanted[i].offset, wanted[i].length) for i in range(number_)])):
                status = got(got_user, i, ffi.from_buffer(data), len(data))
                if status != lib.OK:
                    return int(status)
            return int(lib.OK)

        made, source = cls.__new__(cls), ffi.new("struct umb_region_source *")
        made._problems = problems
        made._callback = ffi.callback(
            "enum umb_status(void *, const struct umb_range *, size_t, umb_range_fn, void *, struct umb_error *)",
            ranges, error=core.UMB_E_IO, onerror=lambda kind, problem, trace: problems.append(problem))
        source.read = made._callback
        try:
            made.__init__(source, close, **options)  # type: ignore[misc]
        except BaseException:
            close()
            raise
        return made

    _problems: list[Any] = []
    _callback: Any = None

    def _check(self, status: Any, error: Any) -> None:
        """As check, but the exception that the reader raised goes on to the caller."""
        if self._problems:
            raise self._problems.pop()
        check(status, error)

    def close(self) -> None:
        with self._lock:
            region, self._region = self._region, None
            if region is not None:
                rpc.umb_region_close(region)
                self._close_source()

    def __del__(self) -> None:
        if getattr(self, "_region", None) is not None:
            self.close()

    def _open_region(self) -> Any:
        if self._region is None:
            raise ValueError("the asset is closed")
        return self._region

    def fetch(self, *views: View, max_bytes: int = 0,
              progress: Optional[Callable[[Held], Any]] = None) -> Held:
        """
        Reads the missing pages that the views need; without a view those that queries missed.

        max_bytes  bytes to read before it stops; 0: no limit
        progress   called with what is held after each round; a true result stops
        """
        request, error, problems = ffi.new("struct umb_region_request *"), lib.new_error(), []
        c_views = ffi.new("struct umb_partial_view[]", max(len(views), 1))
        for view, out in zip(views, c_views):
            view.fill(out)
        request.views, request.view_count = c_views, len(views)
        request.max_bytes = count(max_bytes, "max_bytes", 2**64 - 1)

        def told(_user: Any, _region: Any) -> int:
            return int(core.UMB_E_CANCELLED if progress is not None and progress(self.held()) else lib.OK)

        callback = ffi.callback("enum umb_status(void *, struct umb_region *)", told, error=core.UMB_E_CANCELLED,
                                onerror=lambda kind, problem, trace: problems.append(problem))
        request.progress = callback  # also where Ctrl-C is heard
        with self._lock:
            status = rpc.umb_region_update(self._open_region(), request, error)
            if problems:
                raise problems[0]
            if status != core.UMB_E_CANCELLED or progress is None:
                self._check(status, error)
            return self.held()

    def held(self) -> Held:
        """What is held now."""
        stats = ffi.new("struct umb_region_stats *")
        with self._lock:
            rpc.umb_region_get_stats(self._open_region(), stats)
        part = stats.partial
        return Held(part.page_count, part.pages_held, part.asset_bytes, part.held_bytes, part.memory_bytes,
                    stats.received_bytes, stats.requests, stats.rounds)

    def _answer(self, settings: Any, dial: Dial, points: Any, batch: Any, values: Any, stats: bool,
                threads: int) -> Optional[Result]:
        if dial != Dial():
            raise UnsupportedError("max_error, max_visibility and budget need a whole asset", "E_UNSUPPORTED")
        if settings[5] != "f32":
            raise UnsupportedError(f"format: {settings[5]}, an asset of ranges answers f32", "E_UNSUPPORTED")
        shape, error = points.shape[:-1], lib.new_error()
        wanted, answers = c_settings(Settings(*settings)), ffi.new("struct umb_partial_answers *")
        kept = [ffi.from_buffer("float[]", values)] if values.size else [ffi.new("float[1]")]
        answers.values = kept[0]
        if stats:
            low, high, error_m = (np.zeros(shape, FLOAT) for _ in range(3))
            if values.size:
                kept += [ffi.from_buffer("float[]", array) for array in (low, high, error_m)]
                answers.low, answers.high, answers.error_m = kept[1:]
        with self._lock:
            check(rpc.umb_region_query(self._open_region(), wanted, batch, 1, answers, error), error)
            lower = core.umb_partial_lower(rpc.umb_region_partial(self._region))
            bound = core.umb_query_bound_m(lower, wanted) if stats else 0.0
        if not stats:
            return None
        return Result(values, bound, low == high, low, high, error_m, stats_of(answers.stats), wanted.taps or 1,
                      wanted.level, 0, self.info.id)

    def _unsupported(self, *_arguments: Any) -> None:
        raise UnsupportedError("segments, columns and boxes need a whole asset", "E_UNSUPPORTED")

    _segments = _columns = _boxes = _unsupported  # type: ignore[assignment]


def open_url(url: str, headers: Optional[dict[str, str]] = None, **options: Any) -> RangeAsset:
    """The asset of an http:// or https:// address."""
    source = HttpSource(url, headers)
    return RangeAsset.of_reader(source.read, source.close, **options)


def open_ranges(path: Any, **options: Any) -> RangeAsset:
    """The asset of a packed file, of which only ranges are read."""
    file = open(path, "rb")

    def read(ranges: list[tuple[int, int]]) -> Iterator[bytes]:
        for offset, length in ranges:
            file.seek(offset)
            yield file.read(length)

    return RangeAsset.of_reader(read, file.close, **options)
