"""The exact posterior of a still source from bearings, on a grid: what the filters are measured against."""

from __future__ import annotations

import math

import numpy as np

from ...core.geometry import wrap_angles
from ...core.localizer.bearing_noise import log_likelihood
from ...core.localizer.particles import least_relative_error
from ...core.localizer.triangulation import PlanarFix, Ray
from ...core.types import Array


class BearingGrid:
    """A source that is a priori uniform in area between two ranges from where the first bearing was heard.

    p(s | b_1 .. b_n) ~ prod_k p(b_k | s), on cells in bearing and range from that point. When the cells that count have
    become few, they are divided and all bearings taken again, so the grid stays finer than the posterior. A source
    with known motion is a still one in the frame that moves with it.
    """

    def __init__(self, ray: Ray, range_min: float, range_max: float, *, noise: str, cells: int = 128) -> None:
        if not 0 <= range_min < range_max:
            raise ValueError(f"range_min must be below range_max and not below 0, got {range_min:g} and {range_max:g}")
        self._noise, self._cells, self._origin = noise, cells, (ray.x, ray.y)
        self._rays: list[Ray] = []
        self._lay(ray.bearing - math.pi, ray.bearing + math.pi, range_min, range_max)
        self.update(ray)

    def update(self, ray: Ray) -> None:
        """Multiplies by the likelihood of a bearing."""
        self._rays.append(ray)
        self._log_weight += self._log_likelihood(ray)
        while self._divide():
            pass

    def estimate(self) -> PlanarFix:
        """The posterior's point of least relative error, seen from the first point, and the mean square about it."""
        weight = np.exp(self._log_weight - self._log_weight.max())
        points = np.stack([self._x.ravel(), self._y.ravel()])
        origin = np.array(self._origin)[:, None]
        return least_relative_error(points, weight.ravel() / weight.sum(), origin)

    def _lay(self, left: float, right: float, near: float, far: float) -> None:
        share = (np.arange(self._cells) + 0.5) / self._cells
        self._box = left, right, near, far
        angles, ranges = left + share * (right - left), near + share[:, None] * (far - near)
        self._x = self._origin[0] + ranges * np.cos(angles)
        self._y = self._origin[1] + ranges * np.sin(angles)
        self._log_weight: Array = np.broadcast_to(np.log(ranges), self._x.shape).copy()  # area of a cell
        for ray in self._rays:
            self._log_weight += self._log_likelihood(ray)

    def _divide(self) -> bool:
        """Lays the grid over the living cells and their neighbours, if these fill less than half of it.

        At least two rows of cells live: the heaviest of all may lie beside a posterior that is finer than they are.
        """
        best = np.partition(self._log_weight, -2 * self._cells, axis=None)[-2 * self._cells]
        alive = self._log_weight >= min(self._log_weight.max() + _NEGLIGIBLE, best)
        edges = []
        for axis in (0, 1):
            index = np.flatnonzero(alive.any(axis=axis))
            edges += [max(index[0] - 1, 0) / self._cells, min(index[-1] + 2, self._cells) / self._cells]
        if (edges[1] - edges[0]) * (edges[3] - edges[2]) > _FULL:
            return False
        left, right, near, far = self._box
        width, depth = right - left, far - near
        self._lay(left + edges[0] * width, left + edges[1] * width, near + edges[2] * depth, near + edges[3] * depth)
        return True

    def _log_likelihood(self, ray: Ray) -> Array:
        error = wrap_angles(ray.bearing - np.arctan2(self._y - ray.y, self._x - ray.x))
        return np.asarray(ray.weight * log_likelihood(self._noise, error, ray.std, softness=_HARD))


_NEGLIGIBLE = -16.0  # log of a cell's weight over the heaviest one's
_FULL = 0.5
_HARD = 1e-6  # bounded errors have edges
