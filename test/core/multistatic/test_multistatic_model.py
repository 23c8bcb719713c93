import math
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.core.multistatic.estimator import RAYLEIGH_SCALE, Noise, SonarNet, gaussian_likelihood
from uw_acoustic_loc.core.multistatic.model import rayleigh_terms
from uw_acoustic_loc.core.multistatic.posterior import posterior
from uw_acoustic_loc.core.multistatic.start import directions


def likelihoods():
    net = SonarNet(np.zeros(2), np.array([[2000.0, 0.0], [-1000.0, 1732.0], [-1000.0, -1732.0]]))
    noise = Noise(np.full(3, 40.0), np.full(3, 0.02))
    ranges, bearings = net.measure(np.array([[1500.0, 800.0]]))
    ranges, bearings = ranges + np.array([[30.0], [80.0], [120.0]]), bearings + np.array([[0.02], [-0.01], [0.0]])
    gaussian = gaussian_likelihood(net, ranges - noise.bias[:, None], bearings, noise)
    scale = noise.range_std[:, None] * RAYLEIGH_SCALE
    exact = replace(gaussian, ranges=ranges, scale=scale)
    return {"gaussian": gaussian, "ranges": gaussian.without_bearings(), "exact": exact}


@pytest.mark.parametrize("kind", ["gaussian", "ranges", "exact"])
@pytest.mark.parametrize("offset", [(-30.0, 20.0), (60.0, 90.0)])  # the second lies beyond the Rayleigh edge
def test_descent_direction_is_minus_the_finite_difference_of_the_cost(kind, offset):
    likelihood = likelihoods()[kind]
    x, y, h = np.array([1500.0 + offset[0]]), np.array([800.0 + offset[1]]), 1e-3
    at = likelihood.moments(x, y)
    assert at.cost == pytest.approx(likelihood.cost(x, y))
    assert at.gx == pytest.approx((likelihood.cost(x - h, y) - likelihood.cost(x + h, y)) / (2 * h), rel=1e-5)
    assert at.gy == pytest.approx((likelihood.cost(x, y - h) - likelihood.cost(x, y + h)) / (2 * h), rel=1e-5)


def test_rayleigh_terms_are_derivatives_of_each_other_and_continue_beyond_the_edge():
    scale, h = np.array(61.0), 1e-4
    error = np.array([-80.0, -1.0, 0.5, 1.5, 30.0, 200.0])
    cost, slope, curvature = rayleigh_terms(error, scale)
    ahead, behind = rayleigh_terms(error + h, scale), rayleigh_terms(error - h, scale)
    np.testing.assert_allclose(slope, (ahead[0] - behind[0]) / (2 * h), rtol=1e-4)
    inside = error > 2.0  # beyond the edge the expansion keeps u^2/2 + its own curvature
    np.testing.assert_allclose(curvature[inside], ((ahead[1] - behind[1]) / (2 * h))[inside], rtol=1e-4)
    np.testing.assert_allclose(curvature[~inside], ((ahead[1] - behind[1]) / (2 * h))[~inside], rtol=1e-2)
    u = 30.0 / 61.0
    assert cost[4] == pytest.approx(u * u / 2 - math.log(u))


def test_posterior_is_the_mean_and_covariance_of_the_normalised_likelihood():
    exact = likelihoods()["exact"]
    exact = replace(exact, bearing_weight=exact.bearing_weight / 25)  # 0.1 rad: the ranges decide
    at = exact.moments(np.array([1500.0]), np.array([800.0]))
    for _ in range(30):
        step_x, step_y = at.step(np.array([1e-3]))
        at = exact.moments(at.x + step_x, at.y + step_y)
    axis = np.arange(-400.0, 400.0, 4.0)
    offsets = np.stack(np.meshgrid(axis, axis)).reshape(2, -1)
    x, y = at.x + offsets[0], at.y + offsets[1]
    inside = np.all(exact.ranges > exact.legs(x, y)[-1], axis=0)  # the density has a hard edge
    weights = np.where(inside, np.exp(at.cost - exact.cost(x, y)), 0.0)
    to_mean, cov = offsets @ weights / weights.sum(), np.cov(offsets, aweights=weights, ddof=0)
    mx, my, xx, xy, yy = (float(term[0]) for term in posterior(exact, at))
    assert np.linalg.norm(to_mean) > 5
    np.testing.assert_allclose([mx - at.x[0], my - at.y[0]], to_mean, atol=0.05 * np.sqrt(np.trace(cov)))
    np.testing.assert_allclose([[xx, xy], [xy, yy]], cov, atol=0.06 * np.trace(cov))


def test_posterior_of_a_peak_between_its_points_is_the_mode():
    gaussian = likelihoods()["gaussian"]
    x, y = np.array([1500.0]), np.array([800.0])
    dx, dy, *_, total = gaussian.legs(x, y)
    wide = replace(gaussian, ranges=total, bearings=np.arctan2(dy, dx))
    at = wide.moments(x, y)
    peaked = replace(wide, range_weight=1e8 * wide.range_weight, bearing_weight=1e8 * wide.bearing_weight)
    np.testing.assert_array_equal(posterior(peaked, at), [x, y, *at.cov()])
    np.testing.assert_allclose(posterior(wide, at)[2:], at.cov(), rtol=0.03)


def test_directions_are_cosine_and_sine():
    angles = np.array([-np.pi, -1.5, -1e-9, 0.0, 0.5 * np.pi, 3.0, np.pi, 7.0])
    np.testing.assert_allclose(directions(angles), [np.cos(angles), np.sin(angles)], atol=1e-14)
