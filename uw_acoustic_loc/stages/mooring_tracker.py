"""Measured offsets of moored buoys in, filtered offsets and velocities out."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, ClassVar

import numpy as np

from ..contract import ANY_ID, Emission, Input, Output, Stage, Status
from ..core.mooring.estimator import (
    KalmanMooring,
    MooringConfig,
    MooringEstimate,
    ParticleMooring,
    make_filter,
    step_of,
)
from ..core.mooring.noise_learning import LearntNoise
from ..core.types import Array, Odometry, Point
from ..topics import known

_OFFSET, _ODOMETRY = known("mooring/<id>/offset"), known("mooring/<id>/odometry")

UNKNOWN_VARIANCE = 1e6  # of everything but the offset and its velocity


class MooringTrackerStage(Stage):
    """One filter per mooring; the time steps are those between the stamps.

    Of the odometry only x is estimated: position.x the offset, linear.x its velocity, both along the x of map.
    """

    Config: ClassVar[type] = MooringConfig
    any_id: ClassVar[Mapping[str, Any]] = {"mooring_ids": [ANY_ID]}

    def __init__(self, config: MooringConfig) -> None:
        self._config = config
        self._filters = {name: self._begun(name) for name in config.mooring_ids}
        self._restarts: Counter[str] = Counter()
        self._t_ns: dict[str, int] = {}
        self._values: dict[str, float | int | str] = {}
        self._gated: Counter[str] = Counter()

    @property
    def inputs(self) -> tuple[Input, ...]:
        return tuple(_OFFSET.input(partial(self._on_offset, name), name, frame="map") for name in self._filters)

    @property
    def outputs(self) -> tuple[Output, ...]:
        return tuple(_ODOMETRY.output(name) for name in self._filters)

    def status(self) -> Status:
        silent = [name for name in self._filters if name not in self._t_ns]
        values = self._values | {f"{name}.gated": count for name, count in self._gated.items()}
        values |= {f"{name}.restarts": count for name, count in self._restarts.items()}
        if silent:
            return Status(Status.WARN, f"no offset yet of {', '.join(silent)}", values)
        return Status(Status.OK, "running", values)

    def change(self, config: MooringConfig) -> None:
        self._config = config
        for mooring in self._filters.values():
            mooring.change(config)

    def _on_offset(self, name: str, measured: Point) -> Iterator[Emission]:
        offset, t_ns = float(measured.position[0]), measured.t_ns
        if not math.isfinite(offset):
            raise ValueError(f"offset of mooring {name} must be finite, got {offset}")
        dt = (t_ns - self._t_ns.get(name, t_ns)) * 1e-9
        if dt < 0 or t_ns == self._t_ns.get(name):
            raise ValueError(f"offset of mooring {name} must be newer than the last one, got {dt} s")
        mooring = self._filters[name]
        if dt > 0:
            mooring.predict(step_of(self._config, dt))
        estimate = mooring.update(np.array([offset]))
        self._t_ns[name] = t_ns
        mean, cov = estimate.mean[:, 0], estimate.cov[:, :, 0]
        if not (abs(mean[0]) <= self._config.max_offset and np.isfinite(cov).all() and min(cov[0, 0], cov[1, 1]) >= 0):
            self._filters[name] = self._begun(name)
            self._restarts[name] += 1
            raise ValueError(
                f"offset of mooring {name} must keep its filter within max_offset {self._config.max_offset:g} m, "
                f"{offset:g} m put it at {mean[0]:g} m: it restarts"
            )
        self._note(name, offset, estimate)
        yield _ODOMETRY.named(name), _odometry(t_ns, name, mean, cov)

    def _begun(self, name: str) -> KalmanMooring | ParticleMooring:
        return make_filter(
            self._config, np.random.default_rng([self._config.seed, self._config.mooring_ids.index(name)])
        )

    def _note(self, name: str, offset: float, estimate: MooringEstimate) -> None:
        self._gated[name] += int(estimate.rejected[0])
        self._values[f"{name}.residual_m"] = offset - float(estimate.mean[0, 0])
        self._values[f"{name}.std_m"] = math.sqrt(float(estimate.cov[0, 0, 0]))
        mooring = self._filters[name]
        if isinstance(mooring, ParticleMooring):
            self._values[f"{name}.ess"] = float(estimate.ess[0])
            if isinstance(mooring.noise, LearntNoise):
                std, fraction = mooring.noise.mean[:, 0].tolist()
                self._values |= {f"{name}.noise_std_m": std, f"{name}.impulse_fraction": fraction}


def _odometry(t_ns: int, name: str, mean: Array, cov: Array) -> Odometry:
    along = np.array([1.0, 0.0, 0.0])
    quat = np.array([0.0, 0.0, 0.0, 1.0])
    pose_cov, twist_cov = _only_x(cov[0, 0]), _only_x(cov[1, 1])
    return Odometry(
        t_ns, mean[0] * along, quat, mean[1] * along, np.zeros(3), pose_cov, twist_cov, "map", f"mooring/{name}"
    )


def _only_x(variance: float) -> Array:
    return np.diag([float(variance)] + [UNKNOWN_VARIANCE] * 5)
