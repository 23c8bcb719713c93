"""The sequencer: stamp order whatever the order of delivery, bounded waiting, a new run of the clock."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from uw_acoustic_loc.stages.sequencer import Sequencer

SECOND = 1_000_000_000


def feed(sequencer: Sequencer, messages: list[tuple[str, int]]) -> list[tuple[str, int]]:
    released = []
    for topic, t_ns in messages:
        released += [(topic, value) for topic, value in sequencer.push(topic, t_ns, t_ns)]
    return released


def test_a_message_waits_until_every_input_has_reached_its_stamp() -> None:
    sequencer = Sequencer(["imu", "dvl"], SECOND)
    assert feed(sequencer, [("imu", 10), ("imu", 20)]) == []
    assert feed(sequencer, [("dvl", 15)]) == [("imu", 10), ("dvl", 15)]
    assert list(sequencer.flush()) == [("imu", 20)]


def test_equal_stamps_come_in_the_order_of_the_inputs() -> None:
    assert feed(Sequencer(["imu", "dvl"], SECOND), [("dvl", 10), ("imu", 10)]) == [("imu", 10), ("dvl", 10)]


def test_a_silent_input_delays_by_the_lateness_and_no_more() -> None:
    sequencer = Sequencer(["imu", "dvl"], SECOND)
    assert feed(sequencer, [("imu", 5), ("imu", 5 + SECOND - 1)]) == []
    assert feed(sequencer, [("imu", 5 + SECOND)]) == [("imu", 5)]


def test_what_comes_too_late_is_counted() -> None:
    sequencer = Sequencer(["imu", "dvl"], SECOND)
    feed(sequencer, [("imu", 100), ("imu", 100 + 2 * SECOND)])
    assert feed(sequencer, [("dvl", 50)]) == []
    assert sequencer.late == {"imu": 0, "dvl": 1}


def test_a_single_stray_stamp_is_not_a_new_run() -> None:
    sequencer = Sequencer(["imu"], 0)
    feed(sequencer, [("imu", 100 * SECOND), ("imu", 10 * SECOND), ("imu", 101 * SECOND)])
    assert not sequencer.new_run
    assert sequencer.late["imu"] == 1


def test_three_messages_of_the_past_in_a_row_are_a_new_run() -> None:
    sequencer = Sequencer(["imu"], 0)
    feed(sequencer, [("imu", 100 * SECOND)] + [("imu", k * SECOND) for k in (1, 2, 3)])
    assert [t for _, t, _ in sequencer.new_run] == [SECOND, 2 * SECOND, 3 * SECOND]


def test_an_input_that_lags_behind_the_others_is_not_a_new_run() -> None:
    sequencer = Sequencer(["imu", "dvl"], SECOND)
    feed(sequencer, [("imu", k * SECOND) for k in range(1, 20)])
    feed(sequencer, [("dvl", k * SECOND) for k in range(1, 8)])
    assert not sequencer.new_run


@given(st.integers(0, 2**32 - 1))
def test_any_interleaving_within_the_lateness_gives_the_same_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    streams = {
        "a": [("a", int(t)) for t in np.sort(rng.choice(10_000, 40, replace=False))],
        "b": [("b", int(t)) for t in np.sort(rng.choice(10_000, 9, replace=False))],
        "c": [("c", int(t)) for t in np.sort(rng.choice(10_000, 3, replace=False))],
    }
    everything = sorted([m for stream in streams.values() for m in stream], key=lambda m: (m[1], m[0]))
    sequencer = Sequencer(list(streams), 20_000)
    pending = {name: list(stream) for name, stream in streams.items()}
    released = []
    while any(pending.values()):
        name = str(rng.choice([name for name, rest in pending.items() if rest]))
        released += feed(sequencer, [pending[name].pop(0)])
    released += list(sequencer.flush())
    assert released == everything
    assert sum(sequencer.late.values()) == 0


def test_late_messages_are_handled_when_the_input_can_rewind() -> None:
    sequencer = Sequencer(["a", "b"], 0, {"a": 2 * SECOND})
    handled = [item for t_ns in (1, 5, 3, 2) for item in sequencer.push("a", t_ns * SECOND, t_ns)]
    assert handled == [("a", 1), ("a", 5), ("a", 3)]
    assert sequencer.late == {"a": 1, "b": 0}
    assert list(sequencer.push("b", 4 * SECOND, 4)) == []
    assert sequencer.late["b"] == 1
