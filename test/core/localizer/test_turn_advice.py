"""Which turn tells the side or the range."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.config import build
from uw_acoustic_loc.core.geometry import wrap_angle
from uw_acoustic_loc.core.localizer.config import LocalizerConfig
from uw_acoustic_loc.core.localizer.localizer import SourceLocalizer
from uw_acoustic_loc.core.localizer.turn_advice import advice, best_turn


def degrees(*angles: float) -> list[float]:
    return [math.radians(angle) for angle in angles]


@pytest.mark.parametrize(
    ("bearings", "range_open", "turn"),
    [
        ((90,), True, 0),
        ((20,), True, -40),  # away from it: the shorter way
        ((-20,), True, 40),
        ((180,), True, 60),
        ((90, -90), False, 20),  # 70 against 110 degrees from the axis
        ((5, -5), False, 20),
        ((90, -90), True, 20),
        ((30, -30), True, 90),  # both at least 60 degrees off the course
    ],
)
def test_best_turn(bearings, range_open, turn):
    assert best_turn(degrees(*bearings), range_open=range_open, array_yaw=0.0) == turn


def test_the_turn_for_the_side_depends_on_the_arrays_axis():
    """An array athwart: its mirror images are ahead and astern."""
    assert best_turn(degrees(10, 170), range_open=False, array_yaw=math.pi / 2) == 20


def run(steps, *, mirror: bool, source=(60.0, 5.0)) -> tuple[SourceLocalizer, tuple[float, float, float]]:
    values = {"source_ids": ("a",), "bearing_std": math.radians(2), "bearing_correlation_time": 0.0, "mirror": mirror}
    localizer = SourceLocalizer(build(LocalizerConfig, values | {"process_noise": 0.0}, "test"), 0)
    rng = np.random.default_rng(3)
    for k, (x, y, yaw) in enumerate(steps):
        bearing = wrap_angle(math.atan2(source[1] - y, source[0] - x) - yaw + rng.normal(0, math.radians(2)))
        localizer.update((k + 1) * 100_000_000, x, y, yaw, bearing, 0.0)
    return localizer, (x, y, yaw)


def test_a_source_ahead_has_no_range_and_the_advised_turn_gives_it():
    straight = [(0.1 * k, 0.0, 0.0) for k in range(150)]
    localizer, pose = run(straight, mirror=False, source=(60.0, 0.0))
    sentence = advice(localizer, *pose)
    start, _, side = sentence.rpartition(" ")
    assert start == "range unobservable: all bearings along one line; turn 60 deg to"
    away = math.radians(60 if side == "port" else -60)
    turned = [(15 + 0.1 * k * math.cos(away), 0.1 * k * math.sin(away), away) for k in range(1, 250)]
    localizer, pose = run(straight + turned, mirror=False, source=(60.0, 0.0))
    assert advice(localizer, *pose) == ""


def test_a_straight_course_leaves_the_side_and_the_advised_turn_settles_it():
    straight = [(0.15 * k, 0.0, 0.0) for k in range(300)]
    localizer, pose = run(straight, mirror=True, source=(25.0, 18.0))
    sentence = advice(localizer, *pose)
    assert sentence.startswith("side not known yet; turn ")
    turn = math.radians(float(sentence.split()[5])) * (1 if "port" in sentence else -1)
    turned = [(45 + 0.15 * k * math.cos(turn), 0.15 * k * math.sin(turn), turn) for k in range(1, 60)]
    localizer, pose = run(straight + turned, mirror=True, source=(25.0, 18.0))
    assert len(localizer.sides) == 1 and advice(localizer, *pose) == ""


def test_nothing_is_advised_before_the_first_bearing():
    localizer = SourceLocalizer(build(LocalizerConfig, {"source_ids": ("a",)}, "test"), 0)
    assert advice(localizer, 0.0, 0.0, 0.0) == ""
