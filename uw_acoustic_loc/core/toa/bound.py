"""What arrivals at a net of receivers can tell of a target: the Cramer-Rao bound of a single ping, and of a track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Array
from .config import ToaConfig
from .model import arrival_times, by_emission, motion, process_noise


@dataclass(frozen=True)
class PingNoise:
    """Standard deviations of what a ping's arrivals depend on besides the position."""

    toa: float  # s, of each arrival
    sound_speed: float  # m/s
    emission: float  # s, of the instant


def ping_bound(targets: Array, images: Array, sound_speed: float, noise: PingNoise) -> Array:
    """(m, 3) least variances in m^2 of x, y, z found from one ping at the images (n, 3), for targets (m, 3).

    Nothing is known of the position before; inf along an axis that the arrivals leave open.
    """
    path = targets[:, None] - images
    length = np.linalg.norm(path, axis=2)
    H = np.empty((*length.shape, 5))
    H[..., :3] = path / (length * sound_speed)[..., None]
    H[..., 3] = -length / sound_speed**2 * noise.sound_speed  # in standard deviations, so that the prior's
    H[..., 4] = noise.emission  # information is 1
    J = np.swapaxes(H, 1, 2) @ H / noise.toa**2 + np.diag([0.0, 0.0, 0.0, 1.0, 1.0])
    position = J[:, :3, :3] - J[:, :3, 3:] @ np.linalg.solve(J[:, 3:, 3:], J[:, 3:, :3])
    scale = np.trace(position, axis1=1, axis2=2)[:, None]
    cov = np.linalg.inv(position + _OPEN * scale[..., None] * np.eye(3))
    variances = np.diagonal(cov, axis1=1, axis2=2)
    return np.where(variances * scale < 0.01 / _OPEN, variances, np.inf)


_OPEN = 1e-11  # of all information: what an axis must have more of, or else it is open


def track_bound(tracks: Array, images: Array, prior: Array, noise: PingNoise, config: ToaConfig, dt: float) -> Array:
    """(pings, 7, 7) posterior Cramer-Rao bound of a filter's state after each ping.

    The recursion of Tichavsky, Muravchik, Nehorai 1998 for the linear motion of `config`, the information of a ping
    averaged over true tracks (runs, pings, 7); prior (7, 7) at the first ping, images (n, 3), dt s between pings.
    Neither limits of the sound speed nor gates are in it.
    """
    F = motion(dt)
    cov, bounds = prior, []
    for states in np.swapaxes(tracks, 0, 1):
        gained = np.mean([ping_information(state, images, noise) for state in states], axis=0)
        cov = np.linalg.inv(np.linalg.inv(cov) + gained)
        bounds.append(cov)
        cov = F @ cov @ F.T + process_noise(dt, config.process)
    return np.array(bounds)


def ping_information(state: Array, images: Array, noise: PingNoise) -> Array:
    """(7, 7) Fisher information of one ping about a state (7,), its emission unknown by noise.emission."""
    _, H = arrival_times(state, images)
    common = by_emission(state, H)
    seen = noise.emission * (H.T @ common)
    shared = np.outer(seen, seen) / (noise.emission**2 * (common @ common) + noise.toa**2)
    return np.asarray((H.T @ H - shared) / noise.toa**2)
