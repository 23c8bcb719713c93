import dataclasses

import numpy as np
import pytest
from scipy import stats

from uw_acoustic_loc.core.impulsive import AlphaStable, ImpulsiveNoise, LikelihoodTable, s0_location, s1_location

X = np.array([-60.0, -20, -8, -3, -1.5, -0.4, 0, 0.3, 1, 2.5, 6, 15, 60, 300])
NOISE = ImpulsiveNoise(0.5, 0.3, AlphaStable(1.8, 1.0, 10.0, -3.0))  # Lee et al. 2013, table 1


@pytest.mark.parametrize(("alpha", "beta"), [(1.8, 1.0), (1.2, -0.5), (1.0, 0.5), (0.8, 0.3), (0.5, 1.0)])
def test_density_is_scipys_in_parameterisation_s1(alpha: float, beta: float) -> None:
    ours = AlphaStable(alpha, beta, 2.0, -1.0).density(X)
    assert ours == pytest.approx(stats.levy_stable.pdf(X, alpha, beta, loc=-1.0, scale=2.0), abs=1e-4, rel=1e-2)


@pytest.mark.parametrize(
    ("stable", "known"),
    [
        (AlphaStable(2.0, 0.0, 3.0, 1.0), stats.norm(1.0, 3.0 * 2**0.5)),
        (AlphaStable(1.0, 0.0, 3.0, 1.0), stats.cauchy(1.0, 3.0)),
        (AlphaStable(0.5, 1.0, 3.0, 1.0), stats.levy(1.0, 3.0)),
    ],
    ids=["gaussian", "cauchy", "levy"],
)
def test_special_cases(stable: AlphaStable, known: stats.rv_continuous) -> None:
    assert stable.density(X) == pytest.approx(known.pdf(X), abs=1e-4)
    draws = stable.draw(np.random.default_rng(1), 20_000)
    assert stats.kstest(draws, known.cdf).pvalue > 1e-4


@pytest.mark.parametrize(("alpha", "beta"), [(1.8, 1.0), (1.3, -0.7), (1.0, 0.8), (0.7, 0.4)])
def test_draws_have_the_characteristic_function(alpha: float, beta: float) -> None:
    scale, location, n = 2.0, -3.0, 40_000
    draws = AlphaStable(alpha, beta, scale, location).draw(np.random.default_rng(2), n)
    for t in (0.05, 0.2, 0.6):
        twist = -2 / np.pi * np.log(t) if alpha == 1 else np.tan(np.pi * alpha / 2)
        shift = 2 / np.pi * beta * scale * np.log(scale) if alpha == 1 else 0.0
        # scale x + location (+ shift for alpha = 1) of a standard variable; scale^alpha |t|^alpha and log(scale t)
        twist = -2 / np.pi * np.log(scale * t) if alpha == 1 else twist
        expected = np.exp(-((scale * t) ** alpha) * (1 - 1j * beta * twist) + 1j * (location + shift) * t)
        assert abs(np.exp(1j * t * draws).mean() - expected) < 4 / np.sqrt(n)


def test_s1_location_is_the_mean_above_alpha_1() -> None:
    stable = AlphaStable(1.8, 1.0, 10.0, -3.0)
    x = np.arange(-300, 20_000, 0.05)
    mass, mean = (float(np.sum(x**k * stable.density(x)) * 0.05) for k in (0, 1))
    assert mass == pytest.approx(1.0, abs=1e-4)
    assert mean == pytest.approx(-3.0, abs=0.05)  # what lies beyond 20 000 is 0.02


@pytest.mark.parametrize(("alpha", "beta"), [(1.8, 1.0), (1.2, -0.5), (1.0, 0.5), (0.7, 1.0)])
def test_s0_location_is_scipys(alpha: float, beta: float) -> None:
    """scipy evaluates both parameterisations; ours with the converted location is its S0 density."""
    ours = AlphaStable(alpha, beta, 3.0, s1_location(alpha, beta, 3.0, -2.0))
    x = X[2:11]
    levy_stable = type(stats.levy_stable)()
    levy_stable.parameterization = "S0"
    assert ours.density(x) == pytest.approx(levy_stable.pdf(x, alpha, beta, loc=-2.0, scale=3.0), abs=1e-4, rel=1e-2)


