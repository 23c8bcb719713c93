"""A second pass of EKF-SLAM: exact where the track is linear, honest with a bad gyro, bounded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slam_runs import BOAT, PINGERS, SCENARIO, config, errors, feed, measurements

from uw_acoustic_loc.core.slam import relinearise as slam_passes
from uw_acoustic_loc.core.slam.filter import Slam
from uw_acoustic_loc.core.slam.inertial import SIZE
from uw_acoustic_loc.core.slam.relinearise import Pass, SlamPasses
from uw_acoustic_loc.core.types import Imu
from uw_acoustic_loc.sim.scenario import Scenario

Event = tuple[int, str, object]


def with_bias(bias: float, seed: int) -> tuple[Scenario, list[Event]]:
    """A run whose yaw gyro has this bias in rad/s."""
    scenario = replace(SCENARIO, vehicle=replace(BOAT, gyro_bias_std=0.0), seed=seed)
    events = measurements(scenario)
    turned = np.array([0.0, 0.0, bias])
    biased = [(t, n, replace(v, angular=v.angular + turned) if n == "imu/data" else v) for t, n, v in events]
    return scenario, biased


@pytest.mark.parametrize("walk", [1e-5, 1e-3])
def test_where_the_track_is_linear_the_point_of_linearisation_does_not_matter(walk):
    events, moving = measurements(replace(SCENARIO, duration=4.0), pingers={}), config(gyro_bias_walk=walk)
    there, here = Pass(moving, 1e-4), Slam(moving)
    feed(there.slam, events)
    feed(here, events)
    assert np.abs(there.slam.joint.mean[:SIZE] - here.joint.mean).max() > 1e-4
    there.restore_prior()
    np.testing.assert_allclose(there.slam.joint.mean, here.joint.mean, atol=2e-6)
    np.testing.assert_allclose(there.slam.joint.cov, here.joint.cov, atol=1e-7)


def test_a_gyro_bias_of_three_sigma_does_not_change_the_result():
    """With the same noise and the opposite bias, pingers end at the same place; after one pass alone 0.5 m apart."""
    ends = []
    for bias in (6e-3, -6e-3):
        scenario, events = with_bias(bias, 5)
        passes = SlamPasses(config())
        feed(passes, events)
        assert passes.linearised_at == pytest.approx(bias, abs=1e-3)
        ends.append(passes.slam)
        assert max(distance for distance, _ in errors(passes.slam, scenario).values()) < 0.8
    for name in PINGERS:
        one, other = (slam.position(name) for slam in ends)
        assert one is not None and other is not None
        np.testing.assert_allclose(one.mean, other.mean, atol=0.05)
        np.testing.assert_allclose(one.cov, other.cov, rtol=0.1)


def test_a_pass_that_has_caught_up_is_one_from_the_start():
    """Bit for bit, with the measurements that came while it was under way."""
    scenario, events = with_bias(6e-3, 5)
    passes, taken = SlamPasses(config()), 0
    while passes.linearised_at == 0:
        feed(passes, events[taken : taken + 1])
        taken += 1
    alone = Pass(config(), passes.linearised_at)
    feed(alone.slam, events[:taken])
    alone.restore_prior()
    np.testing.assert_array_equal(passes.slam.joint.mean, alone.slam.joint.mean)
    np.testing.assert_array_equal(passes.slam.joint.cov, alone.slam.joint.cov)
    assert 20.0 < (events[taken][0] - scenario.start_ns) * 1e-9 < 80.0


def test_no_pass_goes_through_what_is_forgotten(monkeypatch):
    """Neither what is older than the memory nor what was heard under another configuration."""
    _, events = with_bias(6e-3, 5)
    soon = [e for e in events if e[0] < events[0][0] + 70_000_000_000]
    reconfigured = SlamPasses(config())
    feed(reconfigured, soon[: len(soon) // 4])
    reconfigured.change(config(gate_sigma=6.0))
    feed(reconfigured, soon[len(soon) // 4 :])
    monkeypatch.setattr(slam_passes, "_MEMORY_NS", 10_000_000_000)
    forgetful = SlamPasses(config())
    feed(forgetful, soon)
    assert reconfigured.linearised_at == forgetful.linearised_at == 0
    assert reconfigured.slam.config.gate_sigma == 6.0


@pytest.mark.parametrize("bias", [5e-3, -6e-3])
def test_lines_of_both_sides_that_a_bias_bends_begin_a_pass(bias):
    """They wait for the turn, after 100 s, and do not meet then; only they tell of the bias."""
    scenario, events = with_bias(bias, 8)
    passes = SlamPasses(config(mirror=True))
    feed(passes, events)
    assert passes.linearised_at == pytest.approx(bias, abs=2e-3)
    for distance, nees in errors(passes.slam, scenario).values():
        assert distance < 1.0
        assert nees < 5.3  # chi-square, 2 degrees of freedom: beyond once in 200


def test_a_pass_that_does_not_know_the_bias_does_not_take_over():
    _, events = with_bias(0.0, 5)
    soon = [e for e in events if e[0] < events[0][0] + 60_000_000_000]
    wrong, alone = SlamPasses(config(mirror=True)), Slam(config(mirror=True))
    feed(wrong, soon[: len(soon) // 2])
    wrong._again, wrong._unknown = Pass(config(mirror=True), 6e-3), 30.0
    feed(wrong, soon[len(soon) // 2 :])
    feed(alone, soon)
    assert wrong._next == len(wrong._past) and wrong.linearised_at == 0
    np.testing.assert_array_equal(wrong.slam.joint.mean, alone.joint.mean)


def test_a_refused_measurement_is_not_remembered():
    passes, level = SlamPasses(config()), np.array([0.0, 0.0, 9.81])
    passes.take(Imu(1_000_000_000, np.zeros(3), level))
    with pytest.raises(ValueError, match="must come after"):
        passes.take(Imu(1_000_000_000, np.zeros(3), level))
    assert len(passes._past) == 1
