# SPDX-License-Identifier: Apache-2.0
"""
Opens assets of all kinds: of files, web servers and daemons.
"""
from __future__ import annotations

from typing import Optional

from ._library import Path
from .assets import Asset
from .daemon import open_daemon_asset
from .file_asset import FileAsset
from .range_asset import open_ranges, open_url

DAEMONS = ("tcp:", "tls:", "unix:")
SITES = ("http://", "https://")


def open(where: Path, *, partial: bool = False, id: Optional[str] = None, memory: int = 0,
         headers: Optional[dict[str, str]] = None, token: Optional[str] = None, token_file: Optional[Path] = None,
         ca_file: Optional[Path] = None, certificate_file: Optional[Path] = None, key_file: Optional[Path] = None,
         server_name: Optional[str] = None, timeout: Optional[float] = None) -> Asset:
    """
    Opens an asset.

    where    a file ("city.umb"): queried in process, a FileAsset
             an address ("https://.../city.umb"): a RangeAsset, which reads the pages that views need
             a daemon ("tcp:host:port/city", "tls:...", "unix:path/city"): a DaemonAsset, whose queries it answers
    partial  True: of a file too, only the pages that views need are read (a RangeAsset)
    id       id that a RangeAsset must have; without it the server chooses the asset
    memory   most bytes that the asset may take; 0: 64 GiB for a file, 1 GiB for a RangeAsset
    headers  HTTP headers, such as Authorization
    token, token_file, ca_file, certificate_file, key_file, server_name, timeout   of a daemon: as `connect` takes them

    Raises TypeError or ValueError that names the argument, FileError, FormatError, LimitError, NotFoundError,
    RightsError, UnavailableError.
    """
    name = where if isinstance(where, str) else ""
    is_daemon, is_site = name.startswith(DAEMONS), name.startswith(SITES)
    of_daemon = {key: value for key, value in (
        ("token", token), ("token_file", token_file), ("ca_file", ca_file), ("certificate_file", certificate_file),
        ("key_file", key_file), ("server_name", server_name), ("timeout", timeout)) if value is not None}
    for given, argument, fits in ((of_daemon, next(iter(of_daemon), ""), is_daemon), (headers, "headers", is_site),
                                  (id, "id", is_site or partial), (memory, "memory", not is_daemon),
                                  (partial, "partial", not is_daemon)):
        if given and not fits:
            raise TypeError(f"{argument}: does not belong to {name[:80] or 'a file'!r}")
    if is_daemon:
        return open_daemon_asset(name, **of_daemon)
    if is_site:
        return open_url(name, headers, asset_id=id, memory=memory)
    if partial:
        return open_ranges(where, asset_id=id, memory=memory)
    return FileAsset(where, memory)
