"""Kalman update with the arrivals of a ping, each within the gate (Choi 2025, eq. 8-10)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from ..types import AnyArray, Array


class Absorbed(NamedTuple):
    """What an update does to a mean and a covariance (D, D)."""

    change: Array  # (D,) of the mean
    cov: Array  # (D, D) after
    used: int  # arrivals within the gate
    nis: float  # sum of squares of their normalised innovations


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
        return absorb(cov, innovations[keep], H[keep], R[np.ix_(keep, keep)], np.inf)
    root = L[n:, n:-1]
    after = root.dot(root.T)
    return Absorbed(after[-1, :-1], after[:-1, :-1], n, nis)


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
