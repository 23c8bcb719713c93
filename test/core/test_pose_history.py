"""Odometry with resets and glitches: what is one, what is believed, and that motion goes on meanwhile."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest

from uw_acoustic_loc.core.geometry import quat_from_yaw, wrap_angle
from uw_acoustic_loc.core.pose_history import OdomFrame, PoseHistory
from uw_acoustic_loc.core.types import Odometry

Poses = list[tuple[float, float, float, float]]  # s, m, m, rad


def weaving(rng: np.random.Generator, rate: float, seconds: float = 40.0) -> tuple[Poses, np.ndarray, np.ndarray]:
    """A vehicle of some speed that weaves with some amplitude; with its speed and yaw rates."""
    speed, swing, period = rng.uniform(0.3, 3.0), rng.uniform(0.0, 1.2), rng.uniform(10.0, 60.0)
    t = np.arange(0.0, seconds, 1 / rate)
    yaw = rng.uniform(-math.pi, math.pi) + swing * np.sin(2 * math.pi * t / period)
    steps = speed / rate * np.stack([np.cos(yaw), np.sin(yaw)])
    x, y = np.cumsum(steps, axis=1)
    rates = swing * 2 * math.pi / period * np.cos(2 * math.pi * t / period)
    return list(zip(t.tolist(), x.tolist(), y.tolist(), yaw.tolist(), strict=True)), np.full(t.size, speed), rates


def fed(poses: Poses, speeds: Iterable[float], rates: Iterable[float]) -> PoseHistory:
    history = PoseHistory()
    for (t, x, y, yaw), speed, rate in zip(poses, speeds, rates, strict=True):
        linear, angular = np.array([speed, 0.0, 0.0]), np.array([0.0, 0.0, rate])
        history.add(Odometry(round((10 + t) * 1e9), np.array([x, y, 0.0]), quat_from_yaw(yaw), linear, angular))
    return history


def off(history: PoseHistory, pose: tuple[float, float, float, float]) -> tuple[float, float]:
    """Distance and turn of the history's last pose from a pose of odom."""
    t, x, y, yaw = pose
    found = history.at(round((10 + t) * 1e9))
    return math.hypot(found.x - x, found.y - y), abs(wrap_angle(found.yaw - yaw))


@pytest.mark.parametrize("twist", [True, False])
@pytest.mark.parametrize("rate", [2.0, 10.0, 20.0])
def test_a_glitched_yaw_changes_nothing(rate, twist):
    """One sample, or half a second, at random times of random tracks; of 0.5 rad and more at 2 Hz, 0.3 else."""
    rng = np.random.default_rng([1, int(rate), twist])
    for _ in range(30):
        poses, speeds, rates = weaving(rng, rate)
        begin, size = int(rng.integers(5, len(poses) - 10)), rng.uniform(0.5 if rate < 5 else 0.3, 2.5)
        for k in range(begin, begin + int(rng.choice([1, max(1, int(rate / 2))]))):
            t, x, y, yaw = poses[k]
            poses[k] = t, x, y, yaw + size
        history = fed(poses, twist * speeds, twist * rates)
        assert history.resets == 0 and history.glitches >= 1
        assert history.frame == history.believed_frame == OdomFrame()
        assert max(off(history, poses[-1])) < 1e-9


def test_a_glitch_of_the_position_changes_nothing():
    rng = np.random.default_rng(2)
    for _ in range(30):
        poses, speeds, rates = weaving(rng, 10.0)
        k = int(rng.integers(5, len(poses) - 10))
        t, x, y, yaw = poses[k]
        poses[k] = t, x + rng.uniform(3, 100), y - rng.uniform(0, 100), yaw
        history = fed(poses, speeds, rates)
        assert (history.resets, history.glitches) == (0, 1) and max(off(history, poses[-1])) < 1e-9


def test_a_disturbance_of_two_seconds_is_believed_and_then_undone():
    rng = np.random.default_rng(3)
    for _ in range(30):
        poses, speeds, rates = weaving(rng, 10.0)
        begin, size = int(rng.integers(5, len(poses) - 40)), rng.uniform(0.6, 2.5)
        for k in range(begin, begin + 20):
            t, x, y, yaw = poses[k]
            poses[k] = t, x, y, yaw + size
        during = fed(poses[: begin + 10], speeds[: begin + 10], rates[: begin + 10])
        assert during.resets == 1 and during.believed_frame == during.frame != OdomFrame()
        history = fed(poses, speeds, rates)
        assert (history.resets, history.glitches) == (0, 1) and max(off(history, poses[-1])) < 1e-9


@pytest.mark.parametrize("twist", [True, False])
def test_a_reset_is_believed_after_three_poses_and_motion_goes_on(twist):
    """Dead reckoning begins again at zero; the history goes on as if nothing had happened."""
    rng = np.random.default_rng([4, twist])
    for _ in range(30):
        poses, speeds, rates = weaving(rng, 10.0)
        begin = int(rng.integers(100, len(poses) - 10))
        _, x0, y0, yaw0 = poses[begin]
        turn = np.exp(-1j * yaw0)
        told = poses[:begin]
        for t, x, y, yaw in poses[begin:]:
            at = turn * complex(x - x0, y - y0)
            told.append((t, at.real, at.imag, yaw - yaw0))
        before = fed(told[: begin + 3], twist * speeds[: begin + 3], twist * rates[: begin + 3])
        history = fed(told, twist * speeds, twist * rates)
        if math.hypot(x0, y0) < 4 and abs(wrap_angle(yaw0)) < 0.6:
            continue  # too near to zero to be told from motion
        assert before.resets == 0 and before.believed_frame == OdomFrame()
        assert history.resets == 1 and history.glitches == 0
        distance, turned = off(history, poses[-1])
        assert distance < 0.3 and turned < 0.05  # what one step of 0.1 s may curve


def test_a_noisy_compass_is_no_reset():
    """0.08 rad of white noise: it may count as glitches, but sources are not carried about."""
    rng = np.random.default_rng(5)
    for _ in range(10):
        poses, speeds, rates = weaving(rng, 10.0)
        noisy = [(t, x, y, yaw + rng.normal(0, 0.08)) for t, x, y, yaw in poses]
        history = fed(noisy, speeds, rates)
        assert history.resets == 0 and history.believed_frame == OdomFrame()


def test_without_a_twist_fast_motion_is_no_reset():
    rng = np.random.default_rng(6)
    for _ in range(20):
        poses, speeds, _ = weaving(rng, 1.0, 200.0)
        fast = [(t, 4 * x, 4 * y, yaw) for t, x, y, yaw in poses]
        history = fed(fast, 0 * speeds, 0 * speeds)
        assert history.resets == 0
