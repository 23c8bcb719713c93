"""Offset of a moored buoy measured with impulsive noise (Lee, Yang, Huh 2013).

Three filters of one model: a particle filter whose likelihood is the noise mixture's own (mooring_particles), the
Kalman filter that takes the noise for Gaussian, and the same with a gate. All work on many runs at once.
"""

from __future__ import annotations

import math

import numpy as np

from ..types import Array
from .model import MooringConfig, MooringEstimate, MooringStep, discretise, step_of
from .particles import ParticleMooring

__all__ = [
    "KalmanMooring",
    "MooringConfig",
    "MooringEstimate",
    "ParticleMooring",
    "discretise",
    "make_filter",
    "step_of",
]


class KalmanMooring:
    """Kalman filter of `runs` moorings with the same system; with a gate, measurements beyond it are ignored."""

    def __init__(self, config: MooringConfig, runs: int = 1) -> None:
        self._config = config
        self._mean = np.zeros((2, runs))
        self._mean[0] = config.initial_offset
        self._cov = np.zeros((2, 2, runs))
        self._cov[0, 0], self._cov[1, 1] = config.initial_std**2, config.initial_velocity_std**2

    def change(self, config: MooringConfig) -> None:
        """Goes on with another gate or noise."""
        self._config = config

    @property
    def _gate(self) -> float:
        return self._config.gate_sigma if self._config.filter == "kalman_gated" else math.inf

    def predict(self, step: MooringStep) -> None:
        """Moves on by a time step (eq. 5)."""
        self._mean = step.F @ self._mean + step.drive[:, None]
        moved = np.einsum("ij,jkr,lk->ilr", step.F, self._cov, step.F) + step.Q[:, :, None]
        self._cov = (moved + moved.transpose(1, 0, 2)) / 2

    def update(self, measured: Array) -> MooringEstimate:
        """Takes in a measured offset (runs,)."""
        S = self._cov[0, 0] + self._config.measurement_std**2
        innovation = measured - self._mean[0]
        rejected = np.abs(innovation) > self._gate * np.sqrt(S)
        g = np.where(rejected, 0.0, self._cov[0] / np.sqrt(S))
        self._mean = self._mean + g * (innovation / np.sqrt(S))
        self._cov = self._cov - g[:, None] * g[None]
        return MooringEstimate(self._mean, self._cov, np.zeros(len(S)), rejected)


def make_filter(config: MooringConfig, rng: np.random.Generator, runs: int = 1) -> KalmanMooring | ParticleMooring:
    """The filter that the config names."""
    return ParticleMooring(config, rng, runs) if config.filter == "particle" else KalmanMooring(config, runs)
