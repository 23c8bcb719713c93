"""Clocks of the buoys as states of the tracker: for each receiver by how many s it is ahead, and its drift.

The states follow the seven others: all offsets in the order of the net's rows, then, with a drift, all drifts.
"""

from __future__ import annotations

import numpy as np

from ..types import AnyArray, Array
from .config import ToaConfig
from .model import STATES, arrival_times


def with_clocks(mean: Array, cov: Array, receivers: int, config: ToaConfig) -> tuple[Array, Array]:
    """Mean (7,) and covariance (7, 7) followed by the prior of the clocks, when there is one."""
    stds = [s for s in (config.receivers.buoy_clock_offset_std, config.receivers.buoy_clock_drift_std) if s > 0]
    variances = np.concatenate([np.diagonal(cov), np.repeat(np.square(stds), receivers)])
    whole = np.diag(variances)
    whole[:STATES, :STATES] = cov
    return np.concatenate([mean, np.zeros(len(variances) - STATES)]), whole


def heard_times(
    mean: Array, images: Array, receiver: AnyArray, bias: Array | float = 0.0, lag: Array | float | None = None
) -> tuple[Array, Array]:
    """`arrival_times` by the clocks of the receivers, rows (n,) of the net; the Jacobian is (n, D)."""
    times, H = arrival_times(mean, images, bias, lag)
    clocks = len(mean) - STATES
    if not clocks:
        return times, H
    rows = np.zeros((len(times), clocks))
    rows[np.arange(len(times)), receiver] = 1.0
    return times + rows @ mean[STATES:], np.hstack([H, rows])
