# SPDX-License-Identifier: Apache-2.0
"""
Assets and answers: what is common to assets of files, of ranges and of daemons.
"""
from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Any, Callable, Iterable, Literal, Optional, Sequence, Union, overload

import numpy as np
import numpy.typing as npt

from ._arrays import DOUBLE, FLOAT, as_array, c_points, triple, writable
from ._library import ffi
from ._settings import FORMATS, Dial, choose, count
from .errors import ArgumentError, NotFoundError, UnsupportedError
from .info import AssetInfo, Light
from .maps import Camera, Derived
from .views import Held, Triple, View, check_fetch

BYTE = np.dtype("uint8")
THREADS_MAX = 1024
NO_DIAL = Dial()
Numbers = Union[npt.NDArray[np.float32], npt.NDArray[np.float64], Sequence[Any]]
LightChoice = Union[int, str, Sequence[Union[int, str]]]


@dataclass(frozen=True)
class Stats:
    """
    Counts of a query (struct umb_query_stats).

    points          points that were answered
    outside         points beside the light's frustum: lit
    before, behind  points before its first voxel: lit; behind its last: answered as that voxel
    facing_away     points that their normal shadows
    undefined       points too far from every surface of an asset baked under the static rule: answers mean nothing
    nodes, bricks   parts of the DAG that were read; they depend on how a batch is split
    """

    points: int = 0
    outside: int = 0
    before: int = 0
    behind: int = 0
    facing_away: int = 0
    undefined: int = 0
    nodes: int = 0
    bricks: int = 0


@dataclass(frozen=True)
class Result:
    """
    Answers with what is known about them. Arrays have the shape of the answers.

    values       share of light, 0 shadowed to 1 lit, in the format that was asked for
    bound_m      an answer is true, or a true shadow boundary is at most this far from the point, metres; 0: no bound
                 is stated (penumbras, footprints)
    exact        bool: True where the answer is that of the whole asset. Always, but for assets of which only some
                 pages are held
    low, high    float32: bounds of the whole asset's answer; equal to values where exact
    error_m      float32: edge in metres of the missing cubes; 0 where exact
    stats        counts of the run
    taps, level  what answered, also if a dial chose it
    nanoseconds  CPU time of the server; 0 in process
    asset_id     id of the asset that answered
    """

    values: npt.NDArray[Any]
    bound_m: float
    exact: npt.NDArray[np.bool_]
    low: npt.NDArray[Any]
    high: npt.NDArray[Any]
    error_m: npt.NDArray[np.float32]
    stats: Stats
    taps: int
    level: int
    nanoseconds: int
    asset_id: str


@dataclass(frozen=True)
class Segments:
    """
    Answers of n segments.

    lit              float64[n]: share of each segment that is lit, 0 to 1
    lit_m            float64[n]: length of the lit parts, metres
    interval_counts  int64[n]: number of lit intervals
    intervals        float64[n, most, 2]: begin and end of the first intervals, as parameters 0 to 1 along the
                     segment; NaN behind the last
    """

    lit: npt.NDArray[np.float64]
    lit_m: npt.NDArray[np.float64]
    interval_counts: npt.NDArray[np.int64]
    intervals: npt.NDArray[np.float64]


@dataclass(frozen=True)
class Columns:
    """
    First occluders of the columns of voxels in which n points lie.

    lit         uint32[n]: number of voxels before the first shadowed one
    outside     bool[n]: True if the column is beyond the frustum
    distance_m  float64[n]: metres along the light from the point to depth `lit`; negative if the occluder lies
                between light and point, infinite without an occluder
    """

    lit: npt.NDArray[np.uint32]
    outside: npt.NDArray[np.bool_]
    distance_m: npt.NDArray[np.float64]


@dataclass(frozen=True)
class Boxes:
    """Counts of n boxes: uint64[n] of lit voxels, and of all voxels in box and frustum."""

    lit: npt.NDArray[np.uint64]
    voxels: npt.NDArray[np.uint64]


def stats_of(c_stats: Any) -> Stats:
    """Stats of a struct umb_query_stats."""
    return Stats(*(getattr(c_stats, name) for name in Stats.__dataclass_fields__))


def stats_sum(parts: Iterable[Stats]) -> Stats:
    """Counts of several runs together."""
    return Stats(*(sum(column) for column in zip(*(astuple(part) for part in parts))))


