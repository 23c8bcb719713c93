"""The bearing node: samples of two hydrophones in, a bearing per ping and source out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from ..contract import ANY_ID, Emission, Input, Output, Stage, Status
from ..core.bearing.config import BearingConfig
from ..core.bearing.estimator import BearingEstimator, SourceReport
from ..core.types import HydrophoneInfo, Odometry, Samples
from ..topics import known

_INFO, _SAMPLES, _ODOMETRY = known("hydrophones/info"), known("hydrophones/samples"), known("odometry")
_BEARING, _PARTICLES = known("sources/<id>/bearing"), known("sources/<id>/particles")
_CLOUD_PERIOD_NS = 500_000_000
_SILENT = 5.0  # s; a source that has not been heard for this long is missed


class BearingStage(Stage):
    """Waits for hydrophones/info; another info restarts it."""

    Config: ClassVar[type] = BearingConfig
    any_id: ClassVar[Mapping[str, Any]] = {"source_ids": [ANY_ID], "band_low": [1e3], "band_high": [2e3]}

    def __init__(self, config: BearingConfig) -> None:
        self._config = config
        self._info: HydrophoneInfo | None = None
        self._estimator: BearingEstimator | None = None
        self._cloud_ns = [0] * len(config.source_ids)

    @property
    def config(self) -> BearingConfig:
        """The parameters as they are now."""
        return self._config

    @property
    def inputs(self) -> tuple[Input, ...]:
        return (
            _INFO.input(self._on_info, frame="hydrophone_array"),
            _ODOMETRY.input(self._on_odometry, optional=True),
            _SAMPLES.input(self._on_samples, frame="hydrophone_array", until_ns=self._end_ns),
        )

    @property
    def outputs(self) -> tuple[Output, ...]:
        return tuple(row.output(name) for row in (_BEARING, _PARTICLES) for name in self._config.source_ids)

    def check(self, config: BearingConfig) -> None:
        """Raises ValueError for a config that the hydrophones' sample rate rules out."""
        if self._estimator is not None:
            self._estimator.check(config)

    def change(self, config: BearingConfig) -> None:
        if self._estimator is not None:
            self._estimator.change(config)
        self._config = config

    def status(self) -> Status:
        e = self._estimator
        if e is None:
            return Status(Status.WARN, "waiting for hydrophones/info")
        values = _frames(e)
        reports = {name: e.report(k) for k, name in enumerate(self._config.source_ids)}
        for name, report in reports.items():
            values |= {f"{name}.{key}": value for key, value in _source(report).items()}
        warnings = e.health.faults if e.frames else []
        if silent := [name for name, report in reports.items() if report.silent > _SILENT]:
            warnings.append(f"not heard for {_SILENT:g} s: {', '.join(silent)}")
        return Status(Status.WARN, "; ".join(warnings), values) if warnings else Status(values=values)

    def _end_ns(self, frame: Samples) -> int:
        """After the last sample: the odometry up to then comes first."""
        if self._info is None:
            return frame.t_ns
        return frame.t_ns + round(1e9 * frame.h0.size / self._info.sample_rate)

    def _on_info(self, info: HydrophoneInfo) -> Iterator[Emission]:
        self._estimator = BearingEstimator(self._config, info)
        self._info = info
        yield from ()

    def _on_samples(self, frame: Samples) -> Iterator[Emission]:
        if self._estimator is None:
            raise ValueError("hydrophones/info must come before hydrophones/samples")
        for source, bearing in self._estimator.process(frame):
            yield _BEARING.named(self._config.source_ids[source]), bearing
            if bearing.t_ns - self._cloud_ns[source] >= _CLOUD_PERIOD_NS:
                yield from self._cloud(self._estimator, source, bearing.t_ns)

    def _cloud(self, estimator: BearingEstimator, source: int, t_ns: int) -> Iterator[Emission]:
        cloud = estimator.cloud(source, t_ns)
        if cloud is not None:
            self._cloud_ns[source] = t_ns
            yield _PARTICLES.named(self._config.source_ids[source]), cloud

    def _on_odometry(self, odometry: Odometry) -> Iterator[Emission]:
        if self._estimator is not None:
            self._estimator.move(odometry)
        yield from ()


Numbers = dict[str, float | int | str]


def _frames(e: BearingEstimator) -> Numbers:
    values: Numbers = {"frames": e.frames, "gaps": e.listener.gaps, "overlaps": e.listener.overlaps}
    values["stamp_jitter_ms"] = 1e3 * e.listener.jitter
    for k in (0, 1):
        values |= {f"h{k}.full_scale": e.health.full_scale[k], f"h{k}.dead_frames": e.health.dead_frames[k]}
        values[f"h{k}.clicks"] = int(e.listener.clicks[k])
    if math.isfinite(e.health.sample_rate):
        values["sample_rate_by_stamps"] = e.health.sample_rate
    return values


def _source(r: SourceReport) -> Numbers:
    values: Numbers = {"pings": r.pings, "echoes": r.echoes, "too_short": r.too_short, "rate_hz": r.rate}
    values |= {"period_s": r.period, "clipped": r.clipped, "lobes": r.lobes}
    measured = {"snr_db": r.snr_db, "noise_floor_db": r.noise_db, "std_deg": math.degrees(r.std)}
    return values | {key: value for key, value in measured.items() if math.isfinite(value)}
