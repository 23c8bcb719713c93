"""Bearings against the true directions to their sources."""

from __future__ import annotations

import numpy as np

from ..core.geometry import wrap_angles
from ..core.types import Array
from .errors import Errors, TruePoses, true_vehicle
from .recording import Recording, Series


def bearing_errors(recording: Recording, series: Series) -> Errors | None:
    """Returns errors in rad, one per ping: of two bearings with one stamp (both sides) that nearer to the truth counts.

    The truth is the azimuth of the source in base_link, seen from the position that the message gives.
    """
    true, path = recording.source(series.id), true_vehicle(recording, series.space)
    if true is None or path is None or not path.covers(series.t_ns).any():
        return None
    inside = path.covers(series.t_ns)
    t_ns = series.t_ns[inside]
    bearings = np.array([value.bearing for value in series.values])[inside]
    arrays = np.array([value.position for value in series.values])[inside]
    variances = np.array([value.variance for value in series.values])[inside]
    error = wrap_angles(bearings - _azimuths(path, t_ns, arrays, true.values[-1].position))
    order = np.lexsort((np.abs(error), t_ns))
    nearest = order[np.unique(t_ns[order], return_index=True)[1]]
    return Errors(t_ns[nearest], bearings[nearest, None], error[nearest, None], variances[nearest, None, None])


def _azimuths(path: TruePoses, t_ns: Array, arrays: Array, source: Array) -> Array:
    """Returns azimuths (n,) of the source in base_link, from the arrays' positions (n, 3) in base_link."""
    positions, yaw = path.at(t_ns)
    cos, sin = np.cos(yaw), np.sin(yaw)
    x = positions[:, 0] + cos * arrays[:, 0] - sin * arrays[:, 1]
    y = positions[:, 1] + sin * arrays[:, 0] + cos * arrays[:, 1]
    return wrap_angles(np.arctan2(source[1] - y, source[0] - x) - yaw)
