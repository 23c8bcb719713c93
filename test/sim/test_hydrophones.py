from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.core.geometry import wrap_angle
from uw_acoustic_loc.sim.environment import SoundSpeed
from uw_acoustic_loc.sim.hydrophones import HydrophoneSource
from uw_acoustic_loc.sim.scenario import Scenario, load_scenario
from uw_acoustic_loc.sim.trajectory import Trajectory

SCENARIO = replace(load_scenario(Path(__file__).parents[2] / "config/harbour/scenario.yaml"), duration=1.0)


def with_array(**changes):
    return replace(SCENARIO, hydrophones=replace(SCENARIO.hydrophones, **changes))


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


def test_pulses_run_on_across_frames():
    """The same second in frames of 0.1 s and of 0.025 s."""
    quiet = {"noise_std": 0.0, "format": "float32"}
    long = HydrophoneSource(with_array(frame_length=0.1, **quiet))
    short = HydrophoneSource(with_array(frame_length=0.025, **quiet))
    joined = np.concatenate([short.frame(k).h1 for k in range(40)])
    assert joined == pytest.approx(np.concatenate([long.frame(k).h1 for k in range(10)]), abs=1e-5)


def test_the_delay_between_the_hydrophones_is_that_of_the_geometry():
    """Cross-correlation of the noiseless direct path of one pinger, against positions at the time of arrival."""
    environment = replace(SCENARIO.environment, surface_reflection=0.0, bottom_reflection=0.0)
    array = replace(SCENARIO.hydrophones, noise_std=0.0, format="float32", sample_rate=1e6, array_yaw=0.4)
    scenario = replace(SCENARIO, environment=environment, hydrophones=array, pingers=SCENARIO.pingers[:1])
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
    source = HydrophoneSource(with_array(full_scale=1.0))
    frame, info = source.frame(3), next(source.events())[2]
    exact = HydrophoneSource(with_array(format="float32", full_scale=1e6)).frame(3)
    assert frame.h0.dtype == np.int16
    assert frame.h0.max() == 32767
    assert frame.h0.min() == -32767
    assert frame.h0 * info.scale == pytest.approx(np.clip(exact.h0, -1.0, 1.0), abs=info.scale)


def test_the_level_falls_with_the_distance():
    quiet = replace(with_array(noise_std=0.0, format="float32"), pingers=SCENARIO.pingers[:1])
    still = replace(quiet, environment=replace(quiet.environment, surface_reflection=0.0, bottom_reflection=0.0))
    source = HydrophoneSource(still)
    distance = np.linalg.norm(np.array([20.0, 17.0, -15.5]) - source.positions(np.array([0.35]), np.array([0]))[:, 0])
    assert np.abs(source.frame(3).h0).max() == pytest.approx(100.0 / distance, rel=0.02)


def test_a_vehicle_is_needed():
    with pytest.raises(ValueError, match="scenario: key 'vehicle' is missing"):
        HydrophoneSource(Scenario())
