import math

import numpy as np
import pytest

from uw_acoustic_loc.core.multistatic.bound import cramer_rao, dilution, position_error
from uw_acoustic_loc.core.multistatic.estimator import METHODS, Noise, SonarNet, locate

TRIALS = 40


def polygon(count, distance=2000.0):
    angle = 2 * np.pi * np.arange(count) / count
    return SonarNet(np.zeros(2), distance * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def uniform(net, range_std=40.0, bearing_std=0.02, rayleigh=True):
    count = len(net.receivers)
    return Noise(np.full(count, range_std), np.full(count, bearing_std), rayleigh)


def grid():
    axis = np.arange(-4680.0, 5000.0, 720.0)  # 14 x 14, no cell upon a node
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


def simulate(net, targets, noise, trials, seed=0):
    ranges, bearings = net.measure(targets)
    range_errors, bearing_errors = noise.draw(np.random.default_rng(seed), (len(targets), trials))
    return ranges[..., None] + range_errors, bearings[..., None] + bearing_errors


def errors_of(net, targets, noise, method, trials, seed=0):
    fixes = locate(net, *simulate(net, targets, noise, trials, seed), noise, method)
    return fixes.positions - targets[:, None], fixes


def rmse_per_cell(errors):
    """RMSE (cells,) and the Monte Carlo standard deviation of each."""
    squares = np.square(errors).sum(axis=-1)
    rmse = np.sqrt(squares.mean(axis=1))
    return rmse, squares.std(axis=1) / math.sqrt(squares.shape[1]) / (2 * rmse)


def nees(errors, cov):
    return np.einsum("...i,...i->...", errors, np.linalg.solve(cov, errors[..., None])[..., 0])


# --- conventions ----------------------------------------------------------------------------------------------------


def test_measures_range_sum_and_bearing_of_the_target_at_the_receiver():
    ranges, bearings = SonarNet(np.array([0.0, 0.0]), np.array([[300.0, 0.0], [0.0, 0.0]])).measure(
        np.array([300.0, 400.0])
    )
    np.testing.assert_allclose(ranges, [900.0, 1000.0])
    np.testing.assert_allclose(bearings, [math.pi / 2, math.atan2(4, 3)])


def test_rayleigh_range_error_has_the_stated_mean_and_deviation_and_is_never_early():
    noise = Noise(np.array([40.0]), np.array([0.02]))
    ranges, bearings = noise.draw(np.random.default_rng(1), (200_000,))
    spread = 1 / math.sqrt(200_000)
    assert ranges.min() >= 0
    assert abs(ranges.mean() - noise.bias[0]) < 4 * 40 * spread
    assert noise.bias[0] == pytest.approx(1.913 * 40, rel=1e-3)
    assert ranges.std() == pytest.approx(40, rel=4 * spread)
    assert bearings.std() == pytest.approx(0.02, rel=4 * spread)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("target", [(2600.0, 1400.0), (-900.0, 300.0), (300.0, -2500.0)])
def test_exact_measurements_give_the_exact_position(method, target):
    net = polygon(3)
    fix = locate(net, *net.measure(np.array(target)), uniform(net, rayleigh=False), method)
    assert fix.converged
    np.testing.assert_allclose(fix.positions, target, atol=0.01)


def test_a_start_on_the_wrong_side_of_the_angle_cut_is_no_obstacle():
    net = polygon(3)
    ranges, bearings = net.measure(np.array([-4000.0, -1.0]))
    fix = locate(net, ranges, bearings + 2 * np.pi * np.array([1, 0, -1]), uniform(net, rayleigh=False))
    np.testing.assert_allclose(fix.positions, [-4000.0, -1.0], atol=0.01)


# --- the bound -----------------------------------------------------------------------------------------------------


def test_cramer_rao_bound_is_the_inverse_of_the_information_of_finite_differences():
    net, noise, h = polygon(5), uniform(polygon(5)), 1e-3
    target = np.array([700.0, -1900.0])
    ahead, behind = (np.array(net.measure(target + side * h * np.eye(2))) for side in (1, -1))
    G = (ahead - behind) / (2 * h)  # (2 kinds, N, 2)
    information = G[0].T @ G[0] / 40.0**2 + G[1].T @ G[1] / 0.02**2
    np.testing.assert_allclose(cramer_rao(net, target, noise), np.linalg.inv(information), rtol=1e-6)


def test_dilution_of_a_net_that_can_be_worked_out_by_hand():
    # rows of G: (1, 0) + (1, 0) and (1, 0) + (0, 1), so the trace of (G^T G)^-1 is 1.5
    net = SonarNet(np.zeros(2), np.array([[0.0, 0.0], [1000.0, -1000.0]]))
    assert dilution(net, np.array([1000.0, 0.0])) == pytest.approx(math.sqrt(1.5))


def test_bound_is_infinite_where_the_net_does_not_determine_the_position():
    net = SonarNet(np.zeros(2), np.array([[1000.0, 0.0], [2000.0, 0.0]]))
    assert np.isinf(dilution(net, np.array([3000.0, 0.0])))


# --- how good the fixes are -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("count", "distance", "range_std", "bearing_std"),
    [
        (3, 2000, 40, 0.02), (5, 2000, 40, 0.02), (9, 2000, 40, 0.02),
        (3, 2000, 20, 0.03), (3, 2000, 60, 0.01), (3, 1000, 40, 0.02), (3, 6000, 40, 0.02),
    ],
)  # fmt: skip
def test_fixes_reach_the_cramer_rao_bound_all_over_the_grid(count, distance, range_std, bearing_std):
    net, targets = polygon(count, distance), grid()
    noise = uniform(net, range_std, bearing_std)
    bound = position_error(cramer_rao(net, targets, noise))
    mean, spread = {}, {}
    for method in METHODS:
        errors, _ = errors_of(net, targets, noise, method, TRIALS)
        rmse, deviation = rmse_per_cell(errors)
        mean[method], spread[method] = rmse.mean(), np.sqrt(np.square(deviation).sum()) / len(rmse)
        if method.startswith("ml_range_bearing"):
            assert np.max(rmse / bound) < 1.6
    assert mean["ml_range_bearing"] < 1.02 * bound.mean() + 3 * spread["ml_range_bearing"]
    assert mean["ml_exact"] < mean["ml_range_bearing"]  # the same noise, so the spread is common
    assert mean["ls"] > mean["ml_range_bearing"] + 3 * spread["ls"]
    assert mean["ml_range"] > mean["ml_range_bearing"] + 3 * spread["ml_range"]


