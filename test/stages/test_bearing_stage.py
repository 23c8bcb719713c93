from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.contract import Status
from uw_acoustic_loc.core.bearing import BearingConfig
from uw_acoustic_loc.core.geometry import quat_from_yaw, wrap_angles
from uw_acoustic_loc.core.types import Odometry, Samples
from uw_acoustic_loc.sim.hydrophones import HydrophoneSource
from uw_acoustic_loc.sim.scenario import load_scenario
from uw_acoustic_loc.sim.trajectory import Trajectory
from uw_acoustic_loc.stages.bearing import BearingStage

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
            push(stage, "odometry", odometry(value.t_ns))
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
        assert np.mean(np.abs(errors) > np.radians(5.0)) < 0.01
        assert 0.25 < normalised.mean() < 2.0
    status = stage.status()
    assert status.level == Status.OK
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
    assert stage.status().message == "not heard for 5 s: x"
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
