"""Sound from a still source to a moving receiver between surface and seabed: image sources and the light-time
equation, solved exactly, so that delay, Doppler and spreading follow from the geometry.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.types import Array
from .scenario import Environment, Pinger

EDGE = 0.1  # share of a pulse taken by each raised-cosine edge
_ITERATIONS = 5  # of the light-time equation; each gains a factor c / v


def images(source: Array, env: Environment) -> tuple[Array, Array]:
    """(3, P) image sources and (P,) amplitude coefficients: direct, over the surface, over the bottom."""
    x, y, z = source
    heights = np.array([z, -z, -2.0 * env.depth - z])
    gains = np.array([1.0, env.surface_reflection, env.bottom_reflection])
    positions = np.stack([np.full(3, x), np.full(3, y), heights])
    return positions[:, gains != 0.0], gains[gains != 0.0]


def arrival_times(sources: Array, emission: Array, receiver: Callable[[Array], Array], sound_speed: Array) -> Array:
    """Times (n,) at which what sources (3, n) emit at times (n,) reaches a receiver whose path is `receiver(times)`."""
    arrival = emission
    for _ in range(_ITERATIONS):
        arrival = emission + np.sqrt(np.square(receiver(arrival) - sources).sum(axis=0)) / sound_speed
    return np.asarray(arrival, dtype=np.float64)


def pulse(pinger: Pinger, age: Array) -> Array:
    """Pressure at 1 m, linear chirp with raised-cosine edges, at ages in [0, pulse_length]."""
    phase = age / pinger.pulse_length
    sweep = pinger.band_low + (0.5 * (pinger.band_high - pinger.band_low)) * phase
    edge = np.minimum(np.minimum(phase, 1.0 - phase) / EDGE, 1.0)
    wave = np.sin(2 * np.pi * sweep * age) * (pinger.source_level * np.sin(0.5 * np.pi * edge) ** 2)
    return np.asarray(wave, dtype=np.float64)


def emissions(pinger: Pinger, begin: float, end: float) -> Array:
    """(K,) emission times of the pings that start in [begin, end), none before the pinger's offset."""
    first = max(0, int(np.ceil((begin - pinger.offset) / pinger.period)))
    last = int(np.ceil((end - pinger.offset) / pinger.period))
    return np.asarray(pinger.offset + pinger.period * np.arange(first, max(first, last)), dtype=np.float64)
