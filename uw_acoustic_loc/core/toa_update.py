"""Kalman update with the arrivals of a ping, each within the gate (Choi 2025, eq. 8-10)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from .types import AnyArray, Array


class Absorbed(NamedTuple):
    """What an update does to a mean and a covariance (D, D)."""

    change: Array  # (D,) of the mean
    cov: Array  # (D, D) after
    used: int  # arrivals within the gate
    nis: float  # sum of squares of their normalised innovations


def absorb(cov: Array, innovations: Array, H: Array, variances: Array, gate_sigma: float) -> Absorbed:
    """Arrivals with innovations (n,), Jacobian H (n, D) and variances (n,), linearised at the prediction.

    The same as one arrival after the other, each gated by what those before it have left: the innovations whitened by
    the Cholesky factor of their covariance. When one fails, the most expected come first, so that an outlier
    meets a covariance that the good ones have narrowed.
    """
    HP = H.dot(cov)
    S = HP.dot(H.T)
    S.flat[:: len(S) + 1] += variances
    late = innovations[:, None]
    white = _whitened(S, np.concatenate([HP, late], axis=1))
    taken = white.T.dot(white)  # gains and all that is needed of them in one product
    if taken[-1, -1] > gate_sigma**2 and np.abs(white[:, -1]).max() > gate_sigma:
        keep = _within_gate(S, late, gate_sigma)
        white = _whitened(S[np.ix_(keep, keep)], np.concatenate([HP[keep], late[keep]], axis=1))
        taken = white.T.dot(white)
    return Absorbed(taken[:-1, -1], cov - taken[:-1, :-1], len(white), float(taken[-1, -1]))


def _whitened(S: Array, rows: Array) -> Array:
    """L^-1 rows (n, m), S = L L^T."""
    return np.asarray(dtrtrs(dpotrf(S, lower=1)[0], rows, lower=1)[0]) if len(S) else rows


def _within_gate(S: Array, late: Array, gate_sigma: float) -> AnyArray:
    """Which arrivals pass, the most expected first."""
    keep: AnyArray = np.argsort(np.square(late[:, 0]) / np.diagonal(S), kind="stable")
    while len(keep):
        outside = np.flatnonzero(np.abs(_whitened(S[np.ix_(keep, keep)], late[keep])) > gate_sigma)
        if not len(outside):
            break
        keep = np.delete(keep, outside[0])
    return keep
