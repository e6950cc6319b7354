# SPDX-License-Identifier: Apache-2.0
"""
Shadow maps for GPUs, derived from an asset (umbrage/derive.h).
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _library as lib
from ._arrays import number, triple
from ._library import check, ffi
from ._library import maps as library
from ._settings import choose, count
from .views import Triple

TECHNIQUES = {"pcf": library.UMB_MAP_PCF, "vsm": library.UMB_MAP_VSM, "esm": library.UMB_MAP_ESM,
              "evsm": library.UMB_MAP_EVSM, "msm": library.UMB_MAP_MSM}
FORMATS = {"f32": (library.UMB_MAP_F32, "float32"), "f16": (library.UMB_MAP_F16, "float16"),
           "u16": (library.UMB_MAP_U16, "uint16")}


@dataclass(frozen=True)
class Derived:
    """
    Maps derived from an asset: one, or one for each cascade.

    levels         levels[map][mip]: array[height, width, channels] in the format
    world_to_map   float64[maps, 4, 4]: (x, y, depth, w) = M (world - origin, 1)
    origin         metres, world space
    splits         distances in metres between the cascades; empty without cascades
    texel_error_m  depth is right to this many metres for the ray through the texel's column
    ktx2           the maps as a KTX 2.0 file
    """

    levels: list[list[npt.NDArray[Any]]]
    world_to_map: npt.NDArray[np.float64]
    origin: npt.NDArray[np.float64]
    splits: list[float]
    texel_error_m: float
    ktx2: bytes


def _levels(one: Any, dtype: str) -> list[npt.NDArray[Any]]:
    levels: list[npt.NDArray[Any]] = []
    out = ffi.new("struct umb_map_level *")
    while library.umb_map_get_level(one, len(levels), out) == lib.OK:
        data = np.frombuffer(ffi.buffer(out.texels, out.bytes), dtype).copy()
        levels.append(data.reshape(out.height, out.width, out.channels))
        if out.width == 1 and out.height == 1:
            break
    return levels


def derive(asset: Any, width: int, height: int, technique: str, format: str, light: int, rect: Any, mips: bool,
           camera: Any, cascades: int, weight: float) -> Derived:
    """See FileAsset.derive."""
    settings, keep = ffi.new("struct umb_derive_settings *"), []
    settings.light, settings.width, settings.height = count(light, "light"), count(width, "width"), count(height,
                                                                                                          "height")
    settings.map.technique = choose(TECHNIQUES, technique, "technique")
    settings.map.format, dtype = choose(FORMATS, format, "format")
    settings.map.access = library.UMB_MAP_MIPS if mips else library.UMB_MAP_BASE
    if rect is not None:
        if not hasattr(rect, "__len__") or isinstance(rect, (str, bytes)) or len(rect) != 4:
            raise ValueError("rect: must be x0, y0, x1, y1")
        settings.rect = [number(one, "rect") for one in rect]
    if camera is not None and not isinstance(camera, Camera):
        raise TypeError(f"camera: must be a Camera, not {type(camera).__name__}")
    if camera is not None and not cascades:
        raise ValueError("cascades: 0, must be 1 or more with a camera")
    if cascades:
        if camera is None:
            raise ValueError("camera: cascades need one")
        keep.append(ffi.new("struct umb_camera *", camera._as_c()))
        settings.camera = keep[0]
        settings.cascades.count, settings.cascades.weight = count(cascades, "cascades"), number(weight, "weight")
    out, error, problems = ffi.new("struct umb_derived **"), lib.new_error(), []
    hear = ffi.callback("int(void *)", lambda _user: 0, error=1, onerror=lambda _k, problem, _t: problems.append(problem))
    settings.cancelled = hear  # called for each row of a map: where Ctrl-C is heard
    status = library.umb_derive(asset, settings, ffi.NULL, out, error)
    if problems:
        raise problems[0]
    check(status, error)
    derived = out[0]
    try:
        data, size = ffi.new("const uint8_t **"), ffi.new("size_t *")
        check(library.umb_derived_ktx2(derived, data, size, error), error)
        found, frusta = range(derived.count), derived.frusta
        return Derived([_levels(derived.maps[i], dtype) for i in found],
                       np.array([[list(row) for row in frusta[i].world_to_map] for i in found]),
                       np.array(list(frusta[0].origin)), list(derived.splits)[:derived.count + 1] if cascades else [],
                       derived.texel_error_m, bytes(ffi.buffer(data[0], size[0])))
    finally:
        library.umb_derived_destroy(derived)


@dataclass(frozen=True)
class Camera:
    """
    A camera (struct umb_camera).

    eye          its place, metres, world space
    forward, up  directions, world space, any length
    fov_y        vertical field of view, radians
    aspect       width over height
    near_m, far_m   distances of the planes, metres
    """

    eye: Triple
    forward: Triple
    up: Triple = (0.0, 0.0, 1.0)
    fov_y: float = 1.0
    aspect: float = 1.0
    near_m: float = 0.1
    far_m: float = 1000.0

    def _as_c(self) -> dict[str, Any]:
        """The fields as cffi takes them."""
        return {"eye": triple(self.eye, "eye"), "forward": triple(self.forward, "forward"),
                "up": triple(self.up, "up"), "fov_y": number(self.fov_y, "fov_y"),
                "aspect": number(self.aspect, "aspect"), "near_m": number(self.near_m, "near_m"),
                "far_m": number(self.far_m, "far_m")}


