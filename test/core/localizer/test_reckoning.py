"""Odometry that pauses, is reset or stands still."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.core.geometry import quat_from_yaw
from uw_acoustic_loc.core.localizer.reckoning import Reckoning
from uw_acoustic_loc.core.localizer.triangulation import PlanarFix
from uw_acoustic_loc.core.types import Odometry


def odometry(t: float, x: float, y: float, yaw: float, speed: float = 1.5, rate: float = 0.0) -> Odometry:
    linear, angular = np.array([speed, 0.0, 0.0]), np.array([0.0, 0.0, rate])
    return Odometry(round(t * 1e9), np.array([x, y, -3.0]), quat_from_yaw(yaw), linear, angular)


def test_the_pose_is_moved_on_to_the_stamp_and_to_the_array():
    reckoning = Reckoning(1.0, 2.0)
    reckoning.update(odometry(10.0, 4.0, 5.0, math.pi / 2))
    position, yaw = reckoning.array_pose(10_500_000_000, np.array([1.0, 0.0, 0.2]))
    np.testing.assert_allclose(position, [4.0, 5.0 + 0.75 + 1.0, -2.8])
    assert yaw == pytest.approx(math.pi / 2)


def test_a_confirmed_reset_carries_the_sources_along():
    """Dead reckoning starts again at the origin, turned by 1.2 rad: nothing moves, seen from the vehicle."""
    reckoning = Reckoning(1.0, 2.0)
    reckoning.update(odometry(10.0, 40.0, -20.0, 2.0))
    before = reckoning.array_pose(10_100_000_000, np.zeros(3))
    reckoning.update(odometry(10.1, 0.0, 0.0, 0.8))
    after = reckoning.array_pose(10_100_000_000, np.zeros(3))
    np.testing.assert_allclose(after[0], before[0], atol=1e-12)
    assert after[1] == pytest.approx(before[1])
    assert reckoning.resets == 0  # one pose is not believed
    for k in range(1, 4):
        ahead = 0.15 * k
        reckoning.update(odometry(10.1 + 0.1 * k, ahead * math.cos(0.8), ahead * math.sin(0.8), 0.8))
    assert reckoning.resets == 1 and reckoning.gaps == reckoning.glitches == 0
    assert reckoning.notice == "odometry was reset by 44.6 m and -69 deg: sources carried along"
    ahead = PlanarFix(after[0][:2] + 30 * np.array([math.cos(2.0), math.sin(2.0)]), np.diag([4.0, 1.0]))
    back = reckoning.to_odom(ahead)
    np.testing.assert_allclose(back.mean, 30 * np.array([math.cos(0.8), math.sin(0.8)]), atol=1e-12)
    np.testing.assert_allclose(np.linalg.eigvalsh(back.cov), [1.0, 4.0])
    np.testing.assert_allclose(reckoning.points_to_odom(ahead.mean[:, None])[:, 0], back.mean)


def test_a_pause_is_told_and_believed():
    reckoning = Reckoning(1.0, 2.0)
    reckoning.update(odometry(10.0, 0.0, 0.0, 0.0))
    reckoning.update(odometry(30.0, 20.0, 10.0, 1.0))
    assert (reckoning.gaps, reckoning.resets, reckoning.notice) == (1, 0, "odometry paused for 20.0 s")
    np.testing.assert_allclose(reckoning.array_pose(30_000_000_000, np.zeros(3))[0], [20.0, 10.0, -3.0])


def test_ordinary_motion_is_no_reset():
    """15 m/s and a turn of 20 deg/s at 2 Hz, the velocities not filled in with more than noise."""
    reckoning, rng = Reckoning(1.0, 2.0), np.random.default_rng(5)
    for k in range(200):
        t, yaw = 0.5 * k, 0.17 * k
        x, y = 43 * math.sin(0.17 * k), -43 * math.cos(0.17 * k)
        reckoning.update(odometry(10 + t, x, y, yaw, 15.0 + rng.normal(0, 1), 0.34 + rng.normal(0, 0.05)))
    assert reckoning.resets == reckoning.glitches == reckoning.gaps == 0


def test_sentences():
    reckoning = Reckoning(1.0, 2.0)
    with pytest.raises(ValueError, match="bearing refused: no odometry yet"):
        reckoning.array_pose(1, np.zeros(3))
    reckoning.update(odometry(10.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="odometry at 10000000000 ns must come after the one at 10000000000 ns"):
        reckoning.update(odometry(10.0, 1.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"odometry is 2\.000 s older, allowed are 1 s"):
        reckoning.array_pose(12_000_000_000, np.zeros(3))
