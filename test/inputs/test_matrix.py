"""Every input of every estimator, damaged in every way: what is lost by it, and that nothing else is.

`python -m test.inputs.test_matrix [ESTIMATOR ...]` prints the table of docs/inputs.md.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest

from test.inputs.harness import (
    HARBOUR,
    Damage,
    Heard,
    Outcome,
    changed,
    damaged,
    dropped,
    duplicated,
    graph,
    heard,
    lost,
    put,
    repeated,
    run,
    shift_at,
    silent,
    swapped,
)
from uw_acoustic_loc.bag.process import OfflineRun
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import decode
from uw_acoustic_loc.core.types import Odometry, Position
from uw_acoustic_loc.resolved_graph import resolve_stage

pytestmark = pytest.mark.slow


# --- damage to what a message says -----------------------------------------------------------------------------------

_VALUES = ("angular_velocity.z", "twist.twist.linear.x", "pose.pose.position.x", "pose.pose.orientation.z", "point.x")
_COVARIANCES = ("angular_velocity_covariance", "twist.covariance", "pose.covariance")


def _value(message: Any) -> None:
    if hasattr(message, "point_step"):
        _column(message, ("h0", "time", "range", "x", "sample_rate"), np.nan)
        return
    for path in _VALUES:
        if _has(message, path):
            put(message, path, np.nan)


def _spread(variance: float) -> Callable[[Any], None]:
    """All variances of a message."""

    def change(message: Any) -> None:
        if hasattr(message, "point_step"):
            _column(message, ("std", "range_std"), variance)
            return
        for path in _COVARIANCES:
            if _has(message, path):
                put(message, path, np.full(36 if "." in path else 9, variance))

    return change


def _has(message: Any, path: str) -> bool:
    for name in path.split("."):
        if not hasattr(message, name):
            return False
        message = getattr(message, name)
    return True


def _column(message: Any, names: tuple[str, ...], value: float) -> None:
    """Every row of the columns of these names."""
    data = np.array(message.data)
    for field in message.fields:
        kind = {7: np.float32, 8: np.float64}.get(field.datatype)
        if field.name in names and kind:
            own = np.frombuffer(kind(value).tobytes(), np.uint8)
            rows = data.reshape(-1, message.point_step)
            rows[:, field.offset : field.offset + own.size] = own
    object.__setattr__(message, "data", data)


# --- the matrix ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """An input of an estimator, and when its trouble begins, in seconds of the topic."""

    estimator: str
    topic: str
    begin: float = 5.0


CASES = [
    Case("bearing", "/auv1/hydrophones/info", 0.0),
    Case("bearing", "/auv1/hydrophones/samples", 2.0),
    Case("bearing", "/auv1/odometry", 1.0),
    Case("bearing_slam", "/auv1/imu/data", 6.0),
    Case("bearing_slam", "/auv1/dvl/twist", 6.0),
    Case("bearing_slam", "/auv1/sources/a/bearing", 2.0),
    Case("bearing_localizer", "/auv1/slam/odometry", 1.0),
    Case("bearing_localizer", "/auv1/sources/a/bearing", 2.0),
    Case("toa_tracker", "/buoys/arrivals", 6.0),
    Case("toa_tracker", "/buoys/positions", 0.0),
    Case("multistatic_fusion", "/sonar/detections", 5.0),
    Case("multistatic_fusion", "/sonar/positions", 0.0),
    Case("mooring_tracker", "/mooring/buoy1/offset", 6.0),
]


def damages(case: Case) -> dict[str, Damage]:
    begin, ms = case.begin, case.topic.endswith(("samples", "bearing"))
    return {
        "repeated at 1 Hz": repeated(duration=4.0 if ms else 20.0),
        "a pair swapped": swapped(begin),
        "one twice": duplicated(begin),
        "one lost": lost(begin),
        "10 % dropped": dropped(),
        "+1 h once": shift_at(begin, 3600.0),
        "-1 h once": shift_at(begin, -3600.0),
        "a NaN value": changed(_value, begin, 1),
        "NaN covariance": changed(_spread(np.nan)),
        "huge covariance": changed(_spread(1e13)),
        "-1 covariance": changed(_spread(-1.0)),
        "another frame": changed(lambda message: put(message, "header.frame_id", "elsewhere"), begin, 1),
        "silent for 10 s": silent(begin - 1.0, 1.0 if ms else 10.0),
    }


DAMAGES = [*damages(CASES[0])]

# Nothing is to be had without the one message of a latched input, with velocities that say nothing, and, where the
# message's own spread is all that weighs a value, of values without one.
NO_RESULT = {
    ("bearing", "/auv1/hydrophones/info"): {"a NaN value", "another frame", "silent for 10 s"},
    ("toa_tracker", "/buoys/positions"): {"a NaN value", "another frame", "silent for 10 s"},
    ("multistatic_fusion", "/sonar/positions"): {"a NaN value", "another frame", "silent for 10 s"},
    ("bearing_slam", "/auv1/dvl/twist"): {"huge covariance"},
    ("bearing_slam", "/auv1/sources/a/bearing"): {"NaN covariance", "huge covariance", "-1 covariance"},
    ("bearing_localizer", "/auv1/sources/a/bearing"): {"NaN covariance", "huge covariance", "-1 covariance"},
    ("toa_tracker", "/buoys/arrivals"): {"huge covariance"},
    ("multistatic_fusion", "/sonar/detections"): {"huge covariance"},
}
LOSES = {"silent for 10 s", "10 % dropped", "one lost"}  # part of what there is to know


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.estimator}:{case.topic}")
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_input_loses_what_is_damaged_and_nothing_else(case: Case, damage: str) -> None:
    clean, spoilt = outcome(case, ""), outcome(case, damage)
    sound(spoilt)
    assert spoilt.restarts == 0
    if damage in NO_RESULT.get((case.estimator, case.topic), ()):
        return
    if damage != "silent for 10 s":
        affected = affected_by(case, damage)
        assert sum(spoilt.refused.values()) - sum(clean.refused.values()) <= max(affected, 1), spoilt.sentences
    error, without = measure(case, clean), measure(case, outcome(case, "one lost"))
    if damage not in LOSES and error is not None:
        found = measure(case, spoilt)
        assert found is not None
        assert found <= 1.1 * max(error, without or 0.0) + 0.02


def affected_by(case: Case, damage: str) -> int:
    """How many messages are not what they were."""
    before = Counter(id(m.message) for m in inputs(case.estimator) if m.topic == case.topic)
    after = Counter(id(m.message) for m in damaged_inputs(case, damage) if m.topic == case.topic)
    return sum((after - before).values()) + sum((before - after).values())


def sound(spoilt: Outcome) -> None:
    """Numbers, and covariances that may be."""
    for topic, t_ns, data in spoilt.out:
        kind = Odometry if topic.endswith("odometry") else Position if topic.endswith(("position", "fix")) else None
        if kind is None:
            continue
        value = decode(kind, data, t_ns)
        cov = value.pose_cov[:2, :2] if kind is Odometry else value.cov[:2, :2]
        assert np.isfinite(value.position).all()
        assert (np.linalg.eigvalsh(cov) > -1e-12).all() or (cov.diagonal() == -1).any(), (topic, cov)


def measure(case: Case, found: Outcome) -> float | None:
    """The estimator's error in its own unit; None without any estimate."""
    return _measures()[case.estimator](found.score) if found.score else None


