"""A pinger in EKF-SLAM: bearing lines until they meet, a landmark from then on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..geometry import mirror_bearing, wrap_angle
from ..localizer.hypothesis import image_error
from ..localizer.triangulation import PlanarFix, fits, meet, merged_pairs, nearest, residuals
from ..types import Array
from .config import SlamConfig
from .inertial import LOG_BIAS, SIZE, YAW, YAW_BIAS
from .joint import Joint, Slot


class Pose(NamedTuple):
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


class Estimate(NamedTuple):
    """A scalar and its variance."""

    value: float
    variance: float


@dataclass(frozen=True, eq=False)
class Meeting:
    """Where lines meet, how that moves with errors of the BIASES (2, 3), and how well they meet.

    `cost` is what is left of the sum of squared residuals when the biases may err as they do, and `biases` (3,) and
    `bias_cov` (3, 3) what they then are; `fits` and `sharp` say that the lines agree, and meet, without that.
    """

    fix: PlanarFix
    by_bias: Array
    cost: float
    biases: Array
    bias_cov: Array
    fits: bool
    sharp: bool


class _Columns(NamedTuple):
    """Columns (n,) of the lines held, in an order that `merged_pairs` asks for."""

    x: Array  # m, where it was heard
    y: Array
    bearing: Array  # rad, in the frame of the raw track
    variance: Array  # rad^2
    time: Array  # s
    yaw: Array  # rad, of the vehicle


class Lines:
    """Bearing lines of one side, drawn from raw dead reckoning.

    The raw track has the true biases of gyro and log in it. When the lines are intersected these are taken out as they
    are then estimated, so that what is left is an error of that estimate, with a known correlation.
    """

    def __init__(self) -> None:
        self._rows = np.empty((_CAPACITY, len(_Columns._fields)))
        self._count = 0

    @property
    def _held(self) -> _Columns:
        return _Columns(*self._rows[: self._count].T)

    def add(self, raw: Pose, offset: Array, bearing: float, variance: float) -> None:
        """Takes a bearing in the vehicle's frame, and forgets what is older than the biases can be trusted."""
        old = int(np.searchsorted(self._held.time, raw.time - _MEMORY))
        self._rows[: self._count - old] = self._rows[old : self._count].copy()
        self._count -= old
        if self._count == _CAPACITY:
            self._count //= 2
            self._rows[: self._count] = merged_pairs(self._rows)
        x, y = raw.at(offset)
        self._rows[self._count] = x, y, wrap_angle(raw.yaw + bearing), variance, raw.time, raw.yaw
        self._count += 1

    @property
    def turn(self) -> float:
        """How far the vehicle has turned to and fro while the lines were heard."""
        return float(np.ptp(self._held.yaw))

    def meeting(self, raw: Pose, pose: Pose, biases: Array, prior: Array, prior_cov: Array) -> Meeting | None:
        """In the frame of `pose`, the estimate of where the raw track has come to; drawn with `biases`.

        None while that is not determined at all.
        """
        lines, variances = self._held, self._held.variance
        turned = pose.yaw - raw.yaw + biases[0] * (raw.time - lines.time)
        origins, moved = self._origins(raw, pose, biases, turned)
        bearings = lines.bearing + turned
        fix = nearest(origins, bearings, variances)
        if fix is None:
            return None
        offset = fix.mean - origins
        H = np.stack([-offset[:, 1], offset[:, 0]], axis=1) / np.square(offset).sum(axis=1)[:, None]
        A = np.einsum("ij,ijk->ik", H, moved)  # of the residuals, with respect to the biases
        A[:, 0] += raw.time - lines.time
        by_bias = fix.cov @ (H.T / variances) @ A
        error, free = residuals(fix.mean, origins, bearings), A - H @ by_bias  # the point being free
        fitting = fits(float(error @ (error / variances)), self._count)
        error = error - free @ (biases - prior)
        pull, information = A.T @ (error / variances), free.T / variances @ A
        cov = np.linalg.solve(np.eye(3) + prior_cov @ information, prior_cov)
        cost = float(error @ (error / variances) - pull @ cov @ pull)
        sharp = fitting and meet(fix, origins, bearings)
        return Meeting(fix, by_bias, cost, prior - cov @ pull, cov, fitting, sharp)

    def _origins(self, raw: Pose, pose: Pose, biases: Array, turned: Array) -> tuple[Array, Array]:
        """Where the lines were heard (n, 2), and how that moves with errors of the biases (n, 2, 3).

        A gyro bias estimated too high by e leaves a step of age a turned by e a against the last; one of the log makes
        each step too short.
        """
        lines = self._held
        x_y = np.vstack([np.stack([lines.x, lines.y], axis=1), (raw.x, raw.y)])
        yaw, time = np.append(lines.yaw, raw.yaw), np.append(lines.time, raw.time)
        age, turn = raw.time - (time[1:] + time[:-1]) / 2, (turned + np.append(turned[1:], pose.yaw - raw.yaw)) / 2
        forward = _rotations((yaw[1:] + yaw[:-1]) / 2 + turn) * np.diff(time)[:, None, None]  # distance per speed
        steps = np.einsum("ijk,ik->ij", _rotations(turn), np.diff(x_y, axis=0)) - forward @ biases[1:]
        by_gyro = np.stack([steps[:, 1], -steps[:, 0]], axis=1) * age[:, None]
        moved = np.concatenate([by_gyro[:, :, None], forward], axis=2)
        return (pose.x, pose.y) - _sum_to_end(steps), _sum_to_end(moved)


