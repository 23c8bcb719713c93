"""Particle filter of a mooring's offset, with the likelihood of impulsive noise (Lee, Yang, Huh 2013, eq. 4-9).

Deviations from the paper. Particles live in the offset alone: given a particle's offsets its velocity is Gaussian, with
the same variance for all particles, and is filtered exactly (Schoen, Gustafsson, Nordlund 2005). The first cloud is
spread evenly over its distribution. A cloud is resampled when its ESS is below half, with one uniform draw.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from .impulsive import LikelihoodTable, likelihood_table
from .mooring_model import MooringConfig, MooringEstimate, Step
from .noise_learning import LearntNoise
from .types import AnyArray, Array


class ParticleMooring:
    """`runs` moorings with the same system; about 100 at a time stay in the processor's cache."""

    def __init__(self, config: MooringConfig, rng: np.random.Generator, runs: int = 1) -> None:
        n = config.particles
        normal = NormalDist(config.initial_offset, config.initial_std) if config.initial_std else None
        first = [normal.inv_cdf((k + 0.5) / n) if normal else config.initial_offset for k in range(n)]  # eq. 4
        self._rng = rng
        self._cloud, self._spare = np.zeros((2, 3, runs, n))  # each: offset, mean velocity, the step's normal draws
        self._cloud[0] = first
        self._velocity_var = config.initial_velocity_std**2  # of every particle
        self._weights = np.full((runs, n), 1 / n)
        self.noise: LikelihoodTable | LearntNoise
        if config.noise == "learnt":
            self.noise = LearntNoise(config.expected_noise, runs)
        else:
            self.noise = likelihood_table(config.expected_noise)

    def change(self, config: MooringConfig) -> None:
        """Goes on with another noise; one that is learnt stays as it is."""
        if config.noise == "given":
            self.noise = likelihood_table(config.expected_noise)

    def predict(self, step: Step) -> None:
        """Moves the cloud on by a time step (eq. 5)."""
        spread, self._velocity_var = _spread(step, self._velocity_var)
        self._rng.standard_normal(out=self._cloud[2])
        moved = self._spare[:2]
        np.matmul(np.column_stack([step.F, spread]), self._cloud.reshape(3, -1), out=moved.reshape(2, -1))
        moved += step.drive[:, None, None]
        self._cloud, self._spare = self._spare, self._cloud

    def update(self, measured: Array) -> MooringEstimate:
        """Weights the cloud by the likelihood of a measured offset (runs,) (eq. 6-8), then resamples."""
        state = self._cloud[:2]
        weights = self.noise.weigh(self._weights, measured[:, None] - state[0])
        weights /= weights.sum(axis=1, keepdims=True)
        mean, cov = self._moments(state, weights)
        ess = 1 / np.einsum("rn,rn->r", weights, weights)
        self._weights = weights
        self._resample(np.flatnonzero(ess < weights.shape[1] / 2))
        return MooringEstimate(mean, cov, ess, np.zeros(len(ess), dtype=bool))

    def _moments(self, state: Array, weights: Array) -> tuple[Array, Array]:
        mean = np.einsum("drn,rn->dr", state, weights)
        off = np.subtract(state, mean[:, :, None], out=self._spare[:2])
        cov = np.einsum("drn,ern->der", off * weights, off)
        cov[1, 1] += self._velocity_var
        return mean, cov

    def _resample(self, rows: AnyArray) -> None:
        """Systematic resampling of some runs (eq. 9)."""
        first = self._rng.random((len(self._weights), 1))[rows]  # of all runs: they do not depend on each other
        n = self._weights.shape[1]
        below = (np.cumsum(self._weights[rows], axis=1) * n + 1 - first).astype(np.intp)
        below[:, -1] = n
        source = np.repeat(np.arange(below.size), np.diff(below, axis=1, prepend=0).ravel())
        for values in self._cloud[:2]:
            values[rows] = values[rows].ravel()[source].reshape(-1, n)
        self._weights[rows] = 1 / n


def _spread(step: Step, velocity_var: float) -> tuple[Array, float]:
    """(2,) offset and mean velocity per normal draw, and the velocity's variance once the new offset is known."""
    F, Q = step.F, step.Q
    offset = F[0, 1] ** 2 * velocity_var + Q[0, 0]
    both = F[0, 1] * F[1, 1] * velocity_var + Q[0, 1]
    velocity = F[1, 1] ** 2 * velocity_var + Q[1, 1]
    if offset == 0:
        return np.zeros(2), float(velocity)
    spread = np.array([offset, both]) / math.sqrt(offset)
    return spread, max(float(velocity - spread[1] ** 2), 0.0)
