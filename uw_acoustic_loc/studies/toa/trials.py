"""Monte Carlo trials of the buoy tracker in the setting of Choi 2025, sec. 4.1, and the bound on them.

The seabed, which the paper does not give, lies at 200 m; the target's start is the paper's, z upwards.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...config import changed, configured
from ...core.toa.bound import PingNoise, track_bound
from ...core.toa.config import ToaConfig
from ...core.toa.model import BIAS_STD
from ...core.toa.paths import ReceiverNet, make_net
from ...core.toa.solver import cold_prior
from ...core.toa.tracker import ToaTracker
from ...core.types import Array, Arrivals
from .batch import ToaBatch
from .result import Result

BUOYS = np.array([[0.0, 0, 0], [2000, 0, 0], [0, 2000, 0], [2000, 2000, 0]])
IDS = (1, 2, 3, 4)
START = np.array([500.0, 800, -60, 1.2, 1.0, 0.2])
SOUND_SPEED, RANGE, WALK = 1500.0, 2.0, 0.3  # m/s; m/s about the mean; m/s per step
DISTURBANCE = 0.02  # m/s^2, new at every step, per axis
PINGS, DT, STD = 50, 1.0, 0.003  # 1; s; s
DEPTH = 200.0  # m
_TRUTH, _START, _PINGS = 1, 2, 3  # keep the random numbers of the parts apart

NARROW = (10.0, 10.0, 10.0, 0.3, 0.3, 0.1, 2.0)
WIDE = (50.0, 50.0, 50.0, 1.0, 1.0, 1.0, 2.0)
DIRECT, BOTH = (Arrivals.DIRECT,), (Arrivals.DIRECT, Arrivals.BOTTOM)


@dataclass(frozen=True)
class Variant:
    """What is heard, and what is known before; an empty prior is a cold start."""

    label: str
    prior: tuple[float, ...] = NARROW
    paths: tuple[int, ...] = BOTH
    outliers: float = 0.0  # share of the arrivals that are late by an exponential of 0.1 s mean
    labelled: bool = True
    emission: str = "known"

    @property
    def config(self) -> ToaConfig:
        """The tracker's, with the noise that the truth has."""
        return configured(
            ToaConfig,
            emission=self.emission,
            bottom_depth=DEPTH if Arrivals.BOTTOM in self.paths else 0.0,
            sound_speed_walk=WALK,
            acceleration_noise=DISTURBANCE,
            vertical_acceleration_noise=DISTURBANCE,
        )

    @property
    def net(self) -> ReceiverNet:
        """The buoys with the images of the paths that are heard."""
        return make_net(IDS, BUOYS, self.config.water.bottom_depth)


VARIANTS = {
    "nominal": Variant("prior 10 m, direct and bottom"),
    "direct_only": Variant("direct arrivals only", paths=DIRECT),
    "outliers": Variant("10 % late outliers", outliers=0.1),
    "cold_start": Variant("no prior", prior=()),
    "unlabelled": Variant("paths not labelled", labelled=False),
    "unknown_emission": Variant("emission unknown", emission="unknown"),
    "wide_prior_outliers": Variant("prior 50 m, outliers", prior=WIDE, outliers=0.1),
    "cold_start_outliers": Variant("no prior, outliers", prior=(), outliers=0.1),
    "unlabelled_outliers": Variant("not labelled, outliers", labelled=False, outliers=0.1),
    "unknown_emission_cold_start": Variant("emission unknown, no prior", prior=(), emission="unknown"),
}


def truths(runs: int, seed: int) -> Array:
    """(runs, PINGS, 7) constant velocity with a random disturbance; a sound speed that walks within its limits."""
    rng = np.random.default_rng([seed, _TRUTH])
    states = np.empty((PINGS, runs, 7))
    x, v, c = np.tile(START[:3], (runs, 1)), np.tile(START[3:], (runs, 1)), np.full(runs, SOUND_SPEED)
    for state in states:
        state[:, :3], state[:, 3:6], state[:, 6] = x, v, c
        a = rng.normal(0.0, DISTURBANCE, (runs, 3))
        x, v = x + DT * v + DT**2 / 2 * a, v + DT * a
        c = np.clip(c + rng.normal(0.0, WALK, runs), SOUND_SPEED - RANGE, SOUND_SPEED + RANGE)
    return np.ascontiguousarray(np.swapaxes(states, 0, 1))


