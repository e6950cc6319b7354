# SPDX-License-Identifier: Apache-2.0
"""
Daemons: their assets, and bakes on them.
"""
from __future__ import annotations

import os
import queue
import threading
import weakref
from dataclasses import dataclass
from typing import Any, Callable, Iterator, Mapping, Optional, Union

from . import _library as lib
from ._arrays import DOUBLE, number, slice_of, triple
from ._limits import Limits, calls, read_limits
from ._library import Handle, Path, check, core, ffi, rpc, text
from ._slices import aside
from ._settings import Dial, Settings, c_dial, c_settings, count
from .assets import NO_DIAL, Asset, Result, stats_of, stats_sum, whole_result
from .bakes import pairs_of
from .errors import LimitError, raise_status
from .info import AssetInfo, curve_row, light_of, three
from .range_asset import RangeAsset

STATES = ("queued", "running", "done", "failed", "poison")
FETCH_MAX = 64 << 30  # bytes that a server may announce to `fetch`


@dataclass(frozen=True)
class Listed:
    """
    An asset in a daemon's list.

    name          as `open` of a Daemon takes it
    id            SHA-256 of the content, 64 hexadecimal digits
    packed_bytes  length of its packed file
    memory_bytes  bytes that its queries read
    light_count   number of its lights
    """

    name: str
    id: str
    packed_bytes: int
    memory_bytes: int
    light_count: int


@dataclass(frozen=True)
class JobStatus:
    """
    State and progress of a bake job.

    job       number of the job, 32 hexadecimal digits
    state     "queued", "running", "done", "failed" or "poison" (its process died too often)
    cause     reason of the last failure
    asset     id of the asset when done, else ""
    phase, done, total, unit, rate   progress of the phase, and units a second; total 0: not known
    plan      lines of the bake's plan, once known
    owner     name of the token that submitted it
    priority  -10 to 10: order among the owner's jobs, higher ones first
    """

    job: str
    state: str
    cause: str
    asset: str
    phase: str
    done: int
    total: int
    unit: str
    rate: float
    plan: str
    owner: str
    priority: int

    @property
    def is_over(self) -> bool:
        """True if the state is final."""
        return self.state in ("done", "failed", "poison")


def job_status(status: Any) -> JobStatus:
    """JobStatus of a struct umb_job_status."""
    state = STATES[status.state] if 0 <= status.state < len(STATES) else "unknown"
    return JobStatus(text(status.job), state, text(status.cause), lib.id_text(status.asset) if status.has_asset else "",
                     text(status.phase), status.done, status.total, text(status.unit), status.rate, text(status.plan),
                     text(status.owner), status.priority)


def _close_client(pointer: Any, _calls: Any, pid: int) -> None:
    """Closes a client. Never on its own thread, where the collector may drop the last holder; never in a fork."""
    if os.getpid() != pid:
        return
    ours = [one.ident for one in threading.enumerate() if not isinstance(one, threading._DummyThread)]
    if threading.get_ident() in ours:
        rpc.umb_client_close(pointer)
    else:
        threading.Thread(target=rpc.umb_client_close, args=(pointer,), daemon=True).start()


class _Client(Handle):
    """A struct umb_client and its calls under way."""

    def __init__(self, pointer: Any) -> None:
        self.calls: set[Any] = set()
        self.pid = os.getpid()
        super().__init__(pointer, _close_client, self.calls, self.pid)


