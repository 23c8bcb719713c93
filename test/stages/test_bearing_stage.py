from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.contract import Status
from uw_acoustic_loc.core.bearing.config import BearingConfig
from uw_acoustic_loc.core.geometry import quat_from_yaw, wrap_angles
from uw_acoustic_loc.core.types import Odometry, Samples
from uw_acoustic_loc.sim.hydrophones import HydrophoneSource
from uw_acoustic_loc.sim.scenario import load_scenario
from uw_acoustic_loc.sim.trajectory import Trajectory
from uw_acoustic_loc.stages.bearing import BearingStage
from uw_acoustic_loc.stages.runner import Runner

SCENARIO = load_scenario(Path(__file__).parents[2] / "config/harbour/scenario.yaml")
TRAJECTORY = Trajectory(SCENARIO.vehicle)


@pytest.fixture(scope="module")
def heard():
    return [(topic, value) for _, topic, value in HydrophoneSource(SCENARIO).events() if topic.startswith("hydro")]


def push(stage, topic, value):
    (handle,) = (i.handle for i in stage.inputs if i.topic == topic)
    return list(handle(value))


def odometry(t_ns):
    motion = TRAJECTORY.at((t_ns - SCENARIO.start_ns) * 1e-9)
    linear, angular = np.array([motion.speed[0], 0, 0]), np.array([0, 0, motion.yaw_rate[0]])
    return Odometry(t_ns, motion.positions[:, 0], quat_from_yaw(float(motion.yaw[0])), linear, angular)


def run(stage, heard):
    published = []
    for topic, value in heard:
        if topic == "hydrophones/samples":
            for ms in (0, 50, 100):
                push(stage, "odometry", odometry(value.t_ns + ms * 1_000_000))
        published += push(stage, topic, value)
    return published


@pytest.mark.parametrize("filter_", ["particle", "histogram"])
def test_the_harbour_is_heard(heard, filter_):
    stage = BearingStage(BearingConfig(filter=filter_))
    published = run(stage, heard)
    assert {topic for topic, _ in published} <= {o.topic for o in stage.outputs}
    for p in SCENARIO.pingers:
        found = [value for topic, value in published if topic == f"sources/{p.id}/bearing"]
        motion = TRAJECTORY.at(np.array([(b.t_ns - SCENARIO.start_ns) * 1e-9 for b in found]))
        true = np.arctan2(p.y - motion.positions[1], p.x - motion.positions[0]) - motion.yaw
        errors = wrap_angles(np.array([b.bearing for b in found]) - true)
        normalised = errors**2 / np.array([b.variance for b in found])
        assert len(found) > 0.99 * 10 * SCENARIO.duration
        assert np.degrees(np.median(np.abs(errors))) < 0.2
        assert np.degrees(np.max(np.abs(errors))) < 0.6, "corners included"
        assert 0.25 < normalised.mean() < 2.0
        assert stage.status().values[f"{p.id}.period_s"] == pytest.approx(p.period, rel=0.05)
    status = stage.status()
    assert status.level == Status.OK
    assert status.values["a.echoes"] > 500, "over the seabed, on every ping"
    assert status.values["a.rate_hz"] == pytest.approx(10.0, abs=0.1)
    assert status.values["a.snr_db"] > 20.0


def test_particles_are_shown_at_most_twice_a_second(heard):
    stage = BearingStage(BearingConfig())
    clouds = [value for topic, value in run(stage, heard[:51]) if topic == "sources/a/particles"]
    assert np.all(np.diff([c.t_ns for c in clouds]) >= 500_000_000)
    assert len(clouds) >= 8
    assert max(c.x.size for c in clouds) <= 200


def test_status_says_what_is_missing(heard):
    stage = BearingStage(BearingConfig(source_ids=("a", "x"), band_low=(18e3, 2e3), band_high=(24e3, 8e3)))
    assert stage.status().level == Status.WARN
    assert "hydrophones/info" in stage.status().message
    run(stage, heard[:70])
    assert stage.status().level == Status.WARN
    assert "not heard for 5 s: x" in stage.status().message
    assert stage.status().values["x.pings"] == 0


def test_a_refused_frame_leaves_nothing_behind(heard):
    clean, disturbed = BearingStage(BearingConfig()), BearingStage(BearingConfig())
    expected = run(clean, heard[:8])
    published = run(disturbed, heard[:4])
    bad = heard[4][1]
    with pytest.raises(ValueError, match="samples h0 and h1 must be two"):
        push(disturbed, "hydrophones/samples", Samples(bad.t_ns, bad.h0, bad.h1[:-1]))
    published += run(disturbed, heard[4:8])
    assert [(t, v.t_ns) for t, v in published] == [(t, v.t_ns) for t, v in expected]
    assert published[-1][1].bearing == expected[-1][1].bearing


def test_samples_need_the_info(heard):
    with pytest.raises(ValueError, match="hydrophones/info must come before hydrophones/samples"):
        push(BearingStage(BearingConfig()), *heard[1])


