"""Paths that waypoints can describe."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.sim.scenario import Vehicle, Waypoint
from uw_acoustic_loc.sim.trajectory import Trajectory


def path(points: list[tuple[float, float]], radius: float) -> Trajectory:
    return Trajectory(Vehicle(tuple(Waypoint(*p) for p in points), speed=1.0, turn_radius=radius, z=0.0))


def test_a_square_whose_corners_meet_is_a_circle():
    circle = path([(0, -10), (10, -10), (10, 10), (-10, 10), (-10, -10), (0, -10)], 10.0)
    assert circle.duration == pytest.approx(20 * math.pi)
    motion = circle.at(np.linspace(0.0, circle.duration - 1e-6, 200))
    np.testing.assert_allclose(np.hypot(*motion.positions[:2]), 10.0, atol=1e-9)
    assert np.median(motion.yaw_rate) == pytest.approx(0.1)


def test_a_lawn_mower_turns_to_either_side():
    lanes = [(0, 0), (50, 0), (50, 8), (0, 8), (0, 16), (50, 16)]
    motion = path(lanes, 3.0).at(np.arange(0.0, 150.0, 0.1))
    assert motion.yaw_rate.max() == pytest.approx(1 / 3) and motion.yaw_rate.min() == pytest.approx(-1 / 3)
    steps = np.diff(motion.positions[:2], axis=1)
    np.testing.assert_allclose(np.hypot(*steps), 0.1, atol=1e-4)  # neither jumps nor stops


def test_there_and_back_takes_two_corners():
    motion = path([(0, 0), (30, 0), (30, 3), (0, 3)], 1.0).at(np.array([10.0, 50.0]))
    np.testing.assert_allclose(motion.positions[1], [0.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(motion.yaw, [0.0, math.pi])
    with pytest.raises(ValueError, match="must not double back"):
        path([(0, 0), (30, 0), (0, 0)], 1.0)
