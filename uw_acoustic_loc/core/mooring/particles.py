"""Particle filter of a mooring's offset, with the likelihood of impulsive noise (Lee, Yang, Huh 2013, eq. 4-9).

Deviations from the paper. Particles live in the offset alone: given a particle's offsets its velocity is Gaussian, with
the same variance for all particles, and is filtered exactly (Schoen, Gustafsson, Nordlund 2005). The first cloud is
spread evenly over a somewhat wider distribution, and weighted for that. A cloud is resampled when its ESS is below a
third, with one uniform draw, and copies are moved apart such that mean and covariance stay (Liu, West 2001).
"""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist

import numpy as np

from ..impulsive import LikelihoodTable, likelihood_table
from ..types import AnyArray, Array
from .model import MooringConfig, MooringEstimate, MooringStep
from .noise_learning import LearntNoise

_WIDER = 1.3  # the first cloud than its distribution
_APART = 0.3  # of the cloud's own spread


class ParticleMooring:
    """`runs` moorings with the same system; about 100 at a time stay in the processor's cache."""

    def __init__(self, config: MooringConfig, rng: np.random.Generator, runs: int = 1) -> None:
        n = config.particles
        self._points = _normal_points(n)
        place = np.sort(self._points[0])
        weights = np.exp(-0.5 * (_WIDER**2 - 1) * np.square(place))
        self._rng = rng
        self._cloud, self._spare = np.zeros((2, 3, runs, n))  # each: offset, mean velocity, the step's normal draws
        self._cloud[0] = config.initial_offset + config.initial_std * _WIDER * place  # eq. 4
        self._velocity_var = config.initial_velocity_std**2  # of every particle
        self._weights = np.tile(weights / weights.sum(), (runs, 1))
        self.noise: LikelihoodTable | LearntNoise
        if config.noise == "learnt":
            self.noise = LearntNoise(config.expected_noise, runs)
        else:
            self.noise = likelihood_table(config.expected_noise)

    def change(self, config: MooringConfig) -> None:
        """Goes on with another noise; one that is learnt stays as it is."""
        if config.noise == "given":
            self.noise = likelihood_table(config.expected_noise)

    def predict(self, step: MooringStep) -> None:
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
        self._resample(np.flatnonzero(ess < weights.shape[1] / 3), mean, cov)
        return MooringEstimate(mean, cov, ess, np.zeros(len(ess), dtype=bool))

    def _moments(self, state: Array, weights: Array) -> tuple[Array, Array]:
        mean = np.einsum("drn,rn->dr", state, weights)
        off = np.subtract(state, mean[:, :, None], out=self._spare[:2])
        weighted = off * weights
        pairs = ((0, 0), (0, 1), (1, 1))
        offset, both, velocity = (np.einsum("rn,rn->r", weighted[i], off[j]) for i, j in pairs)
        return mean, np.array([[offset, both], [both, velocity + self._velocity_var]])

    def _resample(self, rows: AnyArray, mean: Array, cov: Array) -> None:
        """Systematic resampling of some runs (eq. 9)."""
        first = self._rng.random((len(self._weights), 1))[rows]  # of all runs: they do not depend on each other
        if not rows.size:
            return
        n = self._weights.shape[1]
        below = np.minimum((np.cumsum(self._weights[rows], axis=1) * n + 1 - first).astype(np.intp), n)
        below[:, -1] = n
        below[:, 1:] -= below[:, :-1]  # now the number of copies
        copies = np.array([np.repeat(values[rows], below.ravel()).reshape(below.shape) for values in self._cloud[:2]])
        self._cloud[:2, rows] = self._apart(copies, mean[:, rows], cov[:, :, rows])
        self._weights[rows] = 1 / n

    def _apart(self, copies: Array, mean: Array, cov: Array) -> Array:
        """Copies (2, runs, n) after a step towards their mean and one of their own (Liu, West 2001, sec. 10.3)."""
        shrink, (first, second) = math.sqrt(1 - _APART**2), _APART * self._points
        offset = np.sqrt(cov[0, 0])
        along = cov[0, 1] / np.maximum(offset, 1e-300)
        across = np.sqrt(np.maximum(cov[1, 1] - self._velocity_var - along**2, 0.0))
        copies *= shrink
        copies += (1 - shrink) * mean[:, :, None]
        copies[0] += offset[:, None] * first
        copies[1] += along[:, None] * first + across[:, None] * second
        return copies


@lru_cache(maxsize=4)
def _normal_points(n: int) -> Array:
    """(2, n) points evenly spread over the standard normal distribution of the plane, neighbours far apart.

    They stand for random draws (additive recurrence with the plastic number, Roberts 2018), so that runs which resample
    do not take random numbers from others.
    """
    turns = np.arange(1, n + 1) * np.array([[0.7548776662466927], [0.5698402909980532]]) % 1.0
    return np.array([[NormalDist().inv_cdf(turn) for turn in row] for row in turns.tolist()])


def _spread(step: MooringStep, velocity_var: float) -> tuple[Array, float]:
    """(2,) offset and mean velocity per normal draw, and the velocity's variance once the new offset is known."""
    F, Q = step.F, step.Q
    offset = F[0, 1] ** 2 * velocity_var + Q[0, 0]
    both = F[0, 1] * F[1, 1] * velocity_var + Q[0, 1]
    velocity = F[1, 1] ** 2 * velocity_var + Q[1, 1]
    if offset == 0:
        return np.zeros(2), float(velocity)
    spread = np.array([offset, both]) / math.sqrt(offset)
    return spread, max(float(velocity - spread[1] ** 2), 0.0)
