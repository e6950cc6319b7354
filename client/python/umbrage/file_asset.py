# SPDX-License-Identifier: Apache-2.0
"""
An asset of a file, queried in process.
"""
from __future__ import annotations

import threading
import time
from typing import Any, Optional, Sequence

import numpy as np

from . import _library as lib
from ._arrays import DOUBLE, FLOAT, c_points, slice_of, triple
from ._library import Handle, check, core, ffi
from ._settings import Dial, Settings, c_dial, c_settings, count
from ._slices import LONG_SLICE, SLICE, run_slices
from .assets import NO_DIAL, Asset, Result, stats_of, whole_result
from .info import read_info
from .maps import Camera, Derived, derive
from .views import Triple

ANSWERS = ffi.typeof("struct umb_answers *")
KEPT = 64             # prepared queries
SAMPLE = 200_000      # points of a batch on which a budget is measured, at most
SLICED = 4096         # items of a volume query between two looks at Ctrl-C


def plain(value: Any) -> Any:
    """A C struct, array or number as dict, list or number."""
    if not isinstance(value, ffi.CData):
        return value
    kind = ffi.typeof(value)
    if kind.kind == "array":
        return [plain(value[i]) for i in range(kind.length)]
    return {name: plain(getattr(value, name)) for name, _ in kind.fields if name != "reserved"}


class FileAsset(Asset):
    """An asset of a file, queried in process. `umbrage.open` makes it."""

    def __init__(self, path: Any, memory: int = 0) -> None:
        options, out, error = ffi.new("struct umb_open_options *"), ffi.new("struct umb_asset **"), lib.new_error()
        options.max_memory_bytes = count(memory, "memory", 2**64 - 1)
        check(core.umb_asset_open_file(lib.path_bytes(path), options, out, error), error)
        self._handle: Optional[Handle] = Handle(out[0], core.umb_asset_close)
        self._prepared: dict[Any, Any] = {}
        self.info = read_info(out[0])

    def close(self) -> None:
        self._handle, self._prepared = None, {}

    def _require_open(self) -> Handle:
        """The asset, which stays open as long as the handle is held. Raises ValueError if it is closed."""
        handle = self._handle
        if handle is None:
            raise ValueError("the asset is closed")
        return handle

    def _query_of(self, held: Handle, settings: Any) -> Any:
        """The prepared query of settings, kept for the next batch."""
        try:
            query = self._prepared.get(settings)
        except TypeError:  # an array of one number, or a wrong type, which c_settings names
            query, settings = None, self._hashable(settings)
        if query is None:
            query, error, kept = ffi.new("struct umb_query *"), lib.new_error(), self._prepared
            check(core.umb_query_prepare(held.pointer, c_settings(Settings(*settings)), query, error), error)
            for old in list(kept)[:max(len(kept) - KEPT + 1, 0)]:
                kept.pop(old, None)
            kept[settings] = query
        return query

    @staticmethod
    def _hashable(settings: Any) -> Any:
        c_settings(Settings(*settings))
        return tuple(one.item() if isinstance(one, np.ndarray) else tuple(one) if isinstance(one, list) else one
                     for one in settings)

    def _choose(self, held: Handle, settings: Any, dial: Dial, batch: Any) -> tuple[Any, ...]:
        """Settings with the taps and level that the dial chooses."""
        wanted, error, calibration = c_settings(Settings(*settings)), lib.new_error(), ffi.NULL
        wanted_dial = c_dial(dial)
        if dial.budget_ns:
            calibration, sample = ffi.new("struct umb_calibration *"), slice_of(batch, 0, min(batch.count, SAMPLE))
            _check_points(sample)
            _calibrate(held, wanted.light, sample, calibration, error)
        check(core.umb_dial_choose(held.pointer, wanted_dial, calibration, wanted, ffi.NULL, error), error)
        return Settings(*settings)._replace(taps=wanted.taps, level=wanted.level)

    def _answer(self, settings: Any, dial: Dial, shape: tuple[int, ...], batch: Any, keep: Any, values: Any,
                stats: bool, threads: int) -> Optional[Result]:
        held = self._handle or self._require_open()
        if dial is not NO_DIAL:
            settings = self._choose(held, settings, dial, batch)
        try:
            query = self._prepared[settings]
        except (KeyError, TypeError):
            query = self._query_of(held, settings)
        total = _run(query, batch, (held, keep), values, threads)
        if not stats:
            return None
        return whole_result(values, shape, stats=stats_of(total), taps=core.umb_query_taps(query),
                            bound_m=core.umb_query_bound_m(held.pointer, c_settings(Settings(*settings))),
                            level=settings[7], nanoseconds=0, asset_id=self.info.id)

    def explain(self, point: Triple, normal: Optional[Triple] = None, **settings: Any) -> dict[str, Any]:
        place = np.array(triple(point, "point"), DOUBLE)
        direction = None if normal is None else np.array(triple(normal, "normal"), FLOAT)
        told = ffi.new("struct umb_explanation *")
        held = self._require_open()
        batch, _keep = c_points(place, None, direction, None)
        unknown = next((name for name in settings if name not in Settings._fields), None)
        if unknown is not None:
            raise TypeError(f"{unknown}: explain takes {', '.join(Settings._fields)}")
        numbers, is_one = self._light_numbers(settings.get("light", 0))
        if not is_one:
            raise ValueError("light: explain takes one light")
        settings["light"] = numbers[0]
        core.umb_query_explain(self._query_of(held, tuple(Settings(**settings))), batch, 0, told)
        words: dict[str, Any] = plain(told[0])
        words["steps"] = words["steps"][:words.pop("step_count")]
        return words

    def derive(self, width: int, height: int, *, technique: str = "pcf", format: str = "f32", light: int = 0,
               rect: Optional[Sequence[float]] = None, mips: bool = False, camera: Optional[Camera] = None,
               cascades: int = 0, weight: float = 0.5) -> Derived:
        held = self._require_open()
        return derive(held.pointer, width, height, technique, format, light, rect, mips, camera, cascades, weight)

    @staticmethod
    def _volume(held: Handle, light: int) -> Any:
        volume, error = ffi.new("struct umb_volume *"), lib.new_error()
        check(core.umb_volume_prepare(held.pointer, light, volume, error), error)
        return volume

    def _segments(self, light: int, ends: Any, number: int, origin: Any, lit: Any, most: int, parts: Any) -> None:
        held = self._require_open()
        volume, error = self._volume(held, light), lib.new_error()
        batch, answers = ffi.new("struct umb_segments *"), ffi.new("struct umb_segment_answers *")
        data, intervals = ffi.from_buffer(ends), ffi.from_buffer(parts)
        batch.ends, batch.count = data, number
        batch.format = core.UMB_POINT_F64 if ends.dtype == DOUBLE else core.UMB_POINT_F32
        if origin is not None:
            batch.origin = triple(origin, "origin")
        check(core.umb_segments_check(batch, error), error)
        answers.segments = lit
        if most:
            answers.intervals, answers.interval_max = ffi.cast("struct umb_interval *", intervals), most
        run_slices(lambda first, n: core.umb_volume_segments(volume, batch, first, n, answers), number, size=SLICED)

    def _columns(self, light: int, batch: Any, number: int, found: Any) -> None:
        held = self._require_open()
        volume, error = self._volume(held, light), lib.new_error()
        check(core.umb_volume_check_columns(volume, error), error)
        check(core.umb_points_check(batch, error), error)
        answers = ffi.new("struct umb_column_answers *")
        answers.columns = found
        run_slices(lambda first, n: core.umb_volume_columns(volume, batch, first, n, answers), number, size=SLICED)

    def _boxes(self, light: int, boxes: Any, found: Any) -> None:
        held = self._require_open()
        volume, error = self._volume(held, light), lib.new_error()
        data = ffi.from_buffer("struct umb_box[]", boxes) if len(boxes) else ffi.new("struct umb_box[]", 1)
        check(core.umb_volume_check_parallel(volume, error), error)
        check(core.umb_boxes_check(data, len(boxes), error), error)
        answers = ffi.new("struct umb_box_answers *")
        answers.boxes = found

        def one(first: int, n: int) -> None:
            check(core.umb_volume_boxes(volume, data, first, n, ffi.NULL, answers, error), error)

        run_slices(one, len(boxes), size=1)


