import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.core.multistatic.estimator import Noise
from uw_acoustic_loc.core.types import NodePositions
from uw_acoustic_loc.sim.environment import SoundSpeed
from uw_acoustic_loc.sim.scenario import Impulses, Node, Scenario, Sonar, Target, Turn, load_scenario
from uw_acoustic_loc.sim.sonar import SonarSource
from uw_acoustic_loc.sim.targets import met_by_ping, states

HARBOUR = load_scenario(Path(__file__).parents[2] / "config/harbour/scenario.yaml")


def scenario(duration=120.0, seed=1, **sonar):
    return dataclasses.replace(HARBOUR, seed=seed, duration=duration, sonar=dataclasses.replace(HARBOUR.sonar, **sonar))


def events(story, topic):
    return [(t_ns, value) for t_ns, name, value in SonarSource(story).events() if name == topic]


def detections(story):
    return [value for _, value in events(story, "sonar/detections")]


def test_positions_come_first_and_time_never_runs_back():
    source = SonarSource(scenario(false_alarms=2.0))
    got = list(source.events())
    assert (got[0][0], got[0][1]) == (HARBOUR.start_ns, "sonar/positions")
    np.testing.assert_array_equal(got[0][2].role, [NodePositions.TRANSMITTER] + [NodePositions.RECEIVER] * 3)
    np.testing.assert_array_equal(got[0][2].positions[1], [2000, 0, -10])
    times = [t_ns for t_ns, _, _ in got]
    assert times == sorted(times)
    assert times[-1] <= HARBOUR.start_ns + 120_000_000_000
    stamps = [value.t_ns for _, name, value in got if name == "sonar/detections"]
    assert np.all(np.diff(stamps) == 4_000_000_000)
    assert {name for _, name, _ in got} == {output.topic for output in source.outputs}


def test_the_same_scenario_gives_the_same_events_and_another_seed_others():
    def content(source):
        return [(t_ns, name, [np.asarray(c).tobytes() for c in vars(v).values()]) for t_ns, name, v in source.events()]

    source = SonarSource(scenario(false_alarms=1.0, miss_fraction=0.2))
    first = content(source)
    assert first == content(source)
    assert first != content(SonarSource(scenario(seed=2, false_alarms=1.0, miss_fraction=0.2)))


def test_a_ping_meets_a_moving_target_where_both_are_at_once():
    start, velocity, speed = np.array([[2600.0, 1400.0, -30.0]]), np.array([[-25.0, 8.0, 0.0]]), 1480.0
    transmitter = np.array([100.0, 50.0, -10.0])
    met = met_by_ping(transmitter, 1, lambda delays: start + velocity * delays, speed)
    delay = np.linalg.norm(met - transmitter) / speed
    np.testing.assert_allclose(met, start + velocity * delay, atol=1e-9)


def test_noise_free_detections_are_exact_and_arrive_with_the_last_echo():
    story = scenario(range_std=1e-6, bearing_std=1e-9)
    receivers = {node.id: np.array([node.x, node.y, node.z]) for node in HARBOUR.sonar.receivers}
    target = HARBOUR.sonar.targets[0]
    for available, heard in events(story, "sonar/detections"):
        time = (heard.t_ns - story.start_ns) * 1e-9
        speed = float(SoundSpeed(story).at(time))
        velocity = np.array([[target.vx, target.vy, 0.0]])
        start = np.array([[target.x, target.y, target.z]]) + velocity * time
        (met,) = met_by_ping(np.array([0.0, 0.0, -10.0]), 1, lambda t: start + velocity * t, speed)  # noqa: B023
        for receiver, distance, bearing in zip(heard.receiver, heard.range, heard.bearing, strict=True):
            leg = met - receivers[int(receiver)]
            assert distance == pytest.approx(math.dist(met, (0, 0, -10)) + np.linalg.norm(leg), abs=1e-4)
            assert bearing == pytest.approx(math.atan2(leg[1], leg[0]), abs=1e-7)
        assert np.all(np.diff(heard.range) > 0)
        assert available == pytest.approx(heard.t_ns + heard.range[-1] / speed * 1e9, abs=2)


