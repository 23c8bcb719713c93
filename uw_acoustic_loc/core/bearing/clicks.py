"""Clicks: samples far above everything within a millisecond. In a band they would ring like a short ping."""

from __future__ import annotations

import numpy as np

from ..types import AnyArray

_BLOCK = 1e-3  # s, and at most a quarter of a ping
_FEWEST = 32  # samples of a block; a shorter one cannot tell
_OUTLIER = 8.0  # times the mean absolute value: 6 standard deviations of noise; a ping's wave reaches 1.6 times
_LIMIT = 4.0  # times the mean around, what is left of a click


def click_block(sample_rate: float, pulse_length: float) -> int:
    """Samples of a block; 0 for pings too short to be separated from clicks."""
    size = round(min(_BLOCK, pulse_length / 4) * sample_rate)
    return size if size >= _FEWEST else 0


def limit_clicks(samples: AnyArray, block: int) -> tuple[AnyArray, AnyArray]:
    """Samples (..., n) with their clicks cut down, and in how many blocks of each row; without any, the array itself.

    A loud block beside another loud one is the edge of a ping, no click.
    """
    count = samples.shape[-1] // block if block else 0
    rows = samples.shape[:-1]
    if count < 2:
        return samples, np.zeros(rows, int)
    size = np.abs(samples[..., : count * block])
    means = np.zeros((*rows, count + 2), size.dtype)  # with silence before and after
    own = means[..., 1:-1]
    np.divide(np.einsum("...k->...", size.reshape(*rows, count, block)), block, out=own)
    around = np.maximum(means[..., 2:], means[..., :-2])
    loudest = np.maximum.reduceat(size, np.arange(0, count * block, block), axis=-1)  # twice as fast as max
    hit = loudest > _OUTLIER * np.maximum(own, around)
    if not hit.any():
        return samples, np.zeros(rows, int)
    limited = samples.copy()
    blocks = limited[..., : count * block].reshape(*rows, count, block)
    limit = (_LIMIT * around[hit][:, None]).astype(samples.dtype)
    blocks[hit] = np.clip(blocks[hit], -limit, limit)
    return limited, np.count_nonzero(hit, axis=-1)
