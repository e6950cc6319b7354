# SPDX-License-Identifier: Apache-2.0
"""
Daemons: their assets, and bakes on them.
"""
from __future__ import annotations

import os
import queue
import threading
from dataclasses import dataclass
from typing import Any, Callable, Iterator, Mapping, Optional, Union


from . import _library as lib
from ._arrays import DOUBLE, triple
from ._library import check, core, ffi, rpc, text
from ._settings import Dial, Settings, c_dial, c_settings, count
from .assets import Asset, Result, stats_of, whole_result
from .errors import raise_status
from .info import AssetInfo, curve_row, light_of, three
from .range_asset import RangeAsset

STATES = ("queued", "running", "done", "failed", "poison")


@dataclass(frozen=True)
class Listed:
    """An asset in a daemon's list."""

    name: str
    id: str
    packed_bytes: int
    memory_bytes: int
    light_count: int


@dataclass(frozen=True)
class JobStatus:
    """
    State and progress of a bake job.

    state     "queued", "running", "done", "failed" or "poison" (its process died too often)
    cause     reason of the last failure
    asset     id of the asset when done, else ""
    phase, done, total, unit, rate   progress of the phase; total 0: not known
    plan      lines of the bake's plan, once known
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


class _Call:
    """An asynchronous call: wait() ends with it, or cancels it when interrupted."""

    def __init__(self, client: Any) -> None:
        self._client, self._over = client, threading.Event()
        self._status, self._said, self._errno = core.UMB_E_INTERNAL, "", 0
        self._then: Optional[Callable[[], None]] = None
        self._callback = ffi.callback("void(void *, enum umb_status, const struct umb_error *)", self._done)
        self.handle = ffi.new("struct umb_client_async *")
        self.handle.done = self._callback

    def _done(self, _user: Any, status: int, error: Any) -> None:
        self._status = status
        if error != ffi.NULL:
            self._said, self._errno = text(error.message), error.system_error
        self._over.set()
        if self._then is not None:
            self._then()

    def at_end(self, then: Callable[[], None]) -> None:
        """Sets what runs on the client's thread when the call is over. Before the call begins."""
        self._then = then

    def wait(self, status: int, error: Any) -> None:
        """In: what the function that began the call returned. Raises what the call failed with."""
        check(status, error)
        try:
            self._over.wait()
        except BaseException:
            self.cancel()
            raise
        if self._status != lib.OK:
            raise_status(text(core.umb_status_name(self._status)), self._said, self._errno)

    def cancel(self) -> None:
        """Cancels the call and waits for its end: its memory may then be freed."""
        check(rpc.umb_client_cancel(self._client, self.handle.call, ffi.NULL), lib.new_error())
        self._over.wait()


