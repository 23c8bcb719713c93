"""How the array turns and moves between two instants, from the vehicle's odometry."""

from __future__ import annotations

from typing import NamedTuple

from ..pose_history import PoseHistory, rotated
from ..types import Odometry


class Displacement(NamedTuple):
    """Motion of the array between two instants."""

    turn: float  # rad, counter-clockwise
    move: tuple[float, float]  # m, in the array's axes at the first instant
    guessed: float  # share of the time that lies beyond the odometry


class ArrayMotion:
    """Interpolates the change of pose between odometries: a rate would be stale, or noisy, over a ping's period.

    Odometry that is reset or glitches is no motion (`PoseHistory`).
    """

    def __init__(self, array_yaw: float, array_position: tuple[float, ...]) -> None:
        self._yaw, self._position = array_yaw, array_position
        self._history = PoseHistory()

    def add(self, odometry: Odometry) -> None:
        """Odometry in stamp order; an older one is left out.

        Raises:
            ValueError: a pose or a velocity that is not finite.
        """
        if not len(self._history) or odometry.t_ns > self._history.span_ns[1]:
            self._history.add(odometry)

    def between(self, begin_ns: int, end_ns: int) -> Displacement:
        """From one instant to a later one; without any odometry the array is taken to stand still."""
        if not len(self._history):
            return Displacement(0.0, (0.0, 0.0), 1.0)
        a, b = self._history.at(begin_ns), self._history.at(end_ns)
        turn, (px, py) = b.yaw - a.yaw, self._position[:2]
        dx, dy = rotated(b.x - a.x, b.y - a.y, -a.yaw)
        lever_x, lever_y = rotated(px, py, turn)
        move = rotated(dx + lever_x - px, dy + lever_y - py, -self._yaw)
        first_ns, last_ns = self._history.span_ns
        known = min(end_ns, last_ns) - max(begin_ns, first_ns)
        return Displacement(turn, move, 1.0 - min(max(known / max(end_ns - begin_ns, 1), 0.0), 1.0))
