# SPDX-License-Identifier: Apache-2.0
"""
Keyword arguments of queries as struct umb_query_settings.
"""
from __future__ import annotations

import operator
from typing import Any, NamedTuple

from ._arrays import number, triple
from ._library import core, ffi, text

FILTERS = {text(core.umb_filter_name(i)): i for i in range(core.UMB_FILTERS)}
BIAS_MODES = {"auto": core.UMB_BIAS_AUTO, "none": core.UMB_BIAS_NONE}
BIAS_UNITS = {"voxels": core.UMB_BIAS_VOXELS, "metres": core.UMB_BIAS_METRES}
FORMATS = {"f32": core.UMB_ANSWER_F32, "u8": core.UMB_ANSWER_U8, "bit": core.UMB_ANSWER_BIT}


class Settings(NamedTuple):
    """Keyword arguments of Asset.query that make struct umb_query_settings, in their order there."""

    light: int = 0
    taps: int = 0
    filter: str = "box"
    bias: Any = "auto"
    bias_unit: str = "metres"
    format: str = "f32"
    footprint_m: float = 0.0
    level: int = 0
    light_extent: float = 0.0
    opaque_only: bool = False
    eye: Any = None
    pixel_rad: float = 0.0


class Dial(NamedTuple):
    """Requirements by which taps and level are chosen (struct umb_dial); 0 requires nothing."""

    max_error_m: float = 0.0
    max_visibility: float = 0.0
    budget_ns: float = 0.0


def choose(table: dict[str, Any], value: Any, name: str) -> Any:
    """The number of a word. Raises ValueError that lists the words."""
    try:
        return table[value]
    except (KeyError, TypeError):
        raise ValueError(f"{name}: {value!r}, must be one of {', '.join(table)}") from None


def count(value: Any, name: str, most: int = 0xFFFFFFFF, least: int = 0) -> int:
    """A whole number from `least` to `most`. Raises TypeError or ValueError."""
    try:
        whole = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: must be a whole number, not {type(value).__name__}") from None
    if not least <= whole <= most:
        raise ValueError(f"{name}: {whole}, must be {least} to {most}")
    return whole


def c_settings(settings: Settings) -> Any:
    """A struct umb_query_settings. C checks the ranges; here words become numbers."""
    out = ffi.new("struct umb_query_settings *")
    out.light = count(settings.light, "light")
    out.taps = count(settings.taps, "taps")
    if isinstance(settings.bias, str):
        out.bias_mode = choose(BIAS_MODES, settings.bias, "bias")
    else:
        out.bias_mode = choose(BIAS_UNITS, settings.bias_unit, "bias_unit")
        out.bias = number(settings.bias, "bias")
    out.format = choose(FORMATS, settings.format, "format")
    out.filter = choose(FILTERS, settings.filter, "filter")
    out.footprint_m = number(settings.footprint_m, "footprint_m")
    out.level = count(settings.level, "level")
    out.light_extent = number(settings.light_extent, "light_extent")
    out.opaque_only = 1 if settings.opaque_only else 0
    if settings.eye is not None:
        out.eye = triple(settings.eye, "eye")
    out.pixel_rad = number(settings.pixel_rad, "pixel_rad")
    return out


def c_dial(dial: Dial) -> Any:
    """A struct umb_dial."""
    out = ffi.new("struct umb_dial *")
    out.max_error_m = number(dial.max_error_m, "max_error")
    out.max_visibility = number(dial.max_visibility, "max_visibility")
    out.budget_ns = number(dial.budget_ns, "budget")
    return out
