"""Scenario values that cannot be meant are refused with one sentence that names them."""

import copy
import re

import pytest

from uw_acoustic_loc.config import build
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.sim.scenario import Scenario, find_scenario, load_scenario
from uw_acoustic_loc.yaml_file import load_yaml

POOL = load_yaml(resource("config/pool/scenario.yaml"), "scenario")


def refusal(**changes):
    """The sentence about the pool with changes, given by dotted keys."""
    values = copy.deepcopy(POOL)
    for key, value in changes.items():
        *path, last = key.split("__")
        part = values
        for step in path:
            part = part[int(step) if step.isdigit() else step]
        part[last] = value
    with pytest.raises(ValueError) as caught:
        build(Scenario, values, "scenario pool")
    return str(caught.value)


@pytest.mark.parametrize("name", ["harbour", "basin", "sonar_net", "pool"])
def test_the_package_s_own_are_accepted(name, tmp_path):
    load_scenario(find_scenario(name, tmp_path))


def test_bands_in_khz():
    sentence = refusal(pingers__0__band_low=29.0, pingers__0__band_high=31.0)
    assert sentence == (
        "scenario pool: pinger a: band_high must be in Hz, got 31 Hz, of which not even 10 cycles fit the pulse_length"
    )


def test_a_slow_source_with_a_long_pulse_is_accepted():
    values = copy.deepcopy(POOL)
    values["pingers"][0] |= {"band_low": 240.0, "band_high": 260.0, "pulse_length": 0.5}
    assert build(Scenario, values, "scenario pool").pingers[0].band_high == 260.0


def test_a_band_upside_down():
    assert "band_low must be at most band_high, got 31500 and 31000 Hz" in refusal(pingers__0__band_low=31500.0)


@pytest.mark.parametrize("rate", [50e3, 62e3])
def test_a_pinger_above_half_the_sample_rate(rate):
    assert refusal(hydrophones__sample_rate=rate) == (
        "scenario pool: pinger a: band_high must be below half the hydrophones' sample_rate, "
        f"{rate / 2:g} Hz, got 31000 Hz"
    )


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("hydrophones__array_yaw", 90.0, "from -3.15 to 3.15 rad"),
        ("environment__walls__yaw", 45.0, "from -3.15 to 3.15 rad"),
        ("vehicle__gyro_std", 2.0, "from 0 to 1 rad/s"),
        ("hydrophones__spacing", 190.0, "from 0.001 to 100 m"),
        ("pingers__0__pulse_length", 4.0, "from 1e-05 to 1 s"),
        ("pingers__0__z", 3.9, "at most 0 m"),
        ("vehicle__z", 1.0, "at most 0 m"),
    ],
)
def test_degrees_millimetres_milliseconds_and_depths(key, value, allowed):
    assert refusal(**{key: value}).endswith(f"must be {allowed}, got {value}")


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("pingers__0__z", -4.1, "pinger a must lie between the seabed at -4 m and 0 m, got -4.1 m"),
        ("vehicle__z", -5.0, "vehicle: waypoint 0 must lie between the seabed at -4 m and 0 m, got -5 m"),
        ("hydrophones__array_position", [0.0, 0.0, 1.5], "hydrophones must lie between the seabed .*, got 0.5 m"),
        ("buoys", {"nodes": [{"id": 3, "x": 0, "y": 0, "z": -9}]}, "buoy 3 must lie between the seabed .*, got -9 m"),
    ],
)
def test_everything_lies_above_the_seabed_and_in_the_water(key, value, sentence):
    assert re.search(sentence, refusal(**{key: value}))


def test_everything_lies_within_the_walls():
    assert refusal(pingers__0__x=-5.0) == (
        "scenario pool: pinger a must lie within the walls, 25 m x 12 m, got (-5, 4.5), which is at (-1, 7) from "
        "their corner"
    )
    assert "vehicle: waypoint 2 must lie within the walls" in refusal(vehicle__waypoints__2__y=10.0)


@pytest.mark.parametrize("key", ["hydrophones__array_position", "environment__walls__reflection"])
def test_lists_of_numbers_are_whole(key):
    assert "elements, got 0" in refusal(**{key: []})
