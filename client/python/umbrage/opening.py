# SPDX-License-Identifier: Apache-2.0
"""
Opens assets of all kinds: of files, web servers and daemons.
"""
from __future__ import annotations

import os
from typing import Any, Optional, Union

from .assets import Asset
from .daemon import open_daemon_asset
from .file_asset import FileAsset
from .range_asset import open_ranges, open_url

DAEMONS = ("tcp:", "tls:", "unix:")
SITES = ("http://", "https://")


def open(where: Union[str, "os.PathLike[str]"], *, partial: bool = False, id: Optional[str] = None, memory: int = 0,
         headers: Optional[dict[str, str]] = None, **options: Any) -> Asset:
    """
    Opens an asset.

    where    a file ("city.umb"): queried in process, a FileAsset
             an address ("https://.../city.umb"): a RangeAsset, which reads the pages that views need
             a daemon ("tcp:host:port/city", "tls:...", "unix:path/city"): a DaemonAsset, whose queries it answers
    partial  True: of a file too, only the pages that views need are read (a RangeAsset)
    id       id that a RangeAsset must have; without it the server chooses the asset
    memory   most bytes that the asset may take; 0: 64 GiB for a file, 1 GiB for a RangeAsset
    headers  HTTP headers, such as Authorization
    options  of a daemon: see connect

    Raises FileError, FormatError, NotFoundError, UnavailableError.
    """
    name = where if isinstance(where, str) else ""
    is_daemon, is_site = name.startswith(DAEMONS), name.startswith(SITES)
    for given, argument, fits in ((options, next(iter(options), ""), is_daemon), (headers, "headers", is_site),
                                  (id, "id", is_site or partial), (memory, "memory", not is_daemon),
                                  (partial, "partial", not is_daemon)):
        if given and not fits:
            raise TypeError(f"{argument}: does not belong to {name[:80] or 'a file'!r}")
    if is_daemon:
        return open_daemon_asset(name, **options)
    if is_site:
        return open_url(name, headers, asset_id=id, memory=memory)
    if partial:
        return open_ranges(where, asset_id=id, memory=memory)
    return FileAsset(where, memory)
