"""The standard deviation and impulse fraction of a noise, worked out from the measurements that a particle filter sees.

A grid of hypotheses, each weighted by how well it has predicted the measurements so far; the particles are weighted
with the average likelihood of all. Cloud and hypotheses are taken as independent after every measurement. Shape and
relative scale of the impulses are given.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ..impulsive import ImpulsiveNoise, likelihood_table
from ..types import Array

FACTORS = 2.0 ** np.linspace(-2, 2, 13)  # of the standard deviation to start from
FRACTIONS = np.linspace(0.0, 0.6, 13)
MEMORY = 1000  # measurements; the sea changes


class LearntNoise:
    """Hypotheses of `runs` noises; at first all have the same weight."""

    def __init__(self, start: ImpulsiveNoise, runs: int) -> None:
        self._stds = start.std * FACTORS
        self._gaussian, self._impulse = (
            likelihood_table(dataclasses.replace(start, std=1.0, fraction=fraction)) for fraction in (0.0, 1.0)
        )
        self._peak = self._gaussian.peak, self._impulse.peak
        self._weights = np.full((runs, len(FACTORS), len(FRACTIONS)), 1 / (len(FACTORS) * len(FRACTIONS)))

    @property
    def mean(self) -> Array:
        """(2, runs) standard deviation of the Gaussian part, and fraction of impulses."""
        return np.stack([self._weights.sum(axis=2) @ self._stds, self._weights.sum(axis=1) @ FRACTIONS])

    def weigh(self, weights: Array, errors: Array) -> Array:
        """Weights (runs, n) times the likelihood of particles' errors, not normalised; learns from them."""
        share = self._weights @ FRACTIONS  # (runs, stds) of the impulses
        gaussian_share = self._weights.sum(axis=2) - share
        total = np.zeros_like(weights)
        predicted = np.empty((2, *share.shape))
        for k, std in enumerate(self._stds):
            z = errors / std
            parts = self._gaussian(z) * (self._peak[0] / std), self._impulse(z) * (self._peak[1] / std)
            predicted[:, :, k] = [np.einsum("rn,rn->r", part, weights) for part in parts]
            total += gaussian_share[:, k, None] * parts[0] + share[:, k, None] * parts[1]
        self._learn(*predicted)
        return weights * total

    def _learn(self, gaussian: Array, impulse: Array) -> None:
        """Takes in the densities (runs, stds) that either kind of noise has given to a measurement."""
        predicted = gaussian[:, :, None] * (1 - FRACTIONS) + impulse[:, :, None] * FRACTIONS
        posterior = self._weights ** (1 - 1 / MEMORY) * predicted
        self._weights = posterior / posterior.sum(axis=(1, 2), keepdims=True)
