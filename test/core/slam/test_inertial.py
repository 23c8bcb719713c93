"""Strapdown motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.core.slam.inertial import GYRO_BIAS, moved


def differences(function, x: np.ndarray) -> np.ndarray:
    step = 1e-6
    return np.stack([(function(x + step * e) - function(x - step * e)) / (2 * step) for e in np.eye(x.size)], axis=1)


def test_jacobian_is_the_finite_differences():
    rng = np.random.default_rng(1)
    for _ in range(20):
        state, rates, force = 0.5 * rng.normal(size=15), rng.normal(size=3), rng.normal(size=3)
        _, F = moved(state, rates, force, 0.1)
        by_state = differences(lambda s, r=rates, f=force: moved(s, r, f, 0.1)[0], state)
        np.testing.assert_allclose(by_state[:, :12], F, atol=1e-8)
        np.testing.assert_array_equal(by_state[:, 12:], 0)
        by_rate = differences(lambda r, s=state, f=force: moved(s, r, f, 0.1)[0], rates)
        np.testing.assert_allclose(by_rate, -F[:, GYRO_BIAS], atol=1e-8)


def test_a_steady_port_turn_is_a_circle():
    """1.5 m/s on 8 m radius: after half a turn 16 m to port, heading back."""
    state = np.zeros(15)
    state[6], rate = 1.5, 1.5 / 8
    steps = 20_000
    for _ in range(steps):
        state[:9], _ = moved(state, np.array([0, 0, rate]), np.array([0, 1.5 * rate, 9.81]), math.pi / rate / steps)
    np.testing.assert_allclose(state[:9], [0, 16, 0, 0, 0, math.pi, 1.5, 0, 0], atol=5e-3)


def test_a_nose_up_vehicle_at_rest_feels_gravity_forwards():
    state = np.zeros(15)
    state[4] = -0.2
    still, _ = moved(state, np.zeros(3), np.array([9.81 * math.sin(0.2), 0, 9.81 * math.cos(0.2)]), 1.0)
    np.testing.assert_allclose(still, state[:9], atol=1e-12)


def test_pitch_sentence():
    state = np.zeros(15)
    state[4] = 1.55
    with pytest.raises(ValueError, match=r"pitch must stay within 85 degrees, got 88\.8"):
        moved(state, np.zeros(3), np.zeros(3), 0.01)
