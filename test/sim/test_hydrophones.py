from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.core.geometry import wrap_angle
from uw_acoustic_loc.sim.environment import SoundSpeed
from uw_acoustic_loc.sim.hydrophones import HydrophoneSource
from uw_acoustic_loc.sim.scenario import Impulses, Scenario, load_scenario
from uw_acoustic_loc.sim.trajectory import Trajectory

SCENARIO = replace(load_scenario(Path(__file__).parents[2] / "config/harbour/scenario.yaml"), duration=1.0)


QUIET = replace(
    SCENARIO,
    environment=replace(SCENARIO.environment, ambient_level=0.0, snap_rate=0.0),
    hydrophones=replace(SCENARIO.hydrophones, noise_std=0.0, format="float32"),
)


def with_array(scenario, **changes):
    return replace(scenario, hydrophones=replace(scenario.hydrophones, **changes))


def one_path(scenario):
    """Without echoes, and one pinger."""
    return replace(scenario, environment=replace(scenario.environment, reflections=0), pingers=scenario.pingers[:1])


def test_events_are_in_order_and_stamped_with_the_first_sample():
    source = HydrophoneSource(SCENARIO)
    events = list(source.events())
    start = SCENARIO.start_ns
    assert [t for t, _, _ in events] == sorted(t for t, _, _ in events)
    assert [topic for _, topic, _ in events[:4]] == ["hydrophones/info"] + [
        f"/truth/sources/{name}/position" for name in "abc"
    ]
    assert {topic for _, topic, _ in events} == {o.topic for o in source.outputs}
    samples = [(t, v) for t, topic, v in events if topic == "hydrophones/samples"]
    assert [v.t_ns for _, v in samples] == [start + k * 100_000_000 for k in range(10)]
    assert [t for t, _ in samples] == [start + (k + 1) * 100_000_000 for k in range(10)]
    assert events[1][2].position.tolist() == [20.0, 17.0, -15.5]


def test_a_frame_does_not_depend_on_those_before():
    in_turn, alone = HydrophoneSource(SCENARIO), HydrophoneSource(SCENARIO)
    for k in range(5):
        in_turn.frame(k)
    assert np.array_equal(in_turn.frame(5).h0, alone.frame(5).h0)
    assert not np.array_equal(alone.frame(5).h0, alone.frame(6).h0)


def test_impulses_replace_single_samples():
    """alpha = 1, beta = 0 is Cauchy: half of the impulses are beyond the scale of 100 standard deviations."""
    quiet = replace(QUIET, pingers=())
    calm = with_array(quiet, noise_std=0.01)
    impulses = Impulses(fraction=0.05, alpha=1.0, beta=0.0, scale=100.0, location=0.0)
    heard, before = (HydrophoneSource(s).frame(0).h0 for s in (with_array(calm, impulses=impulses), calm))
    n = before.size
    assert np.mean(heard != before) == pytest.approx(0.05, abs=5 * np.sqrt(0.05 / n))
    assert np.mean(np.abs(heard) > 1.0) == pytest.approx(0.025, abs=5 * np.sqrt(0.025 / n))


def test_pulses_run_on_across_frames():
    """The same second in frames of 0.1 s and of 0.025 s."""
    long = HydrophoneSource(with_array(QUIET, frame_length=0.1))
    short = HydrophoneSource(with_array(QUIET, frame_length=0.025))
    joined = np.concatenate([short.frame(k).h1 for k in range(40)])
    assert joined == pytest.approx(np.concatenate([long.frame(k).h1 for k in range(10)]), abs=1e-5)


def test_the_delay_between_the_hydrophones_is_that_of_the_geometry():
    """Cross-correlation of the noiseless direct path of one pinger, against positions at the time of arrival."""
    scenario = with_array(one_path(QUIET), sample_rate=1e6, array_yaw=0.4)
    source, k = HydrophoneSource(scenario), 3
    frame = source.frame(k)
    arrival = k * 0.1 + np.flatnonzero(frame.h0)[0] / 1e6
    spectrum = np.fft.rfft(frame.h0, 200_000) * np.fft.rfft(frame.h1, 200_000).conj()
    lags = np.fft.irfft(spectrum)
    best = int(np.argmax(lags))
    motion, pinger = Trajectory(scenario.vehicle).at(arrival), scenario.pingers[0]
    ahead = np.array([pinger.x, pinger.y]) - motion.positions[:2, 0]
    bearing = wrap_angle(np.arctan2(ahead[1], ahead[0]) - motion.yaw[0] - 0.4)
    tdoa = 0.6 * np.cos(bearing) / float(SoundSpeed(scenario).at(arrival))
    assert (best if best < 100_000 else best - 200_000) / 1e6 == pytest.approx(tdoa, abs=1.5e-6)


def test_the_converter_scales_and_clips():
    source = HydrophoneSource(with_array(SCENARIO, full_scale=1.0))
    frame, info = source.frame(3), next(source.events())[2]
    exact = HydrophoneSource(with_array(SCENARIO, format="float32", full_scale=1e6)).frame(3)
    assert frame.h0.dtype == np.int16
    assert frame.h0.max() == 32767
    assert frame.h0.min() == -32767
    assert frame.h0 * info.scale == pytest.approx(np.clip(exact.h0, -1.0, 1.0), abs=info.scale)


def test_the_level_falls_with_the_distance():
    source = HydrophoneSource(one_path(QUIET))
    distance = np.linalg.norm(np.array([20.0, 17.0, -15.5]) - source.positions(np.array([0.35]), np.array([0]))[:, 0])
    assert np.abs(source.frame(3).h0).max() == pytest.approx(100.0 / distance, rel=0.02)


def test_the_second_channel_lags_by_its_delay_and_has_its_gain():
    """A delay of 10 samples is the same sound 10 samples later; the first channel does not change."""
    plain = HydrophoneSource(QUIET).frame(3)
    array = with_array(QUIET, channel_delay=1e-4, channel_gain_db=-3.0)
    frame = HydrophoneSource(array).frame(3)
    assert np.array_equal(frame.h0, plain.h0)
    assert frame.h1[10:] == pytest.approx(10 ** (-3 / 20) * plain.h1[:-10], abs=1e-4)


def test_noise_and_snaps_are_heard_and_belong_to_the_frame():
    silent = replace(QUIET, pingers=())
    assert not HydrophoneSource(silent).frame(2).h0.any()
    for change in ({"ambient_level": 90.0}, {"snap_rate": 1000.0}):
        source = HydrophoneSource(replace(silent, environment=replace(silent.environment, **change)))
        assert source.frame(2).h0.any()
        assert np.array_equal(source.frame(2).h0, source.frame(2).h0)
        assert not np.array_equal(source.frame(2).h0, source.frame(3).h0)


def test_every_noise_pulse_is_its_own_and_the_same_each_time():
    scenario = one_path(QUIET)
    (pinger,) = scenario.pingers
    noisy = replace(scenario, pingers=(replace(pinger, pulse="noise", offset=0.0),), vehicle=SCENARIO.vehicle)
    long, short = HydrophoneSource(noisy), HydrophoneSource(with_array(noisy, frame_length=0.025))
    frame = long.frame(4).h0
    assert np.concatenate([short.frame(k).h0 for k in range(16, 20)]) == pytest.approx(frame, abs=1e-5)
    assert abs(np.corrcoef(frame, long.frame(5).h0)[0, 1]) < 0.3  # of about 120 independent values


def test_a_vehicle_is_needed():
    with pytest.raises(ValueError, match="scenario: key 'vehicle' is missing"):
        HydrophoneSource(Scenario())
