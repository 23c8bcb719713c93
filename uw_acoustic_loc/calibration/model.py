"""The TDOA that a pair of hydrophones should measure: geometry, and what the electronics add (docs/calibration.md)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..core.types import AnyArray, Array


class Pair(NamedTuple):
    """What is wrong with a pair, beside its polarity."""

    delay_offset: float  # s, of h0 after h1
    spacing_scale: float
    array_yaw: float  # rad


@dataclass(frozen=True, eq=False)
class Poses:
    """Where an array was at n pings."""

    positions: Array  # (n, 3) m of the array's middle
    rotations: Array  # (n, 3, 3) from base_link
    spacing: float  # m, nominal
    sound_speed: float  # m/s
    middle: Array  # (3,) m, of all positions of the run

    def at(self, some: AnyArray) -> Poses:
        """Those at some of the pings."""
        return replace(self, positions=self.positions[some], rotations=self.rotations[some])


def predicted(poses: Poses, pair: Pair, x: Array, y: Array, square: Array) -> Array:
    """(..., n) s for sources (...,) at x, y whose depth below the middle of the positions has this square (eq. 1, 2).

    A negative square is none of a place. It stands for an estimate below zero by noise, so that one near zero has
    symmetric errors as others have.
    """
    axis = poses.rotations @ np.array([np.cos(pair.array_yaw), np.sin(pair.array_yaw), 0.0])
    below = np.sqrt(np.maximum(square, 0.0))[..., None]
    height = poses.positions[:, 2] - poses.middle[2]
    dx, dy = x[..., None] - poses.positions[:, 0], y[..., None] - poses.positions[:, 1]
    along = axis[:, 0] * dx + axis[:, 1] * dy - axis[:, 2] * (below + height)
    far = dx**2 + dy**2 + square[..., None] + 2.0 * below * height + height**2
    far = np.maximum(far, along**2)
    d = pair.spacing_scale * poses.spacing
    arrival_0, arrival_1 = np.sqrt(far + d * along + d**2 / 4), np.sqrt(far - d * along + d**2 / 4)
    return np.asarray((arrival_0 - arrival_1) / poses.sound_speed + pair.delay_offset)


def jacobian(poses: Poses, pair: Pair, place: Array) -> Array:
    """(n, 6) derivatives of `predicted` by delay offset, spacing scale, yaw, and a source's x, y and square."""
    x, y, square = place
    cos, sin = np.cos(pair.array_yaw), np.sin(pair.array_yaw)
    axis, turned = poses.rotations @ np.array([cos, sin, 0.0]), poses.rotations @ np.array([-sin, cos, 0.0])
    below, height = np.sqrt(max(square, 0.0)), poses.positions[:, 2] - poses.middle[2]
    toward = np.stack([x - poses.positions[:, 0], y - poses.positions[:, 1], -(below + height)], axis=1)
    along, by_yaw = (axis * toward).sum(axis=1), (turned * toward).sum(axis=1)
    far = np.maximum(toward[:, 0] ** 2 + toward[:, 1] ** 2 + square + 2.0 * below * height + height**2, along**2)
    d, c = pair.spacing_scale * poses.spacing, poses.sound_speed
    half_0, half_1 = 0.5 / np.sqrt(far + d * along + d**2 / 4), 0.5 / np.sqrt(far - d * along + d**2 / 4)
    by_far, by_along = (half_0 - half_1) / c, d * (half_0 + half_1) / c
    by_scale = poses.spacing * (along * (half_0 + half_1) + d / 2 * (half_0 - half_1)) / c
    per_below = 0.5 / below if below > 0 else 0.0
    by_x, by_y = (2.0 * toward[:, k] * by_far + axis[:, k] * by_along for k in (0, 1))
    by_square = (1.0 + 2.0 * height * per_below) * by_far - axis[:, 2] * per_below * by_along
    return np.stack([np.ones_like(d * along), by_scale, by_yaw * by_along, by_x, by_y, by_square], axis=1)
