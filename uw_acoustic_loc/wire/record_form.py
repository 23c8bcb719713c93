"""Records to CDR and back without a message object: all that stands around their rows is known beforehand."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from .flat import LENGTH, LITTLE_ENDIAN, SECOND, STAMP, Make, aligned_string, checked_stamp
from .record import RECORD, Layout, fields, layout, record_from, record_to, row_types, rows_of, value_of


@dataclass(frozen=True)
class RecordForm:
    """A record's PointCloud2, as a message object and in CDR; a `single` one has one row and becomes numbers."""

    name: str
    kind: type
    single: bool = False
    folder: Path | None = None  # of its layout file, None = the package's own

    @property
    def msgtype(self) -> str:
        return RECORD

    @cached_property
    def _plan(self) -> Layout:
        return layout(self.name, self.folder)

    def encode(self, make: Make, value: Any) -> Any:
        """Builds the message of a core value."""
        return record_to(make, self._plan, value)

    def decode(self, msg: Any, _received_ns: int = 0) -> Any:
        """Returns the core value of a message."""
        return record_from(self._plan, self.kind, msg, self.single)

    def pack(self, value: Any) -> bytes:
        """Returns the CDR bytes of a core value."""
        rows = rows_of(self._plan, value)
        begin = STAMP.pack(LITTLE_ENDIAN, *divmod(value.t_ns, SECOND)) + _begin(value.frame_id)
        sizes = _SIZES.pack(rows.nbytes, rows.nbytes)
        return b"".join((begin, LENGTH.pack(len(rows)), _middle(rows.dtype), sizes, rows.tobytes(), _DENSE))

    def unpack(self, data: bytes) -> Any:
        """Reads CDR bytes; returns None when their layout is not that of `pack`: a general decoder must read them."""
        try:
            found = self._unpacked(data)
        except (struct.error, UnicodeDecodeError):
            return None
        if found is None:
            return None
        t_ns, frame_id, rows = found
        return value_of(self._plan, self.kind, t_ns, frame_id, rows, self.single)

    def _unpacked(self, data: bytes) -> tuple[int, str, Any] | None:
        """Returns stamp in ns, frame and structured rows."""
        encapsulation, sec, nanosec = STAMP.unpack_from(data)
        (length,) = LENGTH.unpack_from(data, STAMP.size)
        at = STAMP.size + LENGTH.size
        frame_id = data[at : at + length - 1].decode()
        begin = _begin(frame_id)
        at = STAMP.size + len(begin)
        if encapsulation != LITTLE_ENDIAN or not data.startswith(begin, STAMP.size):
            return None
        (count,), at = LENGTH.unpack_from(data, at), at + LENGTH.size
        for row in row_types(self._plan):
            if data.startswith(_middle(row), at):
                rows = _rows(data, at + len(_middle(row)), count, row)
                return None if rows is None else (checked_stamp(sec, nanosec), frame_id, rows)
        return None


def _rows(data: bytes, at: int, count: int, row: np.dtype[Any]) -> Any:
    """Returns the structured rows (count,) behind the two sizes; None when the sizes do not fit."""
    size = count * row.itemsize
    if _SIZES.unpack_from(data, at) != (size, size) or len(data) != at + _SIZES.size + size + len(_DENSE):
        return None
    return np.frombuffer(data, row, count, at + _SIZES.size)


@lru_cache(maxsize=256)
def _begin(frame_id: str) -> bytes:
    """Returns the CDR bytes from the frame to the height."""
    return aligned_string(frame_id) + LENGTH.pack(1)


@lru_cache(maxsize=64)
def _middle(row: np.dtype[Any]) -> bytes:
    """From the fields to the size of a row; begins at a multiple of 4."""
    described = fields(row)
    parts = [LENGTH.pack(len(described))]
    for field in described:
        parts += [aligned_string(field["name"]), _FIELD.pack(field["offset"], field["datatype"], field["count"])]
    return b"".join((*parts, _NOT_BIG_ENDIAN, LENGTH.pack(row.itemsize)))


_SIZES = struct.Struct("<II")  # of a row of points, and of the data: all is one row of them
_FIELD = struct.Struct("<IB3xI")
_NOT_BIG_ENDIAN, _DENSE = b"\0\0\0\0", b"\1"
