"""A bearing-only EKF in log-polar coordinates (Aidala, Hammel 1983), as complex numbers: single ones or arrays of runs.

A source at the complex offset `line` from the observer has zeta = log line = log range + i bearing. Its error is
described by g = E |d zeta|^2, the sum of the variances of log range and bearing, and q = E (d zeta)^2, their difference
+ 2 i their covariance. All maps are complex-linear, so g and q stay a covariance without symmetrising.
"""

from __future__ import annotations

import cmath
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .triangulation import Fix

Numbers = Any  # float or complex: one, or an array


def seen_from(line: Numbers, g: Numbers, q: Numbers, shift: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """The state when the observer has moved by -shift: d zeta' = c d zeta, a turn and a stretch."""
    moved = line + shift
    c = line / moved
    return moved, g * (c.real * c.real + c.imag * c.imag), q * c * c


def corrected(
    line: Numbers,
    g: Numbers,
    q: Numbers,
    toward: Numbers,
    variance: Numbers,
    exp: Callable[[Any], Any],
    phase: Callable[[Any], Any],
) -> tuple[Numbers, Numbers, Numbers, Numbers, Numbers]:
    """The state after a bearing, its innovation and the innovation's variance (Shin et al. 2013, eq. 8-12).

    `toward` is exp(i bearing); k = cov(zeta, bearing). `exp` and `phase` are cmath's or numpy's.
    """
    k = 0.5j * (g - q)
    S = k.imag + variance
    error = phase(toward * line.conjugate())
    scaled = k / S
    return line * exp(scaled * error), g - (scaled * k.conjugate()).real, q - scaled * k, error, S


def bearing_moments(
    weight: Sequence[float], line: Sequence[complex], bearing_variance: Sequence[float]
) -> tuple[float, float]:
    """Mean and variance of the bearing in a mixture; the mean may leave (-pi, pi]."""
    centre = line[max(range(len(weight)), key=weight.__getitem__)]
    spread = [cmath.phase(p * centre.conjugate()) for p in line]
    mean = sum(w * off for w, off in zip(weight, spread, strict=True))
    within = zip(weight, spread, bearing_variance, strict=True)
    return cmath.phase(centre) + mean, sum(w * (variance + (off - mean) ** 2) for w, off, variance in within)


def cartesian(
    weight: Sequence[float], line: Sequence[complex], g: Sequence[float], q: Sequence[complex], observer: complex = 0j
) -> Fix:
    """Mean and covariance of a mixture in x and y, exact for Gaussian zeta: E exp(a zeta).

    The members are few, so plain numbers are faster than arrays.
    """
    mean = square = length = 0j
    for w, p, a, b in zip(weight, line, g, q, strict=True):
        mean += w * p * _exp(b / 2)
        square += w * p * p * _exp(2 * b)
        length += w * p * p.conjugate() * _exp(complex(a + b.real))
    square -= mean * mean
    total, apart = length.real - mean.real**2 - mean.imag**2, square.real
    cov = np.array(((total + apart, square.imag), (square.imag, total - apart))) / 2
    return Fix(np.array((observer.real + mean.real, observer.imag + mean.imag)), cov)


def _exp(exponent: complex) -> complex:
    return cmath.exp(complex(min(exponent.real, _LARGEST), exponent.imag))


_LARGEST = 300.0  # nothing is known of such a position, and its square is still a number
