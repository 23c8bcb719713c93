"""What the geometry does not show of a source yet, and which turn of the vehicle would."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..geometry import wrap_angle
from .localizer import TELLING_TURN, SourceLocalizer
from .triangulation import PlanarFix


def advice(source: SourceLocalizer, x: float, y: float, yaw: float) -> str:
    """One sentence for the vehicle at (x, y); empty when side and range are known.

    Range: along the line of sight a bearing gives nothing, across it the most, so the course should be at least 60
    degrees off every place where the source may be (87 % of the most). Side: after the turn the angles from the array's
    axis should differ by 20 degrees, or by half of what the two places are apart; and it takes TELLING_TURN.
    """
    if not source.sides:
        return ""
    fix = source.sides[0].fix
    range_open = fix is None or _range_share(fix, x, y) > _SHARP
    side_open = len(source.sides) == 2
    if not (range_open or side_open):
        return ""
    bearings = [wrap_angle(side.estimator.predicted_bearing(x, y)[0] - yaw) for side in source.sides]
    turn = best_turn(bearings, range_open=range_open, array_yaw=source.config.array_yaw)
    return f"{_unknown(bearings, range_open, side_open)}; {_spoken(turn)}"


def best_turn(bearings: Sequence[float], *, range_open: bool, array_yaw: float) -> int:
    """The smallest turn in degrees, port positive, that does what `advice` says; else the one that comes nearest.

    `bearings` (rad, in the vehicle's frame) are the places where the source may be.
    """

    def score(turn: int) -> float:
        after = [bearing - math.radians(turn) for bearing in bearings]
        shares = [abs(math.sin(b)) / _ACROSS for b in after] if range_open else []
        if len(bearings) == 2 and (apart := abs(wrap_angle(bearings[0] - bearings[1]))) > _SAME:
            angles = [abs(wrap_angle(b - array_yaw)) for b in after]
            shares += [abs(angles[0] - angles[1]) / min(_APART, apart / 2), math.radians(abs(turn)) / TELLING_TURN]
        return min(min(shares, default=1.0), 1.0)

    candidates = [sign * turn for turn in range(0, 100, 10) for sign in (1, -1)]
    return max(candidates, key=lambda turn: round(score(turn), 6))


def _range_share(fix: PlanarFix, x: float, y: float) -> float:
    """Standard deviation of the range over the range."""
    line = fix.mean - np.array([x, y])
    squared = float(line @ line) + 1e-12
    return math.sqrt(float(line @ fix.cov @ line)) / squared


def _unknown(bearings: Sequence[float], range_open: bool, side_open: bool) -> str:
    ahead = min(abs(math.sin(bearing)) for bearing in bearings) < _ALONG
    if range_open and ahead:
        return f"range{' and side' if side_open else ''} unobservable: all bearings along one line"
    return f"{' and '.join(['range'] * range_open + ['side'] * side_open)} not known yet"


def _spoken(turn: int) -> str:
    if turn == 0:
        return "keep this course"
    return f"turn {abs(turn)} deg to {'port' if turn > 0 else 'starboard'}"


_SHARP = 0.2  # a range known to that share of itself is known
_ACROSS = math.sin(math.radians(60))
_ALONG = math.sin(math.radians(15))
_APART = math.radians(20)
_SAME = math.radians(2)  # places that need no telling apart
