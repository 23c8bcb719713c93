"""The bearing node: samples of two hydrophones in, a bearing per ping and source out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import ClassVar

from ..contract import Emission, Input, Output, Status
from ..core.bearing import BearingConfig, BearingEstimator
from ..core.types import Bearing, HydrophoneInfo, Odometry, Particles, Samples

_CLOUD_PERIOD_NS = 500_000_000
_SILENT_NS = 5_000_000_000  # a source that has not been heard for this long is missed


class BearingStage:
    """Waits for hydrophones/info; another info starts anew."""

    Config: ClassVar[type] = BearingConfig

    def __init__(self, config: BearingConfig) -> None:
        self._config = config
        self._info: HydrophoneInfo | None = None
        self._estimator: BearingEstimator | None = None
        self._cloud_ns = [0] * len(config.source_ids)

    @property
    def inputs(self) -> tuple[Input, ...]:
        return (
            Input("hydrophones/info", HydrophoneInfo, self._on_info, frame="hydrophone_array", latched=True),
            Input("hydrophones/samples", Samples, self._on_samples, frame="hydrophone_array"),
            Input("odometry", Odometry, self._on_odometry),
        )

    @property
    def outputs(self) -> tuple[Output, ...]:
        bearings = tuple(Output(f"sources/{name}/bearing", Bearing) for name in self._config.source_ids)
        if self._config.filter != "particle":
            return bearings
        return bearings + tuple(Output(f"sources/{name}/particles", Particles) for name in self._config.source_ids)

    def change(self, config: BearingConfig) -> None:
        if self._estimator is not None:
            self._estimator.change(config)
        self._config = config

    def status(self) -> Status:
        e = self._estimator
        if e is None:
            return Status(Status.WARN, "waiting for hydrophones/info")
        values: dict[str, float | int | str] = {"frames": e.frames, "gaps": e.listener.gaps}
        seconds = max((e.end_ns - e.begin_ns) * 1e-9, 1e-9)
        silent = []
        for k, (name, track) in enumerate(zip(self._config.source_ids, e.tracks, strict=True)):
            values |= {f"{name}.pings": track.pings, f"{name}.clipped": track.clipped}
            values[f"{name}.rate_hz"] = track.pings / seconds
            if track.pings:
                values[f"{name}.snr_db"] = track.snr_db
            if e.frames:
                values[f"{name}.noise_floor_db"] = e.listener.noise_db(k)
                values[f"{name}.std_deg"] = math.degrees(track.std)
            if e.end_ns - (track.heard_ns or e.begin_ns) > _SILENT_NS:
                silent.append(name)
        if silent:
            return Status(Status.WARN, f"not heard for {_SILENT_NS * 1e-9:g} s: {', '.join(silent)}", values)
        return Status(values=values)

    def _on_info(self, info: HydrophoneInfo) -> Iterator[Emission]:
        self._estimator = BearingEstimator(self._config, info)
        yield from ()

    def _on_samples(self, frame: Samples) -> Iterator[Emission]:
        if self._estimator is None:
            raise ValueError("hydrophones/info must come before hydrophones/samples")
        for source, bearing in self._estimator.process(frame):
            yield f"sources/{self._config.source_ids[source]}/bearing", bearing
            if bearing.t_ns - self._cloud_ns[source] >= _CLOUD_PERIOD_NS:
                yield from self._cloud(self._estimator, source, bearing.t_ns)

    def _cloud(self, estimator: BearingEstimator, source: int, t_ns: int) -> Iterator[Emission]:
        cloud = estimator.cloud(source, t_ns)
        if cloud is not None:
            self._cloud_ns[source] = t_ns
            yield f"sources/{self._config.source_ids[source]}/particles", cloud

    def _on_odometry(self, odometry: Odometry) -> Iterator[Emission]:
        if self._estimator is not None:
            self._estimator.move(odometry)
        yield from ()
