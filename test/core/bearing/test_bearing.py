import math
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.config import build
from uw_acoustic_loc.config import changed as altered
from uw_acoustic_loc.core.bearing.config import BearingConfig
from uw_acoustic_loc.core.bearing.estimator import BearingEstimator
from uw_acoustic_loc.core.geometry import hydrophone_positions, quat_from_yaw
from uw_acoustic_loc.core.types import HydrophoneInfo, Odometry, Samples
from uw_acoustic_loc.sim.acoustics import images, pulse
from uw_acoustic_loc.sim.scenario import Environment, Pinger

RATE, T0 = 100_000.0, 10**18
INFO = HydrophoneInfo(T0, RATE, 0.6, 1500.0, 1.0)
CONFIG = BearingConfig(source_ids=("a",), band_low=(20e3,), band_high=(30e3,), filter="none")


def frame(k, theta, band=(20e3, 30e3), noise=0.01, env=None, rng=None, clicks=0.0):
    """Frame k with a source 60 m away at an angle from the array's +x, 7 m below it when there are echoes."""
    env = env or Environment(surface_reflection=0.0, bottom_reflection=0.0)
    rng = rng or np.random.default_rng(k)
    pinger = Pinger(id="a", x=0.0, y=0.0, z=-5.0, band_low=band[0], band_high=band[1], source_level=60.0)
    depth = -12.0 if env.bottom_reflection else -5.0
    source = np.array([60 * math.cos(theta), 60 * math.sin(theta), depth])
    array = hydrophone_positions(0.6) + np.array([0.0, 0.0, -5.0])
    x = noise * rng.standard_normal((2, 10_000))
    x *= np.where(rng.random(x.shape) < clicks, 10.0, 1.0)
    for path, gain in zip(*(a.T for a in images(source, env)), strict=True):
        for channel in (0, 1):
            r = float(np.linalg.norm(path - array[channel]))
            age = np.arange(10_000) / RATE - 0.02 - r / 1500.0
            heard = (age >= 0) & (age <= pinger.pulse_length)
            x[channel, heard] += gain / r * pulse(pinger, age[heard])
    return Samples(T0 + k * 100_000_000, x[0].astype(np.float32), x[1].astype(np.float32))


def silence(k):
    return frame(k, 0.0, noise=0.01, env=None, band=(1.0, 2.0))  # a pinger far out of the band


def bearings(config, frames):
    estimator = BearingEstimator(config, INFO)
    return [b for f in frames for _, b in estimator.process(f)], estimator


@pytest.mark.parametrize("filter_", ["none", "particle", "histogram"])
@pytest.mark.parametrize(("side", "sign"), [("port", 1), ("starboard", -1)])
def test_a_source_to_port_has_a_positive_bearing(filter_, side, sign):
    config = altered(CONFIG, filter=filter_, assumed_side=side)
    found, _ = bearings(config, [frame(k, 1.1) for k in range(4)])
    assert found[-1].bearing == pytest.approx(sign * 1.1, abs=0.005)
    assert found[-1].t_ns == pytest.approx(T0 + 3 * 10**8 + 20_000_000 + 40_000_000, abs=500_000)


def test_both_sides_are_published_port_first_and_turned_with_the_array():
    config = altered(CONFIG, assumed_side="both", array_yaw=2.5, array_position=(0.5, 0.0, -0.2))
    found, _ = bearings(config, [frame(0, 1.1)])
    assert [b.bearing for b in found] == pytest.approx([2.5 + 1.1 - 2 * math.pi, 2.5 - 1.1], abs=0.005)
    assert found[0].t_ns == found[1].t_ns
    assert found[0].position == pytest.approx([0.5, 0.0, -0.2])


@pytest.mark.parametrize("filter_", ["none", "particle", "histogram"])
@pytest.mark.parametrize("theta", [0.0, math.pi])
def test_end_fire_is_clipped_counted_and_finite(filter_, theta):
    config = altered(CONFIG, filter=filter_, sound_speed=1510.0)  # makes the largest possible lag too short
    found, estimator = bearings(config, [frame(k, theta) for k in range(5)])
    assert estimator.tracks[0].clipped == 5
    assert all(math.isfinite(b.bearing) and 0 < b.variance < 10 for b in found)
    assert abs(found[-1].bearing - theta) < 0.1


@pytest.mark.parametrize("theta", [0.5, 0.9, 2.4])
def test_the_variance_is_that_of_sources_off_the_arrays_plane(theta):
    """Elevations as they are normal: five Gauss-Hermite nodes have the exact mean of their fourth power."""
    config = altered(CONFIG, elevation_std=0.1, sound_speed_std=0.0, phase_std=0.0)
    nodes, weights = np.polynomial.hermite_e.hermegauss(5)
    mean = 0.0
    for node, weight in zip(nodes, weights / weights.sum(), strict=True):
        (found,), _ = bearings(config, [frame(0, math.acos(math.cos(theta) * math.cos(0.1 * node)), noise=1e-4)])
        mean += weight * (found.bearing - theta) ** 2 / found.variance
    assert mean == pytest.approx(1.0, abs=0.15), "the rest is of higher order in the elevation"


