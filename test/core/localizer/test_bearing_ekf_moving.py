"""EKF bank of a source with constant velocity."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.core.localizer.bearing_ekf import range_bank
from uw_acoustic_loc.core.localizer.bearing_ekf_moving import MovingBearingEkf
from uw_acoustic_loc.core.localizer.triangulation import Drift, Ray

STD = math.radians(1.0)
DT = 1.0


def course() -> np.ndarray:
    """2 m/s, three legs with turns of 90 degrees."""
    legs = np.repeat([[2.0, 0.0], [0.0, 2.0], [2.0, 0.0], [0.0, -2.0]], 60, axis=0)
    return np.cumsum(legs, axis=0) * DT


def run(source, velocity, seed: int, speed_std: float = 0.5, steps: int = 240):
    rng, track = np.random.default_rng([51, seed]), course()[:steps]
    at = np.asarray(source) + DT * np.arange(steps)[:, None] * np.asarray(velocity)
    bearings = np.arctan2(*(at - track).T[::-1]) + rng.normal(0, STD, steps)
    rays = [Ray(*point, bearing, STD) for point, bearing in zip(track, bearings, strict=True)]
    ekf = MovingBearingEkf(rays[0], 5.0, 500.0, speed_std=speed_std)
    for ray in rays[1:]:
        ekf.predict(DT, Drift())
        ekf.update(ray)
    return ekf, at[-1]


def test_a_moving_source_is_found_with_its_velocity_and_an_honest_covariance():
    """NEES / 2 of 60 runs with speeds drawn from the prior, 1 within 4 sigma; none comes within 30 m of the vehicle."""
    nees, runs = [], 60
    for seed in range(runs):
        velocity = np.random.default_rng([52, seed]).normal(0, 0.25, 2)
        ekf, end = run((80.0, 230.0), velocity, seed, speed_std=0.25)
        fix = ekf.estimate()
        off = fix.mean - end
        nees.append(off @ np.linalg.solve(fix.cov, off) / 2)
        assert math.dist(fix.mean, end) < 30.0
        np.testing.assert_allclose(ekf.velocity, velocity, atol=0.2)
    assert abs(np.mean(nees) - 1) < 4 / math.sqrt(runs)


def test_one_leg_leaves_the_range_open():
    """A target on constant velocity seen from one: any range fits (Nardone, Aidala 1981). After a turn it does not."""
    spreads = []
    for steps in (60, 240):
        ekf, end = run((80.0, 150.0), (0.4, -0.3), 1, speed_std=1.5, steps=steps)
        away = (end - course()[steps - 1]) / math.dist(end, course()[steps - 1])
        spreads.append(math.sqrt(away @ ekf.estimate().cov @ away))
    assert spreads[0] > 50.0 and spreads[1] < 10.0


def test_no_speed_is_the_still_bank(monkeypatch):
    track = course()[:100]
    rays = [Ray(x, y, math.atan2(150 - y, 80 - x) + 0.01 * math.sin(k), STD) for k, (x, y) in enumerate(track)]
    moving = MovingBearingEkf(rays[0], 5.0, 500.0, speed_std=0.0, process_noise=0.1)
    monkeypatch.setattr("uw_acoustic_loc.core.localizer.bearing_ekf._RATIO", 1.2)
    still = range_bank(rays[0], 5.0, 500.0, 0.1)
    for ray in rays[1:]:
        for ekf in (moving, still):
            ekf.predict(DT, Drift(ray.x, ray.y, 1e-5))
            ekf.update(ray)
    np.testing.assert_allclose(moving.estimate().mean, still.estimate().mean, rtol=1e-9)
    np.testing.assert_allclose(moving.estimate().cov, still.estimate().cov, rtol=1e-6)
    assert moving.predicted_bearing(300, 20) == pytest.approx(still.predicted_bearing(300, 20))
    np.testing.assert_allclose(moving.velocity, 0.0)


def test_motion_is_as_the_finite_differences_say():
    """Jacobian of (log p, V / p) over a step; complex-differentiable in both."""
    ekf = MovingBearingEkf(Ray(1.0, 2.0, 0.8, 0.1), 9.0, 10.0, speed_std=1.0)
    ekf._rate = np.array([0.03 - 0.05j])
    ekf.predict(3.0, Drift())
    zeta, rate, point = np.log(ekf._line[0]), ekf._rate[0], 4.0 + 1.5j

    def step(zeta: complex, rate: complex) -> np.ndarray:
        p = np.exp(zeta)
        moved = p + rate * p * 3.0 + (1 + 2j) - point
        return np.array([np.log(moved), rate * p / moved])

    h = 1e-6
    steps = ((h, 0), (0, h))
    numeric = [(step(zeta + a, rate + b) - step(zeta - a, rate - b)) / (2 * h) for a, b in steps]
    J = np.stack(numeric, axis=1)
    line, moved_rate, G, Q = ekf._moved(point)
    np.testing.assert_allclose(G[0], J @ ekf._G[0] @ J.conj().T, rtol=1e-6)
    np.testing.assert_allclose(Q[0], J @ ekf._Q[0] @ J.T, rtol=1e-6)
    np.testing.assert_allclose([np.log(line[0]), moved_rate[0]], step(zeta, rate))
