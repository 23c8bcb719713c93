"""Where the sonar net's targets truly are: constant speed, straight on or in turns."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence

import numpy as np

from ..core.types import Array
from .scenario import Target, Turn


def states(targets: Sequence[Target], times: Array) -> tuple[Array, Array]:
    """Returns the targets' positions and velocities, each (T, 3), at a time each, (T,) s after the start."""
    found = [_state(target, float(time)) for target, time in zip(targets, times, strict=True)]
    positions, velocities = np.array(found).reshape(-1, 2, 3).transpose(1, 0, 2)
    return positions, velocities


def met_by_ping(transmitter: Array, count: int, positions: Callable[[Array], Array], speed: float) -> Array:
    """Returns where a ping meets its `count` targets, (T, 3): |p(t) - transmitter| = c t.

    `positions` gives (T, 3) at times (T,) after the ping. Each round of the fixed point shrinks the error by |v| / c.
    """
    delays = np.zeros(count)
    for _ in range(8):
        delays = np.linalg.norm(positions(delays) - transmitter, axis=1) / speed
    return positions(delays)


def _state(target: Target, time: float) -> list[list[float]]:
    place, velocity = complex(target.x, target.y), complex(target.vx, target.vy)
    legs = [Turn(0.0, 0.0), *target.turns]
    for leg, until in zip(legs, [*(turn.time for turn in target.turns), math.inf], strict=True):
        lasting = max(min(time, until) - leg.time, 0.0)
        half = leg.rate * lasting / 2
        place += velocity * lasting * float(np.sinc(half / np.pi)) * cmath.rect(1.0, half)  # the arc's chord
        velocity *= cmath.rect(1.0, 2 * half)
    return [[place.real, place.imag, target.z], [velocity.real, velocity.imag, 0.0]]
