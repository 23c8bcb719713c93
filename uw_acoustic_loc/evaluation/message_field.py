"""Reads the numbers of a message by the name of their field."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ..core.types import Array
from ..wire.record import table


def numbers(message: Any, field: str) -> Array:
    """Returns (N,) the numbers of a field such as `pose.covariance[35]`, through lists of messages too.

    Raises:
        ValueError: there is no such field, or it holds no numbers.
    """
    if field.startswith("rows."):
        return _column(message, field.removeprefix("rows."))
    values = [message]
    for name, index in _steps(field):
        values = [part for value in values for part in _parts(value, name, index, field)]
    try:
        return np.concatenate([np.asarray(value, dtype=float).ravel() for value in values] or [np.array([])])
    except (TypeError, ValueError):
        raise ValueError(f"field {field} holds no numbers") from None


def _steps(field: str) -> list[tuple[str, str]]:
    steps = [re.fullmatch(r"(\w+)(?:\[(\d+)\])?", step) for step in field.split(".")]
    if not all(steps):
        raise ValueError(f"field {field} must be names with dots and [number]s")
    return [(step[1], step[2] or "") for step in steps if step]


def _parts(value: Any, name: str, index: str, field: str) -> list[Any]:
    if not hasattr(value, name) or name.startswith("_"):
        raise ValueError(f"there is no field {field}: {type(value).__name__} has no {name}")
    part = getattr(value, name)
    if not index:
        return part if isinstance(part, list) else [part]
    if not hasattr(part, "__len__") or int(index) >= len(part):
        raise ValueError(f"there is no field {field}: {name} has no element {index}")
    return [part[int(index)]]


def _column(message: Any, column: str) -> Array:
    if not hasattr(message, "point_step"):
        raise ValueError(f"rows.{column} is a column of sensor_msgs/msg/PointCloud2 only")
    rows = table(message)
    if column not in (rows.dtype.names or ()):
        raise ValueError(f"there is no column {column}, the rows have {', '.join(rows.dtype.names or ()) or 'none'}")
    return np.asarray(rows[column], dtype=float)
