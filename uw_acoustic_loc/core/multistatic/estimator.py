"""Multistatic fixes: one transmitter, receivers that measure the range sum and the bearing of an echo.

Range sum r_i = |p - transmitter| + |p - receiver_i|; bearing of p at receiver_i, counter-clockwise from +x. Horizontal
geometry: a depth difference d over a range R adds d^2 / 2R, which belongs into range_std.

RAYLEIGH CONVENTION: a measured range sum is the true one plus a Rayleigh-distributed error (an echo is never early)
whose standard deviation is range_std. Its scale is range_std / sqrt(2 - pi/2); its mean, sqrt(pi/2) scale =
1.913 range_std, is a bias that every method but `ml_exact` subtracts; `ml_exact` uses the density itself.

Methods: `ls`, pseudo-inverse of the linearised circles (eq. 1-4); `ml_range`, Taylor iteration on range sums (eq. 5-16;
bearings only choose where it starts); `ml_range_bearing`, both stacked (eq. 23-25); `ml_exact`, the Rayleigh and
Gaussian likelihood itself: its mean and covariance, because the mode of a skewed likelihood is biased. Equation numbers
are those of the comparison of LS, ML_dist and ML_proposed in docs/multistatic_fusion.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..types import AnyArray, Array
from .model import Likelihood, Moments
from .posterior import posterior
from .start import closed_form, least_squares, likeliest_start

METHODS = ("ls", "ml_range", "ml_range_bearing", "ml_exact")


@dataclass(frozen=True, eq=False)
class SonarNet:
    """Where a multistatic sonar listens.

    Raises:
        ValueError: a shape is wrong, or a position is not finite.
    """

    transmitter: Array  # (2,) m
    receivers: Array  # (N, 2) m

    def __post_init__(self) -> None:
        if self.transmitter.shape != (2,) or not np.isfinite(self.transmitter).all():
            raise ValueError(f"transmitter must be (2,) and finite, got {self.transmitter!r}")
        if self.receivers.ndim != 2 or self.receivers.shape[1] != 2 or not len(self.receivers):
            raise ValueError(f"receivers must be (N, 2), N >= 1, got {self.receivers.shape}")
        if not np.isfinite(self.receivers).all():
            raise ValueError(f"receivers must be finite, got {self.receivers.tolist()}")

    def measure(self, targets: Array) -> tuple[Array, Array]:
        """True range sums and bearings (N, ...) of targets (..., 2)."""
        to_target = np.moveaxis(targets, -1, 0)[:, None] - self.receivers.T.reshape(2, -1, *[1] * (targets.ndim - 1))
        from_transmitter = np.hypot(*np.moveaxis(targets - self.transmitter, -1, 0))
        return from_transmitter + np.hypot(*to_target), np.arctan2(to_target[1], to_target[0])


@dataclass(frozen=True, eq=False)
class Noise:
    """Errors of each receiver; the range's follow the Rayleigh convention above, the bearing's are Gaussian.

    Raises:
        ValueError: shapes differ, or a standard deviation is not positive.
    """

    range_std: Array  # (N,) m
    bearing_std: Array  # (N,) rad
    rayleigh: bool = True  # else the range error is Gaussian with mean 0

    def __post_init__(self) -> None:
        if self.range_std.ndim != 1 or self.range_std.shape != self.bearing_std.shape:
            raise ValueError(
                f"range_std and bearing_std must be (N,), got {self.range_std.shape} and {self.bearing_std.shape}"
            )
        for name, std in (("range_std", self.range_std), ("bearing_std", self.bearing_std)):
            if not np.all((std > 0) & np.isfinite(std)):
                raise ValueError(f"{name} must be positive, got {std.tolist()}")

    @property
    def bias(self) -> Array:
        """(N,) mean of the range error in m."""
        return self.range_std * (RAYLEIGH_SCALE * math.sqrt(math.pi / 2) if self.rayleigh else 0.0)

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> tuple[Array, Array]:
        """Errors (N, *shape) of range sums and bearings."""
        size = (len(self.range_std), *shape)
        range_std, bearing_std = (s.reshape(-1, *[1] * len(shape)) for s in (self.range_std, self.bearing_std))
        drawn = rng.rayleigh(RAYLEIGH_SCALE, size) if self.rayleigh else rng.standard_normal(size)
        return range_std * drawn, bearing_std * rng.standard_normal(size)


RAYLEIGH_SCALE = 1 / math.sqrt(2 - math.pi / 2)  # scale of the Rayleigh error whose standard deviation is 1


@dataclass(frozen=True, eq=False)
class Fixes:
    """Estimated positions with their covariance; where `converged` is False neither means anything."""

    positions: Array  # (..., 2) m
    cov: Array  # (..., 2, 2) m^2, inverse of the information at the estimate
    converged: AnyArray  # (...) bool
    misfit: Array  # (...) sum of squared normalised Gaussian residuals, of expectation 2N - 2 (ml_range: N - 2)


def locate(net: SonarNet, ranges: Array, bearings: Array, noise: Noise, method: str = "ml_range_bearing") -> Fixes:
    """Fixes from range sums and bearings (N, ...): trailing axes are targets, trials or both.

    Raises:
        ValueError: shapes or method are wrong, or the method needs more receivers (see `check_method`).
    """
    count = len(net.receivers)
    if ranges.shape != bearings.shape or len(ranges) != count or len(noise.range_std) != count:
        raise ValueError(
            f"ranges, bearings and noise must be ({count}, ...), got {ranges.shape}, {bearings.shape} "
            f"and {noise.range_std.shape}"
        )
    check_method(net, method)
    shape, size = ranges.shape[1:], math.prod(ranges.shape[1:])
    flat = ranges.reshape(count, size), bearings.reshape(count, size)
    out, step = np.zeros((7, size)), max(1, _CHUNK // count)
    first = _careful if method == "ml_range" else _quick
    for part in (slice(k, k + step) for k in range(0, size, step)):  # slices: rows by index would be copied
        out[:, part] = _locate(net, flat[0][:, part], flat[1][:, part], noise, method, first)
    left = np.flatnonzero(out[5] == 0) if first is _quick else np.empty(0, dtype=int)
    for late in (left[k : k + step] for k in range(0, left.size, step)):
        out[:, late] = _locate(net, flat[0][:, late], flat[1][:, late], noise, method, _careful)
    cov = np.moveaxis(out[[2, 3, 3, 4]].reshape(2, 2, *shape), (0, 1), (-2, -1))
    positions = np.moveaxis(out[:2].reshape(2, *shape), 0, -1)
    return Fixes(positions, cov, out[5].reshape(shape) > 0, out[6].reshape(shape))


def check_method(net: SonarNet, method: str) -> None:
    """Raises ValueError when there is no such method, or it has no unique answer for this net."""
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if method == "ml_range" and len(net.receivers) < 2:
        raise ValueError("ml_range needs at least 2 receivers, got 1")
    if method == "ls":
        baselines = net.receivers - net.transmitter
        if np.linalg.matrix_rank(baselines, tol=1e-3 * np.abs(baselines).max()) < 2:
            raise ValueError("ls needs 2 receivers that are not in line with the transmitter")


def gaussian_likelihood(net: SonarNet, ranges: Array, bearings: Array, noise: Noise) -> Likelihood:
    """Of range sums (N, M) whose bias is removed, and bearings (N, M)."""
    weights = noise.range_std[:, None] ** -2.0, noise.bearing_std[:, None] ** -2.0
    return Likelihood(net.transmitter, net.receivers, ranges, bearings, *weights)


def _locate(net: SonarNet, ranges: Array, bearings: Array, noise: Noise, method: str, search: Search) -> Array:
    """(7, M): x, y, cov xx xy yy, converged, misfit."""
    gaussian = gaussian_likelihood(net, ranges - noise.bias[:, None], bearings, noise)
    if method == "ls":
        x, y, *cov = least_squares(gaussian)
        return np.array([x, y, *cov, np.isfinite(x) & np.isfinite(y), 2 * gaussian.cost(x, y)])
    used = gaussian.without_bearings() if method == "ml_range" else gaussian
    mode, arrived = search(used, gaussian)
    if method == "ml_exact" and noise.rayleigh:
        exact = replace(gaussian, ranges=ranges, scale=noise.range_std[:, None] * RAYLEIGH_SCALE)
        mode = _climb(exact, mode.x, mode.y)
        arrived &= _arrived(exact, mode)
        x, y, *cov = posterior(exact, mode)
        misfit = 2 * gaussian.cost(x, y)
    else:
        x, y, cov, misfit = mode.x, mode.y, [*used.cov(mode)], 2 * mode.cost
    return np.array([x, y, *cov, arrived & np.isfinite(cov[0]), misfit])


Search = Callable[[Likelihood, Likelihood], tuple[Moments, AnyArray]]  # used, the one to start from -> fix, arrived
_CHUNK = 16384  # receivers x fixes that are worked on at once: the arrays stay in the cache
_STEPS, _SETTLED = 3, 1e-3  # of the quick search: squared length of its last step, in standard deviations of the fix
_ITERATIONS, _MORE_ITERATIONS = 4, 20
_THERE, _ARRIVED = 1e-5, 1e-2  # squared distance to the optimum: where damped steps end, and what is good enough


def _quick(used: Likelihood, start: Likelihood) -> tuple[Moments, AnyArray]:
    """A few plain steps from a closed-form start; arrived only where they have settled upon a good fit."""
    x, y = closed_form(start)
    for _ in range(_STEPS):
        at = used.moments(x, y).moved()
        x, y = at.x, at.y
    dof = 2 * len(used.receivers) - 2
    return at, (at.decrement() < _SETTLED) & (2 * at.cost < dof + 5 * math.sqrt(2 * dof))


def _careful(used: Likelihood, start: Likelihood) -> tuple[Moments, AnyArray]:
    """Damped steps from the best of several candidates."""
    at = _climb(used, *likeliest_start(start))
    return at, _arrived(used, at)


def _arrived(likelihood: Likelihood, at: Moments) -> AnyArray:
    """(M,) where the search has ended at an optimum."""
    return (at.decrement() < _ARRIVED) | likelihood.at_node(at)


def _climb(likelihood: Likelihood, x: Array, y: Array) -> Moments:
    """The optimum near (x, y): a few iterations for all, many more for the few that have not arrived."""
    at = _gauss_newton(likelihood, likelihood.moments(x, y), _ITERATIONS)
    late = np.flatnonzero(_underway(at))
    if not late.size:
        return at
    columns = likelihood.columns(late)
    return at.put(late, _gauss_newton(columns, columns.moments(at.x[late], at.y[late]), _MORE_ITERATIONS))


def _underway(at: Moments) -> AnyArray:
    """(M,) where the optimum is not reached; NaN is nowhere."""
    underway: AnyArray = at.decrement() > _THERE
    return underway


def _gauss_newton(likelihood: Likelihood, at: Moments, iterations: int) -> Moments:
    """Damped Gauss-Newton (eq. 11, 23, with Levenberg's damping): a step that does not lower the cost is not taken."""
    damping = np.full(at.x.shape, 1e-3)
    for _ in range(iterations):
        if not _underway(at).any():
            break
        step_x, step_y = at.step(damping)
        tried = likelihood.moments(at.x + step_x, at.y + step_y)
        better = tried.cost <= at.cost
        at = tried.where(better, at)
        damping = np.where(better, damping * 0.1, damping * 10 + 1e-3)
    return at