def _calibrate(held: Handle, light: int, sample: Any, calibration: Any, error: Any) -> None:
    """Measures settings on a sample. Raises what its clock meets, as Ctrl-C, when the measurement has ended."""
    problems: list[Any] = []

    def went_wrong(_kind: Any, problem: Any, _trace: Any) -> float:
        problems.append(problem)
        return time.thread_time()

    # CPU time of the calling thread: other programs do not lengthen it.
    clock = ffi.callback("double(void)", time.thread_time, onerror=went_wrong)
    status = core.umb_calibrate_points(held.pointer, light, sample, clock, calibration, error)
    if problems:
        raise problems[0]
    check(status, error)


def _check_points(batch: Any) -> None:
    """Raises ArgumentError that names the first bad point."""
    if core.umb_points_check(batch, ffi.NULL) != lib.OK:
        error = lib.new_error()
        check(core.umb_points_check(batch, error), error)


def _run(query: Any, batch: Any, keep: Any, values: Any, threads: int) -> Any:
    """
    Checks and answers a batch slice by slice; threads that are at work hold `keep`. Returns a struct umb_query_stats.
    """
    number = batch.count
    data = ffi.from_buffer(values) if values.size else ffi.new("char[1]")
    if number <= SLICE:
        _check_points(batch)
        answers = ffi.new(ANSWERS)
        answers.values = data
        core.umb_query_run(query, batch, 0, number, answers)
        return answers.stats
    total, lock = ffi.new("struct umb_query_stats *"), threading.Lock()

    def one(first: int, n: int, _keep: Any = keep) -> None:
        if core.umb_points_check(slice_of(batch, first, n), ffi.NULL) != lib.OK:
            _check_points(batch)  # all of them, for the number of the bad one
        answers = ffi.new(ANSWERS)
        answers.values = data
        core.umb_query_run(query, batch, first, n, answers)
        with lock:
            core.umb_query_stats_add(total, ffi.addressof(answers, "stats"))

    run_slices(one, number, threads, longest=LONG_SLICE)
    return total[0]
