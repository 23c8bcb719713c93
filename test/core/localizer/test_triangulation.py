"""Where bearing lines meet."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.core.localizer.triangulation import Ray, Triangulation, intersect, merged_pairs

SOURCE = np.array([10.0, 53.0])


def bearings_of(origins: np.ndarray) -> np.ndarray:
    return np.arctan2(*(SOURCE - origins).T[::-1])


def test_two_lines_give_the_papers_formula():
    """Shin et al. 2013 eq. 1-2: vehicle along x, bearings from (x1, 0) and (x2, 0)."""
    x1, x2 = 0.0, 20.0
    theta1, theta2 = math.atan2(53, 10 - x1), math.atan2(53, 10 - x2)
    y = (x2 - x1) / (math.tan(math.pi / 2 - theta1) - math.tan(math.pi / 2 - theta2))
    fix = intersect(np.array([[x1, 0], [x2, 0]]), np.array([theta1, theta2]), np.full(2, 1e-4))
    assert fix is not None
    np.testing.assert_allclose(fix.mean, [x2 + y / math.tan(theta2), y], rtol=1e-9)


@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0, -2.0])
def test_any_poses_and_any_frame(turn):
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    origins = np.array([[0.0, 0.0], [5.0, 1.0], [7.0, 8.0], [2.0, 12.0]])
    fix = intersect(origins @ rotation.T, bearings_of(origins) + turn, np.full(4, 1e-4))
    assert fix is not None
    np.testing.assert_allclose(fix.mean, rotation @ SOURCE, atol=1e-6)


def test_parallel_and_diverging_lines_have_no_fix():
    origins = np.array([[0.0, 0.0], [10.0, 0.0]])
    assert intersect(origins, np.full(2, 1.2), np.full(2, 1e-4)) is None
    assert intersect(origins, np.array([1.3, 1.1]), np.full(2, 1e-4)) is None
    nearly = bearings_of(np.array([[0.0, 0.0], [0.2, 0.0]]))
    assert intersect(np.array([[0.0, 0.0], [0.2, 0.0]]), nearly, np.full(2, math.radians(2) ** 2)) is None


def test_covariance_is_honest():
    rng, std = np.random.default_rng(4), math.radians(2)
    origins = np.stack([np.linspace(0, 40, 60), np.linspace(0, 5, 60) ** 2 / 5], axis=1)
    nees = []
    for _ in range(200):
        fix = intersect(origins, bearings_of(origins) + rng.normal(0, std, 60), np.full(60, std**2))
        assert fix is not None
        error = fix.mean - SOURCE
        nees.append(error @ np.linalg.solve(fix.cov, error) / 2)
    assert abs(np.mean(nees) - 1) < 4 / math.sqrt(200)  # chi-square of 2: mean of nees/2 has std 1/sqrt(runs)


def test_bounded_memory_keeps_the_information():
    rng, std = np.random.default_rng(5), math.radians(2)
    short, long = (Triangulation(Ray(0, 0, 1.4, std), capacity) for capacity in (20, 1000))
    for x in np.linspace(0, 40, 300):
        bearing = float(bearings_of(np.array([[x, 0.0]]))[0] + rng.normal(0, std))
        short.update(Ray(x, 0.0, bearing, std))
        long.update(Ray(x, 0.0, bearing, std))
    few, all_ = short.estimate(), long.estimate()
    assert few is not None and all_ is not None
    np.testing.assert_allclose(np.sqrt(np.diag(few.cov)), np.sqrt(np.diag(all_.cov)), rtol=0.1)
    assert np.hypot(*(few.mean - all_.mean)) < 0.5 * math.sqrt(np.trace(all_.cov))


def test_pairs_are_averaged_over_the_seam_of_angles():
    lines = np.array([[0.0, 0.0, math.pi - 0.1, 1.0], [2.0, 0.0, -math.pi + 0.1, 1.0]])
    merged = merged_pairs(lines)
    assert merged[0, 0] == 1.0 and merged[0, 3] == 0.5
    assert abs(math.sin(merged[0, 2])) < 1e-12


def test_capacity_sentence():
    with pytest.raises(ValueError, match="capacity must be an even number of at least 4 lines, got 3"):
        Triangulation(Ray(0, 0, 0, 0.1), 3)
