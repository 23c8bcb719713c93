"""Where the vehicle truly is: constant speed and depth along waypoints with rounded corners."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.geometry import wrap_angles
from ..core.types import Array
from .scenario import Vehicle


@dataclass(frozen=True, eq=False)
class Motion:
    """True motion at n instants."""

    positions: Array  # (3, n) map, m
    yaw: Array  # (n,) rad
    speed: Array  # (n,) m/s along body x
    yaw_rate: Array  # (n,) rad/s


class Trajectory:
    """A path as a chain of arcs, straight lines having curvature 0; past its end the vehicle stands still.

    Raises:
        ValueError: fewer than two waypoints, a repeated waypoint, or a leg too short for its turns.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        points = np.array([[w.x, w.y] for w in vehicle.waypoints])
        if len(points) < 2:
            raise ValueError(f"vehicle: waypoints must have at least 2 points, got {len(points)}")
        self._speed, self._z = vehicle.speed, vehicle.z
        lengths, curvatures = _arcs(points, vehicle.turn_radius)
        self._starts = np.concatenate([[0.0], np.cumsum(lengths)])
        self._curvatures = np.append(curvatures, 0.0)
        heading = math.atan2(*(points[1] - points[0])[::-1])
        self._headings = heading + np.concatenate([[0.0], np.cumsum(lengths * curvatures)])
        self._points = _chain(points[0], lengths, self._headings, curvatures)

    @property
    def duration(self) -> float:
        """Time in s to the last waypoint."""
        return float(self._starts[-1] / self._speed)

    def travelled(self, time: Array) -> Array:
        """(n,) m since the start along the path, at times (n,)."""
        return np.asarray(np.clip(time * self._speed, 0.0, self._starts[-1]))

    def at(self, time: Array | float) -> Motion:
        """Returns the motion at times in s after the start, scalar or (n,)."""
        time = np.atleast_1d(np.asarray(time, dtype=float))
        travelled = self.travelled(time)
        moving = (time >= 0) & (time * self._speed <= self._starts[-1])
        k = np.clip(np.searchsorted(self._starts, travelled, side="right") - 1, 0, len(self._starts) - 2)
        along, curvature, heading = travelled - self._starts[k], self._curvatures[k], self._headings[k]
        xy = self._points[k].T + _step(heading, curvature, along)
        speed = np.where(moving, self._speed, 0.0)
        positions = np.vstack([xy, np.full(time.shape, self._z)])
        return Motion(positions, wrap_angles(heading + curvature * along), speed, curvature * speed)


def _arcs(points: Array, radius: float) -> tuple[Array, Array]:
    """Returns lengths and curvatures of legs and corners in turn."""
    legs = np.diff(points, axis=0)
    leg_lengths = np.hypot(*legs.T)
    if np.any(leg_lengths == 0):
        raise ValueError(f"vehicle: waypoint {int(np.argmin(leg_lengths)) + 1} repeats the one before it")
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    turns = wrap_angles(np.diff(headings))
    if np.any(np.abs(turns) > math.radians(175)):
        raise ValueError("vehicle: waypoints must not double back, a turn may be at most 175 degrees")
    cut = np.concatenate([[0.0], radius * np.tan(np.abs(turns) / 2), [0.0]])
    straight = leg_lengths - cut[:-1] - cut[1:]
    if np.any(straight < 0):
        raise ValueError(f"vehicle: leg {int(np.argmin(straight)) + 1} is too short for a turn_radius of {radius:g} m")
    lengths, curvatures = [straight[0]], [0.0]
    for turn, leg in zip(turns, straight[1:], strict=True):
        lengths += [radius * abs(turn), leg]
        curvatures += [math.copysign(1 / radius, turn), 0.0]
    return np.array(lengths), np.array(curvatures)


def _chain(start: Array, lengths: Array, headings: Array, curvatures: Array) -> Array:
    """Returns the start points (K + 1, 2) of the arcs, and the end."""
    steps = _step(headings[:-1], curvatures, lengths)
    return np.vstack([start, start + np.cumsum(steps.T, axis=0)])


def _step(heading: Array, curvature: Array, along: Array) -> Array:
    """Returns the displacement (2, n) along an arc: its chord, turned by half the change of heading."""
    half = curvature * along / 2
    chord = along * np.sinc(half / np.pi)
    return np.stack([chord * np.cos(heading + half), chord * np.sin(heading + half)])
