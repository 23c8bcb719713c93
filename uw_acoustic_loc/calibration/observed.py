"""The pings of a recorded run: what the bearing node's own listener hears in it, and where the vehicle was."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ..bag.definitions import decoded
from ..bag.reader import Bag
from ..bag.remap import RemappedBag
from ..config import changed
from ..contract import Emission, Input, Output, Stage
from ..core.bearing.config import BearingConfig
from ..core.bearing.estimator import BearingEstimator
from ..core.bearing.gcc import Correlation
from ..core.bearing.listener import Listener, check_frame
from ..core.pose_history import PoseHistory
from ..core.types import Array, HydrophoneInfo, Odometry, Samples
from ..resolved_graph import ResolvedStage
from ..stages.bearing import BearingStage
from ..stages.runner import Refusal, Runner

_WIDER = 1.0  # cycles of the lowest band beyond the largest lag that are looked at: offsets reach there
_LEAST_HEIGHT = 0.7  # of the strongest maximum; lower ones are not looked at
_CANDIDATES = 6


class Maxima(NamedTuple):
    """A ping's correlation maxima if the channels have equal or opposite polarity."""

    tdoas: Array  # (P,) s, padded by 0
    costs: Array  # (P,) minus their log-likelihood by height, relative to the best of both polarities; padded by inf
    std: float  # s


@dataclass(frozen=True, eq=False)
class ObservedPing:
    """One ping, with the pose of base_link in the odometry's frame."""

    source: int
    position: Array  # (3,) m
    rotation: Array  # (3, 3) from base_link
    alike: Maxima
    opposite: Maxima


@dataclass(frozen=True, eq=False)
class Observed:
    """All pings of a run in time order, and what the graph says of the array."""

    config: BearingConfig
    info: HydrophoneInfo
    pings: list[ObservedPing]

    @property
    def sound_speed(self) -> float:
        """m/s, as the bearing node takes it."""
        return self.config.array.sound_speed or self.info.sound_speed


def observe(
    bag: Bag | RemappedBag,
    node: ResolvedStage,
    still: bool,
    report: Callable[[Refusal], None],
    progress: Callable[[int], None],
) -> Observed:
    """Listens to a bag as the graph's bearing node would; a `still` vehicle needs no odometry.

    Raises:
        ValueError: the bag lacks samples, info or odometry, or its odometry is reset.
    """
    stage = node.make_stage()
    assert isinstance(stage, BearingStage)
    recorder = _Recorder(stage)
    runner = Runner(lambda: recorder, node.lateness, report, node.input_configs)
    for record in bag.records([*node.inputs]):
        progress(record.t_ns)
        wanted = node.inputs[record.topic]
        try:
            value = decoded(wanted.kind, record)
        except ValueError as error:
            runner.malformed(wanted.topic, str(error))
            continue
        runner.push(wanted.topic, value)
    runner.flush()
    if recorder.info is None or not recorder.frames:
        why = runner.idle_reason() or f"it has no samples on any of {', '.join(node.inputs)}"
        raise ValueError(f"bag {bag.path}: {why}")
    poses = _still(recorder.heard) if still else _poses(recorder, bag)
    pings = [_ping(*both, *pose) for both, pose in zip(recorder.heard, poses, strict=True)]
    return Observed(stage.config, recorder.info, pings)


_Both = tuple[int, int, Correlation, Correlation]  # source, stamp, and as heard with equal and opposite polarity


