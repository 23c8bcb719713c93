import math

import numpy as np
import pytest

from uw_acoustic_loc.core.bearing.array_motion import ArrayMotion
from uw_acoustic_loc.core.geometry import quat_from_yaw
from uw_acoustic_loc.core.types import Odometry

T0, MS = 10**18, 1_000_000
RATE, SPEED = 0.3, 2.0


def on_circle(t):
    """Position, yaw at a time in s: to port, at RATE and SPEED."""
    radius, yaw = SPEED / RATE, RATE * t
    return np.array([radius * math.sin(yaw), radius * (1 - math.cos(yaw)), -5.0]), yaw


def odometry(ms, shift=0.0, turned=0.0):
    position, yaw = on_circle(ms * 1e-3)
    cos, sin = math.cos(turned), math.sin(turned)
    position = np.array([cos * position[0] - sin * position[1], sin * position[0] + cos * position[1], 0.0]) + shift
    twist = np.array([SPEED, 0.0, 0.0]), np.array([0.0, 0.0, RATE])
    return Odometry(T0 + ms * MS, position, quat_from_yaw(yaw + turned), *twist)


def circling(*ms, yaw=0.0, position=(0.0, 0.0, 0.0)):
    motion = ArrayMotion(yaw, position)
    for k in ms:
        motion.add(odometry(k))
    return motion


def expected(begin, end, yaw, position):
    """Move of the array in its axes at the beginning."""
    (p, a), (q, b) = on_circle(begin), on_circle(end)

    def array(at, heading):
        x, y = position[:2]
        cos, sin = math.cos(heading), math.sin(heading)
        return at[:2] + np.array([cos * x - sin * y, sin * x + cos * y])

    dx, dy = array(q, b) - array(p, a)
    cos, sin = math.cos(a + yaw), math.sin(a + yaw)
    return np.array([cos * dx + sin * dy, cos * dy - sin * dx])


@pytest.mark.parametrize("yaw", [0.0, 2.0])
@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (0.7, -0.4, 0.1)])
def test_turn_and_move_between_odometries(yaw, position):
    motion = circling(*range(0, 1001, 50), yaw=yaw, position=position)
    step = motion.between(T0 + 120 * MS, T0 + 730 * MS)
    assert step.turn == pytest.approx(RATE * 0.61, abs=1e-9)
    assert step.move == pytest.approx(expected(0.12, 0.73, yaw, position), abs=1e-3)
    assert step.guessed == pytest.approx(0.0, abs=1e-12)


def test_beyond_the_odometry_the_velocity_is_carried_on_for_half_a_second():
    motion = circling(0, 50, 100)
    step = motion.between(T0 + 50 * MS, T0 + 300 * MS)
    assert step.turn == pytest.approx(RATE * 0.25, abs=1e-9)
    assert step.guessed == pytest.approx(0.8)
    assert motion.between(T0 + 100 * MS, T0 + 5000 * MS).turn == pytest.approx(RATE * 0.5)
    assert circling(1000).between(T0 + 800 * MS, T0 + 900 * MS).guessed == 1.0


def test_without_odometry_all_is_guessed():
    step = ArrayMotion(0.0, (0.0, 0.0, 0.0)).between(T0, T0 + MS)
    assert (step.turn, step.move, step.guessed) == (0.0, (0.0, 0.0), 1.0)


def test_the_pose_counts_not_a_noisy_rate():
    motion, rng = ArrayMotion(0.0, (0.0, 0.0, 0.0)), np.random.default_rng(1)
    for ms in range(0, 1001, 50):
        o = odometry(ms)
        noisy = np.array([0.0, 0.0, RATE + 0.1 * rng.standard_normal()])
        motion.add(Odometry(o.t_ns, o.position, o.quat_xyzw, o.linear, noisy))
    assert motion.between(T0, T0 + 1000 * MS).turn == pytest.approx(RATE, abs=1e-9)


@pytest.mark.parametrize("jump", [{"shift": 50.0}, {"turned": 2.0}, {"shift": -20.0, "turned": -1.0}])
def test_a_reset_of_the_dead_reckoning_is_no_motion(jump):
    motion = circling(*range(0, 501, 50))
    for ms in range(550, 1001, 50):
        motion.add(odometry(ms, **jump))
    step = motion.between(T0 + 480 * MS, T0 + 900 * MS)
    assert step.turn == pytest.approx(RATE * 0.42, abs=1e-6)
    assert step.move == pytest.approx(expected(0.48, 0.9, 0.0, (0.0, 0.0)), abs=2e-3)


def test_old_odometry_is_left_out_and_what_is_not_finite_refused():
    motion = circling(0, 50, 100)
    motion.add(odometry(50))
    assert motion.between(T0, T0 + 100 * MS).turn == pytest.approx(RATE * 0.1)
    bad = Odometry(T0 + 150 * MS, np.array([math.nan, 0, 0]), quat_from_yaw(0.0), np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="odometry pose and twist must be finite"):
        motion.add(bad)