class Daemon:
    """
    A daemon, or several with the same assets. `umbrage.connect` makes it; use it in a `with` statement.

    Threads: any number at once, except for `close`.
    """

    def __init__(self, address: str, *, token: Optional[str] = None, token_file: Any = None, ca_file: Any = None,
                 certificate_file: Any = None, key_file: Any = None, server_name: Optional[str] = None,
                 timeout: float = 60.0) -> None:
        self._client = None
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
        if not 0.001 <= timeout <= 4e6:
            raise ValueError(f"timeout: {timeout}, must be 0.001 to 4e6 seconds")
        options.call_timeout_ms = int(timeout * 1000)
        options.max_reply_bytes = 1 << 32
        check(rpc.umb_client_open(address.encode(), options, out, error), error)
        self._client = out[0]

    def __enter__(self) -> "Daemon":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Cancels calls under way and closes the connections. Closing twice does nothing."""
        client, self._client = self._client, None
        if client is not None:
            rpc.umb_client_close(client)

    def __del__(self) -> None:
        if getattr(self, "_client", None) is not None:
            self.close()

    def client(self) -> Any:
        """The struct umb_client. Raises ValueError if it is closed."""
        if self._client is None:
            raise ValueError("the daemon is closed")
        return self._client

    def assets(self) -> list[Listed]:
        """The daemon's assets in the order of their names."""
        out, number, error = ffi.new("struct umb_client_asset **"), ffi.new("size_t *"), lib.new_error()
        check(rpc.umb_client_list_assets(self.client(), out, number, error), error)
        try:
            return [Listed(text(one.name), lib.id_text(one.id), one.packed_bytes, one.memory_bytes, one.light_count)
                    for one in out[0][0:number[0]]]
        finally:
            core.umb_free(out[0])

    def open(self, asset: str) -> "DaemonAsset":
        """The asset of a name or id; the daemon answers its queries."""
        return DaemonAsset(self, asset)

    def open_ranges(self, asset: str, **options: Any) -> RangeAsset:
        """The asset of a name or id, of which the pages that views need are read from the daemon."""
        source, error = ffi.new("struct umb_region_source *"), lib.new_error()
        def close() -> None:
            rpc.umb_region_daemon_close(source)
            _ = self  # the daemon stays open as long

        check(rpc.umb_region_daemon_open(self.client(), asset.encode(), source, error), error)
        try:
            return RangeAsset(source, close, **options)
        except BaseException:
            rpc.umb_region_daemon_close(source)
            raise

    def submit(self, scene: Any, settings: Optional[Mapping[str, Any]] = None, *, files: Any = None,
               priority: int = 0, progress: Optional[Callable[[int, int], Any]] = None) -> str:
        """
        Submits a scene file as a bake job and returns the job's number. The same submission gives the same job.

        scene     path of the file
        settings  options of umbrage-bake by their long names, as {"sun": "135,45", "resolution": 4096}; True for an
                  option without a value
        files     further files that the scene reads: {name in the scene: local path}
        progress  called with bytes sent and bytes in all
        """
        keep: list[Any] = []

        def c_text(value: Any, name: str) -> Any:
            keep.append(ffi.new("char[]", lib.path_bytes(value, name)))
            return keep[-1]

        submission, submitted = ffi.new("struct umb_job_submission *"), ffi.new("struct umb_job_submitted *")
        named = {os.path.basename(os.fspath(scene)): scene, **dict(files or {})}
        c_files = ffi.new("struct umb_job_file[]", len(named))
        for out, (path, source) in zip(c_files, named.items()):
            out.path, out.source = c_text(path, "files"), c_text(source, "files")
        rows = dict(settings or {})
        c_rows = ffi.new("struct umb_job_setting[]", max(len(rows), 1))
        for out, (name, value) in zip(c_rows, rows.items()):
            out.name, out.value = c_text(str(name).replace("_", "-"), "settings"), c_text(
                "" if value is True else str(value), "settings")
        submission.scene, submission.files, submission.file_count = c_files[0].path, c_files, len(named)
        submission.settings, submission.setting_count, submission.priority = c_rows, len(rows), priority
        sent = ffi.callback("void(void *, uint64_t, uint64_t)", lambda _u, done, total: progress(done, total)
                            if progress is not None else None)
        submission.sent = sent
        call, error = _Call(self.client()), lib.new_error()
        call.wait(rpc.umb_client_submit(self.client(), submission, submitted, call.handle, error), error)
        del keep
        return text(submitted.job)

    def watch(self, job: str) -> Iterator[JobStatus]:
        """Gives the status of a job at once and after each change, until it is over."""
        told: "queue.SimpleQueue[Any]" = queue.SimpleQueue()
        going = [True]

        def on_status(_user: Any, status: Any) -> int:
            told.put(job_status(status))
            return 1 if going[0] else 0

        callback = ffi.callback("int(void *, const struct umb_job_status *)", on_status, error=0)
        call, error = _Call(self.client()), lib.new_error()
        name = ffi.new("char[]", lib.path_bytes(job, "job"))
        call.at_end(lambda: told.put(None))
        check(rpc.umb_client_watch(self.client(), name, callback, ffi.NULL, call.handle, error), error)
        try:
            while (status := told.get()) is not None:
                yield status
            call.wait(lib.OK, error)
        finally:
            going[0] = False
            if not call._over.is_set():
                call.cancel()

    def wait(self, job: str) -> JobStatus:
        """Waits until a job is over and returns its last status."""
        last = None
        for last in self.watch(job):
            pass
        assert last is not None
        return last

    def jobs(self, limit: int = 100) -> list[JobStatus]:
        """The caller's jobs, newest first."""
        out, number, call, error = ffi.new("struct umb_job_status **"), ffi.new("size_t *"), _Call(self.client()), \
            lib.new_error()
        call.wait(rpc.umb_client_list_jobs(self.client(), count(limit, "limit"), out, number, call.handle, error),
                  error)
        try:
            return [job_status(one) for one in out[0][0:number[0]]]
        finally:
            core.umb_free(out[0])

    def cancel(self, job: str) -> None:
        """Cancels a job that is not over."""
        call, error = _Call(self.client()), lib.new_error()
        call.wait(rpc.umb_client_cancel_job(self.client(), lib.path_bytes(job, "job"), ffi.NULL, call.handle, error),
                  error)

    def fetch(self, asset_id: str, path: Any, progress: Optional[Callable[[int, int], Any]] = None) -> None:
        """Writes an asset's packed file to a path, whole or not at all."""
        folder, name = os.path.split(os.path.abspath(path))
        part = os.path.join(folder, f".{name}.{os.getpid()}.{threading.get_ident()}.part")
        problems: list[Any] = []
        with open(part, "xb") as file:
            def got(_user: Any, offset: int, data: Any, number: int, size: int) -> int:
                file.seek(offset)
                file.write(ffi.buffer(data, number))
                if progress is not None:
                    progress(offset + number, size)
                return int(lib.OK)

            callback = ffi.callback("enum umb_status(void *, uint64_t, const void *, size_t, uint64_t)", got,
                                    error=core.UMB_E_IO, onerror=lambda k, problem, t: problems.append(problem))
            try:
                call, error = _Call(self.client()), lib.new_error()
                try:
                    call.wait(rpc.umb_client_fetch(self.client(), lib.asset_id(asset_id, "asset_id"), 0, callback,
                                                   ffi.NULL, call.handle, error), error)
                except Exception:
                    if problems:
                        raise problems[0]
                    raise
                file.flush()
                os.fsync(file.fileno())
                os.replace(part, os.path.join(folder, name))
            except BaseException:
                os.unlink(part)
                raise

    def delete(self, asset_id: str) -> None:
        """Deletes the caller's share in an asset; with the last owner the daemon deletes the file."""
        call, error = _Call(self.client()), lib.new_error()
        call.wait(rpc.umb_client_delete_asset(self.client(), lib.asset_id(asset_id, "asset_id"), call.handle, error),
                  error)