def arrivals(variant: Variant, states: Array, rng: np.random.Generator) -> list[Arrivals]:
    """Of every ping of a run (PINGS, 7); when the stamp is not the emission, the target goes on until the emission."""
    images = variant.net.images[list(variant.paths)].reshape(-1, 3)
    shape = (len(states), len(images))
    errors = rng.normal(0.0, STD, shape)
    errors += (rng.random(shape) < variant.outliers) * rng.exponential(0.1, shape)
    emission = rng.uniform(0.0, 0.5, (len(states), 1)) if variant.emission == "unknown" else np.zeros((len(states), 1))
    positions = states[:, :3] + emission * states[:, 3:6]
    time = emission + np.linalg.norm(positions[:, None] - images, axis=2) / states[:, 6:] + errors
    receiver = np.tile(np.array(IDS, np.uint16), len(variant.paths))
    path = np.repeat(np.array(variant.paths, np.uint8), len(IDS)) * np.uint8(variant.labelled)
    same = np.full(len(images), STD)
    return [Arrivals(round((1 + k * DT) * 1e9), receiver, path, heard, same, same) for k, heard in enumerate(time)]


def trial(variant: Variant, runs: int, seed: int, progress: Callable[[float], None]) -> Result:
    """The node's own tracker on every run. The random numbers of truth and start are the same for all variants."""
    truth = truths(runs, seed)
    mean, cov = np.full(truth.shape, np.nan), np.full((*truth.shape, 7), np.nan)
    for run, states in enumerate(truth):
        tracker = ToaTracker(_started(variant, _start(variant, states, run, seed)), variant.net)
        for k, heard in enumerate(_heard(variant, states, run, seed)):
            if estimate := tracker.update(heard):
                mean[run, k], cov[run, k] = estimate.mean, estimate.cov
        progress((run + 1) / runs)
    return Result(truth, mean, cov, bound(variant, truth))


def bound(variant: Variant, truth: Array) -> Array:
    """(PINGS, 7, 7) posterior Cramer-Rao bound over the true tracks (runs, PINGS, 7), every arrival being good."""
    net, config = variant.net, variant.config
    prior = np.diag(np.square(variant.prior)) if variant.prior else cold_prior(net, config)[1]
    noise = PingNoise(STD, 0.0, BIAS_STD if variant.emission == "unknown" else 0.0)
    return track_bound(truth, net.images[list(variant.paths)].reshape(-1, 3), prior, noise, config, DT)


def published(outliers: float, gate_sigma: float, runs: int, seed: int) -> Result:
    """The paper's filter as it is: a gate that rejects and never reopens, the prior of 10 m, all runs at once."""
    variant = dataclasses.replace(VARIANTS["nominal"], outliers=outliers)
    truth, images = truths(runs, seed), variant.net.images[list(variant.paths)].reshape(-1, 3)
    starts = [_start(variant, states, run, seed) for run, states in enumerate(truth)]
    heard = [_heard(variant, states, run, seed) for run, states in enumerate(truth)]
    cov = np.repeat(np.diag(np.square(variant.prior))[..., None], runs, axis=2)
    batch = ToaBatch(np.transpose(starts), cov, changed(variant.config, gate_sigma=gate_sigma))
    means, covs = [], []
    for k in range(PINGS):
        if k:
            batch.predict(DT)
        batch.update(images, np.transpose([pings[k].time for pings in heard]), STD)
        means.append(batch.mean.T.copy())
        covs.append(np.moveaxis(batch.cov, 2, 0).copy())
    return Result(truth, np.stack(means, axis=1), np.stack(covs, axis=1), bound(variant, truth))


def _start(variant: Variant, states: Array, run: int, seed: int) -> Array:
    """(7,) mean of a prior that is honest about the first of the states; of a cold start, nothing."""
    if not variant.prior:
        return np.zeros(0)
    return np.asarray(states[0] + np.random.default_rng([seed, _START, run]).normal(0.0, variant.prior))


def _heard(variant: Variant, states: Array, run: int, seed: int) -> list[Arrivals]:
    return arrivals(variant, states, np.random.default_rng([seed, _PINGS, run]))


def _started(variant: Variant, start: Array) -> ToaConfig:
    if not start.size:
        return variant.config
    mean = start.tolist()
    return changed(
        variant.config,
        cold_start=False,
        initial_position=tuple(mean[:3]),
        initial_position_std=variant.prior[:3],
        initial_velocity=tuple(mean[3:6]),
        initial_velocity_std=variant.prior[3:6],
        sound_speed=mean[6],
        sound_speed_std=variant.prior[6],
    )
