"""The complex log-polar EKF step against matrices, finite differences and draws."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from uw_acoustic_loc.core.localizer.log_polar import LogPolar, Mixture, bearing_moments, cartesian, corrected, seen_from


def as_cov(g: float, q: complex) -> np.ndarray:
    """(2, 2) of log range and bearing."""
    return np.array([[g + q.real, q.imag], [q.imag, g - q.real]]) / 2


def state(rng: np.random.Generator) -> LogPolar:
    root = 0.3 * rng.standard_normal((2, 2))
    cov = root @ root.T
    line = complex(*rng.uniform(-50, 50, 2))
    return LogPolar(line, float(cov[0, 0] + cov[1, 1]), complex(cov[0, 0] - cov[1, 1], 2 * cov[0, 1]))


def test_a_bearing_corrects_as_the_kalman_equations_say():
    rng, H = np.random.default_rng(1), np.array([[0.0, 1.0]])
    for _ in range(50):
        before = state(rng)
        line, P = before.line, as_cov(before.g, before.q)
        bearing, R = rng.uniform(-math.pi, math.pi), rng.uniform(0.001, 0.1)
        (found, g1, q1), error, S = corrected(before, cmath.rect(1, bearing), R)
        K = P @ H.T / (P[1, 1] + R)
        expected = np.array([math.log(abs(line)), cmath.phase(line)]) + K[:, 0] * error
        assert cmath.exp(complex(*expected)) == pytest.approx(found)
        assert math.remainder(bearing - cmath.phase(line) - error, 2 * math.pi) == pytest.approx(0, abs=1e-12)
        assert abs(error) <= math.pi and pytest.approx(P[1, 1] + R) == S
        np.testing.assert_allclose(as_cov(g1, q1), P - K @ H @ P, atol=1e-14)


def test_a_motion_maps_the_error_with_the_jacobian():
    rng = np.random.default_rng(2)

    def moved(zeta: np.ndarray, shift: complex) -> np.ndarray:
        line = cmath.exp(complex(*zeta)) + shift
        return np.array([math.log(abs(line)), cmath.phase(line)])

    for _ in range(20):
        before = state(rng)
        line, g, q = before
        shift, zeta = complex(*rng.uniform(-5, 5, 2)), np.array([math.log(abs(line)), cmath.phase(line)])
        found, g1, q1 = seen_from(before, shift)
        steps = 1e-6 * np.eye(2)
        J = np.stack([(moved(zeta + step, shift) - moved(zeta - step, shift)) / 2e-6 for step in steps], axis=1)
        assert found == line + shift
        np.testing.assert_allclose(as_cov(g1, q1), J @ as_cov(g, q) @ J.T, rtol=1e-5, atol=1e-9)


def test_arrays_give_what_numbers_give():
    rng = np.random.default_rng(3)
    states = [state(rng) for _ in range(7)]
    together = LogPolar(*(np.array(column) for column in zip(*states, strict=True)))
    toward = np.exp(1j * rng.uniform(-3, 3, 7))
    many = corrected(seen_from(together, 2 - 1j), toward, 0.01)
    for k, one in enumerate(states):
        single = corrected(seen_from(one, 2 - 1j), complex(toward[k]), 0.01)
        np.testing.assert_allclose([column[k] for column in many.state], single.state, rtol=1e-12)
        np.testing.assert_allclose((many.error[k], many.S[k]), (single.error, single.S), rtol=1e-12)


def test_a_thousand_steps_leave_a_covariance():
    """Never an eigenvalue below zero, without symmetrising; the bearing's variance is that of as many measurements."""
    state = LogPolar(40 + 30j, 0.5, 0.3 + 0.1j)
    for k in range(1000):
        state = seen_from(state, 0.05 * cmath.rect(1, 0.01 * k))
        state = corrected(state, state.line / abs(state.line), 1e-4).state
        assert np.linalg.eigvalsh(as_cov(state.g, state.q))[0] > 0


def test_moments_of_a_mixture_are_those_of_draws():
    weight, g, q = np.array([0.3, 0.7]), np.array([0.08, 0.05]), np.array([0.04 + 0.03j, -0.01 + 0.02j])
    line = np.array([-20 + 1j, -30 - 4j])  # on both sides of the seam of angles
    rng, n = np.random.default_rng(4), 300_000
    draws = []
    for k in range(2):
        off = rng.multivariate_normal(np.zeros(2), as_cov(float(g[k]), complex(q[k])), round(weight[k] * n))
        draws.append(line[k] * np.exp(off @ np.array([1, 1j])))
    points = np.concatenate(draws)
    fix = cartesian(Mixture(weight, line, g, q), [0j, 0j], 0j)
    np.testing.assert_allclose(fix.mean, [points.real.mean(), points.imag.mean()], atol=0.1)
    np.testing.assert_allclose(fix.cov, np.cov(points.real, points.imag), atol=0.7)
    apart = np.array([5 - 2j, -30 + 1j])  # seen from two places
    moved = cartesian(Mixture(weight, line, g, q), apart.tolist(), 1 + 1j)
    points += np.repeat(apart, [draw.size for draw in draws])
    np.testing.assert_allclose(moved.mean, [1 + points.real.mean(), 1 + points.imag.mean()], atol=0.1)
    np.testing.assert_allclose(moved.cov, np.cov(points.real, points.imag), atol=1.0)
    points -= np.repeat(apart, [draw.size for draw in draws])
    mean, variance = bearing_moments(Mixture(weight, line, g, q))
    around = np.angle(points * -1)  # the seam lies opposite
    assert math.remainder(mean - math.pi, 2 * math.pi) == pytest.approx(around.mean(), abs=3e-3)
    assert variance == pytest.approx(around.var(), rel=0.02)
