# SPDX-License-Identifier: Apache-2.0
"""
An asset of which only the pages that views need are read: from a file, a web server with ranges, or a daemon.
"""
from __future__ import annotations

import http.client
import socket
import ssl
import threading
import urllib.parse
import weakref
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from typing import Any, Callable, Iterable, Iterator, Optional

import numpy as np

from . import _library as lib
from ._arrays import FLOAT, slice_of
from ._library import Handle, check, core, ffi, rpc
from ._settings import Dial, Settings, c_settings, count
from ._slices import run_slices
from .assets import NO_DIAL, Asset, Result, stats_of
from .errors import ArgumentError, Error, NotFoundError, RightsError, UnavailableError, UnsupportedError
from .info import read_info
from .views import Held, View, check_fetch

TIMEOUT_S = 30.0
BYTES_A_S = 16384  # a server that sends less is given up
REDIRECTS = 5
AT_ONCE = 8        # requests under way
REFUSALS: dict[int, tuple[type[Error], str]] = {401: (RightsError, "E_UNAUTHENTICATED"), 403: (RightsError, "E_PERMISSION"),
                                                404: (NotFoundError, "E_NOT_FOUND")}


class HttpSource:
    """Byte ranges of a file on a web server, over connections that stay open, a few at a time."""

    def __init__(self, url: str, headers: Optional[dict[str, str]] = None) -> None:
        if not isinstance(headers or {}, dict):
            raise TypeError(f"headers: must be a dict, not {type(headers).__name__}")
        self._headers = dict(headers or {})
        for name, value in self._headers.items():
            if not isinstance(name, str) or not isinstance(value, str):
                raise TypeError("headers: names and values must be str")
            if not (name.isascii() and value.isascii() and (name + value).isprintable()):
                raise ValueError(f"headers: {name[:80]!r} has a character that HTTP does not allow")
        self._place = self._parse(url)
        self._url = url
        self._own = threading.local()  # a connection for each thread
        self._sockets: "weakref.WeakSet[Any]" = weakref.WeakSet()
        self._turn = 0  # number of times that requests were given up
        self._threads = ThreadPoolExecutor(AT_ONCE, "umbrage-http")
        try:
            self._await([self._threads.submit(self._follow)], 0, REDIRECTS)
        except BaseException:
            self.close()
            raise

    @staticmethod
    def _parse(url: str) -> tuple[str, str, Optional[int], str]:
        try:
            parts = urllib.parse.urlsplit(url)
            if parts.scheme not in ("http", "https") or not parts.hostname or "@" in parts.netloc:
                raise ValueError("must begin with http:// or https:// and a host, without a user")
            safe = "/%:@!$&'()*+,;=~-._?"
            target = urllib.parse.quote(parts.path or "/", safe=safe[:-1]) + (
                "?" + urllib.parse.quote(parts.query, safe=safe) if parts.query else "")
            return parts.scheme, parts.hostname, parts.port, target
        except ValueError as problem:
            raise ArgumentError(f"url: {url[:200]!r}: {problem}", "E_ARGUMENT") from None

    def _fails(self, reason: Any) -> UnavailableError:
        return UnavailableError(f"{self._place[1]}: {reason}", "E_UNAVAILABLE")

    def _follow(self) -> None:
        """Follows redirections once, when the file is opened."""
        for _ in range(REDIRECTS):
            answer = self._ask(0, 1)
            self._drop()
            if answer.status not in (301, 302, 303, 307, 308):
                return
            there = urllib.parse.urljoin(self._url, answer.headers.get("Location", ""))
            place = self._parse(there)
            if place[:3] != self._place[:3]:  # another server gets no token, and no text in the clear
                self._headers = {}
                if self._place[0] == "https" and place[0] == "http":
                    raise self._fails("redirects from https to http")
            self._url, self._place = there, place
        raise self._fails(f"more than {REDIRECTS} redirections")

    def _ask(self, offset: int, length: int) -> Any:
        (scheme, host, port, target), turn = self._place, self._turn
        for attempt in (0, 1):  # the server may have closed an idle connection
            try:
                connection = getattr(self._own, "connection", None)
                if connection is None:
                    connection = self._own.connection = (
                        http.client.HTTPConnection(host, port, timeout=TIMEOUT_S) if scheme == "http" else
                        http.client.HTTPSConnection(host, port, timeout=TIMEOUT_S,
                                                    context=ssl.create_default_context()))
                if connection.sock is None:
                    connection.connect()
                    self._sockets.add(connection.sock)
                connection.request("GET", target, headers={
                    **self._headers, "Range": f"bytes={offset}-{offset + length - 1}", "Accept-Encoding": "identity"})
                return connection.getresponse()
            except (http.client.HTTPException, OSError) as problem:
                self._drop()
                if attempt or turn != self._turn or not isinstance(problem, (http.client.HTTPException, ConnectionError)):
                    said = f"no answer in {TIMEOUT_S:g} seconds" if isinstance(problem, TimeoutError) else problem
                    raise self._fails(said or "the connection was closed") from problem
        return None

    def _drop(self) -> None:
        connection, self._own.connection = getattr(self._own, "connection", None), None
        if connection is not None:
            if connection.sock is not None:
                self._sockets.discard(connection.sock)
            connection.close()

    def _read(self, wanted: tuple[int, int]) -> bytes:
        offset, length = wanted
        answer = self._ask(offset, length)
        try:
            if answer.status == 416:  # behind the end of the file
                self._drop()
                return b""
            if answer.status != 206:
                known = "it ignores ranges" if answer.status == 200 else answer.reason
                kind, status = REFUSALS.get(answer.status, (UnavailableError, "E_UNAVAILABLE"))
                raise kind(f"{self._place[1]}: HTTP {answer.status}: {known}", status)
            if answer.headers.get("Content-Encoding", "identity") != "identity":
                raise self._fails(f"answers in the encoding {answer.headers['Content-Encoding'][:80]}")
            declared = answer.length
            data = bytes(answer.read(length + 1))
            if len(data) > length:
                raise self._fails("more bytes than the range has")
            if declared is not None and len(data) < declared:
                raise self._fails(f"the answer is cut after {len(data)} of {declared} bytes")
        except Error:
            self._drop()
            raise
        except (http.client.HTTPException, OSError) as problem:
            self._drop()
            raise self._fails(problem) from problem
        if not answer.isclosed():
            self._drop()
        return data

    def _await(self, futures: list[Any], number: int, seconds: float) -> Any:
        """The result of one thread; gives all of them up if it takes longer, or when interrupted."""
        try:
            return futures[number].result(TIMEOUT_S + seconds)
        except BaseException as problem:
            is_late = not futures[number].done() and isinstance(problem, FutureTimeout)
            for future in futures:
                future.cancel()
            self._stop()
            if is_late:
                raise self._fails(f"no answer in {TIMEOUT_S + seconds:.0f} seconds") from None
            raise

    def _stop(self) -> None:
        """Ends the requests under way: their threads find closed connections."""
        self._turn += 1
        for sock in list(self._sockets):
            try:
                sock.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass

    def read(self, ranges: list[tuple[int, int]]) -> Iterator[bytes]:
        """The bytes of (offset, length) ranges, in their order; shorter only at the end of the file."""
        futures = [self._threads.submit(self._read, one) for one in ranges]
        for number, (_, length) in enumerate(ranges):
            yield self._await(futures, number, AT_ONCE * length / BYTES_A_S)

    def close(self) -> None:
        """Ends the requests and connections."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._stop()


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
        self._region: Optional[Handle] = None
        self._lock, self._busy = threading.RLock(), False
        options, out, error = ffi.new("struct umb_region_options *"), ffi.new("struct umb_region **"), lib.new_error()
        try:
            expected = None if asset_id is None else lib.asset_id(asset_id, "id")
            options.id = ffi.NULL if expected is None else expected
            options.max_memory_bytes = count(memory, "memory", 2**64 - 1)
            self._check(rpc.umb_region_open(source, options, out, error), error)
        except BaseException:
            close_source()
            raise

        def end(region: Any, _kept: Any = (source, self._callback)) -> None:
            rpc.umb_region_close(region)
            close_source()

        self._region = Handle(out[0], end)
        self.info = read_info(core.umb_partial_lower(rpc.umb_region_partial(out[0])))

    @classmethod
    def of_reader(cls, read: Callable[[list[tuple[int, int]]], Iterable[bytes]], close: Callable[[], None],
                  asset_id: Optional[str] = None, memory: int = 0) -> "RangeAsset":
        """
        An asset behind a reader of your own.

        read      read([(offset, length), ...]) gives the bytes of each range in their order; fewer only at the end of
                  the file. What it raises reaches the caller
        close     called once
        asset_id  id that the asset must have; None: the reader chooses it
        memory    most bytes that it may take; 0: 1 GiB

        Raises TypeError or ValueError that names the argument, FormatError, LimitError.
        """
        problems: list[Any] = []

        def ranges(_user: Any, wanted: Any, number_: int, got: Any, got_user: Any, _error: Any) -> int:
            given = 0
            for data in read([(wanted[i].offset, wanted[i].length) for i in range(number_)]):
                if given == number_:
                    raise ValueError(f"read: gives more than the {number_} ranges that it is asked for")
                buffer = ffi.from_buffer(data)
                status, given = got(got_user, given, buffer, len(buffer)), given + 1
                if status != lib.OK:
                    return int(status)
            if given < number_:
                raise ValueError(f"read: gives {given} of {number_} ranges")
            return int(lib.OK)

        made, source = cls.__new__(cls), ffi.new("struct umb_region_source *")
        made._problems = problems
        made._callback = ffi.callback(
            "enum umb_status(void *, const struct umb_range *, size_t, umb_range_fn, void *, struct umb_error *)",
            ranges, error=core.UMB_E_IO, onerror=lambda kind, problem, trace: problems.append(problem))
        source.read = made._callback
        made.__init__(source, close, asset_id, memory)  # type: ignore[misc]
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
            if self._busy:
                raise RuntimeError("close: a callback of fetch must not close its asset")
            self._region = None

    def _require_open(self) -> Handle:
        """The region, which stays open as long as the handle is held. Raises ValueError if it is closed."""
        if self._region is None:
            raise ValueError("the asset is closed")
        return self._region

    def fetch(self, *views: View, max_bytes: int = 0,
              progress: Optional[Callable[[Held], Any]] = None) -> Held:
        """
        Reads the missing pages that the views need; without a view, the missing pages that earlier
        queries needed.

        max_bytes  bytes to read before it stops; 0: no limit
        progress   called with what is held after each round; a true result stops

        Ctrl-C ends it between two reads. Raises TypeError or ValueError that names the argument, FormatError for bytes
        that are not the asset's, LimitError for more memory than `open` allows, FileError, UnavailableError.
        """
        check_fetch(views, progress)
        request, error, problems = ffi.new("struct umb_region_request *"), lib.new_error(), []
        c_views = ffi.new("struct umb_partial_view[]", max(len(views), 1))
        for view, out in zip(views, c_views):
            view._fill(out)
        request.views, request.view_count = c_views, len(views)
        request.max_bytes = count(max_bytes, "max_bytes", 2**64 - 1)

        def told(_user: Any, _region: Any) -> int:
            return int(core.UMB_E_CANCELLED if progress is not None and progress(self.held()) else lib.OK)

        callback = ffi.callback("enum umb_status(void *, struct umb_region *)", told, error=core.UMB_E_CANCELLED,
                                onerror=lambda kind, problem, trace: problems.append(problem))
        request.progress = callback  # also where Ctrl-C is heard
        with self._lock:
            if self._busy:
                raise RuntimeError("fetch: must not be called from a callback of fetch")
            region, self._busy = self._require_open(), True
            try:
                status = rpc.umb_region_update(region.pointer, request, error)
            finally:
                self._busy = False
            if problems:
                raise problems[0]
            if status != core.UMB_E_CANCELLED or progress is None:
                self._check(status, error)
            return self.held()

    def held(self) -> Held:
        """What is held now."""
        stats = ffi.new("struct umb_region_stats *")
        with self._lock:
            region = self._require_open()
            rpc.umb_region_get_stats(region.pointer, stats)
        part = stats.partial
        return Held(part.page_count, part.pages_held, part.asset_bytes, part.held_bytes, part.memory_bytes,
                    stats.received_bytes, stats.requests, stats.rounds)

    def _answer(self, settings: Any, dial: Dial, shape: tuple[int, ...], batch: Any, keep: Any, values: Any,
                stats: bool, threads: int) -> Optional[Result]:
        if dial is not NO_DIAL:
            raise UnsupportedError("max_error, max_visibility and budget need a whole asset", "E_UNSUPPORTED")
        if settings[5] != "f32":
            raise UnsupportedError(f"format: {settings[5]}, an asset of ranges answers f32", "E_UNSUPPORTED")
        error, wanted, answers = lib.new_error(), c_settings(Settings(*settings)), \
            ffi.new("struct umb_partial_answers *")
        arrays, names = [values], ["values"]
        if stats:
            low, high, error_m = (np.zeros(shape, FLOAT) for _ in range(3))
            arrays, names = [values, low, high, error_m], ["values", "low", "high", "error_m"]
        memory = [ffi.from_buffer("float[]", one) if one.size else ffi.new("float[1]") for one in arrays]

        def one(first: int, n: int) -> None:
            for name, data in zip(names, memory):
                setattr(answers, name, data + first)
            part = slice_of(batch, first, n)
            if core.umb_points_check(part, ffi.NULL) != lib.OK:
                check(core.umb_points_check(batch, error), error)  # all of them, for the number of the bad one
            check(rpc.umb_region_query(region.pointer, wanted, part, 0 if self._busy else 1, answers, error), error)

        with self._lock:
            region = self._require_open()
            if batch.count:
                run_slices(one, batch.count)
            else:
                one(0, 0)  # checks the settings
            lower = core.umb_partial_lower(rpc.umb_region_partial(region.pointer))
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
    source, error = ffi.new("struct umb_region_source *"), lib.new_error()
    check(rpc.umb_region_file_open(lib.path_bytes(path), source, error), error)

    def close() -> None:
        rpc.umb_region_file_close(source)

    return RangeAsset(source, close, **options)
