"""Densities of a bearing's error."""

from __future__ import annotations

import math

import numpy as np

from .types import Array

NOISES = ("gaussian", "uniform", "student_t", "mixture")


def log_likelihood(noise: str, error: Array, std: Array | float, softness: float = 0.01) -> Array:
    """Log density of bearing errors in rad, times `std` and a constant.

    gaussian; uniform within sqrt(3) std, its edges softened by a share of the width, so that no cloud dies at once;
    student_t with 4 degrees of freedom and the variance std^2; mixture: gaussian, one bearing in ten being a direction
    at random.
    """
    z = error / std
    if noise == "gaussian":
        return np.asarray(-0.5 * z * z)
    if noise == "uniform":
        beyond = np.maximum(np.abs(z) / math.sqrt(3) - 1, 0.0) / softness
        return np.asarray(-0.5 * beyond * beyond)
    if noise == "student_t":  # scale std / sqrt(2): its variance is nu / (nu - 2) of the scale's square
        return np.asarray(-0.5 * (_FREEDOM + 1) * np.log1p(z * z / (_FREEDOM - 2)))
    if noise == "mixture":
        floor = np.log(_OUTLIERS / (1 - _OUTLIERS) * std / math.sqrt(2 * math.pi))
        return np.asarray(np.logaddexp(-0.5 * z * z, floor))
    raise ValueError(f"noise must be one of {', '.join(NOISES)}, got {noise!r}")


def draw_errors(noise: str, std: float, n: int, rng: np.random.Generator) -> Array:
    """(n,) bearing errors in rad with the density of `log_likelihood`."""
    if noise == "uniform":
        return rng.uniform(-math.sqrt(3) * std, math.sqrt(3) * std, n)
    if noise == "student_t":
        return rng.standard_t(_FREEDOM, n) * (std / math.sqrt(_FREEDOM / (_FREEDOM - 2)))
    errors = rng.normal(0.0, std, n)
    if noise == "mixture":
        return np.where(rng.random(n) < _OUTLIERS, rng.uniform(-math.pi, math.pi, n), errors)
    return errors


_FREEDOM = 4.0
_OUTLIERS = 0.1