def test_every_receiver_added_helps():
    targets = grid()
    mean = []
    for count in (3, 5, 7, 9, 15):
        net = polygon(count)
        mean.append(rmse_per_cell(errors_of(net, targets, uniform(net), "ml_range_bearing", TRIALS)[0])[0].mean())
    assert mean == sorted(mean, reverse=True)


@pytest.mark.parametrize(
    "target", [(1000.0, 5.0), (1000.0, -60.0), (-500.0, 870.0), (60.0, -50.0), (2040.0, 30.0), (2005.0, 5.0)]
)
def test_no_run_is_lost_near_baselines_transmitter_and_receiver(target):
    net, targets = polygon(3), np.array([target])
    noise = uniform(net)
    errors, fixes = errors_of(net, targets, noise, "ml_range_bearing", 2000)
    rmse, deviation = rmse_per_cell(errors)
    assert fixes.converged.mean() > 0.995
    assert rmse[0] < 1.6 * position_error(cramer_rao(net, targets, noise))[0] + 3 * deviation[0]
    assert nees(errors, fixes.cov)[fixes.converged].mean() / 2 < 1.5


@pytest.mark.parametrize(
    ("method", "rayleigh", "low", "high"),
    [("ml_range_bearing", True, 1, 1), ("ml_range_bearing", False, 1, 1), ("ml_range", True, 1, 1),
     ("ls", False, 1, 1), ("ml_exact", True, 1, 1), ("ml_exact", False, 1, 1)],
)  # fmt: skip
def test_covariance_is_honest(method, rayleigh, low, high):
    runs = 3000
    net = polygon(5)
    errors, fixes = errors_of(net, np.array([[2600.0, 1700.0]]), uniform(net, rayleigh=rayleigh), method, runs)
    band = 4 / math.sqrt(runs)  # 4 sigma of chi-square / 2 with 2 dof, averaged
    assert low - band < nees(errors, fixes.cov).mean() / 2 < high + band


