"""Update of the buoy tracker's state with the arrivals of one ping: gate, or weights of the noise's mixture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Array, ArrivalPaths
from .clock import heard_times
from .config import ToaConfig
from .model import BIAS_STD, by_emission, curvature, impulsive_noise
from .paths import Epoch
from .robust import mixture_weights
from .solver import solve
from .update import absorb


@dataclass(frozen=True, eq=False)
class ToaEstimate:
    """The state at an epoch's stamp, and what the update was made of."""

    t_ns: int
    mean: Array  # (7,) position m, velocity m/s, sound speed m/s; then the clocks, if there are any (core/toa_clock.py)
    cov: Array  # (7, 7), or more
    used: int  # arrivals within the gate
    rejected: int
    nis: float  # sum of squared normalised innovations of the used ones; `used` degrees of freedom
    paths: ArrivalPaths | None = None  # of arrivals that came without a path


def emission_bias(epoch: Epoch, mean: Array, config: ToaConfig) -> float:
    """Emission after the stamp in s; the median is right as long as most arrivals are."""
    if config.emission == "known" or not len(epoch.time):
        return 0.0
    return float(np.median(epoch.time - heard_times(mean, epoch.images, epoch.receiver)[0]))


def updated(epoch: Epoch, mean: Array, cov: Array, config: ToaConfig) -> ToaEstimate:
    """By one linear update; after a long gap, too curved for that, by iterations from the prediction (7,), (7, 7)."""
    bias = emission_bias(epoch, mean, config)
    times, H = heard_times(mean, epoch.images, epoch.receiver, bias, bias or None)
    bend = curvature(H[:, :3], cov[:3, :3], times - bias)
    if np.any(bend > epoch.std):
        s = solve([epoch], mean, cov, _around(mean, cov), config)
        return ToaEstimate(epoch.t_ns, s.mean, s.cov, s.used, s.rejected, s.cost)
    innovations, variances, sway = epoch.time - times - bend, np.square(epoch.std), _sway(epoch, H)
    weights = _weights(innovations, (H.dot(cov) * H).sum(axis=1) + np.diagonal(sway), variances, config)
    R = np.diag(variances / weights + 2 * np.square(bend)) + sway
    if config.emission == "unknown":
        cov, H = _with_bias(cov), np.column_stack([H, by_emission(mean, H)])
    keep = np.flatnonzero(weights > _LEAST_WEIGHT)
    a = absorb(cov, innovations[keep], H[keep], R[np.ix_(keep, keep)], config.arrivals.gate_sigma)
    rejected = len(epoch.time) - a.used
    size = len(mean)
    return ToaEstimate(epoch.t_ns, mean + a.change[:size], a.cov[:size, :size], a.used, rejected, a.nis)


_LEAST_WEIGHT = 0.01  # of an arrival; one below counts as rejected, so that a lost target is noticed


def _weights(innovations: Array, predicted: Array, variances: Array, config: ToaConfig) -> Array:
    """Of the arrivals (n,): how likely each is of the Gaussian part of the noise (core/robust.py).

    `predicted` (n,): the variances of the predictions without the noise.
    """
    if config.arrivals.noise == "gaussian":
        return np.ones(len(innovations))
    return mixture_weights(innovations / np.sqrt(variances), predicted / variances, impulsive_noise(config.arrivals))


def _sway(epoch: Epoch, H: Array) -> Array:
    """(n, n) covariance of the times that comes from the receivers' x; the paths to a receiver share it."""
    shared = epoch.receiver[:, None] == epoch.receiver
    return np.asarray(np.outer(H[:, 0], H[:, 0] * epoch.net.sway[epoch.receiver]) * shared)


def _with_bias(cov: Array) -> Array:
    """(D + 1, D + 1): the state's covariance (D, D) and that of an unknown instant of emission."""
    whole = np.zeros((len(cov) + 1, len(cov) + 1))
    whole[:-1, :-1] = cov
    whole[-1, -1] = BIAS_STD**2
    return whole


def _around(mean: Array, cov: Array) -> Array:
    """(5, 7) start points: the mean, and 2 sigma to either side along both horizontal axes of the covariance."""
    values, axes = np.linalg.eigh(cov[:2, :2])
    starts = np.tile(mean, (5, 1))
    for k, axis in enumerate((axes * 2 * np.sqrt(values)).T):
        starts[1 + 2 * k : 3 + 2 * k, :2] += np.outer([1, -1], axis)
    return starts
