"""multistatic_fusion: detections of a sonar net -> single-ping fixes and tracks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import ClassVar

import numpy as np

from ..contract import Emission, Input, Output, Stage, Status
from ..core.multistatic.estimator import SonarNet
from ..core.multistatic.fusion import Echoes, Fusion, MultistaticConfig, PingScan, TargetFix
from ..core.multistatic.track import Track, Tracker
from ..core.types import AnyArray, Array, Detections, NodePositions, Position, Tracks
from ..topics import known

_POSITIONS, _DETECTIONS = known("sonar/positions"), known("sonar/detections")
_FIX, _TRACKS = known("sonar/fix"), known("sonar/tracks")


class MultistaticFusionStage(Stage):
    """One message of detections per ping gives the strongest target's fix, if there is one, and all confirmed tracks.

    A fix is where the ping met the target, up to a few seconds after the stamp; tracks are at the stamp itself.
    The net comes from the parameters, or else from `sonar/positions`, which may be sent again when a receiver is added,
    moved or lost; tracks live on. A ping's message does not say who sent it: a net with several transmitters takes a
    node for each. Depth is not observed: z is the transmitter's, of unknown (-1) variance.
    """

    Config: ClassVar[type] = MultistaticConfig

    def __init__(self, config: MultistaticConfig) -> None:
        self._config = config
        self._tracker = Tracker(config.rules)
        self._fusion: Fusion | None = None
        self._ids: AnyArray = np.array([], dtype=int)
        self._z = 0.0
        self._counts: Counter[str] = Counter()
        self._rejected: Counter[str] = Counter()
        self._last_rejected: Counter[str] = Counter()
        self._nis_sum = 0.0
        if config.receiver_ids:
            self._on_positions(_given(config))

    @property
    def inputs(self) -> tuple[Input, ...]:
        detections = _DETECTIONS.input(self._on_detections, frame="map")
        if self._config.receiver_ids:
            return (detections,)
        return (_POSITIONS.input(self._on_positions, frame="map"), detections)

    @property
    def outputs(self) -> tuple[Output, ...]:
        return (_FIX.output(), _TRACKS.output())

    def status(self) -> Status:
        values: dict[str, float | int | str] = {
            name: self._counts[name] for name in ("pings", "detections", "fixes", "nis_count")
        }
        values |= {f"rejected_{name}": count for name, count in self._rejected.items()}
        values |= {"tracks": len(self._tracker.confirmed), "tentative": self._tracker.tentative}
        if self._counts["nis_count"]:
            values["nis_mean"] = self._nis_sum / self._counts["nis_count"]
        if self._last_rejected:
            what = ", ".join(f"{count} by {name}" for name, count in self._last_rejected.items())
            return Status(Status.WARN, f"detections rejected in the last ping: {what}", values)
        return Status(values=values)

    def change(self, config: MultistaticConfig) -> None:
        self._config = config
        self._tracker.rules = config.rules
        if self._fusion:
            self._fusion = Fusion(self._fusion.net, config)

    def _on_positions(self, nodes: NodePositions) -> Iterable[Emission]:
        net, ids, z = _net(nodes)
        self._fusion = Fusion(net, self._config)
        self._ids, self._z = ids, z
        return ()

    def _on_detections(self, detections: Detections) -> Iterator[Emission]:
        if self._fusion is None:
            raise ValueError("detections came before sonar/positions")
        echoes, rejected = usable(detections, self._ids)
        fix = next(self._fusion.fixes(echoes), None)
        tracks = self._tracker.step(detections.t_ns, PingScan(self._fusion, echoes))
        self._count(len(echoes.range), fix is not None, rejected)
        if fix:
            yield _FIX.name, self._position(detections.t_ns, fix)
        yield _TRACKS.name, as_tracks(detections.t_ns, tracks, self._z)

    def _count(self, used: int, fixes: int, rejected: Counter[str]) -> None:
        nis = self._tracker.nis
        self._counts.update(pings=1, detections=used, fixes=fixes, nis_count=len(nis))
        self._rejected.update(rejected)
        self._last_rejected = rejected
        self._nis_sum += sum(nis)

    def _position(self, t_ns: int, fix: TargetFix) -> Position:
        cov = np.zeros((3, 3))
        cov[:2, :2], cov[2, 2] = fix.cov, -1.0
        return Position(t_ns, np.array([*fix.position, self._z]), cov, frame_id="map")


def usable(detections: Detections, receiver_ids: AnyArray) -> tuple[Echoes, Counter[str]]:
    """The rows that can be used, `receiver` as index into `receiver_ids`; and how many not, by what is wrong first."""
    d = detections
    known = d.receiver[:, None] == receiver_ids
    checks = {
        "unknown_receiver": known.any(axis=1),
        "range": np.isfinite(d.range) & (d.range > 0),
        "range_std": np.isfinite(d.range_std) & (d.range_std > 0),
        "bearing": np.isfinite(d.bearing),
        "bearing_std": np.isfinite(d.bearing_std) & (d.bearing_std > 0),
    }
    good = np.ones(len(d.range), dtype=bool)
    rejected: Counter[str] = Counter()
    for name, passed in checks.items():
        if count := int(np.sum(good & ~passed)):
            rejected[name] = count
        good &= passed
    rows = (d.range, d.range_std, d.bearing, d.bearing_std, d.snr)
    return Echoes(np.argmax(known[good], axis=1), *(row[good].astype(float) for row in rows)), rejected


def as_tracks(t_ns: int, tracks: list[Track], z: float) -> Tracks:
    """The record; no rows when there is no track."""
    means: Array = np.array([track.mean for track in tracks]).reshape(-1, 4)
    x, y, vx, vy = means.T
    depth, still = np.full(len(tracks), z), np.zeros(len(tracks))
    ids = np.array([track.id for track in tracks], dtype=np.uint16)
    return Tracks(
        t_ns, ids, x, y, depth, vx, vy, still, np.array([track.position_std for track in tracks], dtype=float)
    )


def _given(config: MultistaticConfig) -> NodePositions:
    """The net of the parameters."""
    x, y, z = np.array([*config.transmitter_position, *config.receiver_positions]).reshape(-1, 3).T
    roles = np.full(x.size, NodePositions.RECEIVER, dtype=np.uint8)
    roles[0] = NodePositions.TRANSMITTER
    return NodePositions(0, np.array([0, *config.receiver_ids], dtype=np.uint16), roles, x, y, z)


def _net(nodes: NodePositions) -> tuple[SonarNet, AnyArray, float]:
    """The net, the receivers' ids in its order, and the transmitter's z."""
    sending, hearing = nodes.role == NodePositions.TRANSMITTER, nodes.role == NodePositions.RECEIVER
    if np.sum(sending) != 1:
        raise ValueError(f"sonar/positions must have one transmitter, got {int(np.sum(sending))}")
    ids = nodes.id[hearing].astype(int)
    if not len(ids) or len(set(ids.tolist())) != len(ids):
        raise ValueError(f"sonar/positions must have receivers with different ids, got {ids.tolist()}")
    if not np.isfinite(nodes.positions).all():
        raise ValueError("sonar/positions must be finite")
    positions = nodes.positions
    return SonarNet(positions[sending][0, :2], positions[hearing][:, :2]), ids, float(positions[sending][0, 2])
