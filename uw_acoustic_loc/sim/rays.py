"""Travel times in water whose sound speed changes linearly with depth: rays are circular arcs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.types import Array


@dataclass(frozen=True)
class LinearProfile:
    """A sound speed that is linear in depth: c = surface + gradient * depth."""

    surface: float  # m/s
    gradient: float  # 1/s, positive where it is faster below

    def speed(self, z: Array | float) -> Array | float:
        """Returns the sound speed in m/s at heights z in m, which are negative."""
        return self.surface - self.gradient * z

    def time(self, flat: Array, z1: Array | float, z2: Array) -> Array:
        """Returns the time in s along the arc between heights z1 and z2 (m, negative), `flat` m apart.

        It is t = arccosh(1 + g^2 d^2 / (2 c1 c2)) / g, d the distance, in a form that holds for g = 0 too. The arc is
        followed even where it would leave the water; beyond that range there really is a shadow.
        """
        root = np.sqrt(self.speed(z1) * self.speed(z2))
        half = np.hypot(flat, z1 - z2) / (2 * root)
        x = self.gradient * half
        return np.asarray(2 * half * np.where(np.abs(x) > 1e-9, np.arcsinh(x) / np.where(x == 0, 1.0, x), 1.0))

    def bottom_time(self, flat: Array, z1: Array | float, z2: Array, depth: float) -> Array:
        """Returns the time in s by a reflection at a flat seabed, at the point of least time (golden section)."""
        z1, z2, flat = np.broadcast_arrays(z1, z2, flat)
        floor = np.full(flat.shape, -depth)

        def by(share: Array) -> Array:
            return self.time(share * flat, z1, floor) + self.time((1 - share) * flat, z2, floor)

        low, high = np.zeros(flat.shape), np.ones(flat.shape)
        for _ in range(50):
            width = _GOLDEN * (high - low)
            left = by(high - width) < by(low + width)
            low, high = np.where(left, low, high - width), np.where(left, low + width, high)
        return by((low + high) / 2)


_GOLDEN = (5**0.5 - 1) / 2
