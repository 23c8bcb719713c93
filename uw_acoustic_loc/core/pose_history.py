"""The vehicle's pose over time, from odometry that may be reset, or glitch for a moment."""

from __future__ import annotations

import cmath
import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from typing import NamedTuple

from .geometry import wrap_angle, yaw_from_quat
from .types import Odometry

RESET_MOVE, RESET_SPEED = 1.0, 3.0  # m, m/s by which a pose may differ from where the last one and its twist lead
_RESET_TURN, _RESET_RATE = 0.15, 0.3  # rad, rad/s likewise; beyond either it is not used
_BELIEVED = 2.0  # times as far off it may be a reset
_CONFIRMING = 3  # poses that have to go on from the first one of a reset until it is believed
_RETURN_NS = 5_000_000_000  # for which the frame before a reset is kept: poses that fit it again undo the reset
_STALE = 0.5  # s for which the last velocity is carried on
_KEPT = 20_000  # poses


class PlanarPose(NamedTuple):
    """Position in m and unwrapped yaw in rad; velocity in the body's axes."""

    x: float
    y: float
    yaw: float
    vx: float
    vy: float
    yaw_rate: float

    def after(self, dt: float) -> PlanarPose:
        """The pose when the velocity stays as it is."""
        turn = self.yaw_rate * dt
        dx, dy = rotated(self.vx * dt, self.vy * dt, self.yaw + turn / 2)
        return self._replace(x=self.x + dx, y=self.y + dy, yaw=self.yaw + turn)


class OdomFrame(NamedTuple):
    """From odom to the frame of a history, points as complex numbers: p -> turn p + shift."""

    turn: complex = 1 + 0j
    shift: complex = 0j

    def pose(self, given: PlanarPose, near: float) -> PlanarPose:
        """A pose of odom in the history's frame, its yaw unwrapped to be near to another."""
        at = self.turn * complex(given.x, given.y) + self.shift
        yaw = given.yaw + cmath.phase(self.turn)
        return given._replace(x=at.real, y=at.imag, yaw=near + wrap_angle(yaw - near))


@dataclass
class Reset:
    """Odometry that did not go on from where it was."""

    t_ns: int
    move: float  # m
    turn: float  # rad
    before: OdomFrame  # that of the poses before
    last: PlanarPose  # the last of these
    last_ns: int
    confirmed: int = 0  # poses since that go on from there
    undone: bool = False  # it was a glitch

    @property
    def believed(self) -> bool:
        """Whether enough poses have confirmed it."""
        return self.confirmed >= _CONFIRMING


