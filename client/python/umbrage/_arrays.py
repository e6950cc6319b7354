# SPDX-License-Identifier: Apache-2.0
"""
Arrays of callers as C arrays, without a copy. Every check names the argument.
"""
from __future__ import annotations

import math
from typing import Any, Optional

import numpy as np

from ._library import core, ffi

FLOAT = np.dtype("float32")
DOUBLE = np.dtype("float64")
POINTS = ffi.typeof("struct umb_points *")
FORMATS = {FLOAT: core.UMB_POINT_F32, DOUBLE: core.UMB_POINT_F64}


def as_array(value: Any, name: str, last: Optional[int], dtypes: Any = (FLOAT, DOUBLE)) -> Any:
    """
    `value` itself if it is an array of floats of one of the dtypes, contiguous, with a last axis of `last` (None: no
    such axis); a list of numbers as float64 (or the only dtype). Raises TypeError or ValueError.
    """
    if value.__class__ is np.ndarray and value.dtype in dtypes:
        pass
    elif not isinstance(value, np.ndarray):
        try:
            found = np.asarray(value)
        except (TypeError, ValueError):
            found = np.empty(0, object)
        if found.dtype.kind not in "biuf":
            raise TypeError(f"{name}: must be an array or list of numbers, not {type(value).__name__}")
        value = np.array(found, dtypes[-1], order="C")
    elif isinstance(value, np.ma.MaskedArray):
        raise TypeError(f"{name}: a masked array: use {name}.compressed() or {name}.filled()")
    elif value.dtype not in dtypes:
        wanted = " or ".join(str(dtype) for dtype in dtypes)
        raise TypeError(f"{name}: dtype {value.dtype}, must be {wanted}: use {name}.astype({dtypes[-1]})")
    if last is not None and (value.ndim == 0 or value.shape[-1] != last):
        raise ValueError(f"{name}: shape {value.shape}, must be (..., {last})")
    if not value.flags.c_contiguous:
        raise ValueError(f"{name}: not contiguous: use numpy.ascontiguousarray({name})")
    return value


def like(value: Any, name: str, shape: tuple[int, ...], last: Optional[int] = None) -> Any:
    """A float32 array of the points' shape (with a last axis of `last`), as as_array gives it."""
    value = as_array(value, name, last, (FLOAT,))
    wanted = shape if last is None else (*shape, last)
    if value.shape != wanted:
        raise ValueError(f"{name}: shape {value.shape}, must be {wanted} as the points say")
    return value


def number(value: Any, name: str) -> float:
    """A float. Raises TypeError, and ValueError for a number beyond those of a float."""
    try:
        if not isinstance(value, (str, bytes)):
            return float(value)
    except (TypeError, ValueError):
        pass
    except OverflowError:
        raise ValueError(f"{name}: an int beyond the largest float") from None
    raise TypeError(f"{name}: must be a number, not {type(value).__name__}")


def triple(value: Any, name: str) -> tuple[float, float, float]:
    """Three finite numbers as a tuple."""
    try:
        numbers = tuple(value)
    except TypeError:
        numbers = ()
    if len(numbers) != 3 or isinstance(value, (str, bytes)):
        raise TypeError(f"{name}: must be three numbers")
    x, y, z = (number(one, name) for one in numbers)
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        raise ValueError(f"{name}: ({x}, {y}, {z}), must be finite")
    return x, y, z


def writable(value: Any, name: str, shape: tuple[int, ...], dtype: Any) -> Any:
    """Checks an array for results, and returns it."""
    if not isinstance(value, np.ndarray):
        raise TypeError(f"{name}: must be an array, not {type(value).__name__}")
    if value.dtype != dtype:
        raise TypeError(f"{name}: dtype {value.dtype}, must be {dtype}")
    if value.shape != shape:
        raise ValueError(f"{name}: shape {value.shape}, must be {shape}")
    if not value.flags.c_contiguous or not value.flags.aligned:
        raise ValueError(f"{name}: not contiguous, or not at an address that its dtype needs")
    if not value.flags.writeable:
        raise ValueError(f"{name}: read-only")
    return value


def slice_of(batch: Any, first: int, count: int) -> Any:
    """A struct umb_points of points first .. first + count - 1 of a batch."""
    part = ffi.new("struct umb_points *", batch[0])
    part.count = count
    part.positions = ffi.cast("char *", batch.positions) + first * (24 if batch.format == core.UMB_POINT_F64 else 12)
    if batch.normals != ffi.NULL:
        part.normals = ffi.cast("float *", batch.normals) + 3 * first
    if batch.footprints != ffi.NULL:
        part.footprints = ffi.cast("float *", batch.footprints) + first
    return part


def c_points(points: Any, origin: Any, normals: Any, footprints: Any) -> tuple[Any, list[Any]]:
    """
    Returns a struct umb_points of checked arrays, and the buffers that must stay alive as long as
    the struct is used.
    """
    out, positions = ffi.new(POINTS), ffi.from_buffer(points)
    keep = [positions]
    out.positions = positions
    if points.dtype is not FLOAT and points.dtype == DOUBLE:
        out.format = core.UMB_POINT_F64
    out.count = points.size // 3
    if origin is not None:
        out.origin = triple(origin, "origin")
    if normals is not None:
        keep.append(ffi.from_buffer(like(normals, "normals", points.shape[:-1], 3)))
        out.normals = keep[-1]
    if footprints is not None:
        keep.append(ffi.from_buffer(like(footprints, "footprints", points.shape[:-1])))
        out.footprints = keep[-1]
    return out, keep
