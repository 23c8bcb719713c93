"""How the array turns and moves between two instants, from the vehicle's odometry."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import NamedTuple

from ..geometry import wrap_angle, yaw_from_quat
from ..types import Odometry

_STALE = 0.5  # s for which the last velocity is carried on
_KEPT = 20_000  # poses
_JUMP_TURN, _JUMP_RATE = 0.05, 0.5  # rad, rad/s by which a turn may differ from the twist's; beyond, the pose was reset
_JUMP_MOVE, _JUMP_SPEED = 0.5, 2.0  # m, m/s


class Displacement(NamedTuple):
    """Motion of the array between two instants."""

    turn: float  # rad, counter-clockwise
    move: tuple[float, float]  # m, in the array's axes at the first instant
    guessed: float  # share of the time that lies beyond the odometry


class _Pose(NamedTuple):
    """Position and unwrapped yaw; velocity in the body's axes."""

    x: float
    y: float
    yaw: float
    vx: float
    vy: float
    yaw_rate: float

    def after(self, dt: float) -> _Pose:
        """The pose when the velocity stays as it is."""
        return self._moved(self.yaw_rate * dt, self.vx * dt, self.vy * dt)

    def _moved(self, turn: float, ahead: float, left: float) -> _Pose:
        cos, sin = math.cos(self.yaw + turn / 2), math.sin(self.yaw + turn / 2)
        x, y = self.x + cos * ahead - sin * left, self.y + sin * ahead + cos * left
        return _Pose(x, y, self.yaw + turn, self.vx, self.vy, self.yaw_rate)


class ArrayMotion:
    """Interpolates the change of pose between odometries: a rate would be stale, or noisy, over a ping's period.

    Changes that contradict the twist (dead reckoning that was reset) are replaced by the twist's.
    """

    def __init__(self, array_yaw: float, array_position: tuple[float, ...]) -> None:
        self._yaw, self._position = array_yaw, array_position
        self._t_ns: list[int] = []
        self._poses: list[_Pose] = []
        self._given: tuple[float, float, float] = (0.0, 0.0, 0.0)  # x, y, yaw of the last odometry

    def add(self, odometry: Odometry) -> None:
        """Odometry in stamp order; an older one is left out.

        Raises:
            ValueError: a pose or a velocity that is not finite.
        """
        x, y, z = odometry.position.tolist()
        vx, vy, vz = odometry.linear.tolist()
        quat, rates = odometry.quat_xyzw.tolist(), odometry.angular.tolist()
        if not math.isfinite(sum((x, y, z, vx, vy, vz, *quat, *rates))):
            raise ValueError(f"odometry pose and twist must be finite, got {[x, y, z, *quat, vx, vy, vz, *rates]}")
        if self._t_ns and odometry.t_ns <= self._t_ns[-1]:
            return
        given: tuple[float, float, float] = (x, y, yaw_from_quat(odometry.quat_xyzw))
        px, py, yaw = self._continued(given, odometry.t_ns) if self._t_ns else given
        self._t_ns.append(odometry.t_ns)
        self._poses.append(_Pose(px, py, yaw, vx, vy, rates[2]))
        self._given = given
        if len(self._t_ns) > _KEPT:
            del self._t_ns[: _KEPT // 2], self._poses[: _KEPT // 2]

    def between(self, begin_ns: int, end_ns: int) -> Displacement:
        """From one instant to a later one; without any odometry the array is taken to stand still."""
        if not self._t_ns:
            return Displacement(0.0, (0.0, 0.0), 1.0)
        a, b = self._at(begin_ns), self._at(end_ns)
        turn, (px, py) = b.yaw - a.yaw, self._position[:2]
        dx, dy = _rotated(b.x - a.x, b.y - a.y, -a.yaw)
        lever_x, lever_y = _rotated(px, py, turn)
        move = _rotated(dx + lever_x - px, dy + lever_y - py, -self._yaw)
        known = min(end_ns, self._t_ns[-1]) - max(begin_ns, self._t_ns[0])
        return Displacement(turn, move, 1.0 - min(max(known / max(end_ns - begin_ns, 1), 0.0), 1.0))

    def _continued(self, given: tuple[float, float, float], t_ns: int) -> tuple[float, float, float]:
        """Position and yaw that go on from the last ones without a jump."""
        last, dt = self._poses[-1], (t_ns - self._t_ns[-1]) * 1e-9
        guess = last.after(dt)
        turn = wrap_angle(given[2] - self._given[2])
        dx, dy = _rotated(given[0] - self._given[0], given[1] - self._given[1], last.yaw - self._given[2])
        off = math.hypot(last.x + dx - guess.x, last.y + dy - guess.y)
        if abs(turn - last.yaw_rate * dt) > _JUMP_TURN + _JUMP_RATE * dt or off > _JUMP_MOVE + _JUMP_SPEED * dt:
            return guess.x, guess.y, guess.yaw
        return last.x + dx, last.y + dy, last.yaw + turn

    def _at(self, t_ns: int) -> _Pose:
        k = bisect_right(self._t_ns, t_ns)
        if k == 0:
            return self._poses[0].after(max((t_ns - self._t_ns[0]) * 1e-9, -_STALE))
        if k == len(self._t_ns):
            return self._poses[-1].after(min((t_ns - self._t_ns[-1]) * 1e-9, _STALE))
        a, b = self._poses[k - 1], self._poses[k]
        w = (t_ns - self._t_ns[k - 1]) / (self._t_ns[k] - self._t_ns[k - 1])
        x, y, yaw = a.x + w * (b.x - a.x), a.y + w * (b.y - a.y), a.yaw + w * (b.yaw - a.yaw)
        return _Pose(x, y, yaw, a.vx, a.vy, a.yaw_rate)


def _rotated(x: float, y: float, angle: float) -> tuple[float, float]:
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y
