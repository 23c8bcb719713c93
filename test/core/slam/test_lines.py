"""Bearing lines of a pinger that waits: where they meet, how biases move that, and what they tell of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.core.slam.lines import Lines, Pose


def test_meeting_moves_with_the_biases_as_the_finite_differences_say():
    times = np.arange(0, 20, 0.1)
    yaws, points = 0.02 * times, np.zeros((times.size, 2))
    points[1:] = 0.04 * np.cumsum(np.stack([np.cos(yaws), np.sin(yaws)], axis=1), axis=0)[:-1]
    lines = Lines()
    for (x, y), yaw, time in zip(points, yaws, times, strict=True):
        bearing = math.atan2(9 - y, 4 - x) - yaw
        lines.add(Pose(x, y, yaw, time), np.array([0.0, 0.0]), bearing, 0.01)
    raw = Pose(*points[-1], yaws[-1], times[-1])
    bias_cov = 1e-6 * np.eye(3)

    def fix(biases: np.ndarray) -> np.ndarray:
        meeting = lines.meeting(raw, raw, biases, biases, bias_cov)
        assert meeting is not None
        return meeting.fix.mean

    meeting = lines.meeting(raw, raw, np.zeros(3), np.zeros(3), bias_cov)
    assert meeting is not None and meeting.sharp
    np.testing.assert_allclose(meeting.fix.mean, [4, 9], atol=1e-6)
    steps = 1e-4 * np.eye(3)
    by_bias = np.stack([(fix(d) - fix(-d)) / 2e-4 for d in steps], axis=1)
    np.testing.assert_allclose(meeting.by_bias, by_bias, rtol=0.02, atol=0.5)


def test_lines_that_a_gyro_bias_bends_tell_of_it():
    """On a straight track of 100 s with -5 mrad/s, redrawn at what is found."""
    times, lines, rng = np.arange(0, 100, 0.5), Lines(), np.random.default_rng(1)
    yaws = -5e-3 * times
    points = 0.15 * np.cumsum(np.stack([np.cos(yaws), np.sin(yaws)], axis=1), axis=0)
    for k, (x, y) in enumerate(points):
        bearing = math.atan2(12, 20 - 0.15 * (k + 1)) + rng.normal(0, 0.02)
        lines.add(Pose(x, y, yaws[k], times[k]), np.zeros(2), bearing, 4e-4)
    raw, prior, prior_cov = Pose(*points[-1], yaws[-1], times[-1]), np.zeros(3), np.diag([4e-6, 1e-8, 1e-8])
    first = lines.meeting(raw, raw, prior, prior, prior_cov)
    assert first is not None and not first.fits
    redrawn = lines.meeting(raw, raw, first.biases, prior, prior_cov)
    assert redrawn is not None and redrawn.sharp
    again = lines.meeting(raw, raw, redrawn.biases, prior, prior_cov)
    assert again is not None
    assert again.biases[0] == pytest.approx(redrawn.biases[0], abs=1e-5)
    assert abs(again.biases[0] + 5e-3) < 3 * math.sqrt(again.bias_cov[0, 0]) < 1.5e-3
