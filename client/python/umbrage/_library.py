# SPDX-License-Identifier: Apache-2.0
"""
The C libraries, by cffi's tables of their public headers (_declarations.py, made by the build).

A wheel carries the libraries in the folder `lib` beside this file, and umbrage-bake in `bin`; else the system's linker
finds the libraries, and PATH the program.
"""
from __future__ import annotations

import os
import weakref
from typing import Any, Callable, Union

from ._declarations import ffi as _ffi
from .errors import raise_status

ffi: Any = _ffi
OWN = os.path.dirname(os.path.abspath(__file__))
Path = Union[str, bytes, "os.PathLike[str]", "os.PathLike[bytes]"]


def _load(name: str) -> Any:
    own = os.path.join(OWN, "lib", name)
    # Never unloaded: objects that Python frees last, at its end, still call functions of it.
    return ffi.dlopen(own if os.path.exists(own) else name, ffi.RTLD_NOW | ffi.RTLD_NODELETE)


core = _load("libumbrage-core.so.1")
rpc = _load("libumbrage.so.1")
maps = _load("libumbrage-maps.so.1")

OK = core.UMB_OK


class Handle:
    """
    A C object that many threads use. Each call holds the handle; `close` runs when the last call
    lets go of it. So neither an interrupt at any moment nor a close during a call frees anything
    that is in use. When Python exits, nothing is freed.
    """

    def __init__(self, pointer: Any, close: Callable[..., Any], *more: Any) -> None:
        self.pointer = pointer
        weakref.finalize(self, close, pointer, *more).atexit = False


def new_error() -> Any:
    """A struct umb_error for one call."""
    return ffi.new("struct umb_error *")


def check(status: Any, error: Any) -> None:
    """Raises the exception of a status that is not UMB_OK."""
    if status != OK:
        sentence = text(error.message) or text(core.umb_status_text(status))
        raise_status(text(core.umb_status_name(status)), sentence, error.system_error)


def text(chars: Any) -> str:
    """A C string as str; bytes that are not UTF-8 become replacement characters."""
    return str(ffi.string(chars).decode("utf-8", "replace")) if chars != ffi.NULL else ""


def version() -> str:
    """Version of the loaded library as "1.2.3"."""
    number = core.umb_version()
    return f"{number // 10000}.{number // 100 % 100}.{number % 100}"


def path_bytes(path: Any, name: str = "path") -> bytes:
    """A path for C. Raises TypeError, and ValueError for a NUL inside."""
    try:
        encoded = os.fsencode(path)
    except TypeError:
        raise TypeError(f"{name}: must be a str, bytes or path, not {type(path).__name__}") from None
    if b"\0" in encoded:
        raise ValueError(f"{name}: has a NUL character")
    return encoded


def path_text(path: Any, name: str = "path") -> str:
    """A path as str. Raises as path_bytes."""
    return os.fsdecode(path_bytes(path, name))


def asset_id(value: Any, name: str = "id") -> Any:
    """uint8[32] of an id in hexadecimal. Raises TypeError or ValueError."""
    if not isinstance(value, str):
        raise TypeError(f"{name}: must be a str of 64 hexadecimal digits, not {type(value).__name__}")
    out = ffi.new("uint8_t[]", 32)
    if len(value) != 64 or core.umb_id_from_text(value.encode("ascii", "replace"), out) != OK:
        raise ValueError(f"{name}: {value[:80]!r} is not 64 hexadecimal digits")
    return out


def id_text(raw: Any) -> str:
    """An id as 64 hexadecimal digits."""
    return bytes(raw).hex()
