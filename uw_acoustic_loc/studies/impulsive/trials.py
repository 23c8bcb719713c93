"""Monte Carlo trials of the mooring tracker under impulsive noise, in the setting of Lee, Yang, Huh 2013, sec. 4."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...core.mooring.estimator import MooringConfig, make_filter
from ...core.mooring.model import step_of
from ...core.types import Array

FRACTIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
STEPS, PERIOD, START = 20, 0.5, 2.0  # measurements; s; m
SETTLING = 2.0  # s that are left out: from then on the paper's filter is close to the truth (sec. 4)
FILTERS: Mapping[str, Mapping[str, str | int]] = {
    "kf": {"filter": "kalman"},
    "kf_gated": {"filter": "kalman_gated"},
    "particle": {"filter": "particle"},
    "learnt": {"filter": "particle", "noise": "learnt"},
    "reference": {"filter": "particle", "particles": 5000},
}
TIMES = PERIOD * np.arange(1, STEPS + 1)  # s
PAPER = {  # Lee et al. 2013, table 2: EKF mean, ODPF mean, EKF standard deviation, ODPF standard deviation, in m
    0.0: (-0.122469, 0.001291, 0.809314, 0.224610),
    0.1: (-0.119069, 0.004077, 1.033843, 0.034384),
    0.2: (0.073413, 0.048803, 1.040795, 0.113664),
    0.3: (-0.344726, -0.073884, 1.138707, 0.194922),
    0.4: (0.148500, -0.054173, 1.348201, 0.132219),
    0.5: (-0.159552, 0.0086227, 1.343063, 0.052018),
}
_CACHED = 20_000  # particles at a time that stay in the processor's cache
_TRUTH, _FILTER = 1, 2  # keep the random numbers apart


@dataclass(frozen=True, eq=False)
class Truth:
    """True and measured offsets (STEPS, runs) in m."""

    offset: Array
    measured: Array


@dataclass(frozen=True, eq=False)
class Tracked:
    """Estimated offsets and what became of them, (STEPS, runs)."""

    offset: Array  # m
    errors: Array  # m
    variances: Array  # m^2

    @property
    def settled(self) -> Array:
        """Errors of all runs from SETTLING on."""
        return self.errors[TIMES >= SETTLING]

    @property
    def mean(self) -> float:
        """Of the settled errors, in m."""
        return float(self.settled.mean())

    @property
    def std(self) -> float:
        """Of the settled errors of all runs together, in m."""
        return float(self.settled.std())

    @property
    def nees(self) -> float:
        """Mean of squared error over variance, settled."""
        return float(np.mean(np.square(self.settled) / self.variances[TIMES >= SETTLING]))


def simulate(fraction: float, runs: int, seed: int, shaken: bool = False) -> Truth:
    """Moorings released at START, at rest; `shaken` ones have the impulses in their motion, too (eq. 3, sec. 4)."""
    config = MooringConfig(impulse_fraction=fraction)
    shocks = dataclasses.replace(config.expected_noise, std=config.process_std, fraction=fraction if shaken else 0.0)
    rng, step = np.random.default_rng([seed, _TRUTH, round(10 * fraction)]), step_of(config, PERIOD)
    state = np.tile([[START], [0.0]], runs)
    offset = np.empty((STEPS, runs))
    for k in range(STEPS):
        state = step.F @ state + step.drive[:, None]
        state[0] += shocks.draw(rng, runs)
        offset[k] = state[0]
    return Truth(offset, offset + config.expected_noise.draw(rng, (STEPS, runs)))


def track(name: str, fraction: float, truth: Truth, seed: int, process_std: float = 0.05) -> Tracked:
    """One of FILTERS, with the node's defaults otherwise, on all runs."""
    config = MooringConfig(impulse_fraction=fraction, process_std=process_std)
    config = dataclasses.replace(config, **FILTERS[name])  # type: ignore[arg-type]
    rng, block = np.random.default_rng([seed, _FILTER, round(10 * fraction)]), max(1, _CACHED // config.particles)
    runs = truth.measured.shape[1]
    parts = [_filtered(config, rng, truth.measured[:, k : k + block]) for k in range(0, runs, block)]
    offset, variances = np.concatenate(parts, axis=2)
    return Tracked(offset, offset - truth.offset, variances)


def widened(fraction: float) -> float:
    """process_std in m that has the variance of shaken moorings' steps, impulses taken for Gaussian (alpha = 2)."""
    config = MooringConfig()
    return config.process_std * math.sqrt(1 - fraction + fraction * 2 * config.impulse_scale**2)


def _filtered(config: MooringConfig, rng: np.random.Generator, measured: Array) -> Array:
    """(2, STEPS, runs) offsets and variances."""
    mooring, step = make_filter(config, rng, measured.shape[1]), step_of(config, PERIOD)
    found = np.empty((2, *measured.shape))
    for k, offsets in enumerate(measured):
        mooring.predict(step)
        estimate = mooring.update(offsets)
        found[:, k] = estimate.mean[0], estimate.cov[0, 0]
    return found
