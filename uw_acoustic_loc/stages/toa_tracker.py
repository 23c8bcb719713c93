"""Arrivals of a ping at buoys in, the target's motion and the sound speed out."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from functools import partial
from typing import ClassVar

import numpy as np

from ..contract import Emission, Input, Output, Stage, Status
from ..core.toa.config import ToaConfig
from ..core.toa.model import STATES, height_from_pressure
from ..core.toa.paths import REASONS, ReceiverNet, make_net
from ..core.toa.pressure_check import PressureCheck
from ..core.toa.tracker import ToaEstimate, ToaTracker
from ..core.types import Array, Arrivals, NodePositions, Odometry, Pressure, Scalar
from ..topics import known
from .node_positions import merged, of_role

_POSITIONS, _ARRIVALS = known("buoys/positions"), known("buoys/arrivals")
_PRESSURE, _MOORING = known("pressure"), known("mooring/<id>/odometry")
_ODOMETRY, _PATHS = known("target/odometry"), known("target/arrival_paths")
_SOUND_SPEED, _SOUND_SPEED_STD = known("target/sound_speed"), known("target/sound_speed_std")

UNKNOWN_VARIANCE = 1e6  # rad^2, rad^2/s^2: of the vehicle's attitude and turn rate
CHILD_FRAME = "target_enu"
_SECOND_NS = 60_000_000_000  # after its last ping a second target is forgotten


class ToaTrackerStage(Stage):
    """One ToaTracker; the receivers come from the parameters, or else from `buoys/positions`, put together by id.

    Arrivals show where the target is and not how it lies. The child frame is therefore not the vehicle's `base_link`
    but `target_enu` (REP-103's suffix), which is at the target with the axes of map: pose and twist are what they say.
    """

    Config: ClassVar[type] = ToaConfig

    def __init__(self, config: ToaConfig) -> None:
        self._config = config
        self._positions: NodePositions | None = None
        self._nodes: tuple[list[int], Array] | None = None
        self._swayed: dict[int, tuple[float, float]] = {}  # offset along x and its variance, by receiver
        self._tracker: ToaTracker | None = None
        self._last: ToaEstimate | None = None
        self._unused = 0
        self._refused: Counter[str] = Counter()  # rows of the last message
        self._pressure = PressureCheck()
        if config.receivers.receiver_ids:
            self._use(list(config.receivers.receiver_ids), np.array(config.receivers.receiver_positions).reshape(-1, 3))

    @property
    def inputs(self) -> tuple[Input, ...]:
        rewind = self._config.rewind
        arrivals = _ARRIVALS.input(self._on_arrivals, frame="map", rewind=rewind)
        inputs = [arrivals]
        if self._config.pressure.pressure_std > 0:
            inputs.insert(0, _PRESSURE.input(self._on_pressure))
        receivers = self._config.receivers
        for name, receiver in zip(receivers.mooring_ids, receivers.mooring_receivers, strict=True):
            inputs.insert(0, _MOORING.input(partial(self._on_mooring, receiver), name, frame="map"))
        if not receivers.receiver_ids:
            latched = not receivers.moving_receivers
            inputs.insert(0, _POSITIONS.input(self._on_positions, frame="map", latched=latched, merge=merged))
        return tuple(inputs)

    @property
    def outputs(self) -> tuple[Output, ...]:
        return tuple(row.output() for row in (_ODOMETRY, _SOUND_SPEED, _SOUND_SPEED_STD, _PATHS))

    def status(self) -> Status:
        if self._tracker is None:
            return Status(Status.WARN, "waiting for buoys/positions")
        values: dict[str, float | int | str] = dict(self._tracker.counts)
        values["epochs_without_estimate"] = self._unused
        if self._last:
            values["last_used"], values["last_rejected"] = self._last.used, self._last.rejected
            values["nis_per_arrival"] = self._last.nis / max(self._last.used, 1)
            values["position_std_m"] = math.sqrt(float(np.trace(self._last.cov[:3, :3])))
            for name, offset in zip(self._nodes[0] if self._nodes else (), self._last.mean[STATES:], strict=False):
                values[f"clock_offset_s.{name}"] = float(offset)
                if self._config.receivers.range_bias_std > 0:
                    values[f"range_bias_m.{name}"] = float(offset * self._last.mean[6])
        warnings = [*self._row_warnings(), *self._pressure.warnings, *self._second_warnings()]
        doing = "tracking" if self._tracker.tracking else "acquiring the target"
        if self._tracker.counts["std_not_given"]:
            doing += f" (arrivals without a std are taken to have {self._config.arrivals.arrival_std:g} s)"
        level = Status.OK if self._tracker.tracking and not warnings else Status.WARN
        return Status(level, "; ".join([doing, *warnings]), values)

    def _row_warnings(self) -> list[str]:
        if not self._refused:
            return []
        rows = ", ".join(f"{count} {reason}" for reason, count in self._refused.items())
        return [f"rows of the last message that were not used: {rows}"]

    def _second_warnings(self) -> list[str]:
        second = self._tracker.second if self._tracker else None
        if second is None or self._last is None or self._last.t_ns - second[0] > _SECOND_NS:
            return []
        x, y, z = second[1]
        return [f"some pings fit another target at ({x:.0f}, {y:.0f}, {z:.0f}) m: two vehicles on one topic?"]

    def change(self, config: ToaConfig) -> None:
        self._config = config
        self._refresh()

    def _on_positions(self, nodes: NodePositions) -> Iterator[Emission]:
        together = merged(self._positions, nodes)
        self._use(*of_role(together, NodePositions.RECEIVER))
        self._positions = together
        yield from ()

    def _on_mooring(self, receiver: int, moved: Odometry) -> Iterator[Emission]:
        offset, variance = float(moved.position[0]), float(moved.pose_cov[0, 0])
        if not (math.isfinite(offset) and 0 <= variance < math.inf):
            raise ValueError(f"offset of receiver {receiver} must be finite with a variance, got {offset}, {variance}")
        self._swayed[receiver] = (offset, variance)
        self._refresh()
        yield from ()

    def _on_pressure(self, measured: Pressure) -> Iterator[Emission]:
        self._pressure.admit(measured.pressure, self._config)
        if self._tracker:
            z, variance = height_from_pressure(measured.pressure, measured.variance, self._config.pressure)
            self._tracker.measure_height(measured.t_ns, z, variance)
            self._pressure.measure_height(measured.t_ns, z, variance)
        yield from ()

    def _use(self, ids: list[int], positions: Array) -> None:
        make_net(ids, positions, self._config.water.bottom_depth)  # refuses what is wrong before anything is kept
        self._nodes = (ids, positions)
        self._refresh()

    def _refresh(self) -> None:
        """Parameters, receivers and what their moorings say, from now on."""
        if self._nodes is None:
            return
        net = self._net(*self._nodes)
        if self._tracker:
            self._tracker.change(self._config, net)
        else:
            self._tracker = ToaTracker(self._config, net)
        self._pressure.use(self._config, net)

    def _net(self, ids: list[int], positions: Array) -> ReceiverNet:
        swayed = np.array([self._swayed.get(name, (0.0, 0.0)) for name in ids])
        moved = positions + np.outer(swayed[:, 0], [1.0, 0.0, 0.0])
        return make_net(ids, moved, self._config.water.bottom_depth, swayed[:, 1])

    def _on_arrivals(self, arrivals: Arrivals) -> Iterator[Emission]:
        if self._tracker is None:
            raise ValueError("arrivals refused: no buoys/positions yet")
        before = self._tracker.counts
        estimate = self._tracker.update(arrivals)
        self._refused = Counter({r: n for r, n in (self._tracker.counts - before).items() if r in REASONS})
        self._pressure.compare(arrivals, estimate)
        if estimate is None:
            self._unused += 1
            return
        self._last = estimate
        yield _ODOMETRY.name, _odometry(estimate)
        yield _SOUND_SPEED.name, Scalar(estimate.t_ns, float(estimate.mean[6]))
        yield _SOUND_SPEED_STD.name, Scalar(estimate.t_ns, math.sqrt(float(estimate.cov[6, 6])))
        if estimate.paths:
            yield _PATHS.name, estimate.paths


def _odometry(estimate: ToaEstimate) -> Odometry:
    mean, cov = estimate.mean, estimate.cov
    pose_cov, twist_cov = _with_unknown_angles(cov[:3, :3]), _with_unknown_angles(cov[3:6, 3:6])
    quat = np.array([0.0, 0.0, 0.0, 1.0])
    return Odometry(
        estimate.t_ns, mean[:3].copy(), quat, mean[3:6].copy(), np.zeros(3), pose_cov, twist_cov, "map", CHILD_FRAME
    )


def _with_unknown_angles(cov: Array) -> Array:
    whole = np.diag([0.0, 0.0, 0.0, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE])
    whole[:3, :3] = cov
    return whole
