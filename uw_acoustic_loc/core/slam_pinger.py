"""A pinger in EKF-SLAM: bearing lines until they meet, a landmark from then on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .geometry import mirror_bearing, wrap_angle, wrap_angles
from .inertial import GYRO_BIAS, LOG_BIAS, SIZE, YAW
from .joint import Joint, Slot
from .triangulation import Fix, intersect, merged_pairs
from .types import Array

if TYPE_CHECKING:
    from .slam import SlamConfig


@dataclass(frozen=True)
class Pose:
    """A level vehicle's pose and the time in s."""

    x: float
    y: float
    yaw: float
    time: float

    def at(self, offset: Array) -> tuple[float, float]:
        """Where a point (2,) of the vehicle is."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        ox, oy = float(offset[0]), float(offset[1])
        return self.x + c * ox - s * oy, self.y + s * ox + c * oy


@dataclass(frozen=True, eq=False)
class Meeting:
    """Where lines meet, how that moves with errors of the BIASES (2, 3), and the residuals' sum of squares."""

    fix: Fix
    by_bias: Array
    cost: float


class Lines:
    """Bearing lines of one side from raw dead reckoning: x, y, bearing, variance, time, yaw of the vehicle (n, 6).

    The raw track has the true biases of gyro and log in it. When the lines are intersected these are taken out as they
    are then estimated, so that what is left is an error of that estimate, with a known correlation.
    """

    def __init__(self) -> None:
        self._lines = np.empty((_CAPACITY, 6))
        self._count = 0

    def add(self, raw: Pose, offset: Array, bearing: float, variance: float) -> None:
        """Takes a bearing in the vehicle's frame."""
        if self._count == _CAPACITY:
            self._count //= 2
            self._lines[: self._count] = merged_pairs(self._lines)
        line = *raw.at(offset), wrap_angle(raw.yaw + bearing), variance, raw.time, raw.yaw
        self._lines[self._count] = line
        self._count += 1

    def meeting(self, raw: Pose, pose: Pose, biases: Array) -> Meeting | None:
        """In the frame of `pose`, the estimate of where the raw track has come to; None while lines are parallel."""
        lines, variances = self._lines[: self._count], self._lines[: self._count, 3]
        turned = pose.yaw - raw.yaw + biases[0] * (raw.time - lines[:, 4])
        origins, moved = self._origins(raw, pose, biases, turned)
        bearings = lines[:, 2] + turned
        fix = intersect(origins, bearings, variances)
        if fix is None:
            return None
        offset = fix.mean - origins
        H = np.stack([-offset[:, 1], offset[:, 0]], axis=1) / np.square(offset).sum(axis=1)[:, None]
        error = wrap_angles(bearings - np.arctan2(offset[:, 1], offset[:, 0]))
        residuals_by_bias = np.einsum("ij,ijk->ik", H, moved)
        residuals_by_bias[:, 0] += raw.time - lines[:, 4]
        return Meeting(fix, fix.cov @ (H.T / variances) @ residuals_by_bias, float(np.square(error) @ (1 / variances)))

    def _origins(self, raw: Pose, pose: Pose, biases: Array, turned: Array) -> tuple[Array, Array]:
        """Where the lines were heard (n, 2), and how that moves with errors of the biases (n, 2, 3).

        A gyro bias estimated too high by e leaves a step of age a turned by e a against the last; one of the log makes
        each step too short.
        """
        lines = self._lines[: self._count]
        x_y_yaw_time = np.vstack([lines[:, [0, 1, 5, 4]], (raw.x, raw.y, raw.yaw, raw.time)])
        step = np.diff(x_y_yaw_time, axis=0)
        middle = (x_y_yaw_time[1:] + x_y_yaw_time[:-1]) / 2
        age, turn = raw.time - middle[:, 3], (turned + np.append(turned[1:], pose.yaw - raw.yaw)) / 2
        forward = _rotations(middle[:, 2] + turn) * step[:, 3, None, None]  # distance per speed
        steps = np.einsum("ijk,ik->ij", _rotations(turn), step[:, :2]) - forward @ biases[1:]
        by_gyro = np.stack([steps[:, 1], -steps[:, 0]], axis=1) * age[:, None]
        moved = np.concatenate([by_gyro[:, :, None], forward], axis=2)
        return (pose.x, pose.y) - _sum_to_end(steps), _sum_to_end(moved)


