"""What one effective sound speed makes of water whose sound speed changes with depth."""

from __future__ import annotations

import numpy as np

from ...core.toa.model import arrival_times
from ...core.types import Array
from ...evaluation.tables import Sheet
from ...sim.rays import LinearProfile
from . import trials

GRADIENTS = (-0.1, -0.03, 0.0, 0.017, 0.1)  # 1/s; 0.017 is that of the pressure in mixed water
TARGETS = ((500.0, 800.0), (1000.0, 1000.0), (1500.0, 300.0))
HEIGHTS = (-20.0, -60.0, -150.0)  # m
_KNOWN = [0, 1, 2, 6]  # position and sound speed; the target rests


def sheet() -> Sheet:
    """Errors of position and one sound speed fitted to direct and bottom arrivals without noise."""
    rows = tuple(_row(gradient, z) for gradient in GRADIENTS for z in HEIGHTS)
    columns = ("gradient 1/s", "z m", "horizontal m", "vertical m", "sound speed m/s", "misfit ms")
    return Sheet("One sound speed in water with a gradient: largest errors at three positions", columns, rows)


def _row(gradient: float, z: float) -> tuple[str, ...]:
    profile = LinearProfile(trials.SOUND_SPEED, gradient)
    error, misfit = (np.array(part) for part in zip(*(fit(profile, np.array([*xy, z])) for xy in TARGETS), strict=True))
    horizontal = np.hypot(error[:, 0], error[:, 1]).max()
    vertical, speed = (error[np.abs(error[:, k]).argmax(), k] for k in (2, 3))
    shown = (f"{horizontal:.2f}", f"{vertical:+.2f}", f"{speed:+.2f}", f"{1e3 * misfit.max():.3f}")
    return (f"{gradient:g}", f"{z:g}", *shown)


def fit(profile: LinearProfile, target: Array) -> tuple[Array, float]:
    """(4,) errors of x y z (m) and of the sound speed against that at the target, and the RMS misfit in s."""
    net = trials.VARIANTS["nominal"].net
    images, times = net.images[list(trials.BOTH)].reshape(-1, 3), _times(profile, target)
    truth = np.array([*target, 0.0, 0.0, 0.0, profile.speed(target[2])])
    state = truth.copy()
    for _ in range(30):
        expected, H = arrival_times(state, images)
        state[_KNOWN] += np.linalg.lstsq(H[:, _KNOWN], times - expected, rcond=None)[0]
    left = times - arrival_times(state, images)[0]
    return (state - truth)[_KNOWN], float(np.sqrt(np.mean(np.square(left))))


def _times(profile: LinearProfile, target: Array) -> Array:
    """(8,) direct, then over the seabed."""
    flat, z = np.hypot(*(trials.BUOYS[:, :2] - target[:2]).T), np.full(len(trials.BUOYS), target[2])
    direct = profile.time(flat, z, trials.BUOYS[:, 2])
    return np.concatenate([direct, profile.bottom_time(flat, z, trials.BUOYS[:, 2], trials.DEPTH)])