def test_fixes_of_late_echoes_are_unbiased_because_the_bias_is_removed():
    net, noise = polygon(3), uniform(polygon(3))
    errors, fixes = errors_of(net, np.array([[2600.0, 1700.0]]), noise, "ml_range_bearing", 4000)
    left_in, _ = errors_of(net, np.array([[2600.0, 1700.0]]), uniform(net, rayleigh=False), "ml_range_bearing", 4000)
    assert np.abs(left_in.mean()) < 2.0  # no bias, none removed
    mean_std = np.sqrt(np.diagonal(fixes.cov[0].mean(axis=0)) / 4000)
    # the rest is the second-order bias of a nonlinear estimate, far below one fix's deviation
    assert np.all(np.abs(errors[0].mean(axis=0)) < 4 * mean_std + 0.05 * mean_std * math.sqrt(4000))


def test_misfit_tells_echoes_that_do_not_belong_together():
    net, noise = polygon(3), uniform(polygon(3))
    ranges, bearings = simulate(net, np.array([[2600.0, 1700.0]]), noise, 500)
    assert locate(net, ranges, bearings, noise).misfit.mean() == pytest.approx(4.0, abs=4 * math.sqrt(8 / 500))
    ranges[0] += 600.0
    assert locate(net, ranges, bearings, noise).misfit.min() > 20.0


def test_chunks_do_not_change_anything():
    net, noise = polygon(3), uniform(polygon(3))
    ranges, bearings = simulate(net, np.array([[2600.0, 1700.0]]), noise, 30_000)
    whole = locate(net, ranges, bearings, noise)
    part = locate(net, ranges[:, 0, 21_000:23_000], bearings[:, 0, 21_000:23_000], noise)
    assert whole.positions.shape == (1, 30_000, 2)
    np.testing.assert_allclose(whole.positions[0, 21_000:23_000], part.positions, rtol=1e-9)
    np.testing.assert_allclose(whole.cov[0, 21_000:23_000], part.cov, rtol=1e-9)


# --- errors ---------------------------------------------------------------------------------------------------------


def test_nan_does_not_converge():
    net = polygon(3)
    ranges, bearings = net.measure(np.array([2600.0, 1400.0]))
    ranges[1] = np.nan
    assert not any(locate(net, ranges, bearings, uniform(net), method).converged for method in METHODS)


def test_contradictory_ranges_are_marked_by_their_misfit():
    net = polygon(3)
    ranges, bearings = net.measure(np.array([2600.0, 1400.0]))
    fix = locate(net, ranges - 2500.0, bearings, uniform(net), "ml_exact")
    assert np.isfinite(fix.positions).all()
    assert fix.misfit > 100


def test_error_sentences():
    net, line = polygon(3), SonarNet(np.zeros(2), np.array([[1000.0, 0.0], [-2000.0, 0.0]]))
    three, one = np.ones(3), np.ones(1)
    with pytest.raises(ValueError, match=r"must be \(3, ...\), got \(1,\), \(1,\) and \(3,\)"):
        locate(net, one, one, Noise(three, three))
    with pytest.raises(ValueError, match=r"method must be one of ls, .* got 'best'"):
        locate(net, three, three, Noise(three, three), "best")
    with pytest.raises(ValueError, match="ml_range needs at least 2 receivers, got 1"):
        locate(SonarNet(np.zeros(2), np.ones((1, 2))), one, one, Noise(one, one), "ml_range")
    with pytest.raises(ValueError, match="ls needs 2 receivers that are not in line with the transmitter"):
        locate(line, np.ones(2), np.ones(2), Noise(np.ones(2), np.ones(2)), "ls")
    with pytest.raises(ValueError, match=r"range_std must be positive, got \[0.0\]"):
        Noise(np.zeros(1), one)
    with pytest.raises(ValueError, match="range_std and bearing_std must be"):
        Noise(three, one)
    with pytest.raises(ValueError, match="transmitter must be"):
        SonarNet(np.array([np.nan, 0.0]), np.ones((1, 2)))
    with pytest.raises(ValueError, match=r"receivers must be \(N, 2\), N >= 1, got \(0, 2\)"):
        SonarNet(np.zeros(2), np.empty((0, 2)))
    with pytest.raises(ValueError, match="receivers must be finite"):
        SonarNet(np.zeros(2), np.array([[np.inf, 0.0]]))
