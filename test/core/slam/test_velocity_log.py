"""What a Doppler log's message says, axis by axis."""

from __future__ import annotations

import math

import numpy as np
import pytest
from slam_runs import config

from uw_acoustic_loc.core.slam.inertial import SIZE, VELOCITY
from uw_acoustic_loc.core.slam.joint import Joint
from uw_acoustic_loc.core.slam.velocity_log import VelocityLog
from uw_acoustic_loc.core.types import BodyVelocity, unknown


def corrected(linear: list[float], cov: np.ndarray, prior: float = 1.0) -> tuple[VelocityLog, Joint]:
    joint, log = Joint(np.zeros(SIZE), np.full(SIZE, 1e-12)), VelocityLog()
    joint.widen(VELOCITY, prior)
    log.correct(joint, BodyVelocity(1, np.array(linear), cov), config(dvl_std=0.1))
    return log, joint


def variances(joint: Joint) -> np.ndarray:
    return joint.cov.diagonal()[VELOCITY]


def test_the_messages_variance_decides_axis_by_axis():
    log, joint = corrected([0.5, 0.2, 0.1], np.diag([0.04, 1e9, 0.0]))
    np.testing.assert_allclose(variances(joint), [0.04 / 1.04, 1.0, 0.01 / 1.01], rtol=1e-6)
    assert joint.mean[7] == 0 and log.used == 1


@pytest.mark.parametrize("cov", [unknown(3), np.zeros((3, 3)), np.full((3, 3), math.nan)])
def test_an_unknown_variance_is_the_parameters(cov):
    _, joint = corrected([0.5, 0.2, 0.1], cov)
    np.testing.assert_allclose(variances(joint), 0.01 / 1.01, rtol=1e-6)


def test_a_huge_variance_is_no_information():
    log, joint = corrected([0.0, 0.0, 0.0], 1e9 * np.eye(3))
    assert (log.used, log.unused, log.uninformative) == (0, 0, 1)
    np.testing.assert_array_equal(joint.mean, 0)
    np.testing.assert_allclose(variances(joint), 1.0)


@pytest.mark.parametrize("value", [-32.768, 32.767, -327.68])
def test_sentinels_are_refused_by_name(value):
    with pytest.raises(ValueError, match=f"velocity {value:g} m/s is what logs send without bottom lock"):
        corrected([value] * 3, 0.01 * np.eye(3))


def test_impossible_velocities_and_zeros_that_contradict_are_refused():
    with pytest.raises(ValueError, match="velocity must be at most 30 m/s on each axis, got 50"):
        corrected([50.0, 0.0, 0.0], 0.01 * np.eye(3))
    joint, log = Joint(np.zeros(SIZE), np.full(SIZE, 1e-6)), VelocityLog()
    joint.mean[6] = 1.5
    for _ in range(5):
        with pytest.raises(ValueError, match="velocity of exactly 0, 0, 0 does not fit"):
            log.correct(joint, BodyVelocity(1, np.zeros(3), 1e-4 * np.eye(3)), config())
    assert joint.mean[6] == 1.5
    joint.mean[6] = 0.0
    assert log.correct(joint, BodyVelocity(1, np.zeros(3), 1e-4 * np.eye(3)), config())  # a vehicle at rest
