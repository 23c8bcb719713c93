"""Impulsive noise: Gaussian noise mixed with alpha-stable noise (Lee, Yang, Huh 2013, eq. 1-3).

Parameterisation S1 (Samorodnitsky and Taqqu 1994; that of scipy.stats.levy_stable by default): for alpha > 1 the
location is the mean. S0 (Nolan) shifts it so that the density moves continuously with alpha; see `s0_location`.
alpha = 2 is Gaussian with variance 2 scale^2, alpha = 1 and beta = 0 Cauchy, alpha = 0.5 and beta = 1 Levy.

Filters that take Gaussian noise use a weight w in (0, 1] for each measurement, which divides its variance (iteratively
reweighted least squares, one step), where a gate knows 0 and 1 only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from .types import AnyArray, Array

_STEP = 1 / 64  # of the standard density's grid: its Fourier transform is cut off at pi / _STEP
_POINTS = 2**18
_PER_STD = 100
_FLOOR = math.exp(-650)
_LEAST_WEIGHT = 1e-6


@dataclass(frozen=True)
class AlphaStable:
    """The distribution with characteristic exponent alpha in (0, 2], skewness beta in [-1, 1], scale, S1 location."""

    alpha: float
    beta: float = 0.0
    scale: float = 1.0
    location: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.alpha <= 2:
            raise ValueError(f"alpha must be in (0, 2], got {self.alpha}")
        if not -1 <= self.beta <= 1:
            raise ValueError(f"beta must be from -1 to 1, got {self.beta}")
        if not (self.scale > 0 and math.isfinite(self.scale)):
            raise ValueError(f"scale must be positive, got {self.scale}")

    def draw(self, rng: np.random.Generator, size: int | tuple[int, ...]) -> Array:
        """Random numbers (Chambers, Mallows, Stuck 1976; Weron 1996, eq. 3.8-3.9)."""
        a, b = self.alpha, self.beta
        angle = rng.uniform(-np.pi / 2, np.pi / 2, size)
        W = rng.exponential(1.0, size)
        if a == 1:
            slope = np.pi / 2 + b * angle
            x = 2 / np.pi * (slope * np.tan(angle) - b * np.log(np.pi / 2 * W * np.cos(angle) / slope))
            return np.asarray(self.scale * x + self.location + 2 / np.pi * b * self.scale * math.log(self.scale))
        skew = b * math.tan(np.pi * a / 2)
        turned = a * angle + math.atan(skew)
        x = (1 + skew**2) ** (0.5 / a) * np.sin(turned) / np.cos(angle) ** (1 / a)
        x *= (np.cos(angle - turned) / W) ** ((1 - a) / a)
        return np.asarray(self.scale * x + self.location)

    def density(self, x: Array) -> Array:
        """Probability density, from the characteristic function by one FFT; alpha from 0.5 up.

        The absolute error of the standard density (scale 1) is below 1e-4, and far less for alpha >= 1.
        """
        if self.alpha < 0.5:
            raise ValueError(f"alpha must be at least 0.5 for a tabulated density, got {self.alpha}")
        grid, values = self._standard
        z = (np.asarray(x, dtype=float) - s0_location(self)) / self.scale
        inner = np.interp(z, grid, values)
        tail = values[np.where(z < 0, 0, -1)] * (grid[-1] / np.maximum(np.abs(z), grid[-1])) ** (self.alpha + 1)
        return np.asarray(np.where(np.abs(z) < grid[-1], inner, tail) / self.scale)

    @cached_property
    def _standard(self) -> tuple[Array, Array]:
        """Grid and density of scale 1 and S0 location 0 (Nolan 2020, eq. 1.4), the half of the period around zero."""
        a, b = self.alpha, self.beta
        dt = 2 * np.pi / (_POINTS * _STEP)
        t = dt * np.arange(_POINTS // 2 + 1)
        t[0] = dt * 1e-9  # log(0)
        twist = 2 / np.pi * np.log(t) if a == 1 else math.tan(np.pi * a / 2) * (t ** (1 - a) - 1)
        transform = np.exp(-(t**a) * (1 + 1j * b * twist))
        values = np.fft.fftshift(np.fft.hfft(transform, _POINTS)) * dt / (2 * np.pi)
        inner = slice(_POINTS // 4, 3 * _POINTS // 4 + 1)
        grid: Array = np.asarray(np.arange(-_POINTS // 4, _POINTS // 4 + 1) * _STEP)
        return grid, np.maximum(values[inner], 0.0)


def s0_location(stable: AlphaStable) -> float:
    """The location of the same distribution in parameterisation S0 (Nolan 2020, eq. 1.8)."""
    a, b, scale = stable.alpha, stable.beta, stable.scale
    if a == 1:
        return stable.location + b * 2 / math.pi * scale * math.log(scale)
    return stable.location + b * scale * math.tan(math.pi * a / 2)


def s1_location(alpha: float, beta: float, scale: float, location_s0: float) -> float:
    """The S1 location of a distribution given with its S0 location."""
    return location_s0 - s0_location(AlphaStable(alpha, beta, scale))


@dataclass(frozen=True)
class ImpulsiveNoise:
    """Gaussian noise of `std`, replaced with probability `fraction` by an alpha-stable impulse in units of `std`."""

    std: float
    fraction: float
    impulse: AlphaStable

    def draw(self, rng: np.random.Generator, size: int | tuple[int, ...]) -> Array:
        """Random numbers of the mixture."""
        return np.asarray(self.strike(rng, self.std * rng.standard_normal(size)))

    def strike(self, rng: np.random.Generator, gaussian: AnyArray) -> AnyArray:
        """Gaussian errors with impulses in the place of some: the mixture when their standard deviation is `std`."""
        if self.fraction == 0:
            return gaussian
        hit = rng.random(gaussian.shape) < self.fraction
        struck = gaussian.copy()
        struck[hit] = self.std * self.impulse.draw(rng, int(hit.sum()))
        return struck

    def density(self, x: Array) -> Array:
        """Probability density of the mixture."""
        z = np.asarray(x, dtype=float) / self.std
        normal = np.exp(-np.square(z) / 2) / math.sqrt(2 * math.pi)
        impulse = self.impulse.density(z) if self.fraction > 0 else 0.0
        return np.asarray(((1 - self.fraction) * normal + self.fraction * impulse) / self.std)


class LikelihoodTable:
    """A mixture's density relative to its maximum, tabulated once, at the nearest of 100 points per `std`.

    It reaches 60 impulse scales to either side and stays constant beyond: out there a particle cloud sees no slope.
    Nothing is below e^-650, so that weights times a likelihood never all vanish and need no logarithms.
    """

    def __init__(self, noise: ImpulsiveNoise) -> None:
        reach = 10.0 + abs(s0_location(noise.impulse)) + (60 * noise.impulse.scale if noise.fraction > 0 else 30.0)
        self._half = min(math.ceil(reach * _PER_STD), 2**20)
        self._per_metre = _PER_STD / noise.std
        density = noise.density(np.arange(-self._half, self._half + 1) / self._per_metre)
        self.peak = float(density.max())
        self._values = np.maximum(density / self.peak, _FLOOR)

    def __call__(self, x: AnyArray) -> Array:
        """Likelihood at errors `x` of any shape."""
        place = x * self._per_metre
        place += self._half + 0.5
        np.clip(place, 0, 2 * self._half, out=place)
        return np.asarray(self._values.take(place.astype(np.intp), mode="clip"))

    def weigh(self, weights: Array, errors: Array) -> Array:
        """Weights times the likelihood of particles' errors, not normalised (Lee et al. 2013, eq. 7)."""
        return weights * self(errors)


