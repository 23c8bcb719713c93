import dataclasses
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.core.multistatic.estimator import METHODS
from uw_acoustic_loc.core.multistatic.fusion import MultistaticConfig
from uw_acoustic_loc.sim.scenario import Target, Turn, load_scenario
from uw_acoustic_loc.sim.sonar import SonarSource
from uw_acoustic_loc.stages.multistatic_fusion import MultistaticFusionStage

HARBOUR = load_scenario(Path(__file__).parents[2] / "config/harbour/scenario.yaml")
SEEDS = range(16)
INTRUDER = HARBOUR.sonar.targets[0]


@dataclasses.dataclass
class Run:
    stage: MultistaticFusionStage
    truth: dict
    out: list
    nees: list  # of the tracks' positions, divided by 2, with the stage's own covariances

    def errors(self, topic):
        """Distance (n,) in m to the nearest true target of every fix or track."""
        found = []
        for name, value in self.out:
            rows = [value.position[:2]] if name == "sonar/fix" else list(zip(value.x, value.y, strict=True))
            if name == topic:
                found += [np.linalg.norm(self._targets(value) - row, axis=1).min() for row in rows]
        return np.array(found)

    def _targets(self, value):
        truth = self.truth[value.t_ns]
        return np.stack([truth.x, truth.y], axis=1)

    def fix_nees(self):
        found = []
        for name, fix in self.out:
            if name == "sonar/fix":
                error = fix.position[:2] - self._targets(fix)[0]
                found.append(error @ np.linalg.solve(fix.cov[:2, :2], error) / 2)
        return found

    @property
    def ids(self):
        return {int(i) for name, value in self.out if name == "sonar/tracks" for i in value.id}


def run(seed, config=MultistaticConfig(), **sonar):  # noqa: B008  frozen
    story = dataclasses.replace(HARBOUR, seed=seed, sonar=dataclasses.replace(HARBOUR.sonar, **sonar))
    result = Run(MultistaticFusionStage(config), {}, [], [])
    handlers = {i.topic: i.handle for i in result.stage.inputs}
    for _, topic, value in SonarSource(story).events():
        if topic.startswith("/truth"):
            result.truth[value.t_ns] = value
            continue
        result.out += list(handlers[topic](value))
        if topic == "sonar/detections":
            for track in result.stage._tracker.confirmed:
                error = track.mean[:2] - result._targets(value)[0]
                result.nees.append(error @ np.linalg.solve(track.cov[:2, :2], error) / 2)
    return result


@pytest.fixture(scope="module")
def runs():
    return [run(seed) for seed in SEEDS]


# --- the harbour's intruder -----------------------------------------------------------------------------------------


def test_fixes_and_tracks_find_the_intruder(runs):
    fixes = np.concatenate([r.errors("sonar/fix") for r in runs])
    tracks = np.concatenate([r.errors("sonar/tracks") for r in runs])
    assert max(np.median(r.errors("sonar/fix")) for r in runs) < 100
    assert np.median(fixes) < 40
    assert np.sqrt(np.mean(tracks**2)) < 0.7 * np.sqrt(np.mean(fixes**2))
    assert all(r.ids == {1} for r in runs)
    assert min(r.errors("sonar/tracks").size for r in runs) >= 25


def test_fixes_and_tracks_are_honest(runs):
    assert 0.5 < np.mean([n for r in runs for n in r.fix_nees()]) < 1.6
    assert 0.5 < np.mean([n for r in runs for n in r.nees]) < 1.6
    values = [r.stage.status().values for r in runs]
    nis = sum(v["nis_mean"] * v["nis_count"] for v in values) / sum(v["nis_count"] for v in values)
    assert 1.0 < nis < 2.5  # 2 is expected of a target that moves as much as process_noise allows; this one does not


