"""The filter of Choi 2025 as published, for many runs at once: no acquisition, no association, labelled arrivals."""

from __future__ import annotations

import numpy as np

from ...core.toa.config import ToaConfig
from ...core.toa.model import STATES, process_noise
from ...core.types import Array

_ORDER = [0, 1, 2, 6, 3, 4, 5]  # inside: position and sound speed first, which alone the arrivals observe
_BACK = [0, 1, 2, 4, 5, 6, 3]
_P, _SEEN, _V = slice(0, 3), slice(0, 4), slice(4, 7)


class ToaBatch:
    """M runs that hear the same receivers at the same stamps, from means (7, M) and covariances (7, 7, M).

    The runs stand last, and the arrivals are taken one by one, so that every operation is one on rows of M numbers.

    Raises:
        ValueError: mean and cov do not belong together.
    """

    def __init__(self, mean: Array, cov: Array, config: ToaConfig) -> None:
        if mean.ndim != 2 or mean.shape[0] != STATES or cov.shape != (STATES, *mean.shape):
            raise ValueError(f"mean and cov must be (7, M) and (7, 7, M), got {mean.shape} and {cov.shape}")
        self._x, self._P = mean[_ORDER], np.ascontiguousarray(cov[np.ix_(_ORDER, _ORDER)])
        self._taken = np.empty((4, *mean.shape))
        self._config = config

    @property
    def mean(self) -> Array:
        """(7, M)."""
        return self._x[_BACK]

    @property
    def cov(self) -> Array:
        """(7, 7, M)."""
        return np.asarray(self._P[np.ix_(_BACK, _BACK)])

    def predict(self, dt: float) -> None:
        """Constant velocity over dt s (eq. 4-5)."""
        self._x[_P] += dt * self._x[_V]
        self._P[_P] += dt * self._P[_V]
        self._P[:, _P] += dt * self._P[:, _V]
        Q = process_noise(dt, self._config.process)[np.ix_(_ORDER, _ORDER)]
        for i, j in np.argwhere(Q).tolist():
            self._P[i, j] += Q[i, j]

    def update(self, images: Array, times: Array, std: float) -> None:
        """With the times (n, M) in s of arrivals at the images (n, 3); NaN where there was none.

        Linearised at the prediction (eq. 6-10); the gate is on the innovation that the arrivals before have left.
        """
        c, change = self._x[3], np.zeros_like(self._x)
        path = self._x[_P] - images[:, :, None]
        length = np.sqrt(np.einsum("nim,nim->nm", path, path))
        expected = length / c
        H = np.empty((len(images), 4, c.size))
        np.multiply(path, (1 / (length * c))[:, None], out=H[:, :3])
        np.divide(expected, -c, out=H[:, 3])
        for h, late in zip(H, times - expected, strict=True):
            self._absorb(change, h, late, std**2)
        self._x += change
        self._P[_V, _SEEN] = self._P[_SEEN, _V].swapaxes(0, 1)

    def _absorb(self, change: Array, h: Array, late: Array, noise: float) -> None:
        """One arrival: takes g g^T away, but leaves the corner that mirrors another one for later."""
        g: Array = np.einsum("am,ajm->jm", h, self._P[_SEEN])
        S = np.einsum("am,am->m", h, g[_SEEN]) + noise
        innovation = late - np.einsum("am,am->m", h, change[_SEEN])
        used = innovation * innovation <= self._config.arrivals.gate_sigma**2 * S
        root = used / np.sqrt(S)
        g *= root
        change += g * (np.where(used, innovation, 0.0) * root)
        np.multiply(g[_SEEN, None], g, out=self._taken)
        self._P[_SEEN] -= self._taken
        self._P[_V, _V] -= g[_V, None] * g[_V]
