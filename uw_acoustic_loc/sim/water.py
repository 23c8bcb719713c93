"""The water of a scenario: what it is like, its boundaries, and its noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..config import param
from ..core.types import Array


@dataclass(frozen=True)
class Walls:
    """Four upright walls around a rectangular basin, which extends from the corner (x, y) to its own +x and +y."""

    x: float = param(unit="m")
    y: float = param(unit="m")
    length: float = param(unit="m", low=0.1, high=1000, doc="along its own x")
    width: float = param(unit="m", low=0.1, high=1000, doc="along its own y")
    yaw: float = param(0.0, unit="rad", low=-3.15, high=3.15, doc="of its own x in map")
    reflection: tuple[float, ...] = param(
        (0.7, 0.7, 0.7, 0.7),
        low=-1,
        high=1,
        length=4,
        doc="amplitude coefficients at the basin's x = 0, x = length, y = 0, y = width",
    )
    floor_db: float = param(
        -80.0,
        unit="dB",
        low=-200,
        high=0,
        doc="paths that are nowhere louder, re the source's level at 1 m, are left out",
    )

    def __post_init__(self) -> None:
        if len(self.reflection) != 4:
            raise ValueError(f"reflection must have 4 elements, got {len(self.reflection)}")

    def to_basin(self, points: Array) -> Array:
        """(3, n) points (3, n) of the map in the basin's own frame."""
        x, y, z = points[0] - self.x, points[1] - self.y, points[2]
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return np.stack([cos * x + sin * y, cos * y - sin * x, z])

    def to_map(self, points: Array) -> Array:
        """(3, n) points (3, n) of the basin's own frame in map."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        x, y, z = points
        return np.stack([self.x + cos * x - sin * y, self.y + sin * x + cos * y, z])


@dataclass(frozen=True)
class Environment:
    """The water and what is heard in it when nothing pings."""

    sound_speed: float = param(1500.0, unit="m/s", low=1350, high=1650, doc="mean")
    sound_speed_walk: float = param(0.3, unit="m/s per sqrt(s)", low=0, doc="random walk of the true sound speed")
    sound_speed_range: float = param(2.0, unit="m/s", low=0, doc="the walk stays within mean +- this")
    sound_speed_gradient: float = param(
        0.0, unit="1/s", low=-1, high=1, doc="with depth, for the buoys' arrivals; sound_speed is then that at z = 0"
    )
    depth: float = param(40.0, unit="m", low=1, doc="flat seabed, below the surface at z = 0")
    surface_reflection: float = param(-0.7, low=-1, high=1, doc="amplitude coefficient")
    bottom_reflection: float = param(0.4, low=-1, high=1, doc="amplitude coefficient")
    reflections: int = param(1, low=0, high=20, doc="most bounces that a path may have")
    walls: Walls | None = param(None, doc="of a basin; left out = open water")
    temperature: float = param(12.0, unit="deg C", low=-2, high=40, doc="for the absorption")
    salinity: float = param(35.0, unit="psu", low=0, high=45, doc="for the absorption")
    ph: float = param(8.0, low=7, high=9, doc="for the absorption")
    ambient_level: float = param(0.0, unit="dB re 1 uPa^2/Hz at 1 kHz", low=0, high=200, doc="0 = none")
    ambient_slope: float = param(-17.0, unit="dB/decade", low=-60, high=0, doc="above 1 kHz (Wenz 1962); flat below")
    snap_rate: float = param(0.0, unit="1/s", low=0, high=1e4, doc="snaps of shrimp, from all directions")
    snap_alpha: float = param(1.7, low=0.1, high=2, doc="characteristic exponent of the snaps' amplitudes")
    snap_scale: float = param(1.0, unit="Pa", low=1e-9, doc="scale of the snaps' amplitudes at the array")

    def check_inside(self, name: str, place: tuple[float, float, float]) -> None:
        """Raises ValueError unless a place in map is in the water, and within the walls of a basin."""
        if not -self.depth <= place[2] <= 0.0:
            raise ValueError(f"{name} must lie between the seabed at {-self.depth:g} m and 0 m, got {place[2]:g} m")
        walls = self.walls
        if walls is not None:
            x, y, _ = walls.to_basin(np.array(place))
            if not (0.0 < x < walls.length and 0.0 < y < walls.width):
                raise ValueError(
                    f"{name} must lie within the walls, {walls.length:g} m x {walls.width:g} m, got "
                    f"({place[0]:g}, {place[1]:g}), which is at ({x:.4g}, {y:.4g}) from their corner"
                )