def altered(value, h0=None, h1=None, delay_ns=0):
    return Samples(value.t_ns + delay_ns, value.h0 if h0 is None else h0, value.h1 if h1 is None else h1)


def told(heard, change, count=30):
    """Status and number of bearings after frames of which `change` makes something else (None = lost)."""
    stage = BearingStage(BearingConfig())
    published = run(stage, heard[:1])
    for k, (_, value) in enumerate(heard[1 : count + 1]):
        if (new := change(k, value)) is not None:
            published += run(stage, [("hydrophones/samples", new)])
    return stage.status(), len([t for t, _ in published if t.endswith("bearing")])


def test_lost_frames_are_counted(heard):
    status, _ = told(heard, lambda k, v: None if k in (7, 8, 15) else v)
    assert (status.values["gaps"], status.values["overlaps"]) == (2, 0)
    assert status.level == Status.OK


def test_an_overlapping_frame_is_counted(heard):
    status, _ = told(heard, lambda k, v: altered(v, delay_ns=-20_000_000) if k == 9 else v)
    assert (status.values["gaps"], status.values["overlaps"]) == (1, 1)


def test_a_repeated_frame_is_refused(heard):
    stage = BearingStage(BearingConfig())
    run(stage, heard[:6])
    with pytest.raises(ValueError, match="samples must begin after the frame before"):
        push(stage, *heard[5])
    assert stage.status().values["overlaps"] == 1


@pytest.mark.parametrize("which", ["h0", "h1"])
def test_clipping_warns_and_names_the_hydrophone(heard, which):
    def clipped(k, v):
        return altered(v, **{which: np.clip(getattr(v, which).astype(int) * 200, -32767, 32767).astype(np.int16)})

    status, _ = told(heard, clipped)
    assert status.level == Status.WARN
    assert f"hydrophone {which[1]} clips" in status.message
    assert status.values[f"{which}.full_scale"] > 100


@pytest.mark.parametrize("which", ["h0", "h1"])
def test_a_dead_channel_warns_and_gives_no_bearings(heard, which):
    status, count = told(heard, lambda k, v: altered(v, **{which: np.full_like(v.h0, 3)}))
    assert status.level == Status.WARN
    assert f"hydrophone {which[1]} is dead" in status.message
    assert count == 0
    _, before_and_after = told(heard, lambda k, v: altered(v, **{which: 0 * v.h0}) if 10 <= k < 15 else v)
    assert before_and_after > 3 * 20


def test_a_wrong_rate_warns_with_both_numbers(heard):
    status, _ = told(heard, lambda k, v: altered(v, delay_ns=k * 1_000_000))
    assert status.level == Status.WARN
    assert "sample_rate is 100000 Hz by hydrophones/info and 99009.9 Hz by the frames' stamps" in status.message


def test_float_samples_give_the_same_bearings(heard):
    scale = heard[0][1].scale
    as_pressure = [(t, altered(v, v.h0 * np.float32(scale), v.h1 * np.float32(scale))) for t, v in heard[1:30]]
    counts, floats = (run(BearingStage(BearingConfig()), [heard[0], *frames]) for frames in (heard[1:30], as_pressure))
    assert len(counts) == len(floats)
    for (topic, a), (_, b) in zip(counts, floats, strict=True):
        if topic.endswith("bearing"):
            assert b.bearing == pytest.approx(a.bearing, abs=1e-3)


def test_a_frame_with_nan_is_refused_and_the_next_is_used(heard):
    stage, bad = BearingStage(BearingConfig()), heard[5][1]
    run(stage, heard[:5])
    with pytest.raises(ValueError, match="samples h1 must be finite, got 1 that are not"):
        push(stage, "hydrophones/samples", altered(bad, bad.h0 * 1.0, np.where(np.arange(10_000) == 5, np.nan, bad.h1)))
    published = run(stage, heard[6:8])
    assert len(published) >= 3
    assert all(np.isfinite(v.bearing) for t, v in published if t.endswith("bearing"))
    assert stage.status().values["gaps"] == 1


def test_the_odometry_up_to_a_frames_end_comes_before_it(heard):
    """Or the vehicle's turn during the frame would be unknown."""
    seen, stage = [], BearingStage(BearingConfig())
    runner = Runner(lambda: stage, 0.5, lambda refusal: seen.append(refusal.sentence))
    list(runner.push(*heard[0]))
    for k in range(20):
        t_ns = heard[1 + k][1].t_ns
        list(runner.push("hydrophones/samples", heard[1 + k][1]))
        for ms in (0, 50):
            list(runner.push("odometry", odometry(t_ns + ms * 1_000_000)))
    assert seen == []
    step = stage._estimator._motion.between(stage._estimator.end_ns - 90_000_000, stage._estimator.end_ns)
    assert stage._estimator.frames == 19
    assert step.guessed == pytest.approx(0.0, abs=1e-9)