class _Recorder(Stage):
    """Has the inputs of the bearing node, and keeps what they say of the pings."""

    Config: ClassVar[type] = BearingConfig

    def __init__(self, stage: BearingStage) -> None:
        self._stage, self._config = stage, stage.config
        self.info: HydrophoneInfo | None = None
        self.history, self.odometry = PoseHistory(), list[Odometry]()
        self.heard: list[_Both] = []
        self.frames = 0
        self._listeners: list[Listener] = []

    @property
    def inputs(self) -> tuple[Input, ...]:
        handlers: dict[type, Callable[[Any], Iterator[Emission]]] = {
            HydrophoneInfo: self._on_info,
            Odometry: self._on_odometry,
            Samples: self._on_samples,
        }
        return tuple(replace(i, handle=handlers[i.kind]) for i in self._stage.inputs)

    @property
    def outputs(self) -> tuple[Output, ...]:
        return ()

    def check(self, config: BearingConfig) -> None:
        """Nothing changes within a run."""

    def change(self, config: BearingConfig) -> None:
        """As `check`."""

    def _on_info(self, info: HydrophoneInfo) -> Iterator[Emission]:
        """The array is taken to be wider than it is: offsets move maxima beyond the largest lag."""
        if self.info is not None and self.frames:
            raise ValueError("hydrophones/info changes within the run, calibrate on a part of the bag")
        c = self._config
        cycle = (c.array.sound_speed or info.sound_speed) / min(sum(band) / 2 for band in c.bands)
        wide = replace(info, spacing=info.spacing + _WIDER * cycle)
        raw = {"delay_offset": 0.0, "spacing_scale": 1.0}
        configs = [changed(c, **raw, invert=invert) for invert in ("none", "h1")]
        self._listeners = [BearingEstimator(config, wide).listener for config in configs]
        self.info = info
        yield from ()

    def _on_odometry(self, odometry: Odometry) -> Iterator[Emission]:
        if not self.odometry or odometry.t_ns > self.odometry[-1].t_ns:
            self.history.add(odometry)
            self.odometry.append(odometry)
        yield from ()

    def _on_samples(self, frame: Samples) -> Iterator[Emission]:
        check_frame(frame)
        c, self.frames = self._config, self.frames + 1
        ways = (c.detection.threshold, c.correlation.weighting, c.correlation.peaks)
        for a, b in zip(*(ear.hear(frame, *ways) for ear in self._listeners), strict=True):
            self.heard.append((a.source, a.t_ns + round(0.5e9 * a.length), a.correlation, b.correlation))
        yield from ()


def _still(heard: list[_Both]) -> Iterator[tuple[Array, Array]]:
    return ((np.zeros(3), np.eye(3)) for _ in heard)


def _poses(recorder: _Recorder, bag: Bag | RemappedBag) -> Iterator[tuple[Array, Array]]:
    """Positions and attitudes of base_link at the pings; those before or after all odometry take the nearest."""
    if len(recorder.odometry) < 2:
        raise ValueError(f"bag {bag.path}: odometry is needed, or --bearing for a pinger and a vehicle that lie still")
    if recorder.history.resets:
        raise ValueError(f"bag {bag.path}: the odometry is reset within the run, calibrate on a part of the bag")
    begin = recorder.odometry[0].t_ns
    times = np.array([(o.t_ns - begin) * 1e-9 for o in recorder.odometry])
    places = np.array([o.position for o in recorder.odometry])
    turns = Slerp(times, Rotation.from_quat(np.array([o.quat_xyzw for o in recorder.odometry])))
    at = np.clip([(t_ns - begin) * 1e-9 for _, t_ns, _, _ in recorder.heard], 0.0, times[-1])
    positions = np.stack([np.interp(at, times, axis) for axis in places.T], axis=1)
    return zip(positions, turns(at).as_matrix() if len(at) else (), strict=True)


def _ping(
    source: int, _t_ns: int, alike: Correlation, opposite: Correlation, place: Array, turn: Array
) -> ObservedPing:
    best = max(float(alike.values.max()), float(opposite.values.max()))
    return ObservedPing(source, place, turn, _maxima(alike, best), _maxima(opposite, best))


_HEIGHT_STD = 0.02  # of a maximum's relative height, by echoes


def _maxima(found: Correlation, best: float) -> Maxima:
    heights = found.heights * (float(found.values.max()) / best)
    likely = heights[:_CANDIDATES] > _LEAST_HEIGHT * heights[0]
    tdoas, costs = np.zeros(_CANDIDATES), np.full(_CANDIDATES, np.inf)
    n = int(likely.sum())
    spread = found.curvature * found.std**2 + _HEIGHT_STD
    tdoas[:n], costs[:n] = found.tdoas[:n], (1.0 - heights[:n]) / spread
    return Maxima(tdoas, costs, found.std)
