"""Bearing lines of a pinger that is not known yet, and where they meet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..geometry import wrap_angle
from ..localizer.triangulation import PlanarFix, fits, meet, merged_pairs, nearest, residuals
from ..types import Array
from .inertial import LOG_BIAS, YAW_BIAS


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
    `bias_cov` (3, 3) what they then are, from the lines' `information` (3, 3) and its `pull` (3,) at the prior; `fits`
    and `sharp` say that the lines agree, and meet, without that.
    """

    fix: PlanarFix
    by_bias: Array
    cost: float
    biases: Array
    bias_cov: Array
    information: Array
    pull: Array
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

    def add(self, raw: Pose, offset: Array, bearing: float, variance: float, memory: float = math.inf) -> None:
        """Takes a bearing in the vehicle's frame, and forgets what is older than `memory` in s."""
        old = int(np.searchsorted(self._held.time, raw.time - memory))
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

    @property
    def age(self) -> float:
        """Time in s from the first to the last line."""
        return float(np.ptp(self._held.time))

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
        pull = A.T @ (error / variances)
        information = free.T / variances @ free  # never negative, even before the point has converged
        cov = np.linalg.solve(np.eye(3) + prior_cov @ information, prior_cov)
        cost = float(error @ (error / variances) - pull @ cov @ pull)
        sharp = fitting and meet(fix, origins, bearings)
        return Meeting(fix, by_bias, cost, prior - cov @ pull, cov, information, pull, fitting, sharp)

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


def _rotations(angles: Array) -> Array:
    """(n, 2, 2)."""
    c, s = np.cos(angles), np.sin(angles)
    return np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)


def _sum_to_end(steps: Array) -> Array:
    """Row i is the sum of rows i, i + 1, ..."""
    return np.asarray(np.cumsum(steps[::-1], axis=0)[::-1])


BIASES = [YAW_BIAS, LOG_BIAS.start, LOG_BIAS.start + 1]  # those that bend and stretch a level track
_CAPACITY = 400  # lines