class _Call:
    """
    An asynchronous call. Until the call ends, the client's table `calls` keeps the call and its
    memory alive, so that after an interrupt the C library still finds valid memory. A call never
    holds the client: the client could then be closed on its own thread.
    """

    def __init__(self, *keep: Any) -> None:
        self._over, self._calls, self._keep = threading.Event(), set[Any](), list(keep)
        self._status, self._said, self._errno = core.UMB_E_INTERNAL, "", 0
        self.is_left = False           # True: the answers are not awaited
        self.problems: list[Any] = []  # what callbacks of this call raised
        self.handle = ffi.new("struct umb_client_async *")
        self._callback = self.callback("void(void *, enum umb_status, const struct umb_error *)", self._done)
        self.handle.done = self._callback
        self.then: Callable[[], None] = lambda: None  # runs on the client's thread at the end

    def callback(self, kind: str, function: Callable[..., Any], failed: Any = None) -> Any:
        """A C callback that lives as long as the call; what it raises is raised by `wait`."""
        made = ffi.callback(kind, function, error=failed,
                            onerror=lambda _kind, problem, _trace: self.problems.append(problem))
        self._keep.append(made)
        return made

    def _done(self, _user: Any, status: int, error: Any) -> None:
        if error != ffi.NULL:
            self._said, self._errno = text(error.message), error.system_error
        self._status = status
        self._end()

    def _end(self) -> None:
        self._over.set()
        self._calls.discard(self)
        self.then()

    def start(self, client: _Client, function: Any, *arguments: Any) -> "_Call":
        """Begins the call function(client, *arguments, async, error)."""
        self.begin(client, lambda error: function(client.pointer, *arguments, self.handle, error), *arguments)
        return self

    def begin(self, client: _Client, begin: Callable[[Any], Any], *keep: Any) -> None:
        """Begins a call by begin(error), which returns its status."""
        self._keep += keep
        self._calls = client.calls
        self._calls.add(self)
        error = lib.new_error()
        status = begin(error)
        if status != lib.OK:
            self._calls.discard(self)
            check(status, error)

    def wait(self, client: _Client) -> None:
        """Ends with the call, or cancels it when interrupted. Raises what the call or a callback failed with."""
        try:
            self._over.wait()
        except BaseException:
            self.is_left = True
            self.cancel(client)
            raise
        self._callback = None
        self._keep.clear()
        if self.problems:
            raise self.problems[0]
        if self._status != lib.OK:
            raise_status(text(core.umb_status_name(self._status)), self._said, self._errno)

    def cancel(self, client: Optional[_Client]) -> None:
        """Cancels the call. Its end comes later, on the client's thread."""
        handle = self.handle
        if client is not None and not self._over.is_set():
            rpc.umb_client_cancel(client.pointer, handle.call, ffi.NULL)


def _prove(path: str, asset_id: Any) -> None:
    """Proves that a packed file has the content of an id. Raises FormatError."""
    file, error = ffi.new("struct umb_file *"), lib.new_error()
    check(core.umb_file_open(lib.path_bytes(path), file, error), error)
    try:
        check(core.umb_packed_prove(file.bytes, file.size, asset_id, rpc.umb_sha256_openssl(), error), error)
    finally:
        core.umb_file_close(file)


