import dataclasses
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.contract import Status
from uw_acoustic_loc.core.mooring.estimator import MooringConfig
from uw_acoustic_loc.core.types import Odometry, Point
from uw_acoustic_loc.sim.buoys import BuoySource
from uw_acoustic_loc.sim.scenario import Scenario, load_scenario
from uw_acoustic_loc.stages.mooring_tracker import MooringTrackerStage

HARBOUR = load_scenario(Path(__file__).parents[2] / "config/harbour/scenario.yaml")
CONFIG = MooringConfig()


def offsets(scenario: Scenario = HARBOUR) -> list[Point]:
    return [v for _, t, v in BuoySource(scenario).events() if t == "mooring/buoy1/offset"]


def run(config: MooringConfig, measured: list[Point]) -> tuple[MooringTrackerStage, list[Odometry]]:
    stage = MooringTrackerStage(config)
    return stage, [value for point in measured for _, value in stage.inputs[0].handle(point)]


def point(seconds: float, offset: float) -> Point:
    return Point(HARBOUR.t_ns(seconds), np.array([offset, 0.0, 0.0]))


def test_harbour() -> None:
    ours, raw, nees = [], [], []
    for seed in range(1, 6):
        scenario = dataclasses.replace(HARBOUR, seed=seed)
        truth = [v for _, t, v in BuoySource(scenario).events() if t == "/truth/mooring/buoy1/odometry"]
        measured = offsets(scenario)
        _, found = run(CONFIG, measured)
        assert [f.t_ns for f in found] == [t.t_ns for t in truth]
        error = np.array([f.position[0] - t.position[0] for f, t in zip(found, truth, strict=True)])
        ours.append(error.std())
        raw.append(np.std([m.position[0] - t.position[0] for m, t in zip(measured, truth, strict=True)]))
        nees.append(np.mean(np.square(error) / [f.pose_cov[0, 0] for f in found]))
    assert np.all(np.array(ours) < 0.5 * np.array(raw))
    assert 0.7 < np.mean(nees) < 1.4


def test_only_x_is_estimated() -> None:
    (found,) = run(CONFIG, [point(0.0, 1.5)])[1]
    assert (found.frame_id, found.child_frame_id) == ("map", "mooring/buoy1")
    assert found.position[1:].tolist() == [0, 0]
    for cov in (found.pose_cov, found.twist_cov):
        assert 0 < cov[0, 0] < 10
        assert np.all(np.diag(cov)[1:] >= 1e6)


@pytest.mark.parametrize("name", ["particle", "kalman", "kalman_gated"])
def test_missed_measurements_widen_the_estimate(name: str) -> None:
    config = dataclasses.replace(CONFIG, filter=name, particles=5000)
    measured = offsets()
    whole, gap = run(config, measured)[1], run(config, [*measured[:100], measured[120]])[1]
    assert gap[-1].t_ns == whole[120].t_ns
    assert gap[-1].pose_cov[0, 0] > whole[120].pose_cov[0, 0]
    assert gap[-1].position[0] == pytest.approx(whole[120].position[0], abs=1.0)


def test_each_mooring_has_its_own_filter() -> None:
    stage = MooringTrackerStage(dataclasses.replace(CONFIG, mooring_ids=("a", "b")))
    assert [i.topic for i in stage.inputs] == ["mooring/a/offset", "mooring/b/offset"]
    assert [o.topic for o in stage.outputs] == ["mooring/a/odometry", "mooring/b/odometry"]
    ((topic, _),) = stage.inputs[1].handle(point(0.0, 1.0))
    assert topic == "mooring/b/odometry"
    status = stage.status()
    assert (status.level, status.message) == (Status.WARN, "no offset yet of a")
    list(stage.inputs[0].handle(point(0.0, 1.0)))
    assert stage.status().level == Status.OK


@pytest.mark.parametrize(
    ("second", "sentence"),
    [
        (point(1.0, np.nan), "offset of mooring buoy1 must be finite, got nan"),
        (point(0.5, 1.0), "must be newer than the last one, got -0.5 s"),
        (point(1.0, 1.0), "must be newer than the last one, got 0.0 s"),
    ],
)
def test_what_cannot_be_used_is_refused_and_leaves_no_trace(second: Point, sentence: str) -> None:
    stage, _ = run(CONFIG, [point(1.0, 1.5)])
    with pytest.raises(ValueError, match=sentence):
        list(stage.inputs[0].handle(second))
    ((_, after),) = stage.inputs[0].handle(point(1.5, 1.2))
    assert after.position.tobytes() == run(CONFIG, [point(1.0, 1.5), point(1.5, 1.2)])[1][-1].position.tobytes()


