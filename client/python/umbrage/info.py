# SPDX-License-Identifier: Apache-2.0
"""
What an asset says of itself, as plain data.
"""
from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from . import _library as lib
from ._library import core, ffi, text

KINDS = {core.UMB_LIGHT_DIRECTIONAL: "directional", core.UMB_LIGHT_SPOT: "spot", core.UMB_LIGHT_POINT: "point",
         core.UMB_LIGHT_RECTANGLE: "rectangle", core.UMB_LIGHT_DISC: "disc"}


@dataclass(frozen=True)
class CurveRow:
    """
    One setting of a light's accuracy curve (umbrage/curve.h).

    level, taps       as `query` takes them
    bound_m           an answer is true, or a true shadow edge is within this many metres
    visibility_error  root mean square difference of the answer, 0 to 1, when a point moves by up to half a voxel
    nodes, lines      DAG nodes and cache lines that a point reads, on average
    """

    level: int
    taps: int
    bound_m: float
    visibility_error: float
    nodes: float
    lines: float


@dataclass(frozen=True)
class Light:
    """
    One light. World space, metres, radians.

    name        as `light=` takes it; "" without a name
    kind        "directional", "spot", "point", "rectangle", "disc"
    direction   unit vector in which the light travels (point light: zeros)
    position    (not directional; of area lights the middle)
    extent      angular diameter in radians (directional), diameter in metres, or the side of a rectangle across
                `side`; 0: none
    side        vector of a rectangle's first side, metres; zeros for others
    resolution  voxels a side of its frusta
    voxel_m     edges of a voxel along x, y, z of its first frustum
    closed      True if baked under the closed rule
    curve       accuracy curve; empty if the asset has none
    """

    name: str
    kind: str
    direction: tuple[float, float, float]
    position: tuple[float, float, float]
    extent: float
    side: tuple[float, float, float]
    resolution: int
    voxel_m: tuple[float, float, float]
    closed: bool
    curve: tuple[CurveRow, ...]


@dataclass(frozen=True)
class AssetInfo:
    """
    An asset's description.

    id, scene_hash  SHA-256 of content and scene, 64 hexadecimal digits
    lights          the lights, in the order of their numbers
    origin          scene origin, metres, world space
    bounds          ((x, y, z), (x, y, z)): box around the casters, metres, world space
    plan, settings  texts of the bake: one line an effect; key=value lines
    memory_bytes    bytes that queries read
    packed_bytes    length of the packed file; 0 for a mapped one
    """

    id: str
    lights: tuple[Light, ...]
    origin: tuple[float, float, float]
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]]
    scene_hash: str
    plan: str
    settings: str
    memory_bytes: int
    packed_bytes: int

    def as_dict(self) -> dict[str, Any]:
        """The description as dicts, lists and numbers, ready for json.dump."""
        return asdict(self)


def three(numbers: Any) -> tuple[float, float, float]:
    """A C array double[3] as a tuple."""
    return numbers[0], numbers[1], numbers[2]


def curve_row(row: Any) -> CurveRow:
    """A CurveRow of a struct umb_curve_row."""
    return CurveRow(*(getattr(row, name) for name in CurveRow.__dataclass_fields__))


def light_of(info: Any, resolution: int, voxel_m: Any, closed: Any, curve: tuple[CurveRow, ...]) -> Light:
    """A Light of a struct umb_light_info and what stands elsewhere."""
    return Light(text(info.name), KINDS.get(info.kind, "unknown"), three(info.direction), three(info.position),
                 info.extent, three(info.side), resolution, three(voxel_m), bool(closed), curve)


def _read_light(asset: Any, number: int) -> Light:
    info, frustum, edges = ffi.new("struct umb_light_info *"), ffi.new("struct umb_frustum_info *"), ffi.new("double[3]")
    rows, count = ffi.new("struct umb_curve_row[]", core.UMB_CURVE_ROWS_MAX), ffi.new("size_t *")
    if core.umb_asset_get_light(asset, number, info) != lib.OK:
        raise AssertionError(number)
    resolution, closed = 0, False
    if core.umb_asset_get_frustum(asset, info.first_frustum, frustum) == lib.OK:
        core.umb_frustum_voxel_edges(frustum, edges)
        resolution, closed = 1 << frustum.log2_size, frustum.closed
    core.umb_asset_get_curve(asset, number, rows, count)
    return light_of(info, resolution, edges, closed, tuple(curve_row(rows[i]) for i in range(count[0])))


def read_info(asset: Any) -> AssetInfo:
    """The AssetInfo of an open struct umb_asset."""
    info = ffi.new("struct umb_asset_info *")
    core.umb_asset_get_info(asset, info)
    return AssetInfo(lib.id_text(info.id), tuple(_read_light(asset, i) for i in range(info.light_count)),
                     three(info.origin), (three(info.bounds.min), three(info.bounds.max)), lib.id_text(info.scene_hash),
                     text(info.plan), text(info.settings), info.memory_bytes, info.packed_bytes)
