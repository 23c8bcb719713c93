"""A run whose truth is known: a vehicle that starts at (10, -20, -5) heading north, estimates with drawn errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from uw_acoustic_loc.bag.rosbags_messages import BagMake, serialize
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.core.geometry import quat_from_yaw, wrap_angle
from uw_acoustic_loc.core.types import (
    Array,
    Bearing,
    NodePositions,
    Odometry,
    Point,
    Position,
    Scalar,
    Tracks,
)
from uw_acoustic_loc.sim.scenario import Vehicle, Waypoint
from uw_acoustic_loc.sim.trajectory import Motion, Trajectory
from uw_acoustic_loc.wire.codec import codec

START_NS = 1_780_272_000_000_000_000
SOURCES = {"a": np.array([-10.0, 10.0, -6.0]), "b": np.array([40.0, 15.0, -4.0])}
BEARING_STD = 0.01  # rad
COV = np.diag([0.25, 0.01, 0.04])  # in odom: far wider ahead of the start than across
TOA_COV = np.array([[1.0, 0.3, 0.0], [0.3, 0.5, 0.0], [0.0, 0.0, 4.0]])
FIX_COV = np.array([[900.0, 200.0], [200.0, 400.0]])
SPEED_STD, MOORING_STD, OFFSET_STD = 0.5, 0.1, 2.0
LATENCY_NS = 40_000_000

Event = tuple[int, str, object]  # log time, topic, core value
TRUTH = Trajectory(
    Vehicle(waypoints=(Waypoint(10.0, -20.0), Waypoint(10.0, 40.0), Waypoint(-30.0, 40.0)), speed=1.5, z=-5.0)
)


def write_bag(path: Path, events: Iterable[Event]) -> Path:
    with BagWriter(path) as writer:
        for logged, topic, value in sorted(events, key=lambda event: event[0]):
            form = codec(type(value))
            writer.add_topic(topic, form.msgtype)
            writer.write(topic, logged, serialize(form.encode(BagMake(), value), form.msgtype))
    return path


def t_ns(time: float) -> int:
    return START_NS + round(time * 1e9)


def times(rate: float, duration: float = 60.0) -> Array:
    return np.arange(round(duration * rate) + 1) / rate


def in_odom(positions: Array) -> Array:
    """Positions (n, 3) of map in odom: less the start, turned back by the first heading of 90 degrees."""
    x, y, z = (positions - [10.0, -20.0, -5.0]).T
    return np.stack([y, -x, z], axis=1)


def pose(time: float) -> tuple[Array, float]:
    motion: Motion = TRUTH.at(time)
    return motion.positions[:, 0], float(motion.yaw[0])


def odometry(time: float, position: Array, yaw: float, cov: Array, frame: str) -> Odometry:
    pose_cov = np.zeros((6, 6))
    pose_cov[:3, :3] = cov
    still = np.zeros(3)
    return Odometry(t_ns(time), position, quat_from_yaw(yaw), still, still, pose_cov, frame_id=frame)


def truth(space: str = "/auv1") -> Iterator[Event]:
    for time in times(10):
        yield t_ns(time), f"/truth{space}/odometry", odometry(time, *pose(time), np.zeros((3, 3)), "map")
    for name, position in SOURCES.items():
        yield t_ns(0), f"/truth/sources/{name}/position", Point(t_ns(0), position)


def bearings(rng: np.random.Generator, space: str = "/auv1") -> Iterator[Event]:
    array = np.array([0.5, 0.2, 0.0])
    for name, source in SOURCES.items():
        for time in times(5, 59):
            position, yaw = pose(time + 0.013)
            cos, sin = np.cos(yaw), np.sin(yaw)
            east, north = source[:2] - position[:2]
            ahead, port = cos * east + sin * north - array[0], cos * north - sin * east - array[1]
            bearing = wrap_angle(np.arctan2(port, ahead) + rng.normal(0.0, BEARING_STD))
            value = Bearing(t_ns(time + 0.013), bearing, BEARING_STD**2, array)
            yield value.t_ns + LATENCY_NS, f"{space}/sources/{name}/bearing", value


def localizer(rng: np.random.Generator, space: str = "/auv1") -> Iterator[Event]:
    for name, source in SOURCES.items():
        for time in times(5):
            drawn = in_odom(source[None])[0] + rng.multivariate_normal(np.zeros(3), COV)
            yield t_ns(time), f"{space}/sources/{name}/position", Position(t_ns(time), drawn, COV)
            yield t_ns(time), f"{space}/sources/{name}/mirror_position", Position(t_ns(time), drawn + 50.0, COV)


def dead_reckoning(space: str = "/auv1", begin: float = 0.0) -> Iterator[Event]:
    """Drifts by 0.1 m/s to the side of the start's heading."""
    for time in times(10):
        position, yaw = pose(time)
        drift = np.array([0.0, 0.1 * (time - begin), 0.0])
        if time >= begin:
            value = odometry(time, in_odom(position[None])[0] + drift, yaw - np.pi / 2, COV, "odom")
            yield t_ns(time), f"{space}/odometry", value


