"""EKF bank and particle filter of a still source, in the simulation of Shin et al. 2013."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.core.geometry import wrap_angles
from uw_acoustic_loc.core.localizer.bearing_ekf import BearingEkf, range_bank, single_start
from uw_acoustic_loc.core.localizer.bearing_noise import NOISES, draw_errors, log_likelihood
from uw_acoustic_loc.core.localizer.particles import BearingParticles
from uw_acoustic_loc.core.localizer.triangulation import Drift, Ray

SOURCE = np.array([10.0, 53.0])
HALF = math.radians(10)
STD = HALF / math.sqrt(3)
RUNS = 60


def simulated(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The source moves 1 m to the left per sample; the same as the vehicle moving to the right."""
    x = np.arange(21.0)
    return x, np.arctan2(53.0, 10.0 - x) + rng.uniform(-HALF, HALF, 21)


def bayes_grid(x: np.ndarray, bearings: np.ndarray) -> float:
    """Error of the exact posterior mean at the end: bounded errors, prior uniform in area from 1 to 140 m."""
    ranges = np.sqrt((np.arange(300) + 0.5) / 300 * (140**2 - 1) + 1)[:, None]
    angles = bearings[0] + np.linspace(-HALF, HALF, 301)
    gx, gy = ranges * np.cos(angles), ranges * np.sin(angles)
    alive = np.ones_like(gx)
    for k in range(1, x.size):
        alive *= np.abs(wrap_angles(bearings[k] - np.arctan2(gy, gx - x[k]))) <= HALF
    return math.hypot((alive * gx).sum() / alive.sum() - 10, (alive * gy).sum() / alive.sum() - 53)


def particle_error(x: np.ndarray, bearings: np.ndarray, seed: int) -> float:
    rays = [Ray(x[k], 0.0, bearings[k], STD) for k in range(21)]
    rng = np.random.default_rng(seed)
    cloud = BearingParticles(rays[0], 1, 140, particles=2000, noise="uniform", rng=rng)
    for ray in rays[1:]:
        cloud.update(ray)
    return math.hypot(*(cloud.estimate().mean - SOURCE))


def rms(errors: list[float]) -> float:
    return math.sqrt(np.mean(np.square(errors)))


def test_particles_come_near_the_exact_answer():
    tracks = [simulated(np.random.default_rng([6, run])) for run in range(RUNS)]
    exact = rms([bayes_grid(*track) for track in tracks])
    assert rms([particle_error(*track, run) for run, track in enumerate(tracks)]) < 1.15 * exact


def test_ekf_with_the_papers_start():
    errors = []
    for run in range(300):
        x, bearings = simulated(np.random.default_rng([7, run]))
        ekf = single_start(np.zeros(2), np.array([50.0, 50.0]), 900.0 * np.eye(2))
        for k in range(21):
            ekf.update(Ray(x[k], 0.0, bearings[k], STD))
        errors.append(math.hypot(*(ekf.estimate().mean - SOURCE)))
    assert rms(errors) < 17


def nees_of(kind: str, run: int) -> float:
    rng, std = np.random.default_rng([8, run]), math.radians(3)
    points = np.stack([np.linspace(0, 60, 150), 8 * np.sin(np.linspace(0, 4, 150))], axis=1)
    bearings = np.arctan2(53 - points[:, 1], 10 - points[:, 0]) + rng.normal(0, std, 150)
    rays = [Ray(*point, bearing, std) for point, bearing in zip(points, bearings, strict=True)]
    estimator: BearingEkf | BearingParticles = range_bank(rays[0], 1, 200)
    if kind == "particles":
        estimator = BearingParticles(rays[0], 1, 200, particles=1000, noise="gaussian", rng=rng)
    for ray in rays[1:]:
        estimator.update(ray)
    fix = estimator.estimate()
    error = fix.mean - SOURCE
    return float(error @ np.linalg.solve(fix.cov, error)) / 2


@pytest.mark.parametrize(("kind", "runs"), [("ekf", 100), ("particles", 40)])
def test_covariance_is_honest(kind, runs):
    nees = np.mean([nees_of(kind, run) for run in range(runs)])
    assert abs(nees - 1) < 4 / math.sqrt(runs)


@pytest.mark.parametrize("noise", NOISES)
def test_particles_are_honest_with_the_errors_they_are_told_of(noise):
    """Whatever the density: NEES / 2 of 30 runs is 1 to four times its spread, when that is a chi-square's."""
    nees, std, x = [], math.radians(3), np.linspace(0, 60, 60)
    for run in range(30):
        rng = np.random.default_rng([10, run])
        bearings = np.arctan2(53.0, 10 - x) + draw_errors(noise, std, 60, rng)
        rays = [Ray(x[k], 0.0, bearings[k], std) for k in range(60)]
        cloud = BearingParticles(rays[0], 1, 200, particles=1000, noise=noise, rng=rng)
        for ray in rays[1:]:
            cloud.update(ray)
        fix = cloud.estimate()
        off = fix.mean - SOURCE
        nees.append(off @ np.linalg.solve(fix.cov, off) / 2)
    assert abs(np.mean(nees) - 1) < 4 / math.sqrt(30)


