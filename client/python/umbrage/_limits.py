# SPDX-License-Identifier: Apache-2.0
"""
Limits of a daemon for one call, and batches cut into calls that keep them.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Iterator

from . import _library as lib
from ._library import check, core, ffi, rpc
from .errors import LimitError

HEAD_BYTES = 512         # of a request beside its records: the asset's name and settings
SEGMENT_INTERVALS = 64   # intervals that a segment counts as, at least
BIT_RECORDS = 8          # answers in a byte


@dataclass(frozen=True)
class Limits:
    """Records that a daemon takes in one call, and bytes of a request (struct umb_client_limits)."""

    points: int
    message_bytes: int
    segments: int
    columns: int
    boxes: int

    def _records(self, most: int, record_bytes: int) -> int:
        return max(min(most, max(self.message_bytes - HEAD_BYTES, 0) // record_bytes), 1)

    def points_a_call(self, batch: Any) -> int:
        """Points like those of a struct umb_points in one call."""
        return self._records(self.points, _point_bytes(batch.format) + 12 * (batch.normals != ffi.NULL) +
                             4 * (batch.footprints != ffi.NULL))

    def columns_a_call(self, batch: Any) -> int:
        """Columns of points like those of a struct umb_points in one call."""
        return self._records(self.columns, _point_bytes(batch.format))

    def segments_a_call(self, format_: int, intervals: int) -> int:
        """Segments in one call, each with room for some intervals."""
        most = self.segments if intervals <= SEGMENT_INTERVALS else self.points // intervals
        return self._records(most, 2 * _point_bytes(format_))

    def boxes_a_call(self) -> int:
        """Boxes in one call."""
        return self._records(self.boxes, 48)


def _point_bytes(format_: int) -> int:
    return 24 if format_ == core.UMB_POINT_F64 else 12


def read_limits(client: Any) -> Limits:
    """Asks a daemon for its limits; blocks. A limit of 0 is none."""
    out, error = ffi.new("struct umb_client_limits *"), lib.new_error()
    check(rpc.umb_client_get_limits(client.pointer, out, error), error)
    return Limits(out.max_points or 2**63, out.max_message_bytes or 2**63, out.max_segments, out.max_columns, out.max_boxes)


def calls(number: int, most: int, bits: bool = False) -> Iterator[tuple[int, int]]:
    """
    First record and number of records of each call, which takes `most` at most. An empty batch is one call, so that its
    settings are checked. With `bits` each call but the last fills whole bytes of answers.
    """
    if bits and number > most:
        most -= most % BIT_RECORDS
        if most == 0:
            raise LimitError(f"points: {number}; the server takes fewer than {BIT_RECORDS} in a call, which \"bit\" needs: "
                             "use another format", "E_TOO_LARGE")
    for first in range(0, max(number, 1), most):
        yield first, min(most, number - first)