@pytest.mark.parametrize("filter_", ["none", "particle", "histogram"])
def test_without_a_ping_nothing_is_published_and_the_std_grows(filter_):
    config = altered(CONFIG, filter=filter_)
    estimator = BearingEstimator(config, INFO)
    for k in range(4):
        list(estimator.process(frame(k, 1.1)))
    stds = []
    for k in range(4, 9):
        assert list(estimator.process(silence(k))) == []
        stds.append(estimator.tracks[0].std)
    assert np.all(np.diff(stds) > 0)


@pytest.mark.parametrize("filter_", ["none", "particle", "histogram"])
def test_odometry_carries_the_bearing_through_a_turn(filter_):
    estimator = BearingEstimator(altered(CONFIG, filter=filter_), INFO)
    for k in range(4):
        list(estimator.process(frame(k, 1.5)))
    for k in range(4, 9):
        still, turn = np.zeros(3), np.array([0.0, 0.0, 0.4])
        estimator.move(Odometry(T0 + k * 10**8, still, quat_from_yaw(0.4 * (k - 4) * 0.1), still, turn))
        list(estimator.process(silence(k)))
    state = estimator.tracks[0].filter
    elapsed = (estimator.tracks[0].state_ns - T0) * 1e-9 - 0.36
    assert state.estimate()[0] == pytest.approx(1.5 - 0.4 * elapsed, abs=0.03)


