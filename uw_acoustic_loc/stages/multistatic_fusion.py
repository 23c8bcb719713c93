"""multistatic_fusion: detections of a sonar net -> single-ping fixes and tracks."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from typing import ClassVar

import numpy as np

from ..contract import Emission, Input, Output, Stage, Status
from ..core.multistatic.estimator import SonarNet
from ..core.multistatic.fusion import Echoes, Fusion, MultistaticConfig, PingScan, Search, TargetFix
from ..core.multistatic.track import Track, Tracker
from ..core.types import AnyArray, Array, Detections, NodePositions, Position, Tracks
from ..topics import known
from .node_positions import merged, of_role

_POSITIONS, _DETECTIONS = known("sonar/positions"), known("sonar/detections")
_FIX, _TRACKS = known("sonar/fix"), known("sonar/tracks")


class MultistaticFusionStage(Stage):
    """One message of detections per ping gives the strongest target's fix, if there is one, and all confirmed tracks.

    A fix is where the ping met the target, up to a few seconds after the stamp; tracks are at the stamp itself.
    The net comes from the parameters, or else from `sonar/positions`, put together by id: a receiver is added, moved or
    removed at any time; tracks live on. A ping's message does not say who sent it: a net with several transmitters
    takes a node for each. Depth is not observed: z is the transmitter's, of unknown (-1) variance.
    """

    Config: ClassVar[type] = MultistaticConfig

    def __init__(self, config: MultistaticConfig) -> None:
        self._config = config
        self._tracker = Tracker(config.rules)
        self._fusion: Fusion | None = None
        self._positions: NodePositions | None = None
        self._lacking = "sonar/positions"  # without which there are no fixes
        self._ids: AnyArray = np.array([], dtype=int)
        self._z = 0.0
        self._counts: Counter[str] = Counter()
        self._rejected: Counter[str] = Counter()
        self._last_rejected: Counter[str] = Counter()
        self._nis_sum = 0.0
        self._left_out = 0  # groups of the last ping
        self._misfits: deque[tuple[float, int]] = deque(maxlen=_FIXES)  # of the last fixes, with degrees of freedom
        if config.receiver_ids:
            self._on_positions(_given(config))
            if self._fusion is None:
                raise ValueError(f"receiver_ids must be others: {self._lacking}")

    @property
    def inputs(self) -> tuple[Input, ...]:
        detections = _DETECTIONS.input(self._on_detections, frame="map")
        if self._config.receiver_ids:
            return (detections,)
        return (_POSITIONS.input(self._on_positions, frame="map", merge=merged), detections)

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
        warnings = list(self._warnings())
        if self._fusion is None:
            return Status(Status.WARN, f"waiting for {self._lacking}", values)
        return Status(Status.WARN, "; ".join(warnings), values) if warnings else Status(values=values)

    def _warnings(self) -> Iterator[str]:
        if self._last_rejected:
            what = ", ".join(f"{count} by {name}" for name, count in self._last_rejected.items())
            yield f"detections rejected in the last ping: {what}"
        if self._left_out:
            yield f"too many detections: {self._left_out} groups of the last ping, the weakest, were not tried"
        dof = sum(freedom for _, freedom in self._misfits)
        if len(self._misfits) >= _FIXES // 2:
            ratio, band = sum(misfit for misfit, _ in self._misfits) / dof, max(3 * math.sqrt(2 / dof), 0.2)
            if abs(ratio - 1) > band:
                yield (
                    f"range_noise does not fit: squared residuals are {ratio:.2f} times what range_std, bearing_std "
                    f"and {self._config.range_noise} errors give ({1 - band:.2f} to {1 + band:.2f})"
                )

    def change(self, config: MultistaticConfig) -> None:
        self._config = config
        self._tracker.rules = config.rules
        if self._fusion:
            self._fusion = Fusion(self._fusion.net, config)

    def _on_positions(self, nodes: NodePositions) -> Iterable[Emission]:
        together = merged(self._positions, nodes)
        senders, places = of_role(together, NodePositions.TRANSMITTER)
        if len(senders) > 1:
            raise ValueError(f"sonar/positions must have one transmitter, got {senders}: remove the others first")
        ids, receivers = of_role(together, NodePositions.RECEIVER)
        self._positions, self._ids = together, np.array(ids, dtype=int)
        if not senders or not ids:
            self._fusion, self._lacking = None, f"a {'receiver' if senders else 'transmitter'} in sonar/positions"
            return ()
        self._z, net = float(places[0, 2]), SonarNet(places[0, :2], receivers[:, :2])
        try:
            self._fusion = Fusion(net, self._config)
        except ValueError as error:  # more receivers may come
            self._fusion, self._lacking = None, f"sonar/positions that suit the method ({error})"
        return ()

    def _on_detections(self, detections: Detections) -> Iterator[Emission]:
        if self._fusion is None:
            raise ValueError(f"detections came before {self._lacking}")
        echoes, rejected = usable(detections, self._ids, self._config)
        search = Search(self._fusion, echoes)
        fix = next(search.fixes(set(range(len(echoes.receiver)))), None)
        tracks = self._tracker.step(detections.t_ns, PingScan(self._fusion, echoes, search))
        self._left_out = search.left_out
        if fix and len(fix.rows) > 1:
            self._misfits.append((fix.misfit, 2 * len(fix.rows) - 2))
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


def usable(detections: Detections, receiver_ids: AnyArray, config: MultistaticConfig) -> tuple[Echoes, Counter[str]]:
    """The rows that can be used, `receiver` as index into `receiver_ids`; and how many not, by what is wrong first.

    A std that is not given (0, negative, NaN) is that of the config; a range that is known no better than _NOTHING says
    nothing, and a bearing never less than that it has a direction.
    """
    d = detections
    known_ids = d.receiver[:, None] == receiver_ids
    range_std = np.where(d.range_std > 0, d.range_std, config.range_std).astype(float)
    bearing_std = np.minimum(np.where(d.bearing_std > 0, d.bearing_std, config.bearing_std), np.pi).astype(float)
    checks = {
        "unknown_receiver": known_ids.any(axis=1),
        "range": np.isfinite(d.range) & (d.range > 0),
        "no_information": range_std < _NOTHING,
        "bearing": np.isfinite(d.bearing),
    }
    good = np.ones(len(d.range), dtype=bool)
    rejected: Counter[str] = Counter()
    for name, passed in checks.items():
        if count := int(np.sum(good & ~passed)):
            rejected[name] = count
        good &= passed
    rows = (d.range, range_std, d.bearing, bearing_std, d.snr)
    return Echoes(np.argmax(known_ids[good], axis=1), *(row[good].astype(float) for row in rows)), rejected


_NOTHING = 1e5  # m
_FIXES = 60  # whose misfit is looked at


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
