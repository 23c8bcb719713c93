"""The record codec: numpy columns <-> sensor_msgs/PointCloud2 rows, driven by a layout file, `<Record>.msg`.

The layout file is the only place that knows a record's columns and types. A message may carry them in any order and
with padding; it must carry all of them, with the declared type.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..core.types import AnyArray
from ..resources import resource
from .flat import Make, header, stamp_ns

RECORD = "sensor_msgs/msg/PointCloud2"

# PointField.datatype of each numpy type
_DATATYPES = {"int8": 1, "uint8": 2, "int16": 3, "uint16": 4, "int32": 5, "uint32": 6, "float32": 7, "float64": 8}
_NUMPY = {code: np.dtype(name) for name, code in _DATATYPES.items()}

# The converter's counts may take the place of pressures (HydrophoneSample.msg).
_ALSO = {"HydrophoneSample": {"float32": "int16"}}


@dataclass(frozen=True, eq=False)
class Layout:
    """A record's columns in order, with their numpy types, and a second type that a column may have."""

    name: str
    columns: tuple[tuple[str, str], ...]
    also: Mapping[str, str]

    def allowed(self, kind: str) -> tuple[str, ...]:
        """Returns the types that a column declared as `kind` may have."""
        return (kind, self.also[kind]) if kind in self.also else (kind,)


@cache
def layout(name: str, folder: Path | None = None) -> Layout:
    """Reads the layout that <name>.msg of a folder declares; None = the package's own msg_defs.

    Raises:
        ValueError: a line of the file is no column of a number.
    """
    file = folder / f"{name}.msg" if folder else resource(f"msg_defs/{name}.msg")
    columns = []
    for number, line in enumerate(file.read_text().splitlines(), 1):
        words = line.split("#")[0].split()
        if words and (len(words) != 2 or words[0] not in _DATATYPES or not words[1].isidentifier()):
            allowed = ", ".join(_DATATYPES)
            raise ValueError(f"{file}, line {number}: must be one of {allowed} and a name, got '{' '.join(words)}'")
        columns += [(words[1], words[0])] if words else []
    return Layout(name, tuple(columns), {} if folder else _ALSO.get(name, {}))


def record_to(make: Make, plan: Layout, value: Any) -> Any:
    """Builds the sensor_msgs/PointCloud2 of a record from a core type with an array (or number) per column."""
    rows = rows_of(plan, value)
    return make(
        RECORD,
        header=header(make, value.t_ns, value.frame_id),
        height=1,
        width=len(rows),
        fields=[make("sensor_msgs/msg/PointField", **field) for field in fields(rows.dtype)],
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.nbytes,
        data=make.uint8_array(rows.tobytes()),
        is_dense=True,
    )


def record_from(plan: Layout, kind: type, msg: Any, single: bool = False) -> Any:
    """Reads a core type from PointCloud2 rows; a `single` record has exactly one row and becomes numbers.

    Raises:
        ValueError: a column is missing or has another type, or the data do not have the length that they declare.
    """
    given = tuple((field.name, field.datatype, field.offset, field.count) for field in msg.fields)
    rows = _rows(plan.name, msg, _checked(plan, given, msg.point_step))
    return value_of(plan, kind, stamp_ns(msg), msg.header.frame_id, rows, single)


def value_of(plan: Layout, kind: type, t_ns: int, frame_id: str, rows: AnyArray, single: bool) -> Any:
    """Makes a core type of structured rows (N,), its columns contiguous: strides would slow every later use."""
    columns: dict[str, Any] = {column: _whole(rows[column], declared) for column, declared in plan.columns}
    if single:
        if len(next(iter(columns.values()))) != 1:
            raise ValueError(f"{plan.name}: must have 1 row, got {len(next(iter(columns.values())))}")
        columns = {column: float(values[0]) for column, values in columns.items()}
        if not all(map(math.isfinite, columns.values())):
            raise ValueError(f"{plan.name} must be finite, got {[*columns.values()]}")
    return kind(t_ns=t_ns, frame_id=frame_id, **columns)


def _whole(column: AnyArray, declared: str) -> AnyArray:
    """A column in one piece; float32 in the place of float64 loses nothing by becoming that."""
    return np.ascontiguousarray(column, np.float64 if declared == "float64" else None)