def test_an_absurd_measurement_changes_nothing() -> None:
    measured = offsets()[:60]
    _, calm = run(CONFIG, measured)
    _, hit = run(CONFIG, [*measured[:-1], dataclasses.replace(measured[-1], position=np.array([1e7, 0.0, 0.0]))])
    assert hit[-1].position[0] == pytest.approx(calm[-1].position[0], abs=0.5)
    assert np.isfinite(hit[-1].pose_cov).all()


def test_a_filter_that_left_its_prior_publishes_nothing_and_restarts() -> None:
    config = dataclasses.replace(CONFIG, filter="kalman")
    stage, _ = run(config, offsets()[:60])
    with pytest.raises(ValueError, match=r"within max_offset 1000 m, 1e\+07 m put it at \d.* m: it restarts"):
        list(stage.inputs[0].handle(point(31.0, 1e7)))
    ((_, after),) = stage.inputs[0].handle(point(31.5, 1.0))
    assert abs(after.position[0]) < 2.0
    assert stage.status().values["buoy1.restarts"] == 1


@pytest.mark.parametrize("name", ["particle", "kalman", "kalman_gated"])
def test_whatever_is_measured_between_silences_nothing_beyond_the_prior_leaves(name: str) -> None:
    rng = np.random.default_rng(21)
    for _ in range(5):
        stage, t = MooringTrackerStage(dataclasses.replace(CONFIG, filter=name)), 0.0
        for _ in range(200):
            t += rng.uniform(10.0, 300.0) if rng.random() < 0.1 else 0.5
            offset = float(rng.standard_cauchy() * 10.0 ** rng.uniform(0, 6))
            try:
                ((_, odometry),) = stage.inputs[0].handle(point(t, offset))
            except ValueError:
                continue
            assert abs(odometry.position[0]) <= CONFIG.max_offset
            assert 0 < odometry.pose_cov[0, 0] < 1e4
            assert 0 < odometry.twist_cov[0, 0] < 1e4


def test_the_gate_can_be_changed() -> None:
    stage, _ = run(dataclasses.replace(CONFIG, filter="kalman_gated"), offsets()[:50])
    before = int(stage.status().values["buoy1.gated"])
    assert before > 0
    stage.change(dataclasses.replace(CONFIG, filter="kalman_gated", gate_sigma=1000.0))
    for measured in offsets()[50:]:
        list(stage.inputs[0].handle(measured))
    assert int(stage.status().values["buoy1.gated"]) == before


def test_learnt_noise_is_told() -> None:
    stage, found = run(dataclasses.replace(CONFIG, noise="learnt", measurement_std=1.0), offsets())
    values = stage.status().values
    assert float(values["buoy1.noise_std_m"]) == pytest.approx(0.5, rel=0.25)
    assert float(values["buoy1.impulse_fraction"]) == pytest.approx(0.3, abs=0.15)
    assert "buoy1.noise_std_m" not in run(CONFIG, offsets()[:2])[0].status().values
    assert np.isfinite([f.pose_cov[0, 0] for f in found]).all()


def test_the_noise_can_be_changed() -> None:
    """With a wider noise the same measurements move the estimate less."""

    def after(measurement_std: float) -> float:
        stage, _ = run(CONFIG, offsets()[:50])
        stage.change(dataclasses.replace(CONFIG, measurement_std=measurement_std))
        shifted = [point(25.0 + 0.5 * k, 1.3) for k in range(4)]
        return float([v for p in shifted for _, v in stage.inputs[0].handle(p)][-1].position[0])

    assert after(5.0) < after(0.5) - 0.02


def test_seed_decides_every_bit() -> None:
    first, again = (run(CONFIG, offsets()[:20])[1][-1].position.tobytes() for _ in range(2))
    other = run(dataclasses.replace(CONFIG, seed=2), offsets()[:20])[1][-1].position.tobytes()
    assert first == again != other
