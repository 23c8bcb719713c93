"""Densities of a bearing's error."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..types import Array

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


class Belief(NamedTuple):
    """How much an EKF believes a bearing: `trust` divides its variance; the log-likelihood is to a constant."""

    trust: Any
    log_likelihood: Any


def believed(noise: str, error: Any, S: Any, counted: Any) -> Belief:
    """What an innovation is worth; numbers, or arrays of them.

    `S` is the innovation's variance, `counted` that with a correlated bearing's share. student_t: the error's expected
    precision (Lange, Little, Taylor 1989), not above 1; mixture: the probability that the bearing is not a direction at
    random; else it is normal and believed.
    """
    nis, counted_nis = error * error / S, error * error / counted
    exp, log = (math.exp, math.log) if isinstance(error, float) else (np.exp, np.log)
    if noise == "student_t":
        at_least_1 = (1 + nis + abs(nis - 1)) / 2
        log_density = -0.5 * ((_FREEDOM + 1) * log(1 + counted_nis / _FREEDOM) + log(counted))
        return Belief((_FREEDOM + 1) / (_FREEDOM + at_least_1), log_density)
    if noise == "mixture":
        normal, at_random = (1 - _OUTLIERS) / math.sqrt(2 * math.pi), _OUTLIERS / (2 * math.pi)
        here = normal * exp(-0.5 * nis) / S**0.5
        log_density = log(normal * exp(-0.5 * counted_nis) / counted**0.5 + at_random)
        return Belief(here / (here + at_random) + _LEAST, log_density)
    return Belief(1.0, -0.5 * (counted_nis + log(counted)))


def log_any_direction(noise: str) -> float:
    """Log-likelihood of a bearing that may come from anywhere, to the constant of `believed`."""
    constant = {"mixture": 0.0, "student_t": math.log(3 / 8)}.get(noise, -0.5 * math.log(2 * math.pi))
    return -math.log(2 * math.pi) - constant


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
_LEAST = 1e-9