class PoseHistory:
    """Poses in a frame that is odom until odometry is reset, and goes on smoothly when it is.

    Odometry is continuous (REP-105). A pose that lies off the last one, carried on with its twist, by more than the
    limits is either the first one after a reset of the dead reckoning or a glitch. It is taken to be where the last one
    leads. When the next poses go on from there, and none comes within twice the limits of the frame before, the reset
    is believed; when they fit that frame again within 5 s, it is undone. A pause is no reset: the limits grow with
    time, the vehicle may have gone on meanwhile.
    """

    def __init__(self, move_limit: float = RESET_MOVE) -> None:
        self._move_limit = move_limit
        self._t_ns: list[int] = []
        self._poses: list[PlanarPose] = []
        self._given: PlanarPose | None = None  # the last odometry's, in odom
        self._frame = OdomFrame()
        self._reset: Reset | None = None  # the last one, while it may be undone
        self.resets = self.glitches = 0
        self.last_reset: Reset | None = None  # the last one that was believed or undone

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def frame(self) -> OdomFrame:
        """Of the last pose; a reset that is not believed yet counts."""
        return self._frame

    @property
    def believed_frame(self) -> OdomFrame:
        """Of what others take for odom now."""
        return self._frame if self._reset is None or self._believed else self._reset.before

    @property
    def _believed(self) -> bool:
        return self._reset is not None and self._reset.believed

    @property
    def span_ns(self) -> tuple[int, int]:
        """Stamps of the first and the last pose."""
        return self._t_ns[0], self._t_ns[-1]

    def add(self, odometry: Odometry) -> None:
        """Takes the next odometry.

        Raises:
            ValueError: a pose or a velocity that is not finite, or a stamp that does not advance.
        """
        given, t_ns = _planar(odometry), odometry.t_ns
        if self._t_ns and t_ns <= self._t_ns[-1]:
            raise ValueError(f"odometry at {t_ns} ns must come after the one at {self._t_ns[-1]} ns")
        pose = given if self._given is None else self._continued(self._given, given, t_ns)
        self._t_ns.append(t_ns)
        self._poses.append(pose)
        self._given = given
        if len(self._t_ns) > _KEPT:
            del self._t_ns[: _KEPT // 2], self._poses[: _KEPT // 2]

    def at(self, t_ns: int) -> PlanarPose:
        """The pose at a stamp: between two by interpolation, beyond them with their velocity for half a second."""
        k = bisect_right(self._t_ns, t_ns)
        if k == 0:
            return self._poses[0].after(max((t_ns - self._t_ns[0]) * 1e-9, -_STALE))
        if k == len(self._t_ns):
            return self._poses[-1].after(min((t_ns - self._t_ns[-1]) * 1e-9, _STALE))
        a, b = self._poses[k - 1], self._poses[k]
        w = (t_ns - self._t_ns[k - 1]) / (self._t_ns[k] - self._t_ns[k - 1])
        return a._replace(x=a.x + w * (b.x - a.x), y=a.y + w * (b.y - a.y), yaw=a.yaw + w * (b.yaw - a.yaw))

    def _continued(self, before: PlanarPose, given: PlanarPose, t_ns: int) -> PlanarPose:
        """The pose in the history's frame."""
        last, dt = self._poses[-1], (t_ns - self._t_ns[-1]) * 1e-9
        dx, dy = rotated(given.x - before.x, given.y - before.y, last.yaw - before.yaw)
        pose = given._replace(x=last.x + dx, y=last.y + dy, yaw=last.yaw + wrap_angle(given.yaw - before.yaw))
        steady = self._steady()
        moving = last if any(last[3:]) else steady
        fits = self._fits(pose, last.after(dt), dt) or self._fits(pose, steady.after(dt), dt)
        back = None if fits and self._believed else self._back(given, t_ns)
        if back is not None:
            return back
        if fits:
            self._confirm(t_ns)
            return pose
        return self._suspect(moving, pose, given, t_ns)

    def _steady(self) -> PlanarPose:
        """The last pose with the velocity between the last two: many drivers do not fill in the twist."""
        last = self._poses[-1]
        if len(self._poses) < 2:
            return last
        before, dt = self._poses[-2], (self._t_ns[-1] - self._t_ns[-2]) * 1e-9
        turn = last.yaw - before.yaw
        ahead, left = rotated(last.x - before.x, last.y - before.y, turn / 2 - last.yaw)
        return last._replace(vx=ahead / dt, vy=left / dt, yaw_rate=turn / dt)

    def _back(self, given: PlanarPose, t_ns: int) -> PlanarPose | None:
        """Undoes the reset if the pose fits the frame before it; the pose in that frame."""
        reset = self._reset
        if reset is None:
            return None
        dt = (t_ns - reset.last_ns) * 1e-9
        guess = reset.last.after(dt)
        back = reset.before.pose(given, guess.yaw)
        if not self._fits(back, guess, dt, 1.0 if reset.believed else _BELIEVED):
            return None
        self.resets -= reset.believed
        self._frame, self._reset, reset.undone = reset.before, None, True
        self.glitches, self.last_reset = self.glitches + 1, reset
        return back

    def _fits(self, pose: PlanarPose, guess: PlanarPose, dt: float, times: float = 1.0) -> bool:
        """Whether a pose lies within so many times the limits of a guess."""
        off, turn = math.hypot(pose.x - guess.x, pose.y - guess.y), abs(pose.yaw - guess.yaw)
        return turn <= times * (_RESET_TURN + _RESET_RATE * dt) and off <= times * (self._move_limit + RESET_SPEED * dt)

    def _suspect(self, moving: PlanarPose, pose: PlanarPose, given: PlanarPose, t_ns: int) -> PlanarPose:
        """Where the last pose leads; a reset that was not believed yet has not happened."""
        guess = moving.after((t_ns - self._t_ns[-1]) * 1e-9)
        move, turned = math.hypot(pose.x - guess.x, pose.y - guess.y), pose.yaw - guess.yaw
        first = self._reset
        if first is not None and not first.believed:
            self._reset = replace(first, t_ns=t_ns, move=move, turn=turned, confirmed=0)
        else:
            self._reset = Reset(t_ns, move, turned, self._frame, moving, self._t_ns[-1])
        turn = cmath.rect(1.0, guess.yaw - given.yaw)
        self._frame = OdomFrame(turn, complex(guess.x, guess.y) - turn * complex(given.x, given.y))
        return given._replace(x=guess.x, y=guess.y, yaw=guess.yaw)

    def _confirm(self, t_ns: int) -> None:
        reset = self._reset
        if reset is None:
            return
        reset.confirmed += 1
        if reset.confirmed == _CONFIRMING:
            self.resets, self.last_reset = self.resets + 1, reset
        if reset.believed and t_ns - reset.t_ns > _RETURN_NS:
            self._reset = None


def rotated(x: float, y: float, angle: float) -> tuple[float, float]:
    """A vector turned counter-clockwise."""
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


def _planar(odometry: Odometry) -> PlanarPose:
    x, y, z = odometry.position.tolist()
    vx, vy, vz = odometry.linear.tolist()
    quat, rates = odometry.quat_xyzw.tolist(), odometry.angular.tolist()
    if not math.isfinite(sum((x, y, z, vx, vy, vz, *quat, *rates))):
        raise ValueError(f"odometry pose and twist must be finite, got {[x, y, z, *quat, vx, vy, vz, *rates]}")
    return PlanarPose(x, y, yaw_from_quat(odometry.quat_xyzw), vx, vy, rates[2])
