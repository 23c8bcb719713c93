"""A bearing-only EKF in log-polar coordinates (Aidala, Hammel 1983), as complex numbers: single ones or arrays of runs.

A source at the complex offset `line` from the observer has zeta = log line = log range + i bearing. Its error is
described by g = E |d zeta|^2, the sum of the variances of log range and bearing, and q = E (d zeta)^2, their difference
+ 2 i their covariance. All maps are complex-linear, so g and q stay a covariance without symmetrising.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .triangulation import PlanarFix

Numbers = Any  # float or complex: one, or an array


class LogPolar(NamedTuple):
    """Offset of a source from the observer, and its error."""

    line: Numbers
    g: Numbers
    q: Numbers


class Mixture(NamedTuple):
    """Members by column: weights that sum to 1, and the states."""

    weight: Sequence[float]
    line: Sequence[complex]
    g: Sequence[float]
    q: Sequence[complex]


class Correction(NamedTuple):
    """The state after a bearing, its innovation in rad, and the innovation's variance."""

    state: LogPolar
    error: Numbers
    S: Numbers


def seen_from(state: LogPolar, shift: Numbers) -> LogPolar:
    """The state when the observer has moved by -shift: d zeta' = c d zeta, a turn and a stretch."""
    line, g, q = state
    moved = line + shift
    c = line / moved
    return LogPolar(moved, g * (c.real * c.real + c.imag * c.imag), q * c * c)


def corrected(state: LogPolar, toward: Numbers, variance: Numbers) -> Correction:
    """The state after a bearing (Shin et al. 2013, eq. 8-12).

    `toward` is exp(i bearing); k = cov(zeta, bearing).
    """
    line, g, q = state
    k = 0.5j * (g - q)
    S = k.imag + variance
    error = _phase(toward * line.conjugate())
    scaled = k / S
    after = LogPolar(line * _exponential(scaled * error), g - (scaled * k.conjugate()).real, q - scaled * k)
    return Correction(after, error, S)


def bearing_moments(mixture: Mixture) -> tuple[float, float]:
    """Mean and variance of the bearing; the mean may leave (-pi, pi]."""
    weight, line, g, q = mixture
    centre = line[max(range(len(weight)), key=weight.__getitem__)]
    spread = [cmath.phase(p * centre.conjugate()) for p in line]
    mean = sum(w * off for w, off in zip(weight, spread, strict=True))
    variances = [min((a - b.real) / 2, ANY_DIRECTION) for a, b in zip(g, q, strict=True)]
    within = zip(weight, spread, variances, strict=True)
    return cmath.phase(centre) + mean, sum(w * (variance + (off - mean) ** 2) for w, off, variance in within)


def cartesian(mixture: Mixture, offset: Sequence[complex], observer: complex) -> PlanarFix:
    """Mean and covariance in x and y, exact for Gaussian zeta: E exp(a zeta).

    `offset` is how far from the observer each member is seen from. The members are few, so plain numbers are faster
    than arrays.
    """
    mean = square = length = 0j
    for w, p, a, b, d in zip(*mixture, offset, strict=True):
        first = w * p * _bounded_exp(b / 2)
        mean += first + w * d
        square += w * p * p * _bounded_exp(2 * b) + d * (2 * first + w * d)
        length += w * p * p.conjugate() * _bounded_exp(complex(a + b.real)) + d.conjugate() * (2 * first + w * d)
    square -= mean * mean
    total, apart = length.real - mean.real**2 - mean.imag**2, square.real
    cov = np.array(((total + apart, square.imag), (square.imag, total - apart))) / 2
    return PlanarFix(np.array((observer.real + mean.real, observer.imag + mean.imag)), cov)


def times_too_near(g: Numbers, q: Numbers) -> Numbers:
    """How many times too near the observer is for the error of the range to be small against the range.

    The error in metres is what it is, wherever the observer goes. Seen from so near that it is as large as the range it
    is not normal in log-polar coordinates, and a linearised correction would be wrong by any amount.
    """
    return ((g + q.real) / (2 * LARGEST_VARIANCE)) ** 0.5


def _phase(number: Numbers) -> Numbers:
    """Of one number, for which numpy would take most of the time, or of an array."""
    return cmath.phase(number) if isinstance(number, complex) else np.angle(number)


def _exponential(number: Numbers) -> Numbers:
    return cmath.exp(number) if isinstance(number, complex) else np.exp(number)


def _bounded_exp(exponent: complex) -> complex:
    return cmath.exp(complex(min(exponent.real, _LARGEST), exponent.imag))


LARGEST_VARIANCE = 0.25  # of the log range
ANY_DIRECTION = math.pi**2 / 3  # rad^2, of a bearing of which nothing is known
_LARGEST = 300.0  # nothing is known of such a position, and its square is still a number
