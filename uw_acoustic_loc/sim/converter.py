"""From pressure to samples: the second channel's gain error, clipping, and 16 bits."""

from __future__ import annotations

import numpy as np

from ..core.types import AnyArray
from .scenario import Hydrophones

COUNTS = 32767  # the largest


def scale(array: Hydrophones) -> float:
    """Returns Pa per count as the driver publishes it, which leaves out the channels' mismatch."""
    return array.full_scale / COUNTS


def convert(pressure: AnyArray, array: Hydrophones) -> AnyArray:
    """Converts the pressure (2, N) in Pa to (2, N) float32 Pa or int16 counts, clipped at full scale."""
    gain = np.array([[1.0], [10 ** (array.channel_gain_db / 20)]], np.float32)
    limit = np.float32(array.full_scale)
    clipped = np.clip(pressure * gain, -limit, limit)
    if array.format == "float32":
        return np.asarray(clipped)
    return np.asarray(np.rint(clipped * (np.float32(COUNTS) / limit)).astype(np.int16))