@lru_cache(maxsize=16)
def likelihood_table(noise: ImpulsiveNoise) -> LikelihoodTable:
    """The table of a noise, made once."""
    return LikelihoodTable(noise)


def mixture_weights(innovations: Array, predicted_var: Array, noise: ImpulsiveNoise) -> Array:
    """Probability of each error (n,) to be of the noise's Gaussian part, the Bayes rule for its two parts.

    `predicted_var` (n,) is that of the predicted measurement, without the noise; impulses are taken to be far wider.
    """
    if noise.fraction == 0:
        return np.ones(np.shape(innovations))
    S = predicted_var + noise.std**2
    gaussian = (1 - noise.fraction) * np.exp(-0.5 * np.square(innovations) / S) / np.sqrt(2 * np.pi * S)
    impulse = noise.fraction * noise.impulse.density(innovations / noise.std) / noise.std
    return np.asarray(np.maximum(gaussian / np.maximum(gaussian + impulse, 1e-300), _LEAST_WEIGHT))


def student_t_weights(innovations: Array, predicted_var: Array, std: Array | float, dof: float) -> Array:
    """The same for Student-t noise of `dof` degrees of freedom and scale `std` (Lange, Little, Taylor 1989).

    A weight does not exceed 1: a small innovation makes nothing more precise than it is.
    """
    nis = np.square(innovations) / (predicted_var + np.square(std))
    return np.asarray(np.minimum((dof + 1) / (dof + nis), 1.0))