def _measures() -> dict[str, Callable[[Any], float | None]]:
    def worst(section: str, key: str, ids: str = "abc") -> Callable[[Any], float | None]:
        return lambda s: max((s[section][k][key] for k in ids if k in s.get(section, {})), default=None)

    return {
        "bearing": worst("bearing", "rmse_deg"),
        "bearing_slam": lambda s: s.get("slam", {}).get("vehicle", {}).get("rmse_m"),
        "bearing_localizer": worst("localizer", "final_m", "ac"),  # the range of b stays open
        "toa_tracker": lambda s: s.get("toa", {}).get("mean_m"),
        "multistatic_fusion": lambda s: s.get("multistatic", {}).get("rmse_m"),
        "mooring_tracker": lambda s: s.get("mooring", {}).get("buoy1", {}).get("std_m"),
    }


@cache
def outcome(case: Case, damage: str) -> Outcome:
    return run(damaged_inputs(case, damage), graph([case.estimator]))


@cache
def damaged_inputs(case: Case, damage: str) -> list[Heard]:
    messages = inputs(case.estimator)
    return damaged(messages, case.topic, damages(case)[damage]) if damage else messages


@cache
def inputs(estimator: str) -> list[Heard]:
    """What an estimator of the harbour graph hears, and the truth."""
    (node,) = graph([estimator]).nodes
    wanted = resolve_stage(node).inputs
    return [m for m in everything() if m.topic in wanted or m.topic.startswith("/truth")]


@cache
def everything() -> list[Heard]:
    """The harbour bag with what its estimators publish."""
    out = Path(mkdtemp()) / "out"
    OfflineRun(Bag(HARBOUR), graph(), lambda *_: None).run(out, keep_inputs=True, progress=lambda _: None)
    return heard(out)


# --- the table -------------------------------------------------------------------------------------------------------


def table(cases: list[Case] = CASES) -> Iterator[str]:
    """A row per input, a column per damage: the error over that of the clean run, and how many were refused."""
    yield "| estimator: input | clean | " + " | ".join(DAMAGES) + " |"
    yield "|---|---|" + "---|" * len(DAMAGES)
    for case in cases:
        clean = outcome(case, "")
        cells = [_cell(case, clean, outcome(case, damage)) for damage in DAMAGES]
        error = measure(case, clean)
        yield f"| {case.estimator}: {case.topic} | {_number(error)} | " + " | ".join(cells) + " |"


def _cell(case: Case, clean: Outcome, spoilt: Outcome) -> str:
    before, after = measure(case, clean), measure(case, spoilt)
    ratio = "none" if after is None or before is None else f"{after / before:.2f}"
    refused = sum(spoilt.refused.values()) - sum(clean.refused.values())
    return f"{ratio}, {refused}" if refused else ratio


def _number(error: float | None) -> str:
    return "none" if error is None else f"{error:.3g}"


def test_its_table_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [*table()]
    with capsys.disabled():
        print("", *rows, sep="\n")
    assert len(rows) == 2 + len(CASES)


if __name__ == "__main__":
    for row in table([case for case in CASES if case.estimator in (sys.argv[1:] or [case.estimator])]):
        print(row, flush=True)
