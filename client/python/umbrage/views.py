# SPDX-License-Identifier: Apache-2.0
"""
Views: which points a program will ask about; what of an asset is held for them.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Sequence

from ._arrays import number, triple
from ._settings import count

Triple = Sequence[float]


@dataclass(frozen=True)
class View:
    """
    The points that later queries ask about, and how exactly (struct umb_partial_view).

    light      number of the light; None: all lights
    box        ((x, y, z), (x, y, z)), metres, world space: only points in this box
    eye, forward, up, fov_y, aspect, far_m   only points that this camera sees; radians, metres; far_m 0: no limit
    max_error_m, max_error_rad   size of cells that need no finer pages: an edge in metres, an angle at the eye
    taps       widest filter of the queries
    """

    light: Optional[int] = None
    box: Optional[Sequence[Triple]] = None
    eye: Optional[Triple] = None
    forward: Triple = (0.0, 1.0, 0.0)
    up: Triple = (0.0, 0.0, 1.0)
    fov_y: float = 1.0
    aspect: float = 1.0
    far_m: float = 0.0
    max_error_m: float = 0.0
    max_error_rad: float = 0.0
    taps: int = 17

    def _fill(self, out: Any) -> None:
        """Fills in a struct umb_partial_view."""
        out.light = 0xFFFFFFFF if self.light is None else count(self.light, "light")
        out.taps = count(self.taps, "taps")
        out.max_error_m, out.max_error_rad = number(self.max_error_m, "max_error_m"), number(self.max_error_rad,
                                                                                            "max_error_rad")
        if self.box is not None:
            if not hasattr(self.box, "__len__") or len(self.box) != 2:
                raise ValueError("box: must be two corners")
            out.has_box, out.box.min, out.box.max = 1, triple(self.box[0], "box[0]"), triple(self.box[1], "box[1]")
        if self.eye is not None:
            out.has_camera, camera = 1, out.camera
            camera.eye, camera.forward = triple(self.eye, "eye"), triple(self.forward, "forward")
            camera.up, camera.far_m = triple(self.up, "up"), number(self.far_m, "far_m")
            camera.fov_y, camera.aspect = number(self.fov_y, "fov_y"), number(self.aspect, "aspect")


def check_fetch(views: Sequence[Any], progress: Any) -> None:
    """Checks the arguments of Asset.fetch. Raises TypeError."""
    for view in views:
        if not isinstance(view, View):
            raise TypeError(f"views: must be View, not {type(view).__name__}")
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: must be callable, not {type(progress).__name__}")


@dataclass(frozen=True)
class Held:
    """
    What of an asset is here, and what it cost to read.

    pages, pages_held        pages of the asset, and those that are here
    asset_bytes, held_bytes  bytes of the packed file, and of the pages that are here
    memory_bytes             memory that they take
    received_bytes, requests, rounds   bytes read, ranges asked for, and times that `fetch` waited for them
    """

    pages: int
    pages_held: int
    asset_bytes: int
    held_bytes: int
    memory_bytes: int
    received_bytes: int
    requests: int
    rounds: int
