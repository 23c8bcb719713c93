"""Bearings and odometry in, positions of the sources in odom out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, ClassVar

import numpy as np

from ..contract import ANY_ID, Emission, Input, Output, Stage, Status
from ..core.localizer.bearing_ekf_moving import MovingBearingEkf
from ..core.localizer.config import LocalizerConfig
from ..core.localizer.localizer import SourceLocalizer
from ..core.localizer.particles import BearingParticles
from ..core.localizer.reckoning import Reckoning
from ..core.localizer.triangulation import PlanarFix
from ..core.localizer.turn_advice import advice
from ..core.types import Bearing, Odometry, Particles, Position
from ..topics import known

_ODOMETRY, _BEARING = known("odometry"), known("sources/<id>/bearing")
_POSITION, _MIRROR = known("sources/<id>/position"), known("sources/<id>/mirror_position")
_PARTICLES = known("sources/<id>/particles")


class BearingLocalizerStage(Stage):
    """One SourceLocalizer per source, and the vehicle's pose carried to each bearing's stamp."""

    Config: ClassVar[type] = LocalizerConfig
    any_id: ClassVar[Mapping[str, Any]] = {"source_ids": [ANY_ID]}

    def __init__(self, config: LocalizerConfig) -> None:
        self._config = config
        self._sources = {name: SourceLocalizer(config, k) for k, name in enumerate(config.source_ids)}
        self._reckoning = Reckoning(config.odometry_timeout, config.odometry_jump)
        self._poses: dict[str, tuple[float, float, float]] = {}  # of the array at the last bearing
        self._heard_ns = 0
        self._cloud_ns: dict[str, int] = {}

    @property
    def inputs(self) -> tuple[Input, ...]:
        bearings = (_BEARING.input(partial(self._on_bearing, name), name, frame="base_link") for name in self._sources)
        return (_ODOMETRY.input(self._on_odometry, upstream=2), *bearings)

    @property
    def outputs(self) -> tuple[Output, ...]:
        rows = [_POSITION]
        rows += [_MIRROR] if self._config.mirror else []
        rows += [_PARTICLES] if self._config.method == "particle_filter" else []
        return tuple(row.output(name) for name in self._sources for row in rows)

    def status(self) -> Status:
        values: dict[str, float | int | str] = {
            "odometry_gaps": self._reckoning.gaps,
            "odometry_jumps": self._reckoning.resets,
            "odometry_glitches": self._reckoning.glitches,
        }
        for name, source in self._sources.items():
            values |= {f"{name}.{key}": value for key, value in _values(source).items()}
            if name in self._poses and (sentence := advice(source, *self._poses[name])):
                values[f"{name}.advice"] = sentence
        silent = [name for name, source in self._sources.items() if not source.sides]
        both = [name for name, source in self._sources.items() if len(source.sides) == 2]
        sentences = [*self._faults()]
        level = Status.WARN if sentences or silent else Status.OK
        if silent:
            sentences.append(f"no bearing yet of {', '.join(silent)}")
        if both:
            sentences.append(f"both sides remain possible of {', '.join(both)}")
        return Status(level, "; ".join(sentences) or "running", values)

    def _faults(self) -> Iterator[str]:
        """What is wrong with odometry, or made a source restart, as long as it is news."""
        for name, source in self._sources.items():
            if source.restarts and self._heard_ns - source.restart_ns < _NEWS_NS:
                yield f"{name} was restarted: {source.restart_reason}"
        last = self._reckoning.last
        if last is None:
            return
        behind = (self._heard_ns - last.t_ns) * 1e-9
        if behind > self._config.odometry_timeout:
            yield f"odometry stands {behind:.1f} s behind the bearings"
        if self._reckoning.notice and last.t_ns - self._reckoning.notice_ns < _NEWS_NS:
            yield self._reckoning.notice

    def change(self, config: LocalizerConfig) -> None:
        self._config = config
        for source in self._sources.values():
            source.config = config

    def _on_odometry(self, odometry: Odometry) -> Iterator[Emission]:
        self._reckoning.update(odometry)
        yield from ()

    def _on_bearing(self, name: str, bearing: Bearing) -> Iterator[Emission]:
        self._heard_ns = max(self._heard_ns, bearing.t_ns)
        position, yaw = self._reckoning.array_pose(bearing.t_ns, bearing.position)
        source = self._sources[name]
        x, y, z = position.tolist()
        source.update(bearing.t_ns, x, y, yaw, bearing.bearing, bearing.variance, self._reckoning.yaw_variance)
        self._poses[name] = x, y, yaw
        for topic, side in zip((_POSITION, _MIRROR), source.sides, strict=False):
            if (fix := side.fix) is not None:
                fix = self._reckoning.to_odom(fix)
                cov = fix.cov + self._reckoning.pose_cov_at(fix.mean)
                yield topic.named(name), _position(bearing.t_ns, PlanarFix(fix.mean, cov), z, self._frame)
        yield from self._cloud(name, bearing.t_ns, z)

    def _cloud(self, name: str, t_ns: int, z: float) -> Iterator[Emission]:
        estimator = self._sources[name].sides[0].estimator
        if not isinstance(estimator, BearingParticles) or t_ns - self._cloud_ns.get(name, 0) < _CLOUD_PERIOD_NS:
            return
        self._cloud_ns[name] = t_ns
        xy, weight = estimator.cloud(_CLOUD_SIZE)
        points = self._reckoning.points_to_odom(xy)
        x, y, z_all, w = (np.asarray(column, dtype=np.float32) for column in (*points, np.full(weight.size, z), weight))
        yield _PARTICLES.named(name), Particles(t_ns, x, y, z_all, w, self._frame)

    @property
    def _frame(self) -> str:
        """The odometry's."""
        return (self._reckoning.last and self._reckoning.last.frame_id) or "odom"


def _values(source: SourceLocalizer) -> dict[str, float | int | str]:
    values: dict[str, float | int | str] = {
        "used": source.used,
        "unused": source.unused,
        "restarts": source.restarts,
        "probability": 1 - source.mirror_probability,
        "mirror_probability": source.mirror_probability,
    }
    if source.sides:
        side = source.sides[0]
        values["nis"] = side.nis
        if (fix := side.fix) is not None:
            values["position_std_m"] = math.sqrt(fix.cov[0, 0] + fix.cov[1, 1])
        if isinstance(side.estimator, BearingParticles):
            values["ess"] = side.estimator.ess
        if isinstance(side.estimator, MovingBearingEkf):
            values["speed"] = math.hypot(*side.estimator.velocity)
    return values


def _position(t_ns: int, fix: PlanarFix, z: float, frame_id: str) -> Position:
    cov = np.zeros((3, 3))
    cov[:2, :2] = fix.cov
    cov[2, 2] = -1.0  # not observed
    return Position(t_ns, np.array([*fix.mean, z]), cov, frame_id)


_NEWS_NS = 30_000_000_000  # how long a fault of odometry is reported
_CLOUD_SIZE = 200
_CLOUD_PERIOD_NS = 500_000_000
