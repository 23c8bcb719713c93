"""The harbour bag with inputs as drivers send them: its estimators keep their errors, and say what is wrong."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from test.inputs.harness import (
    Damage,
    Heard,
    Outcome,
    changed,
    damaged,
    graph,
    harbour,
    put,
    repeated,
    run,
    shift_at,
    shift_between,
)

BEARING, SLAM = "/auv1/bearing", "/auv1/bearing_slam"
IMU, DVL, ODOMETRY, INFO = (f"/auv1/{name}" for name in ("imu/data", "dvl/twist", "odometry", "hydrophones/info"))


@cache
def recorded() -> list[Heard]:
    return harbour()


@cache
def clean() -> Outcome:
    return run(recorded(), graph(["bearing", "bearing_slam"]))


def spoilt(topic: str, damage: Damage, nodes: tuple[str, ...] = ("bearing", "bearing_slam"), **params: Any) -> Outcome:
    return run(damaged(recorded(), topic, damage), graph(nodes, **params))


def bearing_errors(found: Outcome) -> dict[str, tuple[float, int]]:
    return {name: (numbers["rmse_deg"], numbers["n"]) for name, numbers in found.score["bearing"].items()}


def slam_error(found: Outcome) -> float:
    return float(found.score["slam"]["vehicle"]["rmse_m"])


def test_an_array_that_repeats_itself_costs_nothing() -> None:
    """It restarted the estimator each time: 7 to 18 deg."""
    found = spoilt(INFO, repeated(), ("bearing",))
    assert bearing_errors(found) == bearing_errors(clean())


def test_an_odometry_of_unknown_covariance_is_used() -> None:
    found = spoilt(ODOMETRY, changed(lambda m: put(m, "pose.covariance", np.full(36, np.nan))), ("bearing",))
    assert bearing_errors(found) == bearing_errors(clean()) and not found.refused


ONCE = [(IMU, 3600.0), (IMU, 18.0), (IMU, -3600.0), (DVL, 3600.0), (DVL, -3600.0)]


@pytest.mark.slow
@pytest.mark.parametrize(("topic", "by"), ONCE)
def test_one_wrong_stamp_is_refused_alone(topic: str, by: float) -> None:
    found = spoilt(topic, shift_at(2.0, by))
    assert sum(found.refused.values()) == 1
    assert slam_error(found) < 1.1 * slam_error(clean())
    assert bearing_errors(found) == bearing_errors(clean())


@pytest.mark.slow
def test_two_seconds_in_1980_do_not_restart_the_vehicle() -> None:
    """It restarted twice, 9.1 m off with a NEES of 3e5."""
    found = spoilt(IMU, shift_between(5.0, 7.0, -46 * 365 * 86400.0))
    assert found.restarts == 0 and found.refused[SLAM, "imu/data"] == 200
    assert slam_error(found) < 1.1 * slam_error(clean())


@pytest.mark.slow
@pytest.mark.parametrize("by", [-5.0, 5.0])
def test_a_clock_that_steps_is_followed(by: float) -> None:
    """The rest of the topic was lost."""
    found = spoilt(DVL, shift_between(8.0, 99.0, by))
    assert found.refused[SLAM, "dvl/twist"] <= 16
    assert slam_error(found) < 1.1 * slam_error(clean())
    assert any("the clock of dvl/twist has stepped" in said for said in found.said(SLAM))


@pytest.mark.slow
@pytest.mark.parametrize("offset", [18.0, -18.0, 3600.0])
def test_a_clock_that_is_off_is_named_within_five_seconds_and_cured(offset: float) -> None:
    named = spoilt(IMU, shift_between(0.0, 99.0, offset)).said(SLAM, 0.0, 5.5)
    assert any("stamps of imu/data are" in said and f"{abs(offset):.1f}" in said for said in named), named
    cured = spoilt(IMU, shift_between(0.0, 99.0, offset), bearing_slam={"inputs.imu/data.stamp_offset": -offset})
    assert slam_error(cured) == slam_error(clean()) and not cured.refused


@pytest.mark.slow
def test_nanoseconds_beyond_a_second_are_refused_one_by_one() -> None:
    """900 IMU messages and 33 of 40 bearings were lost with them."""

    def spoil(own: list[Heard]) -> list[Heard]:
        def beyond(message: Any) -> None:
            put(message, "header.stamp", type(message.header.stamp)(message.header.stamp.sec, 4_000_000_000))

        return [changed(beyond)([m])[0] if k % 5 == 0 else m for k, m in enumerate(own)]

    found = spoilt(DVL, spoil)
    assert dict(found.refused) == {(SLAM, "dvl/twist"): 21}
    assert slam_error(found) < 1.1 * slam_error(clean())


@pytest.mark.slow
def test_without_odometry_the_chain_goes_on() -> None:
    """SLAM refused every bearing as late. The last half second comes with the end of this bag's sound."""
    found = spoilt(ODOMETRY, lambda _: [])
    assert all(n == 40 for _, n in bearing_errors(found).values())
    assert all(found.counts[SLAM][f"sources/{name}/bearing", "used"] >= 35 for name in "abc")
    assert slam_error(found) < 1.1 * slam_error(clean())


def forward_right_down(own: list[Heard]) -> list[Heard]:
    """An IMU that points down."""

    def turn(message: Any) -> None:
        for vector in ("angular_velocity", "linear_acceleration"):
            for axis in "yz":
                put(message, f"{vector}.{axis}", -getattr(getattr(message, vector), axis))

    return changed(turn)(own)


@pytest.mark.slow
def test_an_imu_that_points_down_is_named_and_cured() -> None:
    assert any("so z points down" in said for said in spoilt(IMU, forward_right_down).said(SLAM, 0.0, 5.0))
    cured = spoilt(IMU, forward_right_down, bearing_slam={"inputs.imu/data.convention": "ned"})
    assert slam_error(cured) == pytest.approx(slam_error(clean()), rel=1e-6)


def mounted(yaw: float, ahead: float) -> Callable[[list[Heard]], list[Heard]]:
    """A velocity log that is turned, and sits ahead of base_link, in a frame of its own."""
    rates = {m.t_ns: m.message.angular_velocity.z for m in recorded() if m.topic == IMU}

    def spoil(own: list[Heard]) -> list[Heard]:
        return [changed(turn(m))([m])[0] for m in own]

    def turn(one: Heard) -> Callable[[Any], None]:
        def change(message: Any) -> None:
            linear = message.twist.twist.linear
            u, v = linear.x, linear.y + rates[one.t_ns] * ahead
            put(linear, "x", np.cos(yaw) * u + np.sin(yaw) * v)
            put(linear, "y", np.cos(yaw) * v - np.sin(yaw) * u)
            put(message, "header.frame_id", "dvl_link")

        return change

    return spoil


@pytest.mark.slow
def test_a_log_that_is_turned_and_sits_ahead_is_refused_with_the_cure_and_cured() -> None:
    damage = mounted(0.785, 2.0)
    refused = spoilt(DVL, damage)
    assert "set inputs.dvl/twist.accept_frames" in refused.sentences[SLAM, "dvl/twist"]
    settings = {"accept_frames": ["dvl_link"], "rotation": [0.0, 0.0, 0.785], "translation": [2.0, 0.0, 0.0]}
    cured = spoilt(DVL, damage, bearing_slam={f"inputs.dvl/twist.{name}": v for name, v in settings.items()})
    assert not cured.refused
    assert slam_error(cured) < 1.1 * slam_error(clean())