def rows_of(plan: Layout, value: Any) -> AnyArray:
    """Makes structured rows (N,) of the record from its columns (each (N,)), in the types that its layout allows."""
    given = [np.atleast_1d(getattr(value, column)) for column, _ in plan.columns]
    rows = np.empty(len(given[0]), _packed_type(plan, tuple(column.dtype for column in given)))
    for column, values in zip(rows.dtype.names, given, strict=True):
        rows[column] = values
    return rows


@lru_cache(maxsize=64)
def _packed_type(plan: Layout, given: tuple[np.dtype[Any], ...]) -> np.dtype[Any]:
    own = [(column, kind, dtype.name) for (column, kind), dtype in zip(plan.columns, given, strict=True)]
    return np.dtype([(column, has if has in plan.allowed(kind) else kind) for column, kind, has in own])


@cache
def row_types(plan: Layout) -> list[np.dtype[Any]]:
    """Returns the row types with the declared column types, and with those that may take their place."""
    allowed = [(column, plan.allowed(kind)) for column, kind in plan.columns]
    count = max(len(kinds) for _, kinds in allowed)
    return [np.dtype([(column, kinds[min(k, len(kinds) - 1)]) for column, kinds in allowed]) for k in range(count)]


@lru_cache(maxsize=64)
def fields(rows: np.dtype[Any]) -> list[dict[str, Any]]:
    """PointField contents of structured rows of this type."""
    described = [(name, *rows.fields[name][:2]) for name in rows.names or ()]  # type: ignore[index]
    return [
        {"name": name, "offset": int(offset), "datatype": _DATATYPES[kind.name], "count": 1}
        for name, kind, offset in described
    ]


def table(msg: Any) -> AnyArray:
    """Structured view (N,) of any PointCloud2's rows: the columns of one number each; ValueError as `record_from`."""
    named = {field.name: field for field in msg.fields}
    plain = [(f.name, f.datatype, f.offset) for f in named.values() if f.count == 1 and f.datatype in _NUMPY]
    good = [column for column in plain if column[2] + _NUMPY[column[1]].itemsize <= msg.point_step]
    return _rows("PointCloud2", msg, tuple(good))


_Column = tuple[str, int, int]  # name, datatype, offset


def _rows(name: str, msg: Any, columns: tuple[_Column, ...]) -> AnyArray:
    count = int(msg.width) * int(msg.height)
    if len(msg.data) != count * msg.point_step:
        raise ValueError(f"{name}: data must have {count} x {msg.point_step} bytes, got {len(msg.data)}")
    return np.frombuffer(msg.data, dtype=_row_type(columns, msg.is_bigendian, msg.point_step), count=count)


@lru_cache(maxsize=64)
def _row_type(columns: tuple[_Column, ...], is_bigendian: bool, step: int) -> np.dtype[Any]:
    """The dtype of a row: names, types and offsets of its columns."""
    formats = [_NUMPY[code].newbyteorder(">" if is_bigendian else "<") for _, code, _ in columns]
    names, offsets = [name for name, _, _ in columns], [offset for _, _, offset in columns]
    layout: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": step}
    return np.dtype(layout)  # type: ignore[no-any-return]


@lru_cache(maxsize=64)
def _checked(plan: Layout, given: tuple[tuple[str, int, int, int], ...], step: int) -> tuple[_Column, ...]:
    """The record's columns among those of a message; ValueError with the first that is missing or of another type."""
    named = {field[0]: field for field in given}
    for column, kind in plan.columns:
        widened = ("float32",) if kind == "float64" else ()
        _check(plan.name, column, plan.allowed(kind) + widened, named.get(column), step)
    return tuple(named[column][:3] for column, _ in plan.columns)


def _check(record: str, column: str, allowed: tuple[str, ...], field: Any, step: int) -> None:
    if field is None:
        raise ValueError(f"{record}: column '{column}' is missing")
    _, datatype, offset, count = field
    kind = _NUMPY.get(datatype)
    if kind is None or kind.name not in allowed or count != 1:
        got = kind.name if kind is not None else f"datatype {datatype}"
        raise ValueError(f"{record}: column '{column}' must be {' or '.join(allowed)}, got {got} x {count}")
    if offset + kind.itemsize > step:
        raise ValueError(f"{record}: column '{column}' lies beyond the row of {step} bytes")