@pytest.mark.parametrize("filter_", ["particle", "histogram"])
@pytest.mark.parametrize(("band", "snr_db"), [((20e3, 30e3), 0.0), ((24e3, 26e3), 10.0)])
def test_the_filters_settle_echoes_clicks_and_wrong_cycles(filter_, band, snr_db):
    """20 m of water, source 7 m deeper than the array, impulsive noise; slow motion without odometry.

    The gross errors (over 5 degrees) of 250 pings, 18 % and 54 % of the maximum alone, must fall by ten, and by six
    where only time and motion tell the cycles apart.
    """
    env, rng = Environment(depth=20.0), np.random.default_rng(11)
    sigma = math.sqrt(0.5 * 10 ** (-snr_db / 10) * (RATE / 2) / (band[1] - band[0]))
    thetas = np.radians(np.linspace(35.0, 145.0, 250))
    frames = [frame(k, th, band, sigma, env, rng, clicks=0.01) for k, th in enumerate(thetas)]
    config = altered(CONFIG, band_low=(band[0],), band_high=(band[1],))
    gross = {}
    for name in ("none", filter_):
        found, _ = bearings(altered(config, filter=name), frames)
        true = thetas[[(b.t_ns - T0) // 10**8 for b in found]]
        errors = np.degrees(np.abs(np.array([b.bearing for b in found]) - true))
        gross[name] = np.mean(errors > 5.0)
        assert len(found) > 0.95 * len(frames)
    assert np.median(errors) < 1.2
    assert gross[filter_] <= gross["none"] / (10 if snr_db == 0.0 else 6)


def test_the_same_seed_gives_the_same_bearings():
    runs = [bearings(altered(CONFIG, filter="particle"), [frame(k, 1.0) for k in range(5)])[0] for _ in range(2)]
    assert [(b.t_ns, b.bearing, b.variance) for b in runs[0]] == [(b.t_ns, b.bearing, b.variance) for b in runs[1]]


def test_the_cloud_is_small_and_lies_around_the_bearing():
    _, estimator = bearings(altered(CONFIG, filter="particle", assumed_side="both"), [frame(k, 1.0) for k in range(5)])
    cloud = estimator.cloud(0, T0)
    assert cloud is not None
    assert 100 < cloud.x.size <= 200
    assert cloud.weight.sum() == pytest.approx(1.0)
    port = cloud.y > 0
    assert 0.3 < cloud.weight[port].sum() < 0.7
    near = np.abs(np.arctan2(cloud.y, cloud.x) - 1.0) < 0.02
    assert cloud.weight[near].sum() > 0.5 * cloud.weight[port].sum()
    assert bearings(CONFIG, [])[1].cloud(0, T0) is None


def test_a_band_can_be_changed_and_the_filter_stays():
    config = altered(CONFIG, filter="histogram")
    estimator = BearingEstimator(config, INFO)
    for k in range(3):
        list(estimator.process(frame(k, 1.1)))
    estimator.change(altered(config, band_low=(32e3,), band_high=(38e3,)))
    assert list(estimator.process(frame(3, 1.1))) == []
    assert estimator.tracks[0].pings == 3
    ((_, bearing),) = estimator.process(frame(4, 1.1, band=(32e3, 38e3)))
    assert bearing.bearing == pytest.approx(1.1, abs=0.005)


def two(k, first, second, bands):
    """Sources at two angles, each on its band."""
    a, b = frame(k, first, bands[0]), frame(k, second, bands[1], noise=0.0)
    return Samples(a.t_ns, a.h0 + b.h0, a.h1 + b.h1)


def test_retuning_one_source_leaves_the_other_as_it_is():
    bands = [(20e3, 26e3), (32e3, 38e3)]
    config = altered(CONFIG, source_ids=("a", "b"), band_low=(20e3, 32e3), band_high=(26e3, 38e3), filter="particle")
    changed, same = BearingEstimator(config, INFO), BearingEstimator(config, INFO)
    expected = [x for k in range(10) for x in same.process(two(k, 1.1, 2.0, bands))]
    found = [x for k in range(6) for x in changed.process(two(k, 1.1, 2.0, bands))]
    changed.change(altered(config, band_low=(20e3, 40e3), band_high=(26e3, 46e3)))
    found += [x for k in range(6, 10) for x in changed.process(two(k, 1.1, 2.0, [bands[0], (40e3, 46e3)]))]
    of_a = [[v for s, v in run if s == 0] for run in (expected, found)]
    assert [v.bearing for v in of_a[1]] == pytest.approx([v.bearing for v in of_a[0]], abs=2e-3)
    assert len(of_a[1]) == 10
    assert changed.listener.ears[0].schedule.period == pytest.approx(0.1, rel=0.01)
    assert changed.listener.ears[1].schedule.period == 0.0
    assert [v.bearing for s, v in found if s == 1] == pytest.approx([2.0] * 10, abs=0.01)


@pytest.mark.parametrize("before", ["none", "particle", "histogram"])
@pytest.mark.parametrize("after", ["none", "particle", "histogram"])
def test_another_filter_begins_with_the_last_ones_estimate(before, after):
    config = altered(CONFIG, filter=before, assumed_side="both")
    estimator = BearingEstimator(config, INFO)
    for k in range(4):
        list(estimator.process(frame(k, 1.1)))
    estimator.change(altered(config, filter=after))
    assert estimator.tracks[0].filter.estimate()[0] == pytest.approx(1.1, abs=0.01)
    found = [b.bearing for _, b in estimator.process(frame(4, 1.1))]
    assert found == pytest.approx([1.1, -1.1], abs=0.005)


def test_a_band_beyond_half_the_sample_rate_is_refused_and_nothing_changes():
    estimator, bad = BearingEstimator(CONFIG, INFO), altered(CONFIG, band_low=(40e3,), band_high=(60e3,))
    for refuse in (estimator.check, estimator.change):
        with pytest.raises(ValueError, match="band must be 0 < low < high < 50000 Hz, got 40000 to 60000 Hz"):
            refuse(bad)
    ((_, bearing),) = estimator.process(frame(0, 1.1))
    assert bearing.bearing == pytest.approx(1.1, abs=0.005)


@pytest.mark.parametrize("theta", [0.6, 1.5, 2.4])
def test_the_bearing_belongs_to_the_pings_beginning_in_a_turn(theta):
    """An array that turns at 0.5 rad/s: the correlation is that of the ping's middle, 2.5 mrad on."""
    rate, early = 0.5, round(0.005 * RATE)
    estimator = BearingEstimator(CONFIG, INFO)
    turning = frame(0, theta)
    t_ns = T0 + 60_000_000
    for k in range(11):
        t, turn = T0 + k * 20_000_000, np.array([0.0, 0.0, rate])
        yaw = quat_from_yaw(rate * (t - t_ns - early / RATE * 1e9) * 1e-9)
        estimator.move(Odometry(t, np.zeros(3), yaw, np.zeros(3), turn))
    ((_, bearing),) = estimator.process(turning)  # as heard at `theta`, half a ping after its beginning
    assert bearing.bearing == pytest.approx(theta + rate * 0.005, abs=2e-4)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"source_ids": []}, "source_ids must be one or more different names, got \\[\\]"),
        ({"source_ids": ["a", "a", "b"]}, "source_ids must be one or more different names"),
        ({"band_low": [1e3]}, "band_low and band_high must have 3 elements, one per source, got 1 and 3"),
        ({"band_low": [25e3, 26e3, 34e3]}, "band_low of source a must be below its band_high 24000 Hz, got 25000 Hz"),
        ({"range_min": 200.0}, "range_min must be below range_max 100 m, got 200 m"),
        ({"min_period": 15.0}, "min_period must be below max_period 12 s, got 15 s"),
        ({"array_position": []}, "array_position must have 3 elements, got 0"),
        ({"filter": "kalman"}, "filter must be one of none, particle, histogram, got 'kalman'"),
    ],
)
def test_config_sentences(values, sentence):
    with pytest.raises(ValueError, match=f"bearing: .*{sentence}"):
        build(BearingConfig, values, "bearing")


@pytest.mark.parametrize("name", ["sample_rate", "spacing", "sound_speed", "scale"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_info_sentences(name, value):
    with pytest.raises(ValueError, match=f"hydrophones/info: {name} must be positive and finite, got {value}"):
        BearingEstimator(CONFIG, replace(INFO, **{name: value}))


def test_odometry_that_is_not_finite_is_refused():
    odometry = Odometry(T0, np.zeros(3), quat_from_yaw(0.0), np.array([math.nan, 0, 0]), np.zeros(3))
    with pytest.raises(ValueError, match="odometry pose and twist must be finite"):
        BearingEstimator(CONFIG, INFO).move(odometry)