@pytest.mark.parametrize("kind", ["rayleigh", "gaussian"])
def test_noise_is_the_stated_one(kind):
    story = {"duration": 4000.0, "range_noise": kind, "targets": (Target(1, 2600.0, 1400.0, -10.0),)}
    noisy = detections(scenario(**story))
    exact = detections(scenario(**story | {"range_std": 1e-6, "bearing_std": 1e-9}))[0]
    true = {int(r): (d, b) for r, d, b in zip(exact.receiver, exact.range, exact.bearing, strict=True)}
    ranges = np.array([d - true[int(r)][0] for v in noisy for r, d in zip(v.receiver, v.range, strict=True)])
    bearings = np.array([b - true[int(r)][1] for v in noisy for r, b in zip(v.receiver, v.bearing, strict=True)])
    spread = 4 / math.sqrt(len(ranges))
    noise = Noise(np.array([40.0]), np.array([0.02]), kind == "rayleigh")
    assert abs(ranges.mean() - noise.bias[0]) < 40 * spread
    assert ranges.std() == pytest.approx(40, rel=spread)
    assert abs(bearings.mean()) < 0.02 * spread
    assert bearings.std() == pytest.approx(0.02, rel=spread)
    assert bool(ranges.min() > -1e-3) is (kind == "rayleigh")
    assert all(np.all(v.range_std == 40) and np.all(v.bearing_std == 0.02) for v in noisy)


def test_impulses_strike_gaussian_ranges_only():
    """alpha = 1, beta = 0 is Cauchy: half of the impulses are beyond its scale."""
    impulses = Impulses(fraction=0.3, alpha=1.0, beta=0.0, scale=20.0, location=0.0)
    calm, struck = (
        np.concatenate([d.range for d in detections(scenario(range_noise="gaussian", range_std=1e-3, impulses=i))])
        for i in (Impulses(), impulses)
    )
    exact = np.concatenate([d.range for d in detections(scenario(range_noise="gaussian", range_std=1e-9))])
    assert np.abs(calm - exact).max() < 0.01
    assert np.mean(np.abs(struck - exact) > 0.01) == pytest.approx(0.3 * 0.7, abs=0.15)  # 2/pi atan(2) = 0.70 of them
    rayleigh = [np.concatenate([d.range for d in detections(scenario(impulses=i))]) for i in (Impulses(), impulses)]
    assert np.array_equal(*rayleigh)


def test_misses_and_false_alarms_are_as_many_as_asked_for():
    pings = detections(scenario(duration=4000.0, miss_fraction=0.3, targets=(Target(1, 2600.0, 1400.0, -10.0),)))
    heard = sum(v.range.size for v in pings) / (3 * len(pings))
    assert heard == pytest.approx(0.7, abs=4 * math.sqrt(0.21 / (3 * len(pings))))
    pings = detections(scenario(duration=4000.0, false_alarms=2.0, targets=()))
    alarms = sum(v.range.size for v in pings) / (3 * len(pings))
    assert alarms == pytest.approx(2.0, abs=4 * math.sqrt(2.0 / (3 * len(pings))))


def test_false_alarms_are_uniform_over_the_ellipse_of_max_range():
    story = scenario(duration=4000.0, false_alarms=3.0, targets=(), max_range=5000.0)
    sums = np.concatenate([v.range[v.receiver == 1] for v in detections(story)])
    assert 2000 <= sums.min() < 2100
    assert sums.max() <= 5000
    # the share of area inside a smaller ellipse with the same foci
    area = lambda longest: longest * math.sqrt(longest**2 - 2000**2)  # noqa: E731
    share = area(3500) / area(5000)
    assert np.mean(sums < 3500) == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / sums.size))
    bearings = np.concatenate([v.bearing[v.receiver == 1] for v in detections(story)])
    assert np.abs(bearings).max() <= math.pi
    assert np.mean(bearings > 0) == pytest.approx(0.5, abs=2 / math.sqrt(bearings.size))


