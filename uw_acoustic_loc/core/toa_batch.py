"""The filter of Choi 2025 as published, for many runs at once: no acquisition, no association, labelled arrivals."""

from __future__ import annotations

import numpy as np

from .toa_model import STATES, ToaConfig, process_noise
from .types import Array

_MEASURED = (0, 1, 2, 6)  # position and sound speed; arrivals tell of the velocity through them alone
_VELOCITY = slice(3, 6)


class ToaBatch:
    """Means (7, M) and covariances (7, 7, M) of M runs that hear the same receivers at the same stamps.

    The runs stand last, and the arrivals are taken one by one, so that every operation is one on rows of M numbers.

    Raises:
        ValueError: mean and cov do not belong together.
    """

    def __init__(self, mean: Array, cov: Array, config: ToaConfig) -> None:
        if mean.ndim != 2 or mean.shape[0] != STATES or cov.shape != (STATES, *mean.shape):
            raise ValueError(f"mean and cov must be (7, M) and (7, 7, M), got {mean.shape} and {cov.shape}")
        self.mean, self.cov = np.array(mean, order="C"), np.array(cov, order="C")
        self._config = config

    def predict(self, dt: float) -> None:
        """Constant velocity over dt s (eq. 4-5)."""
        self.mean[:3] += dt * self.mean[_VELOCITY]
        self.cov[:3] += dt * self.cov[_VELOCITY]
        self.cov[:, :3] += dt * self.cov[:, _VELOCITY]
        Q = process_noise(dt, self._config)
        for i, j in np.argwhere(Q).tolist():
            self.cov[i, j] += Q[i, j]

    def update(self, images: Array, times: Array, std: float) -> None:
        """With the times (n, M) in s of arrivals at the images (n, 3); NaN where there was none.

        Linearised at the prediction (eq. 6-10); the gate is on the innovation that the arrivals before have left.
        """
        path = self.mean[:3, None] - images.T[:, :, None]
        length = np.sqrt(np.square(path).sum(axis=0))
        c, limit = self.mean[6], self._config.gate_sigma**2
        H = np.concatenate([path / (length * c), -(length / np.square(c))[None]])
        late, change = times - length / c, np.zeros_like(self.mean)
        gains = [self._absorb(change, H[:, i], late[i], std**2, limit) for i in range(len(images))]
        self.mean += change
        g = np.stack([gain[_VELOCITY] for gain in gains])
        self.cov[_VELOCITY, _VELOCITY] -= np.einsum("nim,njm->ijm", g, g)
        for row in _MEASURED:
            self.cov[_VELOCITY, row] = self.cov[row, _VELOCITY]

    def _absorb(self, change: Array, h: Array, late: Array, noise: float, limit: float) -> Array:
        """One arrival into the rows that the next one looks at; returns g (7, M), g g^T being what it took away."""
        g: Array = self.cov[0] * h[0]
        innovation = late - h[0] * change[0]
        for slope, row in zip(h[1:], _MEASURED[1:], strict=True):
            g += self.cov[row] * slope
            innovation -= slope * change[row]
        S = noise + sum(slope * g[row] for slope, row in zip(h, _MEASURED, strict=True))
        used = np.square(innovation) <= limit * S
        root = np.where(used, 1 / np.sqrt(S), 0.0)
        g *= root
        change += g * (np.where(used, innovation, 0.0) * root)
        for row in _MEASURED:
            self.cov[row] -= g[row] * g
        return g
