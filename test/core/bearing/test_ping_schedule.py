import numpy as np
import pytest

from uw_acoustic_loc.core.bearing.ping_schedule import PingSchedule, Timing

T0 = 10**18
TIMING = Timing(jitter=0.005, drift=10 / 1500, shortest=0.04, longest=12.0, pings=5)
PERIODS = [0.05, 0.1, 0.73, 2.0, 10.0]


def taken(schedule, onsets):
    """Onsets (n,) that the schedule takes for pings."""
    return np.array([t for t in np.sort(onsets) if schedule.is_ping(T0 + round(1e9 * t))])


def pings(period, count, start=0.3, jitter=0.0, seed=0):
    rng = np.random.default_rng(seed)
    return start + period * np.arange(count) + jitter * rng.standard_normal(count)


def misses(found, true):
    """How many true ones were not taken, and how many others were."""
    return len(set(true.round(9)) - set(found.round(9))), len(set(found.round(9)) - set(true.round(9)))


@pytest.mark.parametrize("period", PERIODS)
def test_the_period_is_learnt(period):
    schedule, onsets = PingSchedule(TIMING), pings(period, 60, jitter=5e-4)
    assert misses(taken(schedule, onsets), onsets) == (0, 0)
    assert schedule.period == pytest.approx(period, rel=0.01)


@pytest.mark.parametrize("period", [0.1, 0.73, 2.0, 10.0])
@pytest.mark.parametrize("echo", [(0.15,), (0.12, 0.31), (0.45,)])
def test_late_echoes_are_left_out_once_the_period_is_known(period, echo):
    schedule, onsets = PingSchedule(TIMING), pings(period, 60, jitter=3e-4)
    late = np.concatenate([onsets + share * period for share in echo])
    found = taken(schedule, np.concatenate([onsets, late]))
    settled = found[found > onsets[12]]
    assert misses(settled, onsets[13:]) == (0, 0)
    assert schedule.period == pytest.approx(period, rel=0.01)


def test_an_echo_that_was_heard_first_does_not_win():
    """The recording begins between ping and echo, and the first direct paths are missing."""
    onsets = pings(1.0, 60)
    found = taken(PingSchedule(TIMING), np.concatenate([onsets[10:], onsets + 0.2]))
    assert misses(found[found > 25.0], onsets[25:]) == (0, 0)


def test_leakage_of_other_sources_is_left_out():
    onsets, others = pings(0.5, 80), pings(0.37, 108, start=0.11)
    found = taken(PingSchedule(TIMING), np.concatenate([onsets, others[::3]]))
    missed, wrong = misses(found[found > 10.0], onsets[onsets > 10.0])
    assert missed == 0
    assert wrong <= 2


@pytest.mark.parametrize("period", [0.1, 1.0, 5.0])
def test_pings_that_fail_do_not_lose_the_period(period):
    rng = np.random.default_rng(1)
    onsets = pings(period, 80, jitter=5e-4)
    heard = onsets[rng.random(80) > 0.3]
    assert misses(taken(PingSchedule(TIMING), heard), heard) == (0, 0)


@pytest.mark.parametrize("period", [0.1, 2.0])
def test_another_phase_is_learnt_when_the_expected_pings_stay_away(period):
    before = pings(period, 20)
    after = pings(period, 40, start=before[-1] + 1.4 * period)
    found = taken(PingSchedule(TIMING), np.concatenate([before, after]))
    assert misses(found[found <= before[-1]], before) == (0, 0)
    assert misses(found[found > after[8]], after[9:]) == (0, 0)


def test_another_period_is_learnt():
    before = pings(1.0, 20)
    after = pings(0.3, 80, start=before[-1] + 0.3)
    schedule = PingSchedule(TIMING)
    found = taken(schedule, np.concatenate([before, after]))
    assert misses(found[found > after[30]], after[31:]) == (0, 0)
    assert schedule.period == pytest.approx(0.3, rel=0.01)


def test_what_does_not_repeat_is_all_taken():
    onsets = np.cumsum(np.random.default_rng(2).uniform(0.3, 3.0, 100))
    """But what comes after a quarter of the longest silence of late: it might be an echo."""
    assert taken(PingSchedule(TIMING), onsets).size > 75


@pytest.mark.parametrize("period", [0.05, 1.0, 10.0])
def test_motion_moves_the_pings_and_they_are_kept(period):
    """3 m/s towards the source, then away: the time between pings changes by 0.4 %."""
    emitted = period * np.arange(80)
    turn = emitted[40]
    onsets = emitted + (200.0 - 3.0 * np.minimum(emitted, turn) + 3.0 * np.maximum(emitted - turn, 0.0)) / 1500.0
    assert misses(taken(PingSchedule(TIMING), onsets), onsets) == (0, 0)


@pytest.mark.parametrize("first", range(8))
def test_a_chain_of_echoes_settles_on_the_direct_path_wherever_it_begins(first):
    """15, 27 and 45 ms late: 85 ms lie between the third echo's beginning and the next but one, which is no period."""
    rng = np.random.default_rng(first)
    echoes = np.array([0.0, 0.015, 0.027, 0.045])
    onsets = np.sort((0.1 * np.arange(60)[:, None] + echoes + rng.normal(0.0, 3e-4, (60, 4))).ravel())
    heard = [t for t in onsets[first:] if rng.random() < 0.95]
    schedule = PingSchedule(TIMING)
    found = [t for t in taken(schedule, heard) if t > 3.0]
    assert schedule.period == pytest.approx(0.1, abs=1e-3)
    assert np.all(np.abs((np.array(found) + 0.05) % 0.1 - 0.05) < 2e-3)
    assert len(found) > 20
