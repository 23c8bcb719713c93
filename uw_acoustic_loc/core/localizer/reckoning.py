"""The vehicle's pose at any stamp, from odometry that may pause, leap or stand still."""

from __future__ import annotations

import cmath
import math

import numpy as np

from ..geometry import rotation_from_rpy, rpy_from_quat, wrap_angle
from ..types import Array, Odometry
from .triangulation import PlanarFix


class Reckoning:
    """Poses in a frame that is odom until odometry leaps, and goes on smoothly when it does.

    Odometry is continuous (REP-105), so a leap is a restart of the dead reckoning, not a motion: what is kept in this
    frame stays where it was, seen from the vehicle. A pause is no leap; the vehicle may have gone on meanwhile.
    `gaps` and `jumps` count, `notice` tells the last one.
    """

    def __init__(self, timeout: float, jump: float) -> None:
        self._timeout, self._jump = timeout, jump  # s, m
        self._turn, self._shift = 1 + 0j, 0j  # from odom to this frame: x + iy -> turn (x + iy) + shift
        self.last: Odometry | None = None
        self.gaps = self.jumps = 0
        self.notice = ""
        self.notice_ns = 0

    def update(self, odometry: Odometry) -> None:
        """Raises ValueError if the stamp does not advance."""
        if self.last is not None:
            if odometry.t_ns <= self.last.t_ns:
                raise ValueError(f"odometry at {odometry.t_ns} ns must come after the one at {self.last.t_ns} ns")
            self._compare(self.last, odometry)
        self.last = odometry

    def array_pose(self, t_ns: int, lever: Array) -> tuple[Array, float]:
        """Position (3,) of a point of base_link and the vehicle's yaw at a stamp: the last pose, moved on.

        Raises:
            ValueError: there is no odometry, or none so near to the stamp.
        """
        if self.last is None:
            raise ValueError("bearing refused: no odometry yet")
        duration = (t_ns - self.last.t_ns) * 1e-9
        if abs(duration) > self._timeout:
            raise ValueError(f"bearing refused: odometry is {duration:.3f} s older, allowed are {self._timeout:g} s")
        position, (roll, pitch, yaw) = _moved_on(self.last, duration)
        position = position + rotation_from_rpy(roll, pitch, yaw) @ lever
        kept = self._turn * complex(position[0], position[1]) + self._shift
        return np.array([kept.real, kept.imag, position[2]]), wrap_angle(yaw + cmath.phase(self._turn))

    def to_odom(self, fix: PlanarFix) -> PlanarFix:
        """A fix of this frame in odom as it is now."""
        if not self.jumps:
            return fix
        rotation = self._back
        return PlanarFix(self.points_to_odom(fix.mean[:, None])[:, 0], rotation @ fix.cov @ rotation.T)

    def points_to_odom(self, xy: Array) -> Array:
        """Points (2, n) of this frame in odom as it is now."""
        return np.asarray(self._back @ (xy - np.array([[self._shift.real], [self._shift.imag]])))

    @property
    def _back(self) -> Array:
        c, s = self._turn.real, self._turn.imag
        return np.array([[c, s], [-s, c]])

    def _compare(self, last: Odometry, new: Odometry) -> None:
        duration = (new.t_ns - last.t_ns) * 1e-9
        expected, (_, _, yaw) = _moved_on(last, duration)
        leap = math.dist(new.position[:2], expected[:2])
        turn = wrap_angle(rpy_from_quat(new.quat_xyzw)[2] - yaw)
        if leap > self._jump + _SPEED * duration or abs(turn) > _TURN * max(1.0, duration):
            self.jumps += 1
            self._tell(new, f"odometry leapt by {leap:.1f} m and {math.degrees(turn):.0f} deg: sources carried along")
            before = self._turn * complex(expected[0], expected[1]) + self._shift
            self._turn *= cmath.rect(1.0, -turn)
            self._shift = before - self._turn * complex(new.position[0], new.position[1])
        elif duration > self._timeout:
            self.gaps += 1
            self._tell(new, f"odometry paused for {duration:.1f} s")

    def _tell(self, odometry: Odometry, sentence: str) -> None:
        self.notice, self.notice_ns = sentence, odometry.t_ns


def _moved_on(odometry: Odometry, duration: float) -> tuple[Array, tuple[float, float, float]]:
    """Position and roll, pitch, yaw after a duration in s with the velocities as they are."""
    roll, pitch, yaw = rpy_from_quat(odometry.quat_xyzw)
    turn = float(odometry.angular[2]) * duration
    midway = rotation_from_rpy(roll, pitch, yaw + turn / 2)
    return odometry.position + midway @ (odometry.linear * duration), (roll, pitch, yaw + turn)


_SPEED = 5.0  # m/s that the velocity in odometry may miss
_TURN = 0.5  # rad, or rad/s over a longer pause
