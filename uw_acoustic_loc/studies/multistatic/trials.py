"""Trials of the multistatic study: nets on a regular polygon, targets on a grid, every method on the same noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...core.multistatic.bound import cramer_rao, position_error
from ...core.multistatic.estimator import METHODS, Noise, SonarNet, locate
from ...core.types import Array

BIASED = "ml_range_bearing, bias left in"
PRINTED = "ml_range_bearing, sqrt(N - 1) sigma removed"  # the paper's eq. 9 to 11, as far as they are legible
REACH, SPACING = 5000.0, 144.0  # m, of the grid of targets (the paper's table 1)
RANGE_STDS, BEARING_STDS = (20.0, 40.0, 60.0), (0.01, 0.02, 0.03)  # m, rad
DISTANCES = (1000.0, 2000.0, 3000.0, 4000.0, 5000.0, 6000.0)  # m, transmitter to receivers
COUNTS = (3, 5, 7, 9, 11, 13, 15)  # receivers


@dataclass(frozen=True)
class Setting:
    """A net and its noise."""

    receivers: int = 3
    distance: float = 2000.0  # m
    range_std: float = 40.0  # m
    bearing_std: float = 0.02  # rad

    @property
    def net(self) -> SonarNet:
        """Transmitter in the middle, the first receiver due east."""
        angle = 2 * np.pi * np.arange(self.receivers) / self.receivers
        return SonarNet(np.zeros(2), self.distance * np.stack([np.cos(angle), np.sin(angle)], axis=1))

    @property
    def noise(self) -> Noise:
        return Noise(np.full(self.receivers, self.range_std), np.full(self.receivers, self.bearing_std))


NOISES = tuple(Setting(range_std=r, bearing_std=b) for r in RANGE_STDS for b in BEARING_STDS)
BY_COUNT = tuple(Setting(receivers=count) for count in COUNTS)
PLACEMENTS = tuple(Setting(receivers=count, distance=distance) for count in COUNTS for distance in DISTANCES)
BY_DISTANCE = tuple(Setting(distance=distance) for distance in DISTANCES)


def grid() -> Array:
    """(70 x 70, 2) targets in m, row by row from the south-west."""
    return square(grid_axis())


def grid_axis() -> Array:
    """(70,) m."""
    count = round(2 * REACH / SPACING) + 1
    return np.asarray(SPACING * (np.arange(count) - (count - 1) / 2), dtype=np.float64)


def square(axis: Array) -> Array:
    """(n x n, 2) points whose coordinates are both in `axis` (n,)."""
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class MethodErrors:
    """What every method makes of the same measurements."""

    bound: Array  # (T,) m, Cramer-Rao
    rmse: Mapping[str, Array]  # (T,) m by method
    median: Mapping[str, float]  # m, of all errors

    @cached_property
    def mean(self) -> dict[str, float]:
        """RMSE over the targets' mean, in m."""
        return {name: float(rmse.mean()) for name, rmse in self.rmse.items()}

    @cached_property
    def worst(self) -> float:
        """Largest RMSE of ml_range_bearing over its bound, of all targets."""
        return float(np.max(self.rmse["ml_range_bearing"] / self.bound))


def errors(
    setting: Setting, targets: Array, trials: int, seed: int, methods: tuple[str, ...] = METHODS
) -> MethodErrors:
    """RMSE at targets (T, 2) over `trials`, which are drawn for `setting` and `seed` alone."""
    net, noise = setting.net, setting.noise
    key = [
        seed,
        setting.receivers,
        *(round(1e3 * x) for x in (setting.distance, setting.range_std, setting.bearing_std)),
    ]
    drawn = noise.draw(np.random.default_rng(key), (len(targets), trials))
    ranges, bearings = (m[..., None] + e for m, e in zip(net.measure(targets), drawn, strict=True))
    found = {name: _distances(net, ranges, bearings, noise, name, targets) for name in methods}
    rmse = {name: np.sqrt(np.square(error).mean(axis=1)) for name, error in found.items()}
    median = {name: float(np.median(error)) for name, error in found.items()}
    return MethodErrors(position_error(cramer_rao(net, targets, noise)), rmse, median)


def _distances(net: SonarNet, ranges: Array, bearings: Array, noise: Noise, method: str, targets: Array) -> Array:
    """(T, trials) errors in m."""
    if method in (BIASED, PRINTED):
        removed = math.sqrt(len(net.receivers) - 1) * noise.range_std[0] if method == PRINTED else 0.0
        ranges, noise, method = ranges - removed, replace(noise, rayleigh=False), "ml_range_bearing"
    off = locate(net, ranges, bearings, noise, method).positions - targets[:, None]
    distances: Array = np.hypot(off[..., 0], off[..., 1])
    return distances
