"""A bearing-only EKF in log-polar coordinates (Aidala, Hammel 1983), as complex numbers: single ones or arrays of runs.

A source at the complex offset `line` from the observer has zeta = log line = log range + i bearing. Its error is
described by g = E |d zeta|^2, the sum of the variances of log range and bearing, and q = E (d zeta)^2, their difference
+ 2 i their covariance. All maps are complex-linear, so g and q stay a covariance without symmetrising.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .triangulation import Fix
from .types import AnyArray, Array

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


def bearing_moments(weight: Array, line: AnyArray, bearing_variance: Array) -> tuple[float, float]:
    """Mean and variance of the bearing in a mixture; the mean may leave (-pi, pi]."""
    centre = line[int(np.argmax(weight))]
    spread = np.angle(line * centre.conjugate())
    mean = float(weight @ spread)
    return float(np.angle(centre)) + mean, float(weight @ (bearing_variance + (spread - mean) ** 2))


def cartesian(weight: Array, line: AnyArray, g: Array, q: AnyArray) -> Fix:
    """Mean and covariance of a mixture in x and y from the observer, exact for Gaussian zeta: E exp(a zeta)."""
    mean = complex(weight @ (line * np.exp(q / 2)))
    square = complex(weight @ (line * line * np.exp(2 * q))) - mean**2
    length = float(weight @ (np.abs(line) ** 2 * np.exp(g + q.real))) - abs(mean) ** 2
    cov = np.array([[length + square.real, square.imag], [square.imag, length - square.real]]) / 2
    return Fix(np.array([mean.real, mean.imag]), cov)
