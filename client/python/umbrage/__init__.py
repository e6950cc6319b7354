# SPDX-License-Identifier: Apache-2.0
"""
umbrage: how much of a light reaches these points?

    import umbrage
    with umbrage.open("city.umb") as asset:             # or an https:// address, or "tcp:host:port/city"
        lit = asset.query(points, normals, taps=9)      # float32, 0 shadowed to 1 lit, in the shape of the points

Arrays go in and come out without a copy, and other Python threads run meanwhile.

    open(where)        an Asset: of a file, of a web server, or of a daemon
    Asset              query answers points; segments, columns, boxes; derive makes maps; fetch reads what a View needs
    connect(address)   a Daemon: its assets; jobs that bake: submit, watch, fetch
    bake(scene, output)  runs umbrage-bake
    Error              base of all exceptions but the TypeError or ValueError of a wrong argument

help(umbrage.Asset.query) and so on say shapes, units and errors; docs/guide/python.md has examples.
"""
from pkgutil import extend_path

from ._library import version
from .assets import Asset, Boxes, Columns, Result, Segments, Stats
from .bakes import Progress, bake
from .daemon import Daemon, DaemonAsset, JobStatus, Listed, connect
from .errors import (ArgumentError, BusyError, CancelledError, DeadlineError, Error, FileError, FormatError, LimitError,
                     NotFoundError, RightsError, SceneError, UnavailableError, UnsupportedError)
from .file_asset import FileAsset
from .info import AssetInfo, CurveRow, Light
from .maps import Camera, Derived
from .opening import open
from .range_asset import RangeAsset
from .views import Held, View

__path__ = extend_path(__path__, __name__)  # message classes that protoc makes are umbrage.v1
__version__ = version()
__all__ = [
    "open", "connect", "bake", "Asset", "FileAsset", "RangeAsset", "DaemonAsset", "Daemon", "Result", "Stats",
    "Segments", "Columns", "Boxes", "View", "Held", "Camera", "Derived", "Progress", "JobStatus", "Listed", "AssetInfo",
    "Light", "CurveRow", "Error", "ArgumentError", "BusyError", "CancelledError", "DeadlineError", "FileError",
    "FormatError", "LimitError", "NotFoundError", "RightsError", "SceneError", "UnavailableError", "UnsupportedError",
]