class Pinger:
    """One pinger.

    Its lines wait outside the state until they meet at a range known to 7 % of itself, all of them linearised at
    that point, and until one side of the array is decisively likelier. A single start at some range, or one with a
    large variance (Choi et al. 2016, 3.2), is linearised where the pinger is not and makes the filter overconfident.
    """

    def __init__(self, joint: Joint) -> None:
        self._joint = joint
        self._sides: list[Lines] = []
        self._slot: Slot | None = None
        self.both_sides = False
        self.used = self.unused = self.restarts = 0
        self.nis = 0.0
        self._in_a_row = 0  # bearings beyond the gate

    @property
    def fix(self) -> Fix | None:
        """The position; None until it is known."""
        return None if self._slot is None else self._joint.position(self._slot)

    def update(self, config: SlamConfig, raw: Pose, bearing: float, std: float, share: float, offset: Array) -> None:
        """Takes a bearing of an array at `offset` (2,); with correlated errors it counts with its share."""
        images = [bearing, mirror_bearing(bearing, config.array_yaw)][: 1 + config.mirror]
        if self._slot is not None:
            self._correct(self._slot, config, images, std, share, offset)
            return
        self._sides = self._sides or [Lines() for _ in images]
        for lines, image in zip(self._sides, images, strict=True):
            lines.add(raw, offset, image, std**2 / share)
        self.used += 1
        if self.used % _EVERY == 0:
            self._try_to_start(config, raw)

    def _correct(
        self, slot: Slot, config: SlamConfig, images: list[float], std: float, share: float, offset: Array
    ) -> None:
        prediction = self._joint.bearing(slot, offset)
        error = min((wrap_angle(image - prediction.value) for image in images), key=abs)
        variance = std**2 / share
        self.nis = error * error / (prediction.variance + std**2)
        if self.nis > config.gate_sigma**2:
            self._reject(config)
            return
        self.used, self._in_a_row = self.used + 1, 0
        if config.bearing_noise == "student_t":  # the expected precision of this error (Lange et al. 1989)
            variance *= (_FREEDOM + error * error / (prediction.variance + variance)) / (_FREEDOM + 1)
        self._joint.correct(prediction, error, variance)

    def _reject(self, config: SlamConfig) -> None:
        self.unused, self._in_a_row = self.unused + 1, self._in_a_row + 1
        if self._in_a_row >= config.reset_after and self._slot is not None:
            self._joint.remove(self._slot)
            self._slot, self._sides, self._in_a_row = None, [], 0
            self.restarts += 1

    def _try_to_start(self, config: SlamConfig, raw: Pose) -> None:
        mean = self._joint.mean
        pose = Pose(float(mean[0]), float(mean[1]), float(mean[YAW]), raw.time)
        found = [m for side in self._sides if (m := side.meeting(raw, pose, mean[BIASES])) is not None]
        self.both_sides = len(self._sides) == 2 and not _decided(found, config.mirror_probability)
        if not found or self.both_sides:
            return
        best = min(found, key=lambda m: m.cost)
        dx, dy = best.fix.mean - (pose.x, pose.y)
        distance = math.hypot(dx, dy)
        bias_cov = self._joint.cov[np.ix_(BIASES, BIASES)]
        spread = np.trace(best.fix.cov + best.by_bias @ bias_cov @ best.by_bias.T)
        if config.range_min <= distance <= config.range_max and spread < (_KNOWN * distance) ** 2:
            J = np.zeros((2, SIZE))
            J[0, 0] = J[1, 1] = 1.0
            J[:, YAW], J[:, BIASES] = (-dy, dx), best.by_bias
            self._slot, self._sides = self._joint.add(best.fix, J), []


def _decided(found: list[Meeting], least: float) -> bool:
    """Whether the lines of both sides meet, and one side's far better than the other's."""
    return len(found) == 2 and abs(found[0].cost - found[1].cost) > 2 * math.log(1 / least - 1)


def _rotations(angles: Array) -> Array:
    """(n, 2, 2)."""
    c, s = np.cos(angles), np.sin(angles)
    return np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)


def _sum_to_end(steps: Array) -> Array:
    """Row i is the sum of rows i, i + 1, ..."""
    return np.asarray(np.cumsum(steps[::-1], axis=0)[::-1])


BIASES = [GYRO_BIAS.stop - 1, LOG_BIAS.start, LOG_BIAS.start + 1]  # those that bend and stretch a level track
_CAPACITY = 400  # lines
_EVERY = 5  # bearings
_KNOWN = 0.07
_FREEDOM = 4.0
