"""The exact posterior against closed forms and against brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.core.geometry import wrap_angles
from uw_acoustic_loc.core.localizer.bearing_noise import NOISES, log_likelihood
from uw_acoustic_loc.core.localizer.triangulation import Ray
from uw_acoustic_loc.studies.localizer.grid import BearingGrid

HALF = math.radians(10)


def rays(noise_std: float, count: int = 12, seed: int = 1) -> list[Ray]:
    rng = np.random.default_rng(seed)
    x = 3.0 * np.arange(count)
    bearings = np.arctan2(53.0 + x / 4, 10.0 - x) + rng.uniform(-1.5, 1.5, count) * noise_std
    return [Ray(x[k], -x[k] / 4, bearings[k], noise_std) for k in range(count)]


def test_one_bounded_bearing_gives_the_closed_form_of_a_sector():
    near, far = 2.0, 140.0
    fix = BearingGrid(Ray(5.0, -3.0, 0.0, HALF / math.sqrt(3)), near, far, noise="uniform", cells=400).estimate()
    radius = (far - near) / math.log(far / near) * math.sin(HALF) / HALF  # E[s / |s|^2] / E[1 / |s|^2]
    np.testing.assert_allclose(fix.mean, [5.0 + radius, -3.0], rtol=2e-3, atol=1e-9)
    across = (far**2 + near**2) / 2 * (1 - math.sin(2 * HALF) / (2 * HALF)) / 2
    assert fix.cov[1, 1] == pytest.approx(across, rel=0.02)


@pytest.mark.parametrize("noise", NOISES)
def test_it_is_the_posterior_of_a_million_draws_from_the_prior(noise):
    """Importance sampling with weights p(b | s), to four of its own standard errors."""
    std, rng, n = 0.1, np.random.default_rng(2), 1_000_000
    heard = rays(std)
    grid = BearingGrid(heard[0], 1.0, 140.0, noise=noise)
    for ray in heard[1:]:
        grid.update(ray)
    radius, angle = np.sqrt(rng.uniform(1.0, 140.0**2, n)), rng.uniform(1.0, 2.0, n)  # beyond, the first ray has none
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    log_weight = sum(
        log_likelihood(noise, wrap_angles(r.bearing - np.arctan2(y - r.y, x - r.x)), std, 1e-6) for r in heard
    )
    weight = np.exp(log_weight - np.max(log_weight))
    weight /= weight.sum()
    share, fix = weight / radius**2, grid.estimate()  # the first bearing was heard at (0, 0)
    share /= share.sum()
    best = np.array([share @ x, share @ y])
    off = np.stack([x, y]) - best[:, None]
    errors = np.sqrt((share**2 * off**2).sum(axis=1))
    assert np.all(np.abs(fix.mean - best) < 4 * errors + 0.02)
    np.testing.assert_allclose(np.sqrt(np.diag(fix.cov)), np.sqrt(weight @ (off**2).T), rtol=0.05)


def test_it_stays_fine_when_the_posterior_is_tiny():
    """Gaussian bearings, small errors: the posterior is the one of linear theory."""
    std, source = 1e-4, np.array([10.0, 53.0])
    points = [(20.0 * k, 7.0 * k * k) for k in range(4)]
    heard = [Ray(x, y, math.atan2(source[1] - y, source[0] - x), std) for x, y in points]
    grid = BearingGrid(heard[0], 1.0, 140.0, noise="gaussian", cells=64)
    for ray in heard[1:]:
        grid.update(ray)
    information = np.zeros((2, 2))
    for x, y in points:
        dx, dy = source - (x, y)
        row = np.array([-dy, dx]) / (dx * dx + dy * dy)
        information += np.outer(row, row) / std**2
    fix = grid.estimate()
    np.testing.assert_allclose(fix.mean, source, atol=1e-3)
    np.testing.assert_allclose(fix.cov, np.linalg.inv(information), rtol=0.01, atol=1e-9)


def test_the_answer_does_not_depend_on_the_cells():
    fixes = []
    for cells in (64, 200):
        heard = rays(0.05, seed=3)
        grid = BearingGrid(heard[0], 1.0, 140.0, noise="uniform", cells=cells)
        for ray in heard[1:]:
            grid.update(ray)
        fixes.append(grid.estimate())
    spread = math.sqrt(np.trace(fixes[1].cov))
    assert math.dist(fixes[0].mean, fixes[1].mean) < 0.03 * spread


def test_sentence():
    with pytest.raises(ValueError, match="range_min must be below range_max and not below 0, got 5 and 2"):
        BearingGrid(Ray(0, 0, 0, 0.1), 5, 2, noise="uniform")
