"""The sequencer: stamp order whatever the order of delivery, bounded waiting, stamps that do not fit."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from uw_acoustic_loc.stages.sequencer import Sequencer

SECOND = 1_000_000_000
HALF = SECOND // 2


@dataclass(frozen=True)
class Value:
    """`true_ns` is when it was measured and delivered; the stamp may be another."""

    t_ns: int
    true_ns: int


def sequencer(topics: Iterable[str], lateness_ns: int, rewind_ns: dict[str, int] | None = None) -> Sequencer:
    return Sequencer(dict.fromkeys(topics, lateness_ns), lateness_ns, rewind_ns)


def feed(order: Sequencer, messages: Iterable[tuple[str, int]]) -> list[tuple[str, int]]:
    return [(t, value.t_ns) for topic, t_ns in messages for t, value in order.push(topic, t_ns, Value(t_ns, t_ns))]


def kinds(order: Sequencer) -> list[tuple[str, str]]:
    return [(refused.topic, refused.kind) for refused in order.take_refused()]


def test_a_message_waits_until_every_input_has_reached_its_stamp() -> None:
    order = sequencer(["imu", "dvl"], SECOND)
    assert feed(order, [("imu", 10), ("imu", 20)]) == []
    assert feed(order, [("dvl", 15)]) == [("imu", 10), ("dvl", 15)]
    assert [topic for topic, _ in order.flush()] == ["imu"]


def test_equal_stamps_come_in_the_order_of_the_inputs() -> None:
    assert feed(sequencer(["imu", "dvl"], SECOND), [("dvl", 10), ("imu", 10)]) == [("imu", 10), ("dvl", 10)]


def test_a_silent_input_delays_by_the_lateness_and_no_more() -> None:
    order = sequencer(["imu", "dvl"], SECOND)
    assert feed(order, [("imu", 5), ("imu", 4 + SECOND)]) == []
    assert feed(order, [("imu", 5 + SECOND), ("imu", 6 + SECOND)]) == [("imu", 5)]


def test_an_input_that_may_be_late_is_waited_for_as_long_as_it_may() -> None:
    order = Sequencer({"imu": SECOND, "bearing": 2 * SECOND}, SECOND)
    messages = [("imu", k * SECOND // 10) for k in range(1, 22)]
    assert feed(order, messages) == [("imu", SECOND // 10)]


def test_what_comes_too_late_is_refused_with_the_wait_that_would_have_been_in_time() -> None:
    order = sequencer(["imu", "dvl"], SECOND)
    feed(order, [("imu", k * SECOND // 10) for k in range(1, 32)])
    assert feed(order, [("dvl", SECOND)]) == []
    assert kinds(order) == [("dvl", "late")]
    assert order.needed_ns == {"dvl": 21 * SECOND // 10}


def test_late_messages_are_handled_when_the_input_can_rewind() -> None:
    order = sequencer(["a", "b"], 0, {"a": 2 * SECOND})
    assert feed(order, [("a", t * SECOND) for t in (1, 5, 6, 3, 4, 1)]) == [("a", t * SECOND) for t in (1, 5, 4)]
    order.flush()
    assert kinds(order) == [("a", "stray")] * 2


# --- stamps that do not fit ----------------------------------------------------------------------------------------

RATES = {"imu": 100, "dvl": 5, "a": 10}  # Hz


def regular(topics: Iterable[str] = RATES, seconds: float = 12.0, begin: float = 100.0) -> list[tuple[str, Value]]:
    """Messages of several inputs in the order of their measurement."""
    found = []
    for k, topic in enumerate(topics):
        for n in range(int(seconds * RATES[topic])):
            t_ns = round((begin + n / RATES[topic]) * SECOND) + 1000 * k
            found.append((topic, Value(t_ns, t_ns)))
    return sorted(found, key=lambda m: m[1].true_ns)


def restamped(
    messages: list[tuple[str, Value]], topic: str, change: Callable[[float], float]
) -> list[tuple[str, Value]]:
    """Other stamps for one input: `change` takes the seconds since the beginning and returns what is added, in s."""
    start = messages[0][1].true_ns
    return [
        (t, Value(v.t_ns + round(change((v.true_ns - start) * 1e-9) * SECOND), v.true_ns) if t == topic else v)
        for t, v in messages
    ]


def played(
    messages: Iterable[tuple[str, Value]], topics: Iterable[str] = RATES
) -> tuple[list[tuple[str, Value]], list]:
    """What is handled, and (topic, kind) of what is refused."""
    order = sequencer(topics, HALF)
    handled: list[tuple[str, Value]] = []
    for topic, value in messages:
        handled += order.push(topic, value.t_ns, value)
        if order.new_run:
            handled += [*order.flush(), ("restart", value)]
            start = order.new_run
            order.clear()
            handled += [item for t, t_ns, v in start for item in order.push(t, t_ns, v)]
    handled += order.flush()
    return handled, kinds(order)


def once(second: float, by: float) -> Callable[[float], float]:
    """One stamp of an input of any rate up to 100 Hz."""
    done: list[float] = []

    def change(t: float) -> float:
        if t < second or done:
            return 0.0
        done.append(t)
        return by

    return change


@given(st.sampled_from([*RATES]), st.floats(1.0, 10.0), st.sampled_from([2.0, 18.0, 3600.0, -2.0, -3600.0, -1.4e9]))
def test_one_wrong_stamp_is_refused_alone(topic: str, second: float, by: float) -> None:
    messages = restamped(regular(begin=1.78e9), topic, once(second, by))
    handled, refused = played(messages)
    assert refused == [(topic, "stray")]
    assert len(handled) == len(messages) - 1
    assert [v.t_ns for _, v in handled] == sorted(v.true_ns for _, v in handled)


def test_two_seconds_in_1980_are_refused_alone() -> None:
    messages = restamped(regular(begin=1.78e9), "imu", lambda t: -1.45e9 if 5 <= t < 7 else 0.0)
    handled, refused = played(messages)
    assert refused == [("imu", "stray")] * 200
    assert len(handled) == len(messages) - 200


def test_two_seconds_an_hour_ahead_are_refused_alone_even_of_a_single_input() -> None:
    for topics in (["imu", "dvl"], ["dvl"]):
        messages = restamped(regular(topics), topics[0], lambda t: 3600.0 if 5 <= t < 7 else 0.0)
        handled, refused = played(messages, topics)
        count = 2 * RATES[topics[0]]
        assert refused == [(topics[0], "stray")] * count
        assert len(handled) == len(messages) - count


@given(st.sampled_from([*RATES]), st.sampled_from([-5.0, 5.0, -300.0, 18.0, 3600.0, -1.4e9]))
def test_a_step_of_one_clock_is_taken_out_after_three_seconds(topic: str, by: float) -> None:
    messages = restamped(regular(begin=1.78e9), topic, lambda t: by if t >= 5 else 0.0)
    handled, refused = played(messages)
    assert all(kind == "stray" and t == topic for t, kind in refused)
    assert len(refused) <= 3.3 * RATES[topic]
    assert len(handled) == len(messages) - len(refused)
    assert max(abs(v.t_ns - v.true_ns) for _, v in handled) <= 1000


def test_a_step_that_brings_an_input_into_line_stays() -> None:
    messages = restamped(regular(), "dvl", lambda t: -40.0 if t < 5 else 0.0)
    handled, refused = played(messages)
    assert {kind for _, kind in refused} <= {"late", "stray"}
    own = [v for topic, v in handled if topic == "dvl" and v.t_ns == v.true_ns]
    assert len(own) >= 5 * (12 - 5 - 3.4)


def test_a_clock_that_is_set_back_for_all_is_a_new_run_and_nothing_is_lost() -> None:
    messages = [*regular(seconds=12), *regular(seconds=6, begin=50.0)]
    handled, refused = played(messages)
    assert refused == []
    assert [topic for topic, _ in handled].count("restart") == 1
    at = [topic for topic, _ in handled].index("restart")
    assert [v.t_ns for _, v in handled[:at]] == sorted(v.t_ns for _, v in regular(seconds=12))
    assert [v.t_ns for _, v in handled[at + 1 :]] == sorted(v.t_ns for _, v in regular(seconds=6, begin=50.0))


def test_a_clock_that_is_set_forward_for_all_loses_nothing() -> None:
    messages = [*regular(seconds=5), *regular(seconds=6, begin=4000.0)]
    handled, refused = played(messages)
    assert refused == []
    assert [v.t_ns for _, v in handled] == [v.t_ns for _, v in messages]


def test_an_input_that_pauses_is_taken_in_at_once() -> None:
    messages = [(t, v) for t, v in regular() if t != "dvl" or not 104 < v.true_ns / SECOND < 109]
    handled, refused = played(messages)
    assert refused == []
    assert handled == messages


def test_an_input_that_joins_late_with_another_clock_poisons_nothing() -> None:
    messages = restamped(
        [(t, v) for t, v in regular() if t != "dvl" or v.true_ns > 105 * SECOND], "dvl", lambda _: 3600.0
    )
    handled, refused = played(messages)
    assert refused == [("dvl", "stray")] * 35
    assert {t for t, _ in handled} == {"imu", "a"}


def test_the_last_message_of_all_with_a_wrong_stamp_is_refused() -> None:
    messages = regular()
    messages[-1] = (messages[-1][0], Value(messages[-1][1].t_ns + 60 * SECOND, messages[-1][1].true_ns))
    handled, refused = played(messages)
    assert [kind for _, kind in refused] == ["stray"] and handled == messages[:-1]


# --- interleaving ---------------------------------------------------------------------------------------------------


def interleaved(
    messages: list[tuple[str, Value]], rng: np.random.Generator, most: float = 0.25
) -> list[tuple[str, Value]]:
    """Each input in its own order, each message up to `most` seconds late."""
    streams = []
    for topic in {topic for topic, _ in messages}:
        own = [v for t, v in messages if t == topic]
        due = np.maximum.accumulate([v.true_ns + rng.uniform(0, most) * SECOND for v in own])
        streams.append([(d, k, topic, v) for k, (d, v) in enumerate(zip(due.tolist(), own, strict=True))])
    return [(topic, v) for _, _, topic, v in heapq.merge(*streams)]


FAULTS: dict[str, Callable[[float], float]] = {
    "none": lambda t: 0.0,
    "3 s ahead, once": lambda t: 3.0 if 5.0 <= t < 5.15 else 0.0,
    "an hour ahead for 2 s": lambda t: 3600.0 if 5 <= t < 7 else 0.0,
    "a year back for 2 s": lambda t: -3e7 if 5 <= t < 7 else 0.0,
    "steps back": lambda t: -5.0 if t >= 5 else 0.0,
    "steps forth": lambda t: 5.0 if t >= 5 else 0.0,
    "steps far": lambda t: 3600.0 if t >= 5 else 0.0,
    "swapped": lambda t: 0.21 if 5.0 <= t < 5.2 else 0.0,
}


@given(st.integers(0, 2**32 - 1), st.sampled_from([*FAULTS]), st.sampled_from([*RATES]), st.booleans())
def test_any_interleaving_within_half_of_the_lateness_gives_the_same(
    seed: int, fault: str, topic: str, gap: bool
) -> None:
    rng = np.random.default_rng(seed)
    messages = restamped(regular(seconds=9), topic, FAULTS[fault])
    if gap:
        messages = [(t, v) for t, v in messages if t != "a" or not 101 < v.true_ns / SECOND < 103.5]
    messages = [m for m in messages if rng.random() > 0.1]
    wanted, refused = played(messages)
    for _ in range(2):
        handled, also = played(interleaved(messages, rng))
        assert handled == wanted
        assert sorted(also) == sorted(refused)


@given(st.integers(0, 2**32 - 1))
def test_a_new_run_is_the_same_in_any_interleaving(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = regular(seconds=5), regular(seconds=5, begin=20.0)
    messages = [*first, *((t, Value(v.t_ns, v.true_ns + 85 * SECOND)) for t, v in second)]
    wanted = [v for t, v in played(messages)[0] if t != "restart"]
    for _ in range(2):
        handled, refused = played(interleaved(messages, rng))
        assert [v for t, v in handled if t != "restart"] == wanted and refused == []