class Landmark:
    """One pinger of the map.

    Its lines wait outside the state until they meet at a range known to 7 % of itself, all of them linearised at
    that point, and until one side of the array is decisively likelier. A single start at some range, or one with a
    large variance (Choi et al. 2016, 3.2), is linearised where the pinger is not and makes the filter overconfident.
    """

    def __init__(self, joint: Joint) -> None:
        self._joint = joint
        self._sides: list[Lines] = []
        self.slot: Slot | None = None  # in the joint state; None until the position is known
        self.both_sides = False
        self.lines_bias: Estimate | None = None  # the yaw gyro's, at which lines meet that do not at the filter's
        self.used = self.unused = self.restarts = 0
        self.nis = 0.0
        self.unused_in_a_row = 0  # bearings beyond the gate

    @property
    def fix(self) -> PlanarFix | None:
        """The position; None until it is known."""
        return None if self.slot is None else self._joint.position(self.slot)

    def update(self, config: SlamConfig, raw: Pose, bearing: float, std: float, share: float, offset: Array) -> None:
        """Takes a bearing of an array at `offset` (2,); with correlated errors it counts with its share."""
        images = images_of(bearing, config)
        if self.slot is not None:
            self._correct(self.slot, config, images, std, share, offset)
            return
        self._sides = self._sides or [Lines() for _ in images]
        for lines, image in zip(self._sides, images, strict=True):
            lines.add(raw, offset, image, std**2 / share)
        self.used += 1
        if self.used % _EVERY == 0:
            self._try_to_start(config, raw)

    def drop_lines(self) -> None:
        """Begins anew with a pinger whose position is not known yet."""
        self._sides = []

    def _correct(
        self, slot: Slot, config: SlamConfig, images: list[float], std: float, share: float, offset: Array
    ) -> None:
        prediction = self._joint.bearing(slot, offset)
        errors = [wrap_angle(image - prediction.value) for image in images]
        error, spread = image_error(errors, std)
        variance = (std**2 + spread) / share
        self.nis = error * error / (prediction.variance + std**2 + spread)
        if self.nis > config.gate_sigma**2:
            self._reject(config)
            return
        self.used, self.unused_in_a_row = self.used + 1, 0
        if config.bearing_noise == "student_t":  # the expected precision of this error (Lange et al. 1989)
            variance *= (_FREEDOM + error * error / (prediction.variance + variance)) / (_FREEDOM + 1)
        self._joint.correct(prediction, error, variance)

    def _reject(self, config: SlamConfig) -> None:
        self.unused, self.unused_in_a_row = self.unused + 1, self.unused_in_a_row + 1
        if self.unused_in_a_row >= config.reset_after and self.slot is not None:
            self._joint.remove(self.slot)
            self.slot, self._sides, self.unused_in_a_row = None, [], 0
            self.restarts += 1

    def _try_to_start(self, config: SlamConfig, raw: Pose) -> None:
        mean, self.lines_bias = self._joint.mean, None
        self.both_sides = len(self._sides) == 2
        if self.both_sides and self._sides[0].turn < _TURN:
            return
        pose = Pose(float(mean[0]), float(mean[1]), float(mean[YAW]), raw.time)
        biases, bias_cov = mean[BIASES], self._joint.cov[np.ix_(BIASES, BIASES)]
        found = [side.meeting(raw, pose, biases, biases, bias_cov) for side in self._sides]
        best = _decided([m for m in found if m is not None], len(found), config.mirror_probability)
        self.both_sides = self.both_sides and best is None
        if best is not None and not best.fits:
            there = self._sides[found.index(best)].meeting(raw, pose, best.biases, biases, bias_cov)
            if there is not None and there.sharp:
                self.lines_bias = Estimate(there.biases.item(0), there.bias_cov.item(0, 0))
        if best is None or not best.sharp:
            return
        dx, dy = best.fix.mean - (pose.x, pose.y)
        distance = math.hypot(dx, dy)
        spread = np.trace(best.fix.cov + best.by_bias @ bias_cov @ best.by_bias.T)
        if config.range_min <= distance <= config.range_max and spread < (_KNOWN * distance) ** 2:
            J = np.zeros((2, SIZE))
            J[0, 0] = J[1, 1] = 1.0
            J[:, YAW], J[:, BIASES] = (-dy, dx), best.by_bias
            self.slot, self._sides = self._joint.add(best.fix, J), []


def images_of(bearing: float, config: SlamConfig) -> list[float]:
    """The bearing, and with `mirror` its image."""
    return [bearing, mirror_bearing(bearing, config.array_yaw)][: 1 + config.mirror]


def _decided(found: list[Meeting], sides: int, least: float) -> Meeting | None:
    """The only side, or the one of two that is far likelier."""
    if len(found) < sides:
        return None
    best = min(found, key=lambda m: m.cost)
    return best if sum(m.cost - best.cost for m in found) > 2 * math.log(1 / least - 1) or sides == 1 else None


def _rotations(angles: Array) -> Array:
    """(n, 2, 2)."""
    c, s = np.cos(angles), np.sin(angles)
    return np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)


def _sum_to_end(steps: Array) -> Array:
    """Row i is the sum of rows i, i + 1, ..."""
    return np.asarray(np.cumsum(steps[::-1], axis=0)[::-1])


BIASES = [YAW_BIAS, LOG_BIAS.start, LOG_BIAS.start + 1]  # those that bend and stretch a level track
_CAPACITY = 400  # lines
_MEMORY = 100.0  # s
_EVERY = 5  # bearings
_TURN = 0.7  # rad; on a straight track the mirror image fits as well, and what the gyro drifts looks like evidence
_KNOWN = 0.07
_FREEDOM = 4.0