class Daemon:
    """
    A daemon, or several with the same assets. `umbrage.connect` makes it; use it in a `with` statement.

    Every call raises ValueError if the daemon is closed, TypeError or ValueError that names a wrong argument,
    UnavailableError without a server, RightsError for a token that does not allow it, BusyError, DeadlineError, and
    what its own text says. Ctrl-C ends every wait.

    Threads: any number at once. `close` cancels the calls of other threads.
    """

    def __init__(self, address: str, *, token: Optional[str] = None, token_file: Optional[Path] = None,
                 ca_file: Optional[Path] = None, certificate_file: Optional[Path] = None, key_file: Optional[Path] = None,
                 server_name: Optional[str] = None, timeout: float = 60.0) -> None:
        self._client: Optional[_Client] = None
        self._limits: Optional[Limits] = None
        if not isinstance(address, str):
            raise TypeError(f"address: must be a str, not {type(address).__name__}")
        options, out, error, keep = ffi.new("struct umb_client_options *"), ffi.new("struct umb_client **"), \
            lib.new_error(), []
        for name, value in (("token", token), ("token_file", token_file), ("ca_file", ca_file),
                            ("certificate_file", certificate_file), ("key_file", key_file),
                            ("server_name", server_name)):
            if value is not None:
                keep.append(ffi.new("char[]", lib.path_bytes(value, name)))
                setattr(options, name, keep[-1])
        if not 0.001 <= number(timeout, "timeout") <= 4e6:
            raise ValueError(f"timeout: {timeout}, must be 0.001 to 4e6 seconds")
        options.call_timeout_ms = int(timeout * 1000)
        options.max_reply_bytes = 1 << 32
        check(rpc.umb_client_open(lib.path_bytes(address, "address"), options, out, error), error)
        self._client = _Client(out[0])

    def __enter__(self) -> "Daemon":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Cancels calls under way and closes the connections. Closing twice does nothing."""
        client, self._client = self._client, None
        for call in list(client.calls) if client is not None else ():
            call.cancel(client)

    def _open_client(self) -> _Client:
        """The client, which stays open as long as the handle is held. Raises ValueError if it is closed."""
        client = self._client
        if client is None:
            raise ValueError("the daemon is closed")
        if client.pid != os.getpid():
            raise RuntimeError("fork: a connection does not pass into a child process; connect again")
        return client

    def _ask(self, function: Any, *arguments: Any) -> None:
        """Makes a call and waits for its end."""
        client = self._open_client()
        _Call().start(client, function, *arguments).wait(client)

    def _call_limits(self) -> Limits:
        """What the daemon takes in one call; it is asked once."""
        if self._limits is None:
            client = self._open_client()
            self._limits = aside(lambda: read_limits(client))
        return self._limits

    def assets(self) -> list[Listed]:
        """The daemon's assets in the order of their names."""
        client = self._open_client()

        def ask() -> list[Listed]:
            out, total, error = ffi.new("struct umb_client_asset **"), ffi.new("size_t *"), lib.new_error()
            check(rpc.umb_client_list_assets(client.pointer, out, total, error), error)
            try:
                return [Listed(text(one.name), lib.id_text(one.id), one.packed_bytes, one.memory_bytes,
                               one.light_count) for one in out[0][0:total[0]]]
            finally:
                core.umb_free(out[0])

        found: list[Listed] = aside(ask)
        return found

    def open(self, asset: str) -> "DaemonAsset":
        """The asset of a name or id; the daemon answers its queries. Raises NotFoundError."""
        return DaemonAsset(self, asset)

    def open_ranges(self, asset: str, *, asset_id: Optional[str] = None, memory: int = 0) -> RangeAsset:
        """
        The asset of a name or id, of which the pages that views need are read from the daemon.

        asset_id  id that it must have; None: the server chooses the asset
        memory    most bytes that it may take; 0: 1 GiB

        Raises NotFoundError, FormatError, LimitError.
        """
        source, error, client = ffi.new("struct umb_region_source *"), lib.new_error(), self._open_client()
        check(rpc.umb_region_daemon_open(client.pointer, lib.path_bytes(asset, "asset"), source, error), error)

        def close(_kept: Any = client) -> None:  # the client stays open as long
            rpc.umb_region_daemon_close(source)

        return RangeAsset(source, close, asset_id, memory)

    def submit(self, scene: Path, settings: Optional[Mapping[str, Any]] = None, *, files: Optional[Mapping[str, Path]] = None,
               priority: int = 0, progress: Optional[Callable[[int, int], Any]] = None) -> str:
        """
        Submits a scene file as a bake job and returns the job's number. The same submission gives the same job.

        scene     path of the file
        settings  options of umbrage-bake by their long names, as {"sun": "135,45", "resolution": 4096}; True for an
                  option without a value, a list repeats an option
        files     further files that the scene reads: {name in the scene: local path}
        priority  -10 to 10: order among the owner's jobs, higher ones first
        progress  called with bytes sent and bytes in all; what it raises ends the call

        Raises FileError for a file that cannot be read, ArgumentError for settings that the daemon does not take,
        LimitError beyond the quota, UnsupportedError if the daemon takes no jobs.
        """
        keep: list[Any] = []

        def c_text(value: Any, name: str) -> Any:
            keep.append(ffi.new("char[]", lib.path_bytes(value, name)))
            return keep[-1]

        for given, name in ((settings, "settings"), (files, "files")):
            if not isinstance(given or {}, Mapping):
                raise TypeError(f"{name}: must be a dict, not {type(given).__name__}")
        if progress is not None and not callable(progress):
            raise TypeError(f"progress: must be callable, not {type(progress).__name__}")
        submission, submitted = ffi.new("struct umb_job_submission *"), ffi.new("struct umb_job_submitted *")
        named = {os.path.basename(lib.path_text(scene, "scene")): scene, **dict(files or {})}
        c_files = ffi.new("struct umb_job_file[]", len(named))
        for out, (path, source) in zip(c_files, named.items()):
            out.path, out.source = c_text(path, "files"), c_text(source, "files")
        rows = list(pairs_of(settings or {}))
        c_rows = ffi.new("struct umb_job_setting[]", max(len(rows), 1))
        for out, (name, value) in zip(c_rows, rows):
            out.name, out.value = c_text(name, "settings"), c_text(value or "", "settings")
        submission.scene, submission.files, submission.file_count = c_files[0].path, c_files, len(named)
        submission.settings, submission.setting_count = c_rows, len(rows)
        submission.priority = count(priority, "priority", 10, -10)
        client, call = self._open_client(), _Call(keep, c_files, c_rows)

        def sent(_user: Any, done: int, total: int) -> None:
            try:
                if progress is not None and not call.problems:
                    progress(done, total)
            except BaseException:
                call.cancel(client_())
                raise

        client_ = weakref.ref(client)  # the callback must not be the last to hold it
        submission.sent = call.callback("void(void *, uint64_t, uint64_t)", sent)
        call.start(client, rpc.umb_client_submit, submission, submitted).wait(client)
        return text(submitted.job)

    def watch(self, job: str) -> Iterator[JobStatus]:
        """
        Gives the status of a job at once and after each change, until it is over: `for status in daemon.watch(job)`.
        Raises NotFoundError.
        """
        told: "queue.SimpleQueue[Any]" = queue.SimpleQueue()
        going = [True]

        def on_status(_user: Any, status: Any) -> int:
            told.put(job_status(status))
            return 1 if going[0] else 0

        client, call, name = self._open_client(), _Call(), ffi.new("char[]", lib.path_bytes(job, "job"))
        call.then = lambda: told.put(None)
        call.start(client, rpc.umb_client_watch, name, call.callback("int(void *, const struct umb_job_status *)",
                                                                     on_status, 0), ffi.NULL)
        try:
            while (status := told.get()) is not None:
                yield status
            call.wait(client)
        finally:
            going[0] = False
            call.cancel(client)

    def wait(self, job: str) -> JobStatus:
        """Waits until a job is over and returns its last status. A failed job is no exception: see `state`."""
        last = None
        for last in self.watch(job):
            pass
        assert last is not None
        return last

    def jobs(self, limit: int = 100) -> list[JobStatus]:
        """The caller's jobs, newest first; at most `limit`, up to 1000."""
        out, total = ffi.new("struct umb_job_status **"), ffi.new("size_t *")
        self._ask(rpc.umb_client_list_jobs, count(limit, "limit", 1000), out, total)
        try:
            return [job_status(one) for one in out[0][0:total[0]]]
        finally:
            core.umb_free(out[0])

    def cancel(self, job: str) -> None:
        """Cancels a job that is not over. Raises NotFoundError."""
        self._ask(rpc.umb_client_cancel_job, lib.path_bytes(job, "job"), ffi.NULL)

    def fetch(self, asset_id: str, path: Path, progress: Optional[Callable[[int, int], Any]] = None,
              max_bytes: int = FETCH_MAX) -> None:
        """
        Writes an asset's packed file to a path, whole or not at all.

        asset_id   64 hexadecimal digits
        progress   called with bytes received and bytes in all; what it raises ends the call
        max_bytes  length of the file at most

        Raises NotFoundError, FormatError if the bytes are not those of the id, LimitError, OSError.
        """
        folder, name = os.path.split(os.path.abspath(lib.path_text(path)))
        part = os.path.join(folder, f".{name}.{os.getpid()}.{threading.get_ident()}.part")
        wanted, client, call = lib.asset_id(asset_id, "asset_id"), self._open_client(), _Call()
        most = count(max_bytes, "max_bytes", 2**63 - 1)
        with open(part, "wb") as file:
            def got(_user: Any, offset: int, data: Any, number_: int, size: int) -> int:
                if size > most or offset + number_ > size:
                    raise LimitError(f"asset: the server announces {size} bytes, max_bytes is {most}", "E_TOO_LARGE")
                file.seek(offset)
                file.write(ffi.buffer(data, number_))
                if progress is not None:
                    progress(offset + number_, size)
                return int(lib.OK)

            callback = call.callback("enum umb_status(void *, uint64_t, const void *, size_t, uint64_t)", got,
                                     core.UMB_E_IO)
            try:
                call.start(client, rpc.umb_client_fetch, wanted, 0, callback, ffi.NULL).wait(client)
                file.flush()
                aside(lambda: _prove(part, wanted))
                os.fsync(file.fileno())
                os.replace(part, os.path.join(folder, name))
            except BaseException:
                os.unlink(part)
                raise

    def delete(self, asset_id: str) -> None:
        """
        Deletes the caller's share in an asset; with the last owner the daemon deletes the file.

        asset_id  64 hexadecimal digits

        Raises NotFoundError.
        """
        self._ask(rpc.umb_client_delete_asset, lib.asset_id(asset_id, "asset_id"))


