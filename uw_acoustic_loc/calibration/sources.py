"""The pings by source, and what is known of the array and of the pingers before a run is looked at."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..core.types import Array
from .model import Poses
from .observed import Observed, ObservedPing

PAIR = ("delay_offset", "spacing_scale", "array_yaw")
FEWEST = 4  # pings of a source
_SQUARE_STD = 50.0  # m^2, of the square of a depth difference beforehand


@dataclass(frozen=True, eq=False)
class Known:
    """What is known beforehand. Positions are in the odometry's frame; a depth is below the middle of the positions."""

    pinger: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)  # by source, m
    depth: float = math.nan  # m that all other pingers lie deeper than the array; NaN = estimated
    bearing: float = math.nan  # rad in base_link, of a pinger that lies still far away, as the vehicle does
    held: tuple[str, ...] = ()  # of PAIR, that keep the graph's value


@dataclass(frozen=True, eq=False)
class SourceData:
    """The pings of one source."""

    name: str
    poses: Poses
    pings: Sequence[ObservedPing]
    cycle: float  # s of its band's centre
    place: tuple[Array, Array]  # (3,) x, y and square of depth: what is assumed beforehand, and its std, 0 = known


def sources_of(seen: Observed, known: Known) -> list[SourceData]:
    """The sources that were heard often enough.

    Raises:
        ValueError: none was.
    """
    names, c = seen.config.source_ids, seen.config
    by_source = {k: [ping for ping in seen.pings if ping.source == k] for k in range(len(names))}
    found = []
    for k, pings in by_source.items():
        if len(pings) >= FEWEST:
            turns = np.array([ping.rotation for ping in pings])
            places = np.array([ping.position for ping in pings]) + turns @ np.array(c.array.array_position)
            poses = Poses(places, turns, seen.info.spacing, seen.sound_speed, places.mean(axis=0))
            place = _beforehand(names[k], poses, known, c.source.range_max)
            found.append(SourceData(names[k], poses, pings, 2.0 / sum(c.bands[k]), place))
    if not found:
        counts = ", ".join(f"{len(pings)} of {names[k]}" for k, pings in by_source.items())
        raise ValueError(f"at least {FEWEST} pings of a source are needed, heard were {counts}")
    return found


def _beforehand(name: str, poses: Poses, known: Known, range_max: float) -> tuple[Array, Array]:
    if not math.isnan(known.bearing):
        return 1e4 * np.array([math.cos(known.bearing), math.sin(known.bearing), 0.0]), np.zeros(3)
    if name in known.pinger:
        x, y, z = known.pinger[name]
        return np.array([x, y, (poses.middle[2] - z) ** 2]), np.zeros(3)
    stated = not math.isnan(known.depth)
    middle = np.array([*poses.middle[:2], known.depth**2 if stated else 0.0])
    return middle, np.array([range_max, range_max, 0.0 if stated else _SQUARE_STD])