def test_a_track_knows_the_velocity(runs):
    last = [[v for name, v in r.out if name == "sonar/tracks"][-1] for r in runs]
    velocities = np.array([(t.vx[0], t.vy[0]) for t in last])
    np.testing.assert_allclose(velocities.mean(axis=0), [-5, 1], atol=0.3)
    assert velocities.std(axis=0).max() < 1.0


@pytest.mark.parametrize("method", METHODS)
def test_every_method_tracks(method):
    result = run(1, MultistaticConfig(method=method))
    assert result.ids == {1}
    assert np.median(result.errors("sonar/fix")) < 100


def test_gaussian_ranges_are_found_with_gaussian_noise_and_biased_with_the_wrong_one():
    def mean_error(kind):
        results = [run(seed, MultistaticConfig(range_noise=kind), range_noise="gaussian") for seed in range(5)]
        return np.concatenate([r.errors("sonar/tracks") for r in results]).mean()

    right, wrong = mean_error("gaussian"), mean_error("rayleigh")
    assert right < 20
    assert wrong > 1.5 * right


def test_false_alarms_and_misses_do_not_make_or_break_tracks():
    results = [run(seed, false_alarms=1.0, miss_fraction=0.2) for seed in SEEDS]
    assert all(1 in r.ids for r in results)
    assert sum(len(r.ids) for r in results) <= len(results) + 1
    errors = np.concatenate([r.errors("sonar/tracks") for r in results])
    assert np.sqrt(np.mean(errors**2)) < 40
    assert np.median(np.concatenate([r.errors("sonar/fix") for r in results])) < 40


def test_three_targets_have_three_tracks():
    targets = (INTRUDER, Target(2, -1500.0, 1500.0, -10.0, 3.0, -4.0), Target(3, 100.0, -2500.0, -10.0, 0.0, 4.0))
    for seed in range(5):
        result = run(seed, targets=targets, false_alarms=0.5, miss_fraction=0.1)
        assert result.ids == {1, 2, 3}
        assert np.sqrt(np.mean(result.errors("sonar/tracks") ** 2)) < 40


def test_a_fast_targets_track_is_where_it_was_at_the_stamp():
    fast = Target(1, 3500.0, -1500.0, -10.0, -5.0, 20.0)
    results = [run(seed, MultistaticConfig(speed_std=15.0), targets=(fast,)) for seed in range(10)]
    late = np.mean([n for r in results for n in r.nees[5:]])
    assert late < 1.6  # 20 m/s for 2.5 s of travel time would be 50 m


def test_a_simulated_target_that_turns_is_held_and_its_covariance_is_honest():
    turns = (Turn(30.0, 0.02), Turn(80.0, -0.02))
    results = [run(seed, targets=(Target(1, 1500.0, 2500.0, -10.0, 7.0, -3.0, turns),)) for seed in SEEDS]
    assert all(r.ids == {1} for r in results)
    assert np.median(np.concatenate([r.errors("sonar/tracks") for r in results])) < 40
    assert 0.6 < np.mean([n for r in results for n in r.nees]) < 1.6


# --- the messages ---------------------------------------------------------------------------------------------------


def test_outputs_bear_the_pings_stamp_and_have_no_nan():
    result = run(3, false_alarms=1.0, miss_fraction=0.5)
    stamps = set(result.truth)
    for _, value in result.out:
        assert value.t_ns in stamps
        assert value.frame_id == "map"
        assert all(np.isfinite(np.asarray(c, dtype=float)).all() for n, c in vars(value).items() if n != "frame_id")
    fix = next(value for name, value in result.out if name == "sonar/fix")
    assert fix.position[2] == -10
    assert fix.cov[2, 2] == -1
    assert sum(name == "sonar/tracks" for name, _ in result.out) == result.stage.status().values["pings"]


def test_the_same_input_gives_the_same_output():
    def content(result):
        return [[name, *(np.asarray(c).tobytes() for c in vars(value).values())] for name, value in result.out]

    story = {"false_alarms": 1.0, "miss_fraction": 0.2}
    assert content(run(4, **story)) == content(run(4, **story))
