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
    likeliest detection inside the gate, and moves by a linear update with each. All detections do so at once.
    """

    def __init__(self, single: Likelihood, receiver: AnyArray, gate: float) -> None:
        """`single` has a row per detection and one column; rows of one `receiver` (D,) exclude each other."""
        self._receiver = receiver
        self._limit = chi_square_limit(gate, 2)
        self._view = View(single, receiver)
        self._positions, self._information = _own_fixes(single)
        self._found: dict[int, tuple[int, ...]] = {}

    def groups(self, free: AbstractSet[int]) -> set[tuple[int, ...]]:
        """What each of the `free` rows gathers among them, rows in ascending order.

        A group is the same as long as all its rows are free: it would choose them again.
        """
        if stale := [row for row in sorted(free) if row not in self._found or not free >= set(self._found[row])]:
            self._found.update(zip(stale, self._gather(np.array(stale), free), strict=True))
        return {self._found[row] for row in free}

    def _gather(self, seeds: AnyArray, free: AbstractSet[int]) -> list[tuple[int, ...]]:
        position, information = self._positions[seeds], self._information[seeds]
        allowed = self._receiver[seeds][:, None] != self._receiver
        allowed &= np.isin(np.arange(len(self._receiver)), list(free))
        groups, open_ = [[seed] for seed in seeds.tolist()], np.arange(len(seeds))
        while open_.size:
            nis, spread = self._view.fit(position[open_], np.asarray(np.linalg.inv(information[open_]), float))
            inside = (nis <= self._limit) & allowed[open_]
            some = inside.any(axis=1)
            open_ = open_[some]
            rows = np.argmin(np.where(inside[some], nis[some] + spread[some], np.inf), axis=1)
            residuals, weighted, gained = self._view.information(position[open_], rows)
            information[open_] += gained
            step = np.linalg.solve(information[open_], weighted @ residuals[..., None])[..., 0]
            position[open_] += step
            allowed[open_] &= self._receiver[rows][:, None] != self._receiver
            for seed, row in zip(open_.tolist(), rows.tolist(), strict=True):
                groups[seed].append(row)
        return [tuple(sorted(group)) for group in groups]


class View:
    """Detections as seen from many positions at once; what hangs on the receiver alone is worked out once for each."""

    def __init__(self, single: Likelihood, receiver: AnyArray) -> None:
        """`single` has a row per detection and one column; `receiver` (D,) says whose."""
        self._single = single
        _, first, self._whose = np.unique(receiver, return_index=True, return_inverse=True)
        self._nodes = single.receivers[first]
        self._variances = np.hstack([1 / single.range_weight, 1 / single.bearing_weight])

    def fit(self, positions: Array, covs: Array) -> tuple[Array, Array]:
        """At positions (S, 2), covs (S, 2, 2): normalised squared innovations (S, D), log det of their covariances."""
        dx, dy = (positions[:, k, None] - self._nodes[:, k] for k in (0, 1))
        ex, ey = (positions - self._single.transmitter).T[:, :, None]
        distance, outward = np.hypot(dx, dy) + _TINY, np.hypot(ex, ey) + _TINY
        ux, uy = dx / distance, dy / distance
        gx, gy = ux + ex / outward, uy + ey / outward
        xx, xy, yy = (covs[:, i, j, None] for i, j in ((0, 0), (0, 1), (1, 1)))
        ranged = gx * gx * xx + 2 * gx * gy * xy + gy * gy * yy  # variances and covariance by the position's
        both = -gx * uy * xx + (gx * ux - gy * uy) * xy + gy * ux * yy  # the bearing's for a lever of 1 m
        turned = uy * uy * xx - 2 * ux * uy * xy + ux * ux * yy
        whose = self._whose
        late = self._single.ranges[:, 0] - (distance + outward)[:, whose]
        turn = _wrapped(self._single.bearings[:, 0] - np.arctan2(dy, dx)[:, whose])
        lever = 1 / np.maximum(distance[:, whose], np.sqrt(self._variances[:, 0]))
        first, cross = ranged[:, whose] + self._variances[:, 0], both[:, whose] * lever
        second = turned[:, whose] * lever * lever + self._variances[:, 1]
        determinant = first * second - cross * cross
        nis = (second * late * late - 2 * cross * late * turn + first * turn * turn) / determinant
        return nis, np.log(determinant)

    def information(self, positions: Array, rows: AnyArray) -> tuple[Array, Array, Array]:
        """Residuals (S, 2), G^T R^-1 and G^T R^-1 G (S, 2, 2) of a detection `rows` (S,) for each position (S, 2)."""
        single = self._single
        (dx, dy), (ex, ey) = (positions - single.receivers[rows]).T, (positions - single.transmitter).T
        distance, outward = np.hypot(dx, dy) + _TINY, np.hypot(ex, ey) + _TINY
        ux, uy = dx / distance, dy / distance
        lever = np.maximum(distance, np.sqrt(self._variances[rows, 0]))
        G = np.array([[ux + ex / outward, uy + ey / outward], [-uy / lever, ux / lever]]).transpose(2, 0, 1)
        turn = _wrapped(single.bearings[rows, 0] - np.arctan2(dy, dx))
        residuals = np.stack([single.ranges[rows, 0] - distance - outward, turn], axis=1)
        weighted = (G / self._variances[rows][:, :, None]).transpose(0, 2, 1)
        return residuals, weighted, weighted @ G


def _wrapped(turn: Array) -> Array:
    turn -= (2 * np.pi) * np.rint(turn / (2 * np.pi))
    return turn


_TINY = 1e-6  # m


class Claims:
    """What tracks take of a ping's detections.

    Each receiver's detections go to the tracks by global nearest neighbour; a track's detections of all receivers are
    one sighting.
    """

    def __init__(self, single: Likelihood, receiver: AnyArray, gate: float, sound_speed: float) -> None:
        """`single` has a row per detection and one column; `receiver` (D,) says whose."""
        self._single, self._receiver = single, receiver
        self._limit, self._sound_speed = chi_square_limit(gate, 2), sound_speed
        self._view = View(single, receiver)
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
        ahead = [track.ahead(self._delay(track)) for track in tracks]
        positions = np.array([position for position, _ in ahead]).reshape(-1, 2)
        return self._view.fit(positions, np.array([cov for _, cov in ahead]).reshape(-1, 2, 2))

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
