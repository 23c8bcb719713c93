"""Offset of a moored buoy, a mass-damper-spring system, measured with impulsive noise (Lee, Yang, Huh 2013).

m x'' + b x' + k x = u. Three filters of one model: a particle filter whose likelihood is the noise mixture's own, the
Kalman filter that takes the noise for Gaussian, and the same with a gate. All work on many runs at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ..config import param
from .impulsive import AlphaStable, ImpulsiveNoise, LogDensity
from .types import Array


@dataclass(frozen=True)
class MooringConfig:
    """Parameters of the mooring tracker; the noise is in the scenario's terms."""

    mooring_ids: tuple[str, ...] = param(("buoy1",), doc="one filter each")
    filter: str = param("particle", choices=("particle", "kalman", "kalman_gated"))
    mass: float = param(1.0, unit="kg", low=0, doc="0 = the paper's scalar form, damping and stiffness alone")
    damping: float = param(0.5, unit="N s/m", low=0)
    stiffness: float = param(1.0, unit="N/m", low=0)
    force: float = param(0.5, unit="N", doc="constant")
    initial_offset: float = param(0.0, unit="m")
    initial_std: float = param(2.0, unit="m", low=0)
    initial_velocity_std: float = param(0.5, unit="m/s", low=0)
    process_std: float = param(0.05, unit="m", low=0, doc="random motion of the offset in one process_period")
    process_period: float = param(0.5, unit="s", low=1e-3)
    measurement_std: float = param(0.5, unit="m", low=1e-9, doc="of the Gaussian part")
    impulse_fraction: float = param(0.3, low=0, high=1)
    impulse_alpha: float = param(1.8, low=0.5, high=2)
    impulse_beta: float = param(1.0, low=-1, high=1)
    impulse_scale: float = param(10.0, low=1e-9, doc="in measurement_std")
    impulse_location: float = param(-3.0, doc="in measurement_std, parameterisation S1")
    gate_sigma: float = param(3.0, unit="sigma", low=0.5, changeable=True, doc="of kalman_gated")
    particles: int = param(100, low=2, high=1_000_000)
    seed: int = param(1, low=0)

    def __post_init__(self) -> None:
        if len(set(self.mooring_ids)) < max(len(self.mooring_ids), 1) or "" in self.mooring_ids:
            raise ValueError(f"mooring_ids must be distinct names, at least one, got {list(self.mooring_ids)}")
        if self.mass == 0 and self.damping == 0:
            raise ValueError("mass and damping must not both be 0")

    @property
    def noise(self) -> ImpulsiveNoise:
        """The measurement noise that the particle filter expects."""
        stable = AlphaStable(self.impulse_alpha, self.impulse_beta, self.impulse_scale, self.impulse_location)
        return ImpulsiveNoise(self.measurement_std, self.impulse_fraction, stable)


@dataclass(frozen=True, eq=False)
class Step:
    """The discrete system over one time step: [x v] -> F [x v] + drive + noise of covariance Q."""

    F: Array  # (2, 2)
    drive: Array  # (2,)
    Q: Array  # (2, 2)

    @cached_property
    def noise_factor(self) -> Array:
        """(2, 2) lower triangular, its square is Q."""
        first = math.sqrt(self.Q[0, 0])
        cross = self.Q[1, 0] / first if first > 0 else 0.0
        return np.array([[first, 0.0], [cross, math.sqrt(max(self.Q[1, 1] - cross**2, 0.0))]])


def discretise(mass: float, damping: float, stiffness: float, force: float, dt: float) -> tuple[Array, Array]:
    """Exact F (2, 2) and drive (2,) of offset and velocity over dt s under a constant force.

    With mass 0 this is the paper's scalar form (eq. 5), x' = f x + g u, the velocity following from the offset.
    """
    if mass == 0:
        f, g = expm(np.array([[-stiffness / damping, force / damping], [0.0, 0.0]]) * dt)[0]
        return np.array([[f, 0], [-stiffness / damping * f, 0]]), np.array([g, (force - stiffness * g) / damping])
    A = np.array([[0, 1, 0], [-stiffness / mass, -damping / mass, force / mass], [0, 0, 0]])
    whole = expm(A * dt)
    return whole[:2, :2], whole[:2, 2]


def expm(A: Array) -> Array:
    """Matrix exponential of a small matrix: Taylor series of A / 2^s, squared s times."""
    halvings = max(0, math.ceil(math.log2(max(float(np.abs(A).sum(axis=1).max()), 1e-300))) + 3)
    A = A / 2.0**halvings
    total = term = np.eye(len(A))
    for k in range(1, 13):
        term = term @ A / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return np.asarray(total)


@lru_cache(maxsize=256)
def step_of(config: MooringConfig, dt: float) -> Step:
    """The system over dt s; a gap of several periods is as many steps, so that missed measurements change nothing."""
    count = max(1, round(dt / config.process_period))
    F, drive = discretise(config.mass, config.damping, config.stiffness, config.force, dt / count)
    Q = np.diag([config.process_std**2 * dt / count / config.process_period, 0.0])
    return _repeated(Step(F, drive, Q), count)


