"""What is learnt of a noise, against the noise that was drawn."""

import dataclasses

import numpy as np
import pytest

from uw_acoustic_loc.core.impulsive import ImpulsiveNoise
from uw_acoustic_loc.core.mooring.estimator import MooringConfig, step_of
from uw_acoustic_loc.core.mooring.noise_learning import FACTORS, FRACTIONS, LearntNoise
from uw_acoustic_loc.core.mooring.particles import ParticleMooring
from uw_acoustic_loc.core.types import Array

START = MooringConfig().expected_noise  # 0.5 m


def learnt(std: float, fraction: float, count: int, runs: int) -> LearntNoise:
    """From errors of a position that is known exactly."""
    drawn = dataclasses.replace(START, std=std, fraction=fraction).draw(np.random.default_rng(1), (count, runs))
    noise = LearntNoise(START, runs)
    for errors in drawn:
        noise.weigh(np.ones((runs, 1)), errors[:, None])
    return noise


@pytest.mark.parametrize(("std", "fraction"), [(0.2, 0.0), (0.5, 0.3), (1.5, 0.5)])
def test_std_and_fraction_are_found(std: float, fraction: float) -> None:
    """200 errors tell a standard deviation to 5 to 8 %, a fraction to 0.035; 20 runs to a quarter of it."""
    found = learnt(std, fraction, 200, 20).mean
    assert found[0].mean() == pytest.approx(std, rel=0.06)
    assert found[1].mean() == pytest.approx(fraction, abs=0.04)
    assert np.abs(found[0] / std - 1).max() < 0.4


def test_without_measurements_everything_on_the_grid_is_as_likely() -> None:
    found = LearntNoise(START, 3).mean
    assert found[:, 0] == pytest.approx([START.std * FACTORS.mean(), FRACTIONS.mean()])


def test_particles_are_weighted_with_the_average_likelihood_of_all_hypotheses() -> None:
    errors = np.array([[-1.3, 0.0, 0.4, 30.0]])
    likelihood = LearntNoise(START, 1).weigh(np.ones((1, 4)), errors)
    hypotheses = [
        ImpulsiveNoise(START.std * factor, fraction, START.impulse) for factor in FACTORS for fraction in FRACTIONS
    ]
    assert likelihood == pytest.approx(np.mean([noise.density(errors) for noise in hypotheses], axis=0), rel=0.03)


def settled(noise: str, told_std: float, measured: Array, truth: Array) -> tuple[float, float]:
    """Standard deviation of the error and mean NEES of a drifting buoy, after the first 50 measurements."""
    config = MooringConfig(noise=noise, measurement_std=told_std, mass=0.0, damping=1.0, stiffness=0.0, force=0.0)
    step, mooring = step_of(config, 0.5), ParticleMooring(config, np.random.default_rng(3), measured.shape[1])
    errors, nees = [], []
    for offsets, true in zip(measured, truth, strict=True):
        mooring.predict(step)
        estimate = mooring.update(offsets)
        errors.append(estimate.mean[0] - true)
        nees.append(np.square(errors[-1]) / estimate.cov[0, 0])
    return float(np.std(errors[50:])), float(np.mean(nees[50:]))


@pytest.mark.parametrize("std", [0.2, 1.2])
def test_learnt_noise_is_nearly_as_good_as_known_noise_and_as_honest(std: float) -> None:
    rng, shape = np.random.default_rng(2), (120, 60)
    truth = np.cumsum(0.05 * rng.standard_normal(shape), axis=0)
    measured = truth + dataclasses.replace(START, std=std).draw(rng, shape)
    known = settled("given", std, measured, truth)
    told = settled("given", START.std, measured, truth)
    found = settled("learnt", START.std, measured, truth)
    assert found[0] < 1.1 * known[0]
    assert found[1] == pytest.approx(1.0, abs=0.2)  # 60 runs of some 7 independent errors each: 3 sigma
    assert abs(told[1] - 1) > 0.2
