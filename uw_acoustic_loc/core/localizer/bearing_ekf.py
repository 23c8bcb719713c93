"""Bearing-only EKF of a still source (Shin et al. 2013, eq. 3-12) in log-polar coordinates, a bank over the range."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ..geometry import wrap_angle
from ..types import Array
from .bearing_noise import believed, log_any_direction
from .log_polar import LogPolar, Mixture, bearing_moments, cartesian, corrected, seen_from, times_too_near
from .triangulation import Drift, PlanarFix, Ray


class Member(NamedTuple):
    """One EKF of the bank, and the point that its source is seen from."""

    state: LogPolar
    log_weight: float
    origin: complex


class BearingEkf:
    """A Gaussian mixture, each member an EKF, weighted by its likelihood.

    With known motion the state is the relative position of eq. 3-12 in the coordinates of Aidala and Hammel (1983): a
    bearing is linear in them, a drift of the heading adds to the bearing alone, and what is known of the range is not
    mistaken for what is known of the bearing, as x and y do after many noisy steps. `process_noise` (m per sqrt(s)) is
    how fast the position may wander in the frame. Each member believes as much of a bearing as fits its own prediction
    (`believed`): an impulse that fits the bank as a whole may be far from the member at the right range. A member that
    the vehicle comes too near to (`times_too_near`) is seen from farther away and waits: to it, a bearing may come from
    anywhere. The members are few, so plain numbers are faster than arrays.
    """

    def __init__(
        self, origin: Array, means: Array, covs: Array, process_noise: float = 0.0, noise: str = "gaussian"
    ) -> None:
        """Members `means` (K, 2) and `covs` (K, 2, 2) of log range and bearing, seen from `origin`; of equal weight."""
        if means.ndim != 2 or means.shape[1] != 2 or covs.shape != (len(means), 2, 2):
            raise ValueError(f"means must be (K, 2) and covs (K, 2, 2), got {means.shape} and {covs.shape}")
        self._origin, log_weight = complex(*origin), -math.log(len(means))
        self._members = [
            Member(_state(mean, cov), log_weight, self._origin) for mean, cov in zip(means, covs, strict=True)
        ]
        self.waiting = 0  # updates in a row that no member could use
        self._process_noise, self._noise = process_noise, noise

    def predict(self, duration: float, drift: Drift) -> None:
        """Lets the position wander for a duration in s, and turn about the vehicle."""
        if drift.variance:
            self._move(complex(drift.x, drift.y))
        wander, turn = 2 * self._process_noise**2 * duration, drift.variance
        self._members = [_far_enough(m._replace(state=_spread(m.state, wander, turn))) for m in self._members]

    def update(self, ray: Ray) -> None:
        """Corrects every member and its weight; a correlated bearing counts with its share."""
        self._move(complex(ray.x, ray.y))
        toward, variance = cmath.rect(1.0, ray.bearing), ray.std**2 / ray.weight
        anywhere, members = log_any_direction(self._noise), []
        self.waiting = self.waiting + 1 if all(m.origin != self._origin for m in self._members) else 0
        for state, log_weight, origin in self._members:
            if origin != self._origin:
                members.append(Member(state, log_weight + anywhere, origin))
                continue
            error, spread = cmath.phase(toward * state.line.conjugate()), (state.g - state.q.real) / 2
            trust, log_likelihood = believed(self._noise, error, spread + ray.std**2, spread + variance)
            after = corrected(state, toward, variance / trust).state
            members.append(Member(after, log_weight + log_likelihood, origin))
        self._members = _normalised(members)

    def predicted_bearing(self, x: float, y: float) -> tuple[float, float]:
        """Absolute bearing of the source from a point, and its variance."""
        mean, variance = bearing_moments(_mixture(self._seen_from(complex(x, y))))
        return wrap_angle(mean), variance

    def estimate(self) -> PlanarFix:
        """Mean and covariance of the mixture in x and y."""
        return cartesian(_mixture(self._members), [m.origin - self._origin for m in self._members], self._origin)

    @property
    def members(self) -> int:
        """How many range hypotheses live."""
        return len(self._members)

    def _move(self, point: complex) -> None:
        self._members, self._origin = [_far_enough(m) for m in self._seen_from(point)], point

    def _seen_from(self, point: complex) -> list[Member]:
        return [
            Member(seen_from(state, clear(state.line, origin - point)), weight, point)
            for state, weight, origin in self._members
        ]


def range_bank(
    ray: Ray, range_min: float, range_max: float, process_noise: float = 0.0, noise: str = "gaussian"
) -> BearingEkf:
    """A start from one bearing: members along it in geometric progression (Peach 1995), equally likely.

    Each has the mean and variance of a log range uniform in its interval.
    """
    log_ranges, variance = range_intervals(range_min, range_max, _RATIO)
    means = np.stack([log_ranges, np.full(log_ranges.size, ray.bearing)], axis=1)
    covs = np.tile(np.diag([variance, ray.std**2 / ray.weight]), (log_ranges.size, 1, 1))
    return BearingEkf(np.array([ray.x, ray.y]), means, covs, process_noise, noise)


def range_intervals(range_min: float, range_max: float, ratio: float) -> tuple[Array, float]:
    """Means of the log range in intervals whose ends have a ratio, and its variance in each."""
    if not 0 < range_min < range_max:
        raise ValueError(f"range_min must be above 0 and below range_max, got {range_min:g} and {range_max:g}")
    count = math.ceil(math.log(range_max / range_min) / math.log(ratio))
    edges = np.linspace(math.log(range_min), math.log(range_max), count + 1)
    return (edges[1:] + edges[:-1]) / 2, float(edges[1] - edges[0]) ** 2 / 12


def single_start(origin: Array, mean: Array, cov: Array) -> BearingEkf:
    """A start at a guessed position (2,) with its covariance (2, 2), as in Shin et al.'s simulation."""
    dx, dy = mean - origin
    squared = float(dx * dx + dy * dy)
    J = np.array([[dx, dy], [-dy, dx]]) / squared
    return BearingEkf(origin, np.array([[math.log(squared) / 2, math.atan2(dy, dx)]]), (J @ cov @ J.T)[None])


