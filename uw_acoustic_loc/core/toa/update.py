"""Update of the buoy tracker's state with one ping: gate, or weights of the noise's mixture (Choi 2025, eq. 8-10)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from ..impulsive import mixture_weights
from ..types import AnyArray, Array, ArrivalPaths
from .config import ToaConfig
from .model import BIAS_STD, by_emission, curvature, heard_times, impulsive_noise
from .paths import Epoch
from .solver import solve


@dataclass(frozen=True, eq=False)
class ToaEstimate:
    """The state at an epoch's stamp, and what the update was made of."""

    t_ns: int
    mean: Array  # (7,) position m, velocity m/s, sound speed m/s; then the clocks, if there are any
    cov: Array  # (7, 7), or more
    used: int  # arrivals within the gate
    rejected: int
    nis: float  # sum of squared normalised innovations of the used ones; `used` degrees of freedom
    accepted: AnyArray  # bool, of the last epoch's arrivals
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
        s = solve([epoch], mean, cov, around(mean, cov), config)
        return ToaEstimate(epoch.t_ns, s.mean, s.cov, s.used, s.rejected, s.cost, s.inside)
    innovations, variances, sway = epoch.time - times - bend, np.square(epoch.std), _sway(epoch, H)
    weights = _weights(innovations, (H.dot(cov) * H).sum(axis=1) + np.diagonal(sway), variances, config)
    R = np.diag(variances / weights + 2 * np.square(bend)) + sway
    if config.emission == "unknown":
        cov, H = _with_bias(cov), np.column_stack([H, by_emission(mean, H)])
    keep = np.flatnonzero(weights > _LEAST_WEIGHT)
    a = absorb(cov, innovations[keep], H[keep], R[np.ix_(keep, keep)], config.arrivals.gate_sigma)
    size, accepted = len(mean), np.zeros(len(epoch.time), dtype=bool)
    accepted[keep[a.rows]] = True
    rejected = len(epoch.time) - a.used
    return ToaEstimate(epoch.t_ns, mean + a.change[:size], a.cov[:size, :size], a.used, rejected, a.nis, accepted)


_LEAST_WEIGHT = 0.01  # of an arrival; one below counts as rejected, so that a lost target is noticed


def _weights(innovations: Array, predicted: Array, variances: Array, config: ToaConfig) -> Array:
    """Of the arrivals (n,): how likely each is of the Gaussian part of the noise (core/impulsive.py).

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


def too_open(epoch: Epoch, mean: Array, cov: Array) -> bool:
    """Whether the horizontal position is so uncertain that an arrival's ring is no straight line any more."""
    horizontal = cov[:3, :3].copy()
    horizontal[2] = horizontal[:, 2] = 0.0
    times, H = heard_times(mean, epoch.images, epoch.receiver)
    return bool(np.any(curvature(H[:, :3], horizontal, times) > epoch.std))


def around(mean: Array, cov: Array) -> Array:
    """(5, 7) start points: the mean, and 2 sigma to either side along both horizontal axes of the covariance."""
    values, axes = np.linalg.eigh(cov[:2, :2])
    starts = np.tile(mean, (5, 1))
    for k, axis in enumerate((axes * 2 * np.sqrt(values)).T):
        starts[1 + 2 * k : 3 + 2 * k, :2] += np.outer([1, -1], axis)
    return starts


class Absorbed(NamedTuple):
    """What an update does to a mean and a covariance (D, D)."""

    change: Array  # (D,) of the mean
    cov: Array  # (D, D) after
    rows: AnyArray  # the arrivals within the gate
    nis: float  # sum of squares of their normalised innovations

    @property
    def used(self) -> int:
        """How many are within the gate."""
        return len(self.rows)


def absorb(cov: Array, innovations: Array, H: Array, R: Array, gate_sigma: float) -> Absorbed:
    """Arrivals with innovations (n,), Jacobian H (n, D) and noise R (n, n), linearised at the prediction.

    The same as one arrival after the other, each gated by what those before it have left: the Cholesky factor of the
    joint covariance of arrivals and state, with the innovations as its last row, holds the whitened innovations and a
    square root of the covariance after. When one fails, the most expected come first, so that an outlier meets a
    covariance that the good ones have narrowed.

    Raises:
        ValueError: the arrivals leave a covariance that is not positive definite; their noise is too small for that.
    """
    n = len(innovations)
    joint = _joint(cov, innovations, H, R)
    L, failed = dpotrf(joint.T, lower=1)
    if failed:
        raise ValueError(f"noise of the arrivals must be larger, got variances of {np.diagonal(R).tolist()} s^2")
    white = L[-1, :n]
    nis = float(white.dot(white))
    if nis > gate_sigma**2 and np.abs(white).max() > gate_sigma:
        keep = _within_gate(joint[:n, :n], innovations[:, None], gate_sigma)
        inside = absorb(cov, innovations[keep], H[keep], R[np.ix_(keep, keep)], np.inf)
        return inside._replace(rows=keep)
    root = L[n:, n:-1]
    after = root.dot(root.T)
    return Absorbed(after[-1, :-1], after[:-1, :-1], np.arange(n), nis)


def _joint(cov: Array, innovations: Array, H: Array, R: Array) -> Array:
    """(n + D + 1) rows and columns of which the upper triangle counts; the sign of the last is that of the change."""
    n = len(innovations)
    size = n + len(cov) + 1
    joint = np.zeros((size, size))
    HP = H.dot(cov)
    joint[:n, :n] = HP.dot(H.T) + R
    joint[:n, n:-1] = HP
    joint[n:-1, n:-1] = cov
    np.negative(innovations, out=joint[:n, -1])
    joint[-1, -1] = _LARGE
    return joint


_LARGE = 1e300  # above every square of a whitened innovation


def _whitened(S: Array, rows: Array) -> Array:
    """L^-1 rows (n, m), S = L L^T."""
    return np.asarray(dtrtrs(dpotrf(S, lower=1)[0], rows, lower=1)[0])


def _within_gate(S: Array, late: Array, gate_sigma: float) -> AnyArray:
    """Which arrivals pass, the most expected first."""
    keep: AnyArray = np.argsort(np.square(late[:, 0]) / np.diagonal(S), kind="stable")
    while len(keep):
        outside = np.flatnonzero(np.abs(_whitened(S[np.ix_(keep, keep)], late[keep])) > gate_sigma)
        if not len(outside):
            break
        keep = np.delete(keep, outside[0])
    return keep
