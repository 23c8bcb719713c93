"""Where to begin a fit: a grid over yaw, delay offset and the pingers' places, by the likeliest maxima alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ..core.types import AnyArray, Array
from .model import Pair, predicted
from .sources import SourceData

_YAWS, _OFFSETS, _BEARINGS, _RANGES = 36, 8, 24, 8
_SQUARES = (0.0, 4.0, 25.0)  # m^2, of depth differences
_NEAREST = 1.0  # m, of a pinger
_PINGS = 40  # of a source that are looked at
_LIKELIEST = 3  # maxima of each
_OUTLIER = 4.0  # largest cost of a ping
_STARTS = 3


def starts(
    prior: Array, free: AnyArray, sources: Sequence[SourceData], tdoas: Sequence[Array], costs: Sequence[Array]
) -> Iterator[Array]:
    """Values to begin with, the likeliest first: PAIR, then the place of each source.

    `prior` has the values assumed beforehand, `free` (3,) says which of PAIR are estimated, `tdoas` and `costs` (n, P)
    are the maxima of each source.
    """
    cycle = min(source.cycle for source in sources)
    yaws = prior[2] + np.arange(_YAWS) * (2 * np.pi / _YAWS) if free[2] else prior[2:3]
    offsets = prior[0] + (np.arange(_OFFSETS) / _OFFSETS - 0.5) * cycle if free[0] else prior[:1]
    tables = [
        _table(source, found, cost, yaws, offsets, prior[1])
        for source, found, cost in zip(sources, tdoas, costs, strict=True)
    ]
    total = np.sum([cost for cost, _ in tables], axis=0)
    for _ in range(min(_STARTS, total.size)):
        k, j = divmod(int(total.argmin()), offsets.size)
        if not np.isfinite(total[k, j]):
            return
        places = [place[k, j] for _, place in tables]
        yield np.concatenate([[offsets[j], prior[1], yaws[k]], *places])
        near = np.minimum(np.abs(np.arange(yaws.size) - k), yaws.size - np.abs(np.arange(yaws.size) - k)) <= 2
        total[np.ix_(near, np.abs(np.arange(offsets.size) - j) <= 1)] = np.inf


def _table(
    source: SourceData, tdoas: Array, costs: Array, yaws: Array, offsets: Array, scale: float
) -> tuple[Array, Array]:
    """(yaws, offsets) least cost of the source, and (yaws, offsets, 3) the place that has it."""
    some = np.unique(np.linspace(0, len(tdoas) - 1, _PINGS).astype(int))
    poses, places = source.poses.at(some), _places(source)
    width = math.sqrt(2.0) * (0.06 * scale * poses.spacing / poses.sound_speed + source.cycle / 8)
    candidates = [(tdoas[some, k] / width, costs[some, k]) for k in range(_LIKELIEST)]
    best = np.empty((yaws.size, offsets.size))
    where = np.empty((yaws.size, offsets.size, 3))
    for k, yaw in enumerate(yaws):
        model = predicted(poses, Pair(0.0, scale, float(yaw)), *places.T) / width
        for j, offset in enumerate(offsets / width):
            loss = np.minimum.reduce([np.square(t - offset - model) + c for t, c in candidates])
            loss = np.minimum(loss, _OUTLIER).sum(axis=1)
            best[k, j], where[k, j] = loss.min(), places[loss.argmin()]
    return best, where


def _places(source: SourceData) -> Array:
    """(M, 3) x, y and square of depth around the middle of the positions."""
    middle, std = source.place
    if not std.any():
        return middle[None]
    ranges = np.geomspace(_NEAREST, std[0], _RANGES)
    bearings = np.arange(_BEARINGS) * (2 * np.pi / _BEARINGS)
    squares = np.array(_SQUARES) if std[2] else middle[2:]
    far, angle, square = (grid.ravel() for grid in np.meshgrid(ranges, bearings, squares))
    return np.stack([middle[0] + far * np.cos(angle), middle[1] + far * np.sin(angle), square], axis=1)
