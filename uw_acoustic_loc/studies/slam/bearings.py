"""Bearings as a bearing node would publish them, without the acoustics: the true direction and an error."""

from __future__ import annotations

import math

import numpy as np

from ...core.geometry import wrap_angle
from ...core.types import Array, Bearing
from ...sim.scenario import Scenario
from ...sim.trajectory import Trajectory

BearingEvent = tuple[int, str, Bearing]  # stamp in ns, topic, bearing


def bearings(scenario: Scenario, std: float, correlation: float = 0.0, period: float = 0.1) -> list[BearingEvent]:
    """Bearings of all pingers in base_link, in stamp order; the array is at its origin, the vehicle level.

    Args:
        std: of the normal errors, rad; each bearing says so in its variance.
        correlation: of an error with the one before it; 0 = white.
        period: s between a pinger's bearings.

    Raises:
        ValueError: the scenario has no vehicle.
    """
    if scenario.vehicle is None:
        raise ValueError("vehicle: the scenario has none")
    rng, trajectory = scenario.rng(_KEY), Trajectory(scenario.vehicle)
    events: list[BearingEvent] = []
    for k, pinger in enumerate(scenario.pingers):
        times = np.arange((k + 0.5) / len(scenario.pingers) * period, scenario.duration, period)
        motion = trajectory.at(times)
        true = np.arctan2(pinger.y - motion.positions[1], pinger.x - motion.positions[0]) - motion.yaw
        for time, bearing in zip(times, true + _errors(rng, times.size, std, correlation), strict=True):
            t_ns = scenario.t_ns(time)
            value = Bearing(t_ns, wrap_angle(bearing), std**2, np.zeros(3))
            events.append((t_ns, f"sources/{pinger.id}/bearing", value))
    return sorted(events, key=lambda event: event[0])


def _errors(rng: np.random.Generator, count: int, std: float, correlation: float) -> Array:
    """(count,) a stationary first-order Gauss-Markov sequence."""
    errors = rng.normal(0.0, std, count)
    fresh = math.sqrt(1 - correlation**2)
    for k in range(1, count):
        errors[k] = correlation * errors[k - 1] + fresh * errors[k]
    return errors


_KEY = 0xBEA2  # of these random numbers
