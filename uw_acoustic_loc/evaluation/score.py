"""The score: errors of a recording's estimates against its truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Group

from ..core.types import Array
from .errors import Errors, mooring_errors, source_errors, target_errors, vehicle_errors
from .errors_bearing import bearing_errors
from .errors_net import fix_errors, sound_speed_errors, track_count
from .recording import ESTIMATOR_ROLES, Recording, Series
from .tables import tables

GROSS_ERROR = np.deg2rad(5.0)

Numbers = dict[str, Any]


def score(recording: Recording) -> dict[str, Any]:
    """Returns errors by section; a section, and each number in it, is there when its topics are in the bag.

    nees_mean is NEES divided by its dimension, 1 for honest covariances: horizontal positions (localizer, slam,
    multistatic), positions in 3-D (toa; velocities are left out), the bearing as `nes_mean`.
    """
    parts = {
        "bearing": _by_source(recording, "bearing", bearing_errors, _bearing),
        "localizer": _by_source(recording, "source", source_errors, _localizer),
        "slam": _slam(recording),
        "toa": _toa(recording),
        "multistatic": _multistatic(recording),
        "mooring": _moorings(recording),
        "latency": {s.topic: _latency(s) for s in recording.series if s.role in ESTIMATOR_ROLES},
    }
    return {name: part for name, part in parts.items() if part}


def table(scored: dict[str, Any]) -> Group:
    """Returns the score as tables for a terminal."""
    return Group(*tables(scored))


def _by_source(
    recording: Recording,
    role: str,
    errors_of: Callable[[Recording, Series], Errors | None],
    numbers: Callable[[Errors], Numbers],
) -> Numbers:
    found = ((series, errors_of(recording, series)) for series in recording.all(role))
    return {recording.label(series.space, series.id): numbers(errors) for series, errors in found if errors}


def _bearing(errors: Errors) -> Numbers:
    error_deg = np.rad2deg(errors.distance)
    return {
        "n": len(error_deg),
        "rmse_deg": _rms(error_deg),
        "median_deg": float(np.median(error_deg)),
        "p95_deg": _percentile(error_deg, 95),
        "gross_fraction": float(np.mean(errors.distance > GROSS_ERROR)),
        **_mean("nes_mean", errors.nees),
    }


def _localizer(errors: Errors) -> Numbers:
    numbers = {"n": len(errors.error), "rmse_m": _rms(errors.distance), "final_m": float(errors.distance[-1])}
    return numbers | _mean("nees_mean", errors.nees)


def _slam(recording: Recording) -> Numbers:
    found: Numbers = {}
    for series in recording.all("slam"):
        if errors := vehicle_errors(recording, series):
            found[recording.label(series.space, "vehicle")] = _slam_vehicle(recording, series, errors)
    if sources := _by_source(recording, "slam_source", source_errors, _final):
        found["sources"] = sources
    return found


def _slam_vehicle(recording: Recording, series: Series, errors: Errors) -> Numbers:
    numbers = {"rmse_m": _rms(errors.distance), "final_m": float(errors.distance[-1])}
    odometry = recording.one("odometry", series.space)
    if odometry and (drift := vehicle_errors(recording, odometry)):
        numbers["dead_reckoning_final_m"] = float(drift.distance[-1])
    return numbers | _mean("nees_mean", errors.nees)


def _final(errors: Errors) -> Numbers:
    return {"final_m": float(errors.distance[-1])}


def _toa(recording: Recording) -> Numbers:
    series = recording.one("target")
    errors = target_errors(recording, series) if series else None
    if errors is None:
        return {}
    numbers = {
        "n": len(errors.error),
        "mean_m": float(errors.distance.mean()),
        "rmse_m": _rms(errors.distance),
        "p95_m": _percentile(errors.distance, 95),
        "max_m": float(errors.distance.max()),
        "horizontal_rmse_m": _rms(np.hypot(*errors.error[:, :2].T)),
        "vertical_rmse_m": _rms(errors.error[:, 2]),
    }
    speed = recording.one("sound_speed")
    if speed and (speed_errors := sound_speed_errors(recording, speed)):
        numbers["sound_speed_rmse"] = _rms(speed_errors.error)
    return numbers | _mean("nees_mean", errors.nees)


def _multistatic(recording: Recording) -> Numbers:
    numbers: Numbers = {}
    fixes, tracks = recording.one("fix"), recording.one("tracks")
    if fixes and (errors := fix_errors(recording, fixes)):
        far = errors.distance
        numbers = {"n": len(far), "rmse_m": _rms(far), "median_m": float(np.median(far))}
        numbers |= _mean("nees_mean", errors.nees)
    return numbers | ({"tracks": track_count(tracks)} if tracks else {})


def _moorings(recording: Recording) -> Numbers:
    found: Numbers = {}
    for series in recording.all("mooring"):
        errors = mooring_errors(recording, series)
        if errors is None:
            continue
        found[series.id] = {"mean_m": float(errors.error.mean()), "std_m": float(errors.error.std())}
        raw = recording.one("offset", series.space, series.id)
        if raw and (raw_errors := mooring_errors(recording, raw)):
            found[series.id]["raw_std_m"] = float(raw_errors.error.std())
    return found


def _latency(series: Series) -> Numbers:
    late_ms = (series.log_ns - series.t_ns) * 1e-6
    return {"p50_ms": _percentile(late_ms, 50), "p99_ms": _percentile(late_ms, 99)}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _percentile(values: Array, percent: float) -> float:
    return float(np.percentile(values, percent))


def _mean(key: str, values: Array) -> Numbers:
    return {key: float(values.mean())} if values.size else {}