def connect(address: str, *, token: Optional[str] = None, token_file: Optional[Path] = None,
            ca_file: Optional[Path] = None, certificate_file: Optional[Path] = None, key_file: Optional[Path] = None,
            server_name: Optional[str] = None, timeout: float = 60.0) -> Daemon:
    """
    A daemon at an address: "tcp:host:port", "tls:host:port" or "unix:path"; several with commas are replicas.

    token, token_file           the token, or a file that holds only the token
    ca_file                     tls: certificates that the server's must be signed by; None: the system's
    certificate_file, key_file  tls: the caller's certificate, PEM
    server_name                 tls: name in the server's certificate, if it is not the host
    timeout                     seconds that a call may take, 0.001 to 4e6

    Nothing is sent before the first call. Raises TypeError or ValueError that names the argument, FileError.
    """
    return Daemon(address, token=token, token_file=token_file, ca_file=ca_file, certificate_file=certificate_file,
                  key_file=key_file, server_name=server_name, timeout=timeout)


class DaemonAsset(Asset):
    """An asset whose queries a daemon answers. Answers are the same bits as in process."""

    def __init__(self, daemon: Daemon, asset: str, owns: bool = False) -> None:
        self._daemon, self._owns, self._closed = daemon, owns, False
        self._name = ffi.new("char[]", lib.path_bytes(asset, "asset"))
        self.info = self._describe()

    def close(self) -> None:
        self._closed = True
        if self._owns:
            self._daemon.close()

    def _require_open(self) -> _Client:
        if self._closed:
            raise ValueError("the asset is closed")
        return self._daemon._open_client()

    def _describe(self) -> AssetInfo:
        out, client = ffi.new("struct umb_client_description **"), self._require_open()
        _Call().start(client, rpc.umb_client_describe, self._name, out).wait(client)
        told = out[0]
        try:
            lights = tuple(light_of(one.info, one.resolution, one.voxel_m, one.closed,
                                    tuple(curve_row(one.curve[k]) for k in range(one.curve_count)))
                           for one in told.lights[0:told.light_count])
            return AssetInfo(lib.id_text(told.asset.id), lights, three(told.origin),
                             (three(told.bounds.min), three(told.bounds.max)), lib.id_text(told.scene_hash),
                             text(told.plan), text(told.settings), told.asset.memory_bytes, told.asset.packed_bytes)
        finally:
            core.umb_free(told)

    def _answer(self, settings: Any, dial: Dial, shape: tuple[int, ...], batch: Any, keep: Any, values: Any,
                stats: bool, threads: int) -> Optional[Result]:
        client, name, flat = self._require_open(), self._name, values.reshape(-1)
        most, told = self._daemon._call_limits().points_a_call(batch), []
        per_byte = 8 if settings[5] == "bit" else 1
        if batch.count > most:
            _check_whole(core.umb_points_check, batch)
        for first, number_ in calls(batch.count, most, per_byte > 1):
            piece = flat[first // per_byte:(first + number_ + per_byte - 1) // per_byte]
            reply = self._answer_call(client, name, settings, dial, slice_of(batch, first, number_), (batch, keep), piece,
                                      stats or dial is not NO_DIAL)
            told.append(reply)
            # The other calls ask the same content with the same settings, whatever is published meanwhile.
            name = _id_name(reply.asset_id)
            if dial is not NO_DIAL and reply.taps:
                settings, dial = Settings(*settings)._replace(taps=reply.taps, level=reply.level), NO_DIAL
        if not stats:
            return None
        return whole_result(values, shape, bound_m=told[0].bound_m, stats=stats_sum(stats_of(one.stats) for one in told),
                            taps=told[0].taps, level=told[0].level, nanoseconds=sum(one.nanoseconds for one in told),
                            asset_id=lib.id_text(told[0].asset_id))

    @staticmethod
    def _answer_call(client: _Client, name: Any, settings: Any, dial: Dial, points: Any, keep: Any, values: Any,
                     stats: bool) -> Any:
        """Answers of one call into `values`; the struct umb_client_query_reply. `keep` is the memory of the points."""
        request, call = ffi.new("struct umb_client_query_request *"), _Call(name, points, keep)
        wanted, c_dial_ = c_settings(Settings(*settings)), c_dial(dial)
        request.asset, request.settings, request.dial, request.points = name, wanted[0], c_dial_[0], points[0]
        request.want_stats = 1 if stats else 0
        target, told = ffi.from_buffer(values) if values.size else ffi.new("char[1]"), []

        def done(_user: Any, status: int, reply: Any, problem: Any) -> None:
            try:
                if status == lib.OK and not call.is_left and reply.value_bytes <= values.nbytes:
                    ffi.memmove(target, reply.values, reply.value_bytes)
                    told.append(ffi.new("struct umb_client_query_reply *", reply[0]))
            finally:
                call._done(ffi.NULL, status, problem)

        callback = call.callback("umb_client_query_fn", done)
        call.begin(client, lambda error: rpc.umb_client_query_start(
            client.pointer, request, callback, ffi.NULL, ffi.addressof(call.handle, "call"), error))
        call.wait(client)
        return told[0]

    def _volume_calls(self, light: int, number_: int, most: int, ask: Callable[[_Call, _Client, Any, int, int, Any], Any],
                      *keep: Any) -> None:
        """
        Makes a volume query of `number_` records in calls of `most`: ask(call, client, wanted, first, records, reply)
        begins one. `keep` is the memory of records and answers.
        """
        client, name = self._require_open(), self._name
        for first, records in calls(number_, most):
            wanted, reply = ffi.new("struct umb_volume_query *"), ffi.new("struct umb_volume_query_reply *")
            wanted.asset, wanted.light = name, light
            call = _Call(keep, name, wanted, reply)
            ask(call, client, wanted, first, records, reply)
            call.wait(client)
            name = _id_name(reply.asset_id)

    def _segments(self, light: int, ends: Any, number: int, origin: Any, lit: Any, most: int, parts: Any) -> None:
        data, intervals, whole = ffi.from_buffer(ends), ffi.from_buffer(parts), ffi.new("struct umb_segments *")
        whole.ends, whole.count = data, number
        whole.format = core.UMB_POINT_F64 if ends.dtype == DOUBLE else core.UMB_POINT_F32
        if origin is not None:
            whole.origin = triple(origin, "origin")
        a_call = self._daemon._call_limits().segments_a_call(whole.format, most)
        if number > a_call:
            _check_whole(core.umb_segments_check, whole)

        def ask(call: _Call, client: _Client, wanted: Any, first: int, records: int, reply: Any) -> None:
            batch, answers = ffi.new("struct umb_segments *", whole[0]), ffi.new("struct umb_segment_answers *")
            batch.ends, batch.count = ffi.cast("char *", data) + first * 6 * ends.itemsize, records
            answers.segments = lit + first
            if most:
                answers.intervals = ffi.cast("struct umb_interval *", intervals) + first * most
                answers.interval_max = most
            call.start(client, rpc.umb_client_segments, wanted, batch, answers, reply)

        self._volume_calls(light, number, a_call, ask, data, intervals, lit)

    def _columns(self, light: int, batch: Any, number: int, found: Any) -> None:
        def ask(call: _Call, client: _Client, wanted: Any, first: int, records: int, reply: Any) -> None:
            answers = ffi.new("struct umb_column_answers *")
            answers.columns = found + first
            call.start(client, rpc.umb_client_columns, wanted, slice_of(batch, first, records), answers, reply)

        a_call = self._daemon._call_limits().columns_a_call(batch)
        if number > a_call:
            _check_whole(core.umb_points_check, batch)
        self._volume_calls(light, number, a_call, ask, batch, found)

    def _boxes(self, light: int, boxes: Any, found: Any) -> None:
        data = ffi.from_buffer("struct umb_box[]", boxes) if len(boxes) else ffi.new("struct umb_box[]", 1)

        def ask(call: _Call, client: _Client, wanted: Any, first: int, records: int, reply: Any) -> None:
            answers = ffi.new("struct umb_box_answers *")
            answers.boxes = found + first
            call.start(client, rpc.umb_client_boxes, wanted, data + first, records, answers, reply)

        a_call = self._daemon._call_limits().boxes_a_call()
        if len(boxes) > a_call:
            _check_whole(core.umb_boxes_check, data, len(boxes))
        self._volume_calls(light, len(boxes), a_call, ask, data, found)


def _check_whole(function: Any, *batch: Any) -> None:
    """Checks a batch that is cut into calls: the server would number a bad record within its call."""
    error = lib.new_error()
    check(function(*batch, error), error)


def _id_name(asset_id: Any) -> Any:
    """An id as the name of an asset for C."""
    return ffi.new("char[]", lib.id_text(asset_id).encode())


def open_daemon_asset(address: str, **options: Any) -> Union[DaemonAsset, RangeAsset]:
    """The asset of "tcp:host:port/name": the part behind the last '/' is its name or id."""
    place, _, name = address.rpartition("/")
    if not place or not name:
        raise ValueError(f"asset: {address[:200]!r}, must end with /NAME")
    daemon = Daemon(place, **options)
    try:
        return DaemonAsset(daemon, name, owns=True)
    except BaseException:
        daemon.close()
        raise