def _repeated(step: Step, count: int) -> Step:
    if count == 1:
        return step
    half = _repeated(step, count // 2)
    whole = _then(half, half)
    return _then(whole, step) if count % 2 else whole


def _then(a: Step, b: Step) -> Step:
    return Step(b.F @ a.F, b.F @ a.drive + b.drive, b.F @ a.Q @ b.F.T + b.Q)


@dataclass(frozen=True, eq=False)
class MooringEstimate:
    """Offset and velocity of every run after a measurement."""

    mean: Array  # (2, runs) m, m/s
    cov: Array  # (2, 2, runs)
    ess: Array  # (runs,) effective number of particles; 0 for the Kalman filters
    rejected: Array  # (runs,) bool, by the gate


class KalmanMooring:
    """Kalman filter of `runs` moorings with the same system; with a gate, measurements beyond it are ignored."""

    def __init__(self, config: MooringConfig, runs: int = 1) -> None:
        self.config = config  # may be replaced by one with another gate
        self._mean = np.zeros((2, runs))
        self._mean[0] = config.initial_offset
        self._cov = np.zeros((2, 2, runs))
        self._cov[0, 0], self._cov[1, 1] = config.initial_std**2, config.initial_velocity_std**2

    @property
    def _gate(self) -> float:
        return self.config.gate_sigma if self.config.filter == "kalman_gated" else math.inf

    def predict(self, step: Step) -> None:
        """Moves on by a time step (eq. 5)."""
        self._mean = step.F @ self._mean + step.drive[:, None]
        moved = np.einsum("ij,jkr,lk->ilr", step.F, self._cov, step.F) + step.Q[:, :, None]
        self._cov = (moved + moved.transpose(1, 0, 2)) / 2

    def update(self, measured: Array) -> MooringEstimate:
        """Takes in a measured offset (runs,)."""
        S = self._cov[0, 0] + self.config.measurement_std**2
        innovation = measured - self._mean[0]
        rejected = np.abs(innovation) > self._gate * np.sqrt(S)
        g = np.where(rejected, 0.0, self._cov[0] / np.sqrt(S))
        self._mean = self._mean + g * (innovation / np.sqrt(S))
        self._cov = self._cov - g[:, None] * g[None]
        return MooringEstimate(self._mean, self._cov, np.zeros(len(S)), rejected)


class ParticleMooring:
    """Particle filter of `runs` moorings with the same system; resamples a run when its ESS is below half."""

    def __init__(self, config: MooringConfig, rng: np.random.Generator, runs: int = 1) -> None:
        n = config.particles
        self.config = config
        self._rng = rng
        self._log_density = LogDensity(config.noise)
        self._state = rng.normal(size=(2, runs, n))  # eq. 4
        self._state[0] = config.initial_offset + config.initial_std * self._state[0]
        self._state[1] *= config.initial_velocity_std
        self._log_weights = np.full((runs, n), -math.log(n))

    def predict(self, step: Step) -> None:
        """Moves the cloud on by a time step (eq. 5)."""
        x, v = self._state
        F, L = step.F, step.noise_factor
        w = self._rng.normal(size=x.shape)
        moved = np.stack([F[0, 0] * x + F[0, 1] * v + L[0, 0] * w, F[1, 0] * x + F[1, 1] * v + L[1, 0] * w])
        if L[1, 1] > 0:
            moved[1] += L[1, 1] * self._rng.normal(size=x.shape)
        self._state = moved + step.drive[:, None, None]

    def update(self, measured: Array) -> MooringEstimate:
        """Weights the cloud by the mixture's likelihood of a measured offset (runs,) (eq. 6-8), then resamples."""
        logs = self._log_weights + self._log_density(measured[:, None] - self._state[0])
        logs -= logs.max(axis=1, keepdims=True)
        weights = np.exp(logs)
        weights /= weights.sum(axis=1, keepdims=True)
        self._log_weights = logs - np.log(np.exp(logs).sum(axis=1, keepdims=True))
        mean = np.einsum("drn,rn->dr", self._state, weights)
        off = self._state - mean[:, :, None]
        cov = np.einsum("drn,ern,rn->der", off, off, weights)
        ess = 1 / np.square(weights).sum(axis=1)
        self._resample(weights, ess < weights.shape[1] / 2)
        return MooringEstimate(mean, cov, ess, np.zeros(len(ess), dtype=bool))

    def _resample(self, weights: Array, poor: Array) -> None:
        """Systematic resampling (eq. 9 with one uniform draw a run) of the runs marked `poor`."""
        rows, n = np.flatnonzero(poor), weights.shape[1]
        first = self._rng.random((len(weights), 1))[rows]  # one draw for every run: runs do not depend on each other
        below = np.floor(np.cumsum(weights[rows], axis=1) * n + 1 - first).astype(np.intp)
        below[:, -1] = n
        copies = np.diff(below, axis=1, prepend=0)
        source = np.repeat(np.tile(np.arange(n), len(rows)), copies.ravel()).reshape(len(rows), n)
        self._state[:, rows] = np.take_along_axis(self._state[:, rows], source[None], axis=2)
        self._log_weights[rows] = -math.log(n)


def make_filter(config: MooringConfig, rng: np.random.Generator, runs: int = 1) -> KalmanMooring | ParticleMooring:
    """The filter that the config names."""
    return ParticleMooring(config, rng, runs) if config.filter == "particle" else KalmanMooring(config, runs)
