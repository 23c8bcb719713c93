"""The water that all sensors share: the true sound speed over time."""

from __future__ import annotations

import numpy as np

from ..core.types import Array
from .scenario import Scenario


class SoundSpeed:
    """A random walk, one step a second, clipped to the scenario's range around the mean; linear between the steps."""

    def __init__(self, scenario: Scenario) -> None:
        env = scenario.environment
        steps = scenario.rng(_KEY).normal(0.0, env.sound_speed_walk, int(scenario.duration) + 2)
        walk = np.empty(steps.size)
        offset = 0.0
        for k, step in enumerate(steps):
            walk[k] = offset
            offset = min(max(offset + step, -env.sound_speed_range), env.sound_speed_range)
        self._values = env.sound_speed + walk

    def at(self, time: Array | float) -> Array:
        """Sound speed in m/s at times in s after the start."""
        return np.asarray(np.interp(time, np.arange(self._values.size), self._values))


_KEY = 0x5EED  # keeps this walk apart from the sensors' own random numbers