@pytest.mark.parametrize(("alpha", "beta"), [(1.8, 1.0), (1.0, 0.5), (0.6, -1.0)])
def test_locations_convert_both_ways(alpha: float, beta: float) -> None:
    stable = AlphaStable(alpha, beta, 3.0, -2.0)
    assert s1_location(alpha, beta, 3.0, s0_location(stable)) == pytest.approx(-2.0)
    near = AlphaStable(1.0 + 1e-6, 0.5, 3.0, s1_location(1.0 + 1e-6, 0.5, 3.0, 0.0))
    cauchy_like = AlphaStable(1.0, 0.5, 3.0, s1_location(1.0, 0.5, 3.0, 0.0))
    assert near.density(X) == pytest.approx(cauchy_like.density(X), abs=1e-5)  # S0 is continuous in alpha


def test_mixture_density_is_that_of_its_draws() -> None:
    edges = np.array([-30.0, -10, -5, -2, -1, -0.5, 0, 0.5, 1, 2, 5, 10, 30])
    n = 50_000
    counts = np.histogram(NOISE.draw(np.random.default_rng(3), n), edges)[0]
    middles = np.arange(-30, 30, 0.001) + 0.0005
    expected = np.histogram(middles, edges, weights=NOISE.density(middles))[0] * 0.001 * n
    chi2 = float(np.sum((counts - expected) ** 2 / expected))
    assert chi2 < stats.chi2.ppf(0.9999, len(counts))


def test_without_impulses_the_mixture_is_gaussian() -> None:
    quiet = dataclasses.replace(NOISE, fraction=0.0)
    assert quiet.density(X) == pytest.approx(stats.norm.pdf(X, 0, 0.5))
    assert stats.kstest(quiet.draw(np.random.default_rng(4), 10_000), stats.norm(0, 0.5).cdf).pvalue > 1e-4


def test_impulses_strike_some_of_the_errors_given() -> None:
    given = np.zeros((2, 10_000), np.float32)
    struck = NOISE.strike(np.random.default_rng(6), given)
    assert (struck.dtype, given.any()) == (np.float32, False)
    assert np.mean(struck != 0) == pytest.approx(0.3, abs=5 * np.sqrt(0.21 / given.size))
    scaled = struck[struck != 0] / NOISE.std
    assert stats.kstest(scaled[:2000], lambda x: stats.levy_stable.cdf(x, 1.8, 1.0, loc=-3.0, scale=10.0)).pvalue > 1e-4


def test_table_is_the_density_but_for_a_factor() -> None:
    """The nearest of 100 points per standard deviation: where the density falls fastest, 1.7 %."""
    x = np.random.default_rng(5).uniform(-50, 280, (100, 20))
    ratio = LikelihoodTable(NOISE)(x) / NOISE.density(x)
    assert ratio == pytest.approx(ratio[0, 0], rel=0.02)
    near = np.linspace(-0.4, 0.4, 81)  # on the grid
    assert LikelihoodTable(NOISE)(near) * NOISE.density(np.zeros(1)) == pytest.approx(NOISE.density(near), rel=1e-2)


@pytest.mark.parametrize("fraction", [0.0, 0.3])
def test_table_is_positive_and_flat_far_out(fraction: float) -> None:
    table = LikelihoodTable(dataclasses.replace(NOISE, fraction=fraction))
    far = table(np.array([-1e300, -1e4, 1e4, 1e300]))
    assert np.all(far > 1e-290)
    assert far[0] == far[1]
    assert far[2] == far[3]
    assert table(np.linspace(-3, 3, 601)).max() == 1.0


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ((2.5, 0.0, 1.0, 0.0), r"alpha must be in \(0, 2\], got 2.5"),
        ((1.5, 2.0, 1.0, 0.0), "beta must be from -1 to 1, got 2.0"),
        ((1.5, 0.0, 0.0, 0.0), "scale must be positive, got 0.0"),
    ],
)
def test_what_is_no_distribution_is_refused(values: tuple[float, ...], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        AlphaStable(*values)


def test_a_density_below_alpha_one_half_is_refused() -> None:
    with pytest.raises(ValueError, match=r"alpha must be at least 0\.5 for a tabulated density, got 0\.3"):
        AlphaStable(0.3).density(X)
