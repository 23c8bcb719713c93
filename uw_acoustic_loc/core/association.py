"""Which detections of one ping show the same target."""

from __future__ import annotations

from collections.abc import Set as AbstractSet

import numpy as np

from .multistatic_model import Likelihood
from .multistatic_start import single_fixes, single_information
from .track import chi_square_limit
from .types import AnyArray, Array


class Grouping:
    """Groups of detections, at most one per receiver.

    A detection gives a position by itself (range sum and bearing). From there it gathers, receiver by receiver, the
    likeliest detection inside the gate, and moves by a linear update with each.
    """

    def __init__(self, single: Likelihood, receiver: AnyArray, gate: float) -> None:
        """`single` has a row per detection and one column; `receiver` (D,) tells which rows exclude each other."""
        self._single, self._receiver = single, receiver
        self._limit = chi_square_limit(gate, 2)
        self._positions, self._information = _own_fixes(single)
        self._R = _noise_cov(single)

    def groups(self, free: AbstractSet[int]) -> set[tuple[int, ...]]:
        """What each of the `free` rows gathers among them, rows in ascending order."""
        return {self._gather(seed, free) for seed in free}

    def _gather(self, seed: int, free: AbstractSet[int]) -> tuple[int, ...]:
        group = [seed]
        position, information = self._positions[seed], self._information[seed]
        while others := [r for r in sorted(free) if self._receiver[r] not in self._receiver[group]]:
            residuals, G = residuals_at(self._single, position)
            residuals, G, R = residuals[others], G[others], self._R[others]
            S = G @ np.linalg.solve(information, G.transpose(0, 2, 1)) + R
            nis = (residuals * np.linalg.solve(S, residuals[..., None])[..., 0]).sum(axis=1)
            inside = nis <= self._limit
            if not inside.any():
                break
            k = int(np.argmin(np.where(inside, nis + np.linalg.slogdet(S)[1], np.inf)))
            weighted = np.linalg.solve(R[k], G[k]).T
            information = information + weighted @ G[k]
            position = position + np.linalg.solve(information, weighted @ residuals[k])
            group.append(others[k])
        return tuple(sorted(group))


def residuals_at(single: Likelihood, position: Array) -> tuple[Array, Array]:
    """Residuals (D, 2) of range sum and bearing at a position (2,), and their Jacobian (D, 2, 2) by the position."""
    legs = single.legs(*position[:, None])
    turn = single.turn(*legs[:2])[:, 0]
    dx, dy, distance, ex, ey, total = (np.squeeze(leg, -1) for leg in legs)
    ux, uy = dx / distance, dy / distance
    by_range = np.stack([ux + ex, uy + ey], axis=1)
    by_bearing = np.stack([-uy, ux], axis=1) / distance[:, None]
    return np.stack([single.ranges[:, 0] - total, turn], axis=1), np.stack([by_range, by_bearing], axis=1)


def _own_fixes(single: Likelihood) -> tuple[Array, Array]:
    """Positions (D, 2) and information (D, 2, 2); the range sum bounds what a fix upon the baseline leaves open."""
    x, y = single_fixes(single)
    xx, xy, yy = (term[:, 0] for term in single_information(single, x, y))
    information = np.stack([np.stack([xx, xy], axis=1), np.stack([xy, yy], axis=1)], axis=1)
    bound = np.maximum(single.ranges[:, 0], 1.0) ** -2.0
    return np.hstack([x, y]), information + bound[:, None, None] * np.eye(2)


def _noise_cov(single: Likelihood) -> Array:
    """(D, 2, 2) of range sum and bearing."""
    variances = np.hstack([1 / single.range_weight, 1 / single.bearing_weight])
    cov: Array = variances[:, :, None] * np.eye(2)
    return cov