def clear(line: complex, shift: complex) -> complex:
    """The shift, but for a source that would come to lie at the observer itself."""
    return shift if abs(line + shift) > NEAREST else NEAREST - line


def _state(mean: Array, cov: Array) -> LogPolar:
    ranges, bearings, mixed = float(cov[0, 0]), float(cov[1, 1]), float(cov[0, 1])
    line = cmath.exp(complex(mean[0], mean[1]))
    return LogPolar(line, ranges + bearings, complex(ranges - bearings, 2 * mixed))


def _far_enough(member: Member) -> Member:
    """The member, seen from farther away along its line if that is needed."""
    state, log_weight, origin = member
    times = times_too_near(state.g, state.q)
    if times <= 1:
        return member
    back = (times - 1) * state.line
    return Member(seen_from(state, back), log_weight, origin - back)


def _spread(state: LogPolar, wander: float, turn: float) -> LogPolar:
    line, g, q = state
    return LogPolar(line, g + wander / (line.real * line.real + line.imag * line.imag) + turn, q - turn)


def _normalised(members: list[Member]) -> list[Member]:
    """Weights that sum to one; the least likely members are dropped."""
    if len(members) == 1:
        return [members[0]._replace(log_weight=0.0)]
    best = max(member.log_weight for member in members)
    kept = [member for member in members if member.log_weight > best + PRUNED]
    total = best + math.log(sum(math.exp(member.log_weight - best) for member in kept))
    return [member._replace(log_weight=member.log_weight - total) for member in kept]


def _mixture(members: Iterable[Member]) -> Mixture:
    states, log_weights, _ = zip(*members, strict=True)
    return Mixture([math.exp(w) for w in log_weights], *zip(*states, strict=True))


_RATIO = 1.6  # of neighbouring ranges
PRUNED = math.log(1e-4)  # log weight relative to the heaviest
NEAREST = 1e-6  # m
