# SPDX-License-Identifier: Apache-2.0
"""
Exceptions, one class for each group of statuses of umbrage/status.h. `str(error)` is the sentence of the C library:
the field, the value and the limit. `error.status` is the status by its name, as "E_CORRUPT".
"""


class Error(Exception):
    """Any failure that the C library reports."""

    def __init__(self, sentence: str, status: str = "E_INTERNAL", system_error: int = 0):
        super().__init__(sentence)
        self.status = status
        self.system_error = system_error  # errno of the failing system call, or 0


class ArgumentError(Error, ValueError):
    """An argument is invalid."""


class NotFoundError(Error, LookupError):
    """An asset, light or job does not exist."""


class UnsupportedError(Error):
    """The asset, the light or the server does not support the request."""


class LimitError(Error):
    """A limit was reached: of size, memory or a quota."""


class RightsError(Error, PermissionError):
    """The file's permissions or the token do not allow the call."""


class FileError(Error, OSError):
    """A file cannot be read or written."""


class FormatError(Error):
    """Bytes are not what they should be: damaged, cut short, or of another version."""


class SceneError(Error):
    """A scene cannot be baked."""


class BusyError(Error):
    """The server is too busy; try again later."""


class UnavailableError(Error, ConnectionError):
    """The server cannot be reached, or the connection was lost."""


class DeadlineError(Error, TimeoutError):
    """A call met its deadline."""


class CancelledError(Error):
    """A call was cancelled."""


_CLASSES = {
    "E_ARGUMENT": ArgumentError, "E_NOT_FOUND": NotFoundError, "E_TOO_LARGE": LimitError,
    "E_UNSUPPORTED": UnsupportedError, "E_PERMISSION": RightsError, "E_UNAUTHENTICATED": RightsError,
    "E_FORMAT": FormatError, "E_VERSION": FormatError, "E_TRUNCATED": FormatError, "E_CORRUPT": FormatError,
    "E_BAD_SCENE": SceneError, "E_BUSY": BusyError, "E_IO": FileError, "E_NO_INPUT": FileError,
    "E_CANNOT_CREATE": FileError, "E_LIMIT": LimitError, "E_UNAVAILABLE": UnavailableError,
    "E_DEADLINE": DeadlineError, "E_CANCELLED": CancelledError, "E_PROTOCOL": UnavailableError,
}


def raise_status(status: str, sentence: str, system_error: int = 0) -> None:
    """Raises the exception of a status. E_NO_MEMORY becomes MemoryError, a missing file FileNotFoundError too."""
    if status == "E_NO_MEMORY":
        raise MemoryError(sentence)
    raise _CLASSES.get(status, Error)(sentence, status, system_error)