def test_bank_spans_the_range_and_collapses():
    bank = range_bank(Ray(0, 0, math.atan2(53, 10), 0.02), 1, 200)
    fix = bank.estimate()
    along = SOURCE / np.hypot(*SOURCE)
    assert bank.members >= 10 and 40 < math.sqrt(along @ fix.cov @ along) < 80
    for x in np.linspace(0, 40, 200):
        bank.update(Ray(x, 0.0, math.atan2(53, 10 - x), 0.02))
    assert bank.members < 4
    np.testing.assert_allclose(bank.estimate().mean, SOURCE, atol=0.3)


def test_predicted_bearing_over_the_seam():
    bank = range_bank(Ray(0, 0, math.pi, 0.1), 5, 50)
    bearing, variance = bank.predicted_bearing(0, 0)
    assert abs(abs(bearing) - math.pi) < 1e-9 and variance == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("noise", NOISES)
def test_likelihood_belongs_to_its_draws(noise):
    """The density of the draws, as a histogram, is the likelihood: same log ratios wherever many fell."""
    errors = draw_errors(noise, 0.1, 400_000, np.random.default_rng(9))
    counts, edges = np.histogram(errors, 17, (-0.165, 0.165))
    middle = (edges[1:] + edges[:-1]) / 2
    expected = log_likelihood(noise, middle, 0.1)
    observed = np.log(counts) - np.log(counts.sum())
    difference = observed - expected
    np.testing.assert_allclose(difference, difference.mean(), atol=0.05)


def test_correlated_bearing_counts_less():
    ekf = [range_bank(Ray(0, 0, 1.4, 0.1), 1, 200) for _ in range(2)]
    ekf[0].update(Ray(5, 0, 1.5, 0.1, weight=0.25))
    ekf[1].update(Ray(5, 0, 1.5, 0.2))
    np.testing.assert_allclose(ekf[0].estimate().mean, ekf[1].estimate().mean)


def test_process_noise_widens():
    for estimator in (
        range_bank(Ray(0, 0, 1.0, 0.01), 10, 20, 0.5),
        BearingParticles(
            Ray(0, 0, 1.0, 0.01),
            10,
            20,
            particles=5000,
            noise="gaussian",
            rng=np.random.default_rng(1),
            process_noise=0.5,
        ),
    ):
        before = np.trace(estimator.estimate().cov)
        estimator.predict(4.0, Drift())
        assert np.trace(estimator.estimate().cov) - before == pytest.approx(2.0, rel=0.1)


def test_moving_on_turns_and_stretches_as_the_finite_differences_say():
    start, moved = np.array([1.0, 2.0]), np.array([6.0, 4.0])
    cov = np.array([[0.04, 0.01], [0.01, 0.02]])
    mean = np.array([math.log(9.0), 0.8])

    def seen(zeta: np.ndarray) -> np.ndarray:
        offset = start + math.exp(zeta[0]) * np.array([math.cos(zeta[1]), math.sin(zeta[1])]) - moved
        return np.array([math.log(np.hypot(*offset)), math.atan2(offset[1], offset[0])])

    J = np.stack([(seen(mean + d) - seen(mean - d)) / 2e-6 for d in 1e-6 * np.eye(2)], axis=1)
    bearing, variance = BearingEkf(start, mean[None], cov[None]).predicted_bearing(*moved)
    assert bearing == pytest.approx(seen(mean)[1]) and variance == pytest.approx((J @ cov @ J.T)[1, 1], rel=1e-6)


def test_cartesian_moments_are_those_of_draws():
    origin, mean, cov = np.zeros(2), np.array([2.0, 0.7]), np.array([[0.09, 0.03], [0.03, 0.04]])
    drawn = np.random.default_rng(3).multivariate_normal(mean, cov, 400_000)
    points = np.exp(drawn[:, 0]) * np.stack([np.cos(drawn[:, 1]), np.sin(drawn[:, 1])])
    fix = BearingEkf(origin, mean[None], cov[None]).estimate()
    np.testing.assert_allclose(fix.mean, points.mean(axis=1), atol=0.02)
    np.testing.assert_allclose(fix.cov, np.cov(points), atol=0.05)


def test_heading_drift_turns_the_source_about_the_vehicle():
    """A source 100 m off at a known point: 0.01 rad of drift make 1 m across, nothing along."""
    start = Ray(0.0, 0.0, 0.0, 1e-4)
    for estimator in (
        single_start(np.zeros(2), np.array([100.0, 0.0]), 1e-6 * np.eye(2)),
        BearingParticles(start, 99.99, 100.01, particles=5000, noise="gaussian", rng=np.random.default_rng(2)),
    ):
        estimator.predict(1.0, Drift(0.0, 0.0, 1e-4))
        cov = estimator.estimate().cov
        assert cov[1, 1] == pytest.approx(1.0, rel=0.1) and cov[0, 0] < 1e-3


def test_sentences():
    with pytest.raises(ValueError, match="range_min must be above 0 and below range_max, got 5 and 2"):
        range_bank(Ray(0, 0, 0, 0.1), 5, 2)
    with pytest.raises(ValueError, match="noise must be one of gaussian, uniform, student_t, mixture, got 'pink'"):
        log_likelihood("pink", np.zeros(1), 1.0)
    with pytest.raises(ValueError, match=r"means must be \(K, 2\)"):
        BearingEkf(np.zeros(2), np.zeros(2), np.eye(2))
