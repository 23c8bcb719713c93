"""A moored buoy as a mass-damper-spring system, m x'' + b x' + k x = u, and the parameters of its filters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...config import param
from ..impulsive import AlphaStable, ImpulsiveNoise
from ..types import Array


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
    max_offset: float = param(1000.0, unit="m", low=1e-3, doc="no mooring goes further: beyond it a filter restarts")
    initial_std: float = param(2.0, unit="m", low=0)
    initial_velocity_std: float = param(1.0, unit="m/s", low=0)
    process_std: float = param(0.05, unit="m", low=0, doc="random motion of the offset in one process_period")
    process_period: float = param(0.5, unit="s", low=1e-3)
    noise: str = param(
        "given",
        choices=("given", "learnt"),
        doc="learnt: the std within a factor of 4, and the fraction",
    )
    measurement_std: float = param(0.5, unit="m", low=1e-9, changeable=True, doc="of the Gaussian part")
    impulse_fraction: float = param(0.3, low=0, high=1, changeable=True)
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
        if abs(self.initial_offset) > self.max_offset:
            raise ValueError(
                f"initial_offset must be within max_offset {self.max_offset:g} m, got {self.initial_offset:g} m"
            )
        if self.mass == 0 and self.damping == 0:
            raise ValueError("mass and damping must not both be 0")
        if self.noise == "learnt" and self.filter != "particle":
            raise ValueError(f"noise can be learnt by filter particle only, got filter {self.filter}")

    @property
    def expected_noise(self) -> ImpulsiveNoise:
        """The measurement noise that the particle filter expects, or starts from."""
        stable = AlphaStable(self.impulse_alpha, self.impulse_beta, self.impulse_scale, self.impulse_location)
        return ImpulsiveNoise(self.measurement_std, self.impulse_fraction, stable)


@dataclass(frozen=True, eq=False)
class MooringStep:
    """The discrete system over one time step: [x v] -> F [x v] + drive + noise of covariance Q."""

    F: Array  # (2, 2)
    drive: Array  # (2,)
    Q: Array  # (2, 2)


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
def step_of(config: MooringConfig, dt: float) -> MooringStep:
    """The system over dt s; a gap of several periods is as many steps, so that missed measurements change nothing."""
    count = max(1, round(dt / config.process_period))
    F, drive = discretise(config.mass, config.damping, config.stiffness, config.force, dt / count)
    Q = np.diag([config.process_std**2 * dt / count / config.process_period, 0.0])
    return _repeated(MooringStep(F, drive, Q), count)


def _repeated(step: MooringStep, count: int) -> MooringStep:
    if count == 1:
        return step
    half = _repeated(step, count // 2)
    whole = _then(half, half)
    return _then(whole, step) if count % 2 else whole


def _then(a: MooringStep, b: MooringStep) -> MooringStep:
    return MooringStep(b.F @ a.F, b.F @ a.drive + b.drive, b.F @ a.Q @ b.F.T + b.Q)


@dataclass(frozen=True, eq=False)
class MooringEstimate:
    """Offset and velocity of every run after a measurement."""

    mean: Array  # (2, runs) m, m/s
    cov: Array  # (2, 2, runs)
    ess: Array  # (runs,) effective number of particles; 0 for the Kalman filters
    rejected: Array  # (runs,) bool, by the gate