def test_the_direct_blast_masks_what_lies_near_the_baseline():
    story = {"duration": 800.0, "false_alarms": 3.0, "blanking": 300.0}
    between = (Target(1, 1000.0, 300.0, -10.0), Target(2, 2600.0, 1400.0, -10.0))  # 88 m beyond receiver 1's baseline
    pings = detections(scenario(**story, range_std=1e-6, bearing_std=1e-9, targets=between))
    assert min(v.range[v.receiver == 1].min(initial=1e9) for v in pings) > 2300
    seen = [np.any(np.abs(v.bearing[v.receiver == 2] - math.atan2(300 - 1732, 2000)) < 1e-6) for v in pings]
    assert all(seen)  # by a receiver whose baseline is elsewhere
    open_water = detections(scenario(**story | {"blanking": 0.0}, range_std=1e-6, bearing_std=1e-9, targets=between))
    assert min(v.range[v.receiver == 1].min() for v in open_water) < 2100


def test_an_empty_ping_is_a_message_without_rows_at_the_end_of_the_window():
    available, heard = events(scenario(targets=()), "sonar/detections")[0]
    assert heard.range.size == heard.receiver.size == 0
    assert available - heard.t_ns == pytest.approx(10_000 / 1500 * 1e9, rel=2e-3)


def test_truth_is_where_the_targets_are_at_the_ping():
    for t_ns, truth in events(scenario(), "/truth/sonar/targets"):
        assert truth.t_ns == t_ns
        time = (t_ns - HARBOUR.start_ns) * 1e-9
        row = [truth.id[0], truth.x[0], truth.y[0], truth.z[0], truth.vx[0], truth.vy[0], truth.vz[0]]
        np.testing.assert_allclose(row, [1, 2600 - 5 * time, 1400 + time, -10, -5, 1, 0])


def test_a_target_turns_when_it_is_told_to():
    rate = math.pi / 120  # half a circle in 120 s
    turning = Target(1, 100.0, 200.0, -10.0, 5.0, 0.0, (Turn(40.0, rate), Turn(160.0, 0.0)))
    radius = 5.0 / rate
    positions, velocities = states([turning] * 4, np.array([40.0, 100.0, 160.0, 200.0]))
    there = [(300, 200), (300 + radius, 200 + radius), (300, 200 + 2 * radius), (100, 200 + 2 * radius)]
    np.testing.assert_allclose(positions, [(*place, -10) for place in there], atol=1e-9)
    np.testing.assert_allclose(velocities, [(5, 0, 0), (0, 5, 0), (-5, 0, 0), (-5, 0, 0)], atol=1e-12)
    truth = dict(events(scenario(targets=(turning,)), "/truth/sonar/targets"))
    at = truth[HARBOUR.start_ns + 100_000_000_000]
    np.testing.assert_allclose([at.x[0], at.y[0], at.vx[0], at.vy[0]], [*there[1], 0, 5], atol=1e-9)


def test_velocities_are_the_derivative_of_positions():
    target, h = Target(1, 0.0, 0.0, 0.0, 3.0, -4.0, (Turn(10.0, 0.02), Turn(50.0, -0.01))), 1e-4
    for time in (5.0, 30.0, 70.0):
        (before, after), (velocity, _) = states([target] * 2, np.array([time, time + h]))
        np.testing.assert_allclose((after - before) / h, velocity, atol=1e-5)


def test_error_sentences():
    with pytest.raises(ValueError, match=r"turns of target 7 must be in order of time, got \[9.0, 3.0\]"):
        SonarSource(scenario(targets=(Target(7, 0.0, 0.0, turns=(Turn(9.0, 0.0), Turn(3.0, 0.0))),)))
    with pytest.raises(ValueError, match="scenario has no sonar"):
        SonarSource(Scenario())
    with pytest.raises(ValueError, match="max_range must exceed the distance of receiver 1, 2000 m, got 1500 m"):
        SonarSource(scenario(max_range=1500.0))
    empty = Sonar(transmitter=Node(0, 0.0, 0.0), receivers=(), targets=())
    with pytest.raises(ValueError, match="receivers must have at least 1 node, got 0"):
        SonarSource(Scenario(sonar=empty))