def connect(address: str, **options: Any) -> Daemon:
    """
    A daemon: "tcp:host:port", "tls:host:port" or "unix:path"; several with commas are replicas.

    options: token, token_file; ca_file, certificate_file, key_file, server_name (tls:); timeout in seconds.
    Nothing is sent before the first call.
    """
    return Daemon(address, **options)


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

    def _client(self) -> Any:
        if self._closed:
            raise ValueError("the asset is closed")
        return self._daemon.client()

    def _describe(self) -> AssetInfo:
        out, call, error = ffi.new("struct umb_client_description **"), _Call(self._client()), lib.new_error()
        call.wait(rpc.umb_client_describe(self._client(), self._name, out, call.handle, error), error)
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

    def _answer(self, settings: Any, dial: Dial, points: Any, batch: Any, values: Any, stats: bool,
                threads: int) -> Optional[Result]:
        request, error, over = ffi.new("struct umb_client_query_request *"), lib.new_error(), threading.Event()
        wanted, c_dial_ = c_settings(Settings(*settings)), c_dial(dial)
        told: dict[str, Any] = {}
        if dial != Dial() and wanted.taps == 1:
            wanted.taps = 0
        request.asset, request.settings, request.dial, request.points = self._name, wanted[0], c_dial_[0], batch[0]
        request.want_stats = 1 if stats else 0
        target = ffi.from_buffer(values) if values.size else ffi.new("char[1]")

        def done(_user: Any, status: int, reply: Any, problem: Any) -> None:
            if status == lib.OK:
                ffi.memmove(target, reply.values, reply.value_bytes)
                told["reply"] = ffi.new("struct umb_client_query_reply *", reply[0])
            else:
                told["error"] = (status, text(problem.message), problem.system_error)
            over.set()

        callback, call, client = ffi.callback("umb_client_query_fn", done), ffi.new("uint64_t *"), self._client()
        check(rpc.umb_client_query_start(client, request, callback, ffi.NULL, call, error), error)
        try:
            over.wait()
        except BaseException:
            check(rpc.umb_client_cancel(client, call[0], error), error)
            over.wait()
            raise
        if "error" in told:
            status, said, number = told["error"]
            raise_status(text(core.umb_status_name(status)), said, number)
        reply = told["reply"]
        if not stats:
            return None
        return whole_result(values, points.shape[:-1], bound_m=reply.bound_m, stats=stats_of(reply.stats),
                            taps=reply.taps, level=reply.level, nanoseconds=reply.nanoseconds,
                            asset_id=lib.id_text(reply.asset_id))

    def _ask(self, function: Any, light: int, batch: Any, answers: Any, *more: Any) -> None:
        wanted, call, error = ffi.new("struct umb_volume_query *"), _Call(self._client()), lib.new_error()
        wanted.asset, wanted.light = self._name, light
        call.wait(function(self._client(), wanted, batch, *more, answers, ffi.NULL, call.handle, error), error)

    def _segments(self, light: int, ends: Any, number: int, origin: Any, lit: Any, most: int, parts: Any) -> None:
        batch, answers = ffi.new("struct umb_segments *"), ffi.new("struct umb_segment_answers *")
        data, intervals = ffi.from_buffer(ends), ffi.from_buffer(parts)
        batch.ends, batch.count = data, number
        batch.format = core.UMB_POINT_F64 if ends.dtype == DOUBLE else core.UMB_POINT_F32
        if origin is not None:
            batch.origin = triple(origin, "origin")
        answers.segments = lit
        if most:
            answers.intervals, answers.interval_max = ffi.cast("struct umb_interval *", intervals), most
        self._ask(rpc.umb_client_segments, light, batch, answers)

    def _columns(self, light: int, batch: Any, number: int, found: Any) -> None:
        answers = ffi.new("struct umb_column_answers *")
        answers.columns = found
        self._ask(rpc.umb_client_columns, light, batch, answers)

    def _boxes(self, light: int, boxes: Any, found: Any) -> None:
        answers = ffi.new("struct umb_box_answers *")
        data = ffi.from_buffer("struct umb_box[]", boxes) if len(boxes) else ffi.new("struct umb_box[]", 1)
        answers.boxes = found
        self._ask(rpc.umb_client_boxes, light, data, answers, len(boxes))


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


