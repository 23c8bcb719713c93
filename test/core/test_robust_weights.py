import numpy as np
import pytest

from uw_acoustic_loc.core.impulsive import AlphaStable, ImpulsiveNoise, mixture_weights, student_t_weights

NOISE = ImpulsiveNoise(0.5, 0.3, AlphaStable(1.8, 1.0, 10.0, -3.0))


def test_mixture_weights_are_how_often_an_error_is_gaussian() -> None:
    """Drawn errors sorted by size: in each class the share of Gaussian ones, to 5 sigma of the counts."""
    rng, n = np.random.default_rng(1), 200_000
    gaussian = rng.random(n) >= NOISE.fraction
    errors = NOISE.std * np.where(gaussian, rng.standard_normal(n), NOISE.impulse.draw(rng, n))
    weights = mixture_weights(errors, np.zeros(n), NOISE)
    for low, high in ((0, 0.5), (0.5, 1.0), (1.0, 1.5), (1.5, 2.0), (2.0, 5.0)):
        here = (np.abs(errors) >= low) & (np.abs(errors) < high)
        share = gaussian[here].mean()
        assert weights[here].mean() == pytest.approx(share, abs=5 * np.sqrt(0.25 / here.sum()))
    assert weights[np.abs(errors) > 5].max() < 1e-3


def test_an_uncertain_prediction_excuses_an_innovation() -> None:
    far = np.array([3.0])
    for weigh in (lambda v: mixture_weights(far, v, NOISE), lambda v: student_t_weights(far, v, 0.5, 4.0)):
        assert weigh(np.array([4.0])) > weigh(np.array([0.0]))


def test_without_impulses_everything_counts() -> None:
    quiet = ImpulsiveNoise(0.5, 0.0, NOISE.impulse)
    assert mixture_weights(np.array([0.0, 9.0]), np.zeros(2), quiet).tolist() == [1.0, 1.0]


def test_student_t_weights() -> None:
    weights = student_t_weights(np.array([0.0, 1.0, 10.0]), np.zeros(3), 1.0, 4.0)
    assert weights == pytest.approx([1.0, 1.0, 5 / 104])
    many = student_t_weights(np.array([3.0]), np.zeros(1), 1.0, 1e9)
    assert many == pytest.approx([1.0], abs=1e-6)  # Gaussian