def whole_result(values: npt.NDArray[Any], shape: tuple[int, ...], **known: Any) -> Result:
    """A Result of a whole asset: every answer is exact."""
    return Result(values=values, low=values, high=values, exact=np.ones(shape, bool), error_m=np.zeros(shape, FLOAT),
                  **known)


class Asset:
    """
    The shadows of one scene. `umbrage.open` makes it; use it in a `with` statement, or call `close`.

    Threads: any number of threads may query an asset at once. Calls that are under way when it is closed end as if it
    were open.
    """

    info: AssetInfo

    def _require_open(self) -> Any:
        """What calls need of the asset. Raises ValueError if it is closed."""
        raise NotImplementedError

    def __enter__(self) -> "Asset":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Frees the asset. Later calls raise ValueError. Closing twice does nothing."""
        raise NotImplementedError

    @property
    def id(self) -> str:
        """SHA-256 of the content, 64 hexadecimal digits."""
        return self.info.id

    @property
    def lights(self) -> tuple[Light, ...]:
        """The lights, in the order of their numbers."""
        return self.info.lights

    # What `stats` and `light` make of the answer. One light is listed before several: a name is a sequence too.
    @overload
    def query(self, points: Numbers, normals: Optional[Numbers] = ..., *, taps: Optional[int] = ...,
              light: LightChoice = ..., filter: str = ..., bias: Union[str, float] = ..., bias_unit: str = ...,
              format: str = ..., origin: Optional[Triple] = ..., footprints: Optional[Numbers] = ...,
              footprint_m: float = ..., level: int = ..., light_extent: float = ..., opaque_only: bool = ...,
              eye: Optional[Triple] = ..., pixel_rad: float = ..., max_error: float = ..., max_visibility: float = ...,
              budget: float = ..., stats: Literal[False] = ..., threads: int = ...,
              out: Optional[npt.NDArray[Any]] = ...) -> npt.NDArray[Any]: ...

    @overload
    def query(self, points: Numbers, normals: Optional[Numbers] = ..., *, taps: Optional[int] = ...,  # type: ignore
              light: Literal["all"], filter: str = ..., bias: Union[str, float] = ..., bias_unit: str = ...,
              format: str = ..., origin: Optional[Triple] = ..., footprints: Optional[Numbers] = ...,
              footprint_m: float = ..., level: int = ..., light_extent: float = ..., opaque_only: bool = ...,
              eye: Optional[Triple] = ..., pixel_rad: float = ..., max_error: float = ..., max_visibility: float = ...,
              budget: float = ..., stats: Literal[True], threads: int = ...,
              out: Optional[npt.NDArray[Any]] = ...) -> list[Result]: ...

    @overload
    def query(self, points: Numbers, normals: Optional[Numbers] = ..., *, taps: Optional[int] = ...,  # type: ignore
              light: Union[int, str] = ..., filter: str = ..., bias: Union[str, float] = ..., bias_unit: str = ...,
              format: str = ..., origin: Optional[Triple] = ..., footprints: Optional[Numbers] = ...,
              footprint_m: float = ..., level: int = ..., light_extent: float = ..., opaque_only: bool = ...,
              eye: Optional[Triple] = ..., pixel_rad: float = ..., max_error: float = ..., max_visibility: float = ...,
              budget: float = ..., stats: Literal[True], threads: int = ...,
              out: Optional[npt.NDArray[Any]] = ...) -> Result: ...

    @overload
    def query(self, points: Numbers, normals: Optional[Numbers] = ..., *, taps: Optional[int] = ...,
              light: Sequence[Union[int, str]], filter: str = ..., bias: Union[str, float] = ..., bias_unit: str = ...,
              format: str = ..., origin: Optional[Triple] = ..., footprints: Optional[Numbers] = ...,
              footprint_m: float = ..., level: int = ..., light_extent: float = ..., opaque_only: bool = ...,
              eye: Optional[Triple] = ..., pixel_rad: float = ..., max_error: float = ..., max_visibility: float = ...,
              budget: float = ..., stats: Literal[True], threads: int = ...,
              out: Optional[npt.NDArray[Any]] = ...) -> list[Result]: ...

    @overload
    def query(self, points: Numbers, normals: Optional[Numbers] = ..., *, taps: Optional[int] = ...,
              light: LightChoice = ..., filter: str = ..., bias: Union[str, float] = ..., bias_unit: str = ...,
              format: str = ..., origin: Optional[Triple] = ..., footprints: Optional[Numbers] = ...,
              footprint_m: float = ..., level: int = ..., light_extent: float = ..., opaque_only: bool = ...,
              eye: Optional[Triple] = ..., pixel_rad: float = ..., max_error: float = ..., max_visibility: float = ...,
              budget: float = ..., stats: bool, threads: int = ...,
              out: Optional[npt.NDArray[Any]] = ...) -> Any: ...

    def query(self, points: Numbers, normals: Optional[Numbers] = None, *, taps: Optional[int] = None, light: LightChoice = 0,
              filter: str = "box", bias: Union[str, float] = "auto", bias_unit: str = "metres", format: str = "f32",
              origin: Optional[Triple] = None, footprints: Optional[Numbers] = None, footprint_m: float = 0.0,
              level: int = 0, light_extent: float = 0.0, opaque_only: bool = False, eye: Optional[Triple] = None,
              pixel_rad: float = 0.0, max_error: float = 0.0, max_visibility: float = 0.0, budget: float = 0.0,
              stats: bool = False, threads: int = 1, out: Optional[npt.NDArray[Any]] = None) -> Any:
        """
        Answers how much of a light reaches each point: 0 shadowed, 1 lit.

        points        float32 or float64[..., 3], metres, world space; contiguous; not copied
        normals       float32[..., 3], world space, any length: exact bias, and receivers that face away are shadowed;
                      a normal that is zero or not finite counts as none
        taps          width of the filter in texels, odd, 1 to 17; None: 1, or the choice of max_error and its like
        light         number or name of a light; a list of them or "all" puts an axis of lights first
        filter        "box", "tent", "gaussian", "penumbra" or "footprint"
        bias          "auto", "none", or a length in bias_unit ("metres" or "voxels")
        format        "f32": float32; "u8": 0 to 255; "bit": uint8, bit i % 8 of byte i / 8 belongs to point i
        origin        metres, added to every point: keep national coordinates here and float32 offsets in `points`
        footprints    float32[...], metres: side of each point's square, for the filter "footprint"
        footprint_m   metres: that side for all points; box and tent: width of the window instead of taps
        level         0: voxels; else odd, from 3: cells of 2^level voxels a side, faster, answers 0, 0.5 or 1
        light_extent  radians: the sun's angular diameter for the filter "penumbra"; 0: the asset's
        opaque_only   True: casters that let light through are ignored
        eye, pixel_rad   eye in metres and angle of a pixel in radians, for "footprint" instead of footprint_m
        max_error, max_visibility, budget   choose taps and level instead: largest bound in metres, largest error of
                      visibility, nanoseconds a point (umbrage/curve.h)
        stats         True: returns a Result with bounds, marks and counts, not the array alone
        threads       number of threads to share the batch, in process
        out           array for the answers, of their shape and dtype

        Returns an array in the shape of the points ("bit": of bytes), or a Result; for several lights, with `stats`, a
        list of Results. Answers are the same bits for every batch size and number of threads, in process or over a
        daemon.

        Raises TypeError or ValueError that names the argument, and umbrage.Error. Ctrl-C ends a long batch within
        milliseconds (a daemon: the call is left to its deadline).
        """
        given: Any = as_array(points, "points", 3)
        if threads.__class__ is not int or threads != 1:
            count(threads, "threads", THREADS_MAX, 1)
        if taps.__class__ is not int:
            taps = 0 if taps is None else count(taps, "taps")
        if level.__class__ is not int:
            level = count(level, "level")
        if format.__class__ is not str:
            choose(FORMATS, format, "format")
        if isinstance(out, np.ndarray):
            for array in (given, normals, footprints):
                if isinstance(array, np.ndarray) and np.may_share_memory(out, array):
                    raise ValueError("out: shares memory with points, normals or footprints")
        if light.__class__ is not int:
            numbers, is_one = self._light_numbers(light)
            if not is_one:
                return self._query_lights(numbers, given, dict(
                    normals=normals, taps=taps, filter=filter, bias=bias, bias_unit=bias_unit, format=format,
                    origin=origin, footprints=footprints, footprint_m=footprint_m, level=level,
                    light_extent=light_extent, opaque_only=opaque_only, eye=eye, pixel_rad=pixel_rad,
                    max_error=max_error, max_visibility=max_visibility, budget=budget, stats=stats, threads=threads),
                    out)
            light = numbers[0]
        settings = (light, taps, filter, bias, bias_unit, format, footprint_m, level, light_extent, opaque_only,
                    eye if eye is None else triple(eye, "eye"), pixel_rad)
        try:
            has_dial = bool(max_error or max_visibility or budget)
        except ValueError:  # an array
            has_dial = True
        dial = Dial(max_error, max_visibility, budget) if has_dial else NO_DIAL
        batch, keep = c_points(given, origin, normals, footprints)
        shape = given.shape[:-1]
        if format == "f32":
            values = np.empty(shape, FLOAT) if out is None else writable(out, "out", shape, FLOAT)
        else:
            length = ((given.size // 3 + 7) // 8,) if format == "bit" else shape
            values = np.empty(length, BYTE) if out is None else writable(out, "out", length, BYTE)
        result = self._answer(settings, dial, shape, batch, keep, values, stats, threads)
        return result if stats else values

    def _query_lights(self, numbers: list[int], points: Any, rest: dict[str, Any], out: Any) -> Any:
        format, count_ = rest["format"], points.size // 3
        shape = ((count_ + 7) // 8,) if format == "bit" else points.shape[:-1]
        dtype: Any = FLOAT if format == "f32" else BYTE
        values = np.empty((len(numbers), *shape), dtype) if out is None else writable(out, "out", (len(numbers), *shape),
                                                                                     dtype)
        results = [self.query(points, light=number, out=values[i, ...], **rest) for i, number in enumerate(numbers)]
        return results if rest["stats"] else values

    def _light_numbers(self, light: Any) -> tuple[list[int], bool]:
        """Numbers of the lights of an argument, and whether it names one light."""
        if isinstance(light, str):
            if light == "all":
                return list(range(len(self.lights))), False
            numbers = [number for number, known in enumerate(self.lights) if known.name == light]
            if not numbers:
                raise NotFoundError(f"light: no light is named {light[:80]!r}", "E_NOT_FOUND")
            return numbers[:1], True
        if isinstance(light, (list, tuple)) or isinstance(light, np.ndarray) and light.ndim:
            return [number for one in light for number in self._light_numbers(one)[0]], False
        return [count(light, "light")], True

    def _answer(self, settings: tuple[Any, ...], dial: Dial, shape: tuple[int, ...], batch: Any, keep: Any,
                values: Any, stats: bool, threads: int) -> Optional[Result]:
        """Answers a batch, whose memory `keep` holds, into `values`; a Result if `stats`."""
        raise NotImplementedError

    def segments(self, ends: Numbers, *, light: int = 0, intervals: int = 0,
                 origin: Optional[Triple] = None) -> Segments:
        """
        Finds the lit intervals of segments.

        ends       float32 or float64[..., 2, 3] (or [..., 6]): both ends, metres, world space; contiguous
        light      number of the light
        intervals  number of intervals to return of each segment
        origin     metres, added to every end

        Exact for the stored voxels; no filter, no bias. Spot, point and directional lights.
        Raises TypeError or ValueError that names the argument, NotFoundError for a light, UnsupportedError for assets
        baked under the static rule.
        """
        array = as_array(ends, "ends", None)
        if array.shape[-2:] != (2, 3) and array.shape[-1:] != (6,):
            raise ValueError(f"ends: shape {array.shape}, must be (n, 2, 3)")
        number = array.size // 6
        most = count(intervals, "intervals", 1 << 20)
        lit = ffi.new("struct umb_segment_answer[]", max(number, 1))
        parts = np.full((number, most, 2), np.nan)
        try:
            self._segments(count(light, "light"), array, number, origin, lit, most, parts)
        except ArgumentError as problem:  # C numbers the records of the argument
            told = str(problem)
            raise ArgumentError(f"ends: {told}" if told.startswith("segments[") else told, problem.status) from None
        raw = np.frombuffer(ffi.buffer(lit), np.dtype([("lit", "f8"), ("lit_m", "f8"), ("n", "u8")]))[:number]
        return Segments(raw["lit"].copy(), raw["lit_m"].copy(), raw["n"].astype(np.int64), parts)

    def _segments(self, light: int, ends: Any, number: int, origin: Any, lit: Any, most: int, parts: Any) -> None:
        raise NotImplementedError

    def columns(self, points: Numbers, *, light: int = 0, origin: Optional[Triple] = None) -> Columns:
        """
        Finds the first occluder on the light's way to each point's column of voxels.

        points  float32 or float64[..., 3], metres, world space; contiguous
        light   number of the light
        origin  metres, added to every point

        Raises TypeError or ValueError that names the argument, NotFoundError for a light, UnsupportedError for assets
        baked under the closed rule without the effect `front`.
        """
        array = as_array(points, "points", 3)
        number = array.size // 3
        batch, keep = c_points(array, origin, None, None)
        found = ffi.new("struct umb_column_answer[]", max(number, 1))
        self._columns(count(light, "light"), batch, number, found)
        del keep
        raw = np.frombuffer(ffi.buffer(found), np.dtype([("lit", "u4"), ("outside", "u4"), ("m", "f8")]))[:number]
        return Columns(raw["lit"].copy(), raw["outside"] != 0, raw["m"].copy())

    def _columns(self, light: int, batch: Any, number: int, found: Any) -> None:
        raise NotImplementedError

    def boxes(self, boxes: Numbers, *, light: int = 0) -> Boxes:
        """
        Counts the lit voxels of boxes.

        boxes  float64[n, 2, 3]: lowest and highest corner, metres, world space; contiguous
        light  number of the light

        A voxel is in a box if its centre is. Raises TypeError or ValueError that names the argument, NotFoundError for
        a light, UnsupportedError for spot and point lights.
        """
        array = as_array(boxes, "boxes", 3, (DOUBLE,))
        if array.ndim != 3 or array.shape[1] != 2:
            raise ValueError(f"boxes: shape {array.shape}, must be (n, 2, 3)")
        found = ffi.new("struct umb_box_answer[]", max(len(array), 1))
        self._boxes(count(light, "light"), array, found)
        raw = np.frombuffer(ffi.buffer(found), np.uint64).reshape(-1, 2)[:len(array)]
        return Boxes(raw[:, 0].copy(), raw[:, 1].copy())

    def _boxes(self, light: int, boxes: Any, found: Any) -> None:
        raise NotImplementedError

    def derive(self, width: int, height: int, *, technique: str = "pcf", format: str = "f32", light: int = 0,
               rect: Optional[Sequence[float]] = None, mips: bool = False, camera: Optional[Camera] = None,
               cascades: int = 0, weight: float = 0.5) -> Derived:
        """
        Derives shadow maps for a GPU from an asset of a file alone.

        width, height  texels of each map; powers of two with mips
        technique      "pcf" (depth), "vsm", "esm", "evsm" or "msm"
        format         "f32", "f16" or "u16"
        light          number of the light
        mips           True: with the chain of smaller maps; "pcf" has none
        rect           x0, y0, x1, y1 in voxels of the light's frustum; None: all of it
        camera, cascades   that many maps, one for each slice of the camera's view
        weight         where slices end: 0 equal lengths, 1 equal ratios (umbrage/cascades.h)

        Ctrl-C ends it between two rows. Raises TypeError or ValueError that names the argument, NotFoundError for a
        light, LimitError for maps that are too large, UnsupportedError for spot and point lights, for assets baked
        under the closed rule without the effect `front`, and for assets of ranges and daemons.
        """
        raise UnsupportedError("derive needs an asset of a file", "E_UNSUPPORTED")

    def explain(self, point: Triple, normal: Optional[Triple] = None, **settings: Any) -> dict[str, Any]:
        """
        How the answer of one point comes about, step by step: the fields of struct umb_explanation as a dict.

        point, normal  three numbers, metres, world space; the normal of any length
        settings  keywords of `query` that set how it answers: light, taps, filter, bias ...

        Raises TypeError or ValueError that names the argument, UnsupportedError for assets of ranges and daemons.
        """
        raise UnsupportedError("explain needs an asset of a file", "E_UNSUPPORTED")

    def fetch(self, *views: View, max_bytes: int = 0, progress: Optional[Callable[[Held], Any]] = None) -> Held:
        """
        Reads the missing pages that the views need; without a view, the missing pages that earlier
        queries needed. An asset of a file or a daemon is whole: nothing is read.

        max_bytes  bytes to read before it stops; 0: no limit
        progress   called with what is held after each round; a true result stops

        Raises TypeError or ValueError that names the argument, FormatError for bytes that are not the asset's,
        LimitError for more memory than `open` allows, FileError, UnavailableError.
        """
        check_fetch(views, progress)
        count(max_bytes, "max_bytes", 2**64 - 1)
        return self.held()

    def held(self) -> Held:
        """What of the asset is here."""
        self._require_open()
        size = self.info.packed_bytes or self.info.memory_bytes
        return Held(1, 1, size, size, self.info.memory_bytes, 0, 0, 0)