def slam(rng: np.random.Generator, space: str = "/auv1") -> Iterator[Event]:
    for time in times(5):
        position, yaw = pose(time)
        drawn = in_odom(position[None])[0] + rng.multivariate_normal(np.zeros(3), COV)
        yield t_ns(time), f"{space}/slam/odometry", odometry(time, drawn, yaw - np.pi / 2, COV, "odom")
        for name, source in SOURCES.items():
            fixed = Position(t_ns(time), in_odom(source[None])[0] + [0.3, -0.4, 9.0], COV)
            yield t_ns(time), f"{space}/slam/sources/{name}/position", fixed


def toa(rng: np.random.Generator) -> Iterator[Event]:
    for k, time in enumerate(times(1)):
        position, yaw = pose(time)
        speed = 1500.0 + k
        yield t_ns(time), "/truth/target/odometry", odometry(time, position, yaw, np.zeros((3, 3)), "map")
        yield t_ns(time), "/truth/target/sound_speed", Scalar(0, speed)
        drawn = position + rng.multivariate_normal(np.zeros(3), TOA_COV)
        said = t_ns(time + 0.4)
        yield said, "/target/odometry", odometry(time, drawn, 0.0, TOA_COV, "map")
        yield said, "/target/sound_speed", Scalar(0, speed + rng.normal(0.0, SPEED_STD))
        yield said, "/target/sound_speed_std", Scalar(0, SPEED_STD)


def sonar(rng: np.random.Generator) -> Iterator[Event]:
    """Two targets; each fix is of the first, where the ping met it: 3000 m away at 1500 m/s, 2 s after the stamp."""
    node = {"id": np.array([0, 1], np.uint16), "role": np.array([1, 0], np.uint8)}
    yield t_ns(0), "/sonar/positions", NodePositions(t_ns(0), **node, x=np.zeros(2), y=np.zeros(2), z=np.zeros(2))
    cov = np.diag([0.0, 0.0, -1.0])
    cov[:2, :2] = FIX_COV
    for k in range(100):
        stamp, zero = t_ns(4 * k), np.zeros(2)
        x, y = np.array([3000.0, -3000.0]), np.array([-2.0 * 5.0, 0.0])
        yield stamp, "/truth/sonar/targets", tracks(stamp, [7, 8], x, y, np.array([5.0, 0.0]), zero)
        met = np.array([3000.0, 0.0, 0.0])
        met[:2] += rng.multivariate_normal(np.zeros(2), FIX_COV)
        yield stamp, "/sonar/fix", Position(stamp, met, cov, "map")
        yield stamp, "/sonar/tracks", tracks(stamp, [1 + k // 50], x[:1], y[:1], zero[:1], zero[:1])


def tracks(stamp: int, ids: list[int], x: Array, y: Array, vy: Array, zero: Array) -> Tracks:
    return Tracks(stamp, np.array(ids, np.uint16), x, y, zero, zero, vy, zero, zero)


def mooring(rng: np.random.Generator) -> Iterator[Event]:
    for time in times(2, 500):
        along = np.array([1.0, 0.0, 0.0])
        offset = float(np.sin(time))
        truth = odometry(time, offset * along, 0.0, np.zeros((3, 3)), "map")
        estimate = (offset + 0.02 + rng.normal(0.0, MOORING_STD)) * along
        yield t_ns(time), "/truth/mooring/m1/odometry", truth
        yield t_ns(time), "/mooring/m1/odometry", odometry(time, estimate, 0.0, MOORING_STD**2 * np.eye(3), "map")
        measured = (offset + rng.normal(0.0, OFFSET_STD)) * along
        yield t_ns(time), "/mooring/m1/offset", Point(t_ns(time), measured)


def everything(seed: int = 1) -> list[Event]:
    rng = np.random.default_rng(seed)
    vehicle = [*truth(), *bearings(rng), *localizer(rng), *dead_reckoning(), *slam(rng)]
    return [*vehicle, *toa(rng), *sonar(rng), *mooring(rng)]
