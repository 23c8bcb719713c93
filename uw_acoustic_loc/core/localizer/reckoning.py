"""The vehicle's pose at any stamp, from odometry that may pause, be reset or stand still."""

from __future__ import annotations

import cmath
import math

import numpy as np

from ..geometry import rotation_from_rpy, rpy_from_quat, wrap_angle
from ..pose_history import OdomFrame, PoseHistory, Reset
from ..types import Array, Odometry
from .triangulation import PlanarFix


class Reckoning:
    """Poses in the frame of a `PoseHistory`: what is kept in it stays where it was, seen from the vehicle.

    `gaps`, `resets` and `glitches` count, `notice` describes the last one.
    """

    def __init__(self, timeout: float, move_limit: float) -> None:
        self._timeout = timeout  # s
        self._history = PoseHistory(move_limit)
        self.last: Odometry | None = None
        self.gaps = 0
        self.notice = ""
        self.notice_ns = 0

    @property
    def resets(self) -> int:
        """Odometry resets that later poses have confirmed."""
        return self._history.resets

    @property
    def glitches(self) -> int:
        """Poses, or some in a row, that lay off the track and were not used."""
        return self._history.glitches

    def update(self, odometry: Odometry) -> None:
        """Raises ValueError if the stamp does not advance, or a number is not finite."""
        last, before = self.last, self._history.last_reset
        self._history.add(odometry)
        self.last, reset = odometry, self._history.last_reset
        pause = 0.0 if last is None else (odometry.t_ns - last.t_ns) * 1e-9
        if reset is not None and reset is not before:
            self._report(odometry, _sentence(reset))
        elif pause > self._timeout:
            self.gaps += 1
            self._report(odometry, f"odometry paused for {pause:.1f} s")

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
        turn, shift = self._history.frame
        kept = turn * complex(position[0], position[1]) + shift
        return np.array([kept.real, kept.imag, position[2]]), wrap_angle(yaw + cmath.phase(turn))

    @property
    def yaw_variance(self) -> float:
        """Of the last odometry, in rad^2; 0 when it does not know it."""
        return 0.0 if self.last is None else max(self.last.pose_cov.item(5, 5), 0.0)

    def pose_cov_at(self, point: Array) -> Array:
        """(2, 2) what the odometry's own pose covariance makes of a point (2,) of odom that is seen from there.

        What the odometry does not know of its covariance counts as zero.
        """
        odometry = self.last
        if odometry is None:
            return np.zeros((2, 2))
        dx, dy = (point - odometry.position[:2]).tolist()
        get = odometry.pose_cov.item
        x_yaw, y_yaw, yaws = get(0, 5), get(1, 5), max(get(5, 5), 0.0)
        xx, yy = max(get(0, 0), 0.0) - dy * (2 * x_yaw - dy * yaws), max(get(1, 1), 0.0) + dx * (2 * y_yaw + dx * yaws)
        xy = get(0, 1) + dx * x_yaw - dy * (y_yaw + dx * yaws)
        return np.array(((xx, xy), (xy, yy)))

    def to_odom(self, fix: PlanarFix) -> PlanarFix:
        """A fix of this frame in odom as it is now."""
        frame = self._history.believed_frame
        if frame == OdomFrame():
            return fix
        rotation = _back(frame)
        return PlanarFix(self.points_to_odom(fix.mean[:, None])[:, 0], rotation @ fix.cov @ rotation.T)

    def points_to_odom(self, xy: Array) -> Array:
        """Points (2, n) of this frame in odom as it is now."""
        frame = self._history.believed_frame
        return np.asarray(_back(frame) @ (xy - np.array([[frame.shift.real], [frame.shift.imag]])))

    def _report(self, odometry: Odometry, sentence: str) -> None:
        self.notice, self.notice_ns = sentence, odometry.t_ns


def _back(frame: OdomFrame) -> Array:
    c, s = frame.turn.real, frame.turn.imag
    return np.array([[c, s], [-s, c]])


def _sentence(reset: Reset) -> str:
    size = f"by {reset.move:.1f} m and {math.degrees(reset.turn):.0f} deg"
    if reset.undone:
        return f"odometry glitched {size} and came back: nothing carried along"
    return f"odometry was reset {size}: sources carried along"


def _moved_on(odometry: Odometry, duration: float) -> tuple[Array, tuple[float, float, float]]:
    """Position and roll, pitch, yaw after a duration in s with the velocities as they are."""
    roll, pitch, yaw = rpy_from_quat(odometry.quat_xyzw)
    turn = float(odometry.angular[2]) * duration
    midway = rotation_from_rpy(roll, pitch, yaw + turn / 2)
    return odometry.position + midway @ (odometry.linear * duration), (roll, pitch, yaw + turn)
