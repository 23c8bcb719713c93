"""Which detections of one ping show the same target: those that fit a track, and those that fit each other."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet

import numpy as np

from ..types import AnyArray, Array
from .model import Likelihood
from .start import single_fixes, single_information
from .track import Sighting, Track, chi_square_limit


class Grouping:
    """Groups of detections, at most one per receiver.

    A detection gives a position by itself (range sum and bearing). From there it gathers, receiver by receiver, the
    likeliest detection inside the gate, and moves by a linear update with each.
    """

    def __init__(self, single: Likelihood, receiver: AnyArray, gate: float) -> None:
        """`single` has a row per detection and one column; rows of one `receiver` (D,) exclude each other."""
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


class Claims:
    """What tracks take of a ping's detections.

    Each receiver's detections go to the tracks by global nearest neighbour; a track's detections of all receivers are
    one sighting.
    """

    def __init__(self, single: Likelihood, receiver: AnyArray, gate: float, sound_speed: float) -> None:
        """`single` has a row per detection and one column; `receiver` (D,) says whose."""
        self._single, self._receiver = single, receiver
        self._limit, self._sound_speed = chi_square_limit(gate, 2), sound_speed
        self._R = _noise_cov(single)

    def rows(self, tracks: Sequence[Track], free: AbstractSet[int]) -> list[list[int]]:
        """For each track, its detections among the `free` rows, at most one per receiver."""
        claimed: list[list[int]] = [[] for _ in tracks]
        nis, spread = self._fit(tracks)
        for receiver in np.unique(self._receiver):
            own = [row for row in np.flatnonzero(self._receiver == receiver).tolist() if row in free]
            for i, j in assign(nis[:, own], spread[:, own], self._limit).items():
                claimed[i].append(own[j])
        return claimed

    def sighting(self, track: Track, rows: Sequence[int]) -> Sighting:
        """The rows' range sums and bearings as one position, linearised where they put the track."""
        delay = self._delay(track)
        updated, rows = track, list(rows)
        for _ in range(_LINEARISED):
            position = updated.ahead(delay)[0]
            residuals, G = residuals_at(self._single, position)
            weighted = np.linalg.solve(self._R[rows], G[rows]).transpose(0, 2, 1)
            bound = np.eye(2) * np.maximum(self._single.ranges[rows], 1.0).max() ** -2.0  # as of `_own_fixes`
            cov = np.linalg.inv((weighted @ G[rows]).sum(axis=0) + bound)
            step = cov @ (weighted @ residuals[rows, :, None]).sum(axis=0)[:, 0]
            sighting = Sighting(position + step, cov, delay)
            updated = track.update(sighting)
        return sighting

    def _fit(self, tracks: Sequence[Track]) -> tuple[Array, Array]:
        """(T, D) normalised squared innovations, and the logarithms of their covariances' determinants."""
        nis, spread = np.empty((2, len(tracks), len(self._receiver)))
        for i, track in enumerate(tracks):
            position, cov = track.ahead(self._delay(track))
            residuals, G = residuals_at(self._single, position)
            S = G @ cov @ G.transpose(0, 2, 1) + self._R
            nis[i] = (residuals * np.linalg.solve(S, residuals[..., None])[..., 0]).sum(axis=1)
            spread[i] = np.linalg.slogdet(S)[1]
        return nis, spread

    def _delay(self, track: Track) -> float:
        """From the ping's stamp until it meets the track."""
        return float(np.hypot(*(track.mean[:2] - self._single.transmitter))) / self._sound_speed


_LINEARISED = 2  # times: at the prediction and at the update


def assign(nis: Array, spread: Array, limit: float) -> dict[int, int]:
    """Global nearest neighbour: row of each assigned track -> column of its detection, nis and spread being (T, D).

    Of all ways to assign pairs inside the gate, the likeliest; a pair left out counts as the least likely inside.
    """
    if not nis.size:
        return {}
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415  scipy.optimize is slow to import

    gain = np.where(nis <= limit, limit - nis + spread.max() - spread, 0.0)
    rows, columns = linear_sum_assignment(gain, maximize=True)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if nis[i, j] <= limit}


def residuals_at(single: Likelihood, position: Array) -> tuple[Array, Array]:
    """Residuals (D, 2) of range sum and bearing at a position (2,), and their Jacobian (D, 2, 2) by the position.

    A bearing's lever is range_std at least, see `Likelihood.cov`.
    """
    legs = single.legs(*position[:, None])
    distance = legs.distance[:, 0]
    ux, uy = legs.dx[:, 0] / distance, legs.dy[:, 0] / distance
    by_range = np.stack([ux + legs.ex, uy + legs.ey], axis=1)
    lever = np.maximum(distance, single.range_weight[:, 0] ** -0.5)
    by_bearing = np.stack([-uy, ux], axis=1) / lever[:, None]
    residuals = np.hstack([single.ranges - legs.total, single.turn(legs.dx, legs.dy)])
    return residuals, np.stack([by_range, by_bearing], axis=1)


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
