"""Plan views of true and estimated positions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..core.types import Array, NodePositions
from .errors import MAP, MapFrame, TruePoses, frame_of, true_vehicle
from .plot import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    RAW,
    RED,
    SKY,
    TRUTH,
    Picture,
    canvas,
    ellipse,
    legend_below,
    picture,
    plan,
)
from .recording import Recording, Series

KM = 1e-3


def vehicle_plans(recording: Recording) -> Iterator[Picture]:
    """Yields a plan view per vehicle."""
    spaces = {s.space for role in ("odometry", "slam", "source", "slam_source") for s in recording.all(role)}
    for space in sorted(spaces):
        yield _vehicle_plan(recording, space)


def net_plans(recording: Recording) -> Iterator[Picture]:
    """Yields plan views of the buoys with their target and of the sonar net with its targets."""
    if recording.one("target") or recording.one("buoys"):
        yield _buoy_plan(recording)
    if any(recording.one(role) for role in ("fix", "tracks", "true_targets")):
        yield _sonar_plan(recording)


def _vehicle_plan(recording: Recording, space: str) -> Picture:
    truth = true_vehicle(recording, space)
    figure, axes = canvas(1, 1, 6.0)
    axis = axes[0, 0]
    if truth:
        _line(axis, truth.positions, TRUTH, "true track", 2.2, 0.55)
    for role, colour, label in (("odometry", ORANGE, "dead reckoning"), ("slam", BLUE, "SLAM track")):
        if series := recording.one(role, space):
            _line(axis, _positions(series, _frame(recording, series, truth)), colour, label)
    centres: dict[str, Array] = {}
    for role, colour, label in (("source", RED, "pinger, localizer"), ("slam_source", BLUE, "pinger, SLAM")):
        for k, series in enumerate(recording.all(role, space)):
            frame = _frame(recording, series, truth)
            centres[series.id] = _estimated_pinger(axis, series, frame, colour, label if k == 0 else None)
    if truth:
        for k, series in enumerate(recording.all("true_source")):
            _true_pinger(axis, series, centres.get(series.id), "true pinger" if k == 0 else None)
    plan(axis, "m", "map" if truth else "odom")
    legend_below(figure, axis)
    name = space.strip("/") or "the vehicle"
    return picture(f"Plan view of {name}", "Pingers as last estimated, with their 2-sigma ellipses.", figure)


def _buoy_plan(recording: Recording) -> Picture:
    nodes = recording.one("buoys")
    figure, axes = canvas(1, 2 if nodes else 1, 4.2)
    close = axes[0, -1]
    _buoy_tracks(close, recording, 1.0)
    plan(close, "m")
    close.set_title("the track")
    if nodes:
        whole = axes[0, 0]
        _buoy_tracks(whole, recording, KM)
        _nodes(whole, nodes.values[-1], "buoy")
        plan(whole, "km")
        whole.set_title("whole net")
    legend_below(figure, *axes[0])
    return picture("Plan view of the buoys", "The target as tracked from times of arrival.", figure)


def _buoy_tracks(axis: Any, recording: Recording, scale: float) -> None:
    if true := recording.one("true_target"):
        _line(axis, TruePoses(true).positions * scale, TRUTH, "true track", 2.2, 0.55)
    if target := recording.one("target"):
        _line(axis, _positions(target, MAP) * scale, GREEN, "track from arrivals")


def _sonar_plan(recording: Recording) -> Picture:
    figure, axes = canvas(1, 2, 4.2)
    whole, close = axes[0]
    for axis in (whole, close):
        _sonar_targets(axis, recording)
    if nodes := recording.one("sonar_nodes"):
        _nodes(whole, nodes.values[-1], "receiver")
    for axis, title in ((whole, "whole net"), (close, "the targets")):
        plan(axis, "km")
        axis.set_title(title)
    legend_below(figure, whole)
    caption = "Single-ping fixes with their 2-sigma ellipses, and tracks."
    return picture("Plan view of the sonar net", caption, figure)


def _sonar_targets(axis: Any, recording: Recording) -> None:
    if fixes := recording.one("fix"):
        positions = _positions(fixes, MAP) * KM
        axis.plot(*positions[:, :2].T, "x", color=PURPLE, markersize=5, label="single-ping fix")
        for fix, centre in zip(fixes.values, positions, strict=True):
            _ellipse_if_known(axis, centre, fix.cov[:2, :2] * KM**2, PURPLE)
    if tracks := recording.one("tracks"):
        _tracks(axis, tracks, SKY, "track", 1.8)
    if true := recording.one("true_targets"):
        _tracks(axis, true, TRUTH, "true target", 1.1)


def _tracks(axis: Any, series: Series, colour: str, label: str | None, width: float) -> None:
    rows = [(i, x, y) for value in series.values for i, x, y in zip(value.id, value.x, value.y, strict=True)]
    for number in sorted({row[0] for row in rows}):
        xy = np.array([row[1:] for row in rows if row[0] == number]) * KM
        axis.plot(*xy.T, color=colour, linewidth=width, marker=".", markersize=3, label=label)
        label = None


def _estimated_pinger(axis: Any, series: Series, frame: MapFrame, colour: str, label: str | None) -> Array:
    """Draws the last estimate and returns its position (3,)."""
    last = series.values[-1]
    centre: Array = frame.positions(last.position[None])[0]
    axis.plot(*centre[:2], "o", color=colour, markersize=4.5, label=label, zorder=4)
    _ellipse_if_known(axis, centre, frame.covs(last.cov[None])[0, :2, :2], colour)
    return centre


def _true_pinger(axis: Any, series: Series, estimate: Array | None, label: str | None) -> None:
    """Draws the true position, its name on the side away from the estimate."""
    at = series.values[-1].position[:2]
    axis.plot(*at, "*", color=TRUTH, markersize=11, markeredgecolor="white", markeredgewidth=0.6, label=label, zorder=5)
    away = np.ones(2) if estimate is None else np.where(at < estimate[:2], -1.0, 1.0)
    style = {"fontsize": 10, "fontweight": "bold", "ha": "center", "va": "center"}
    axis.annotate(series.id, at, tuple(11 * away), textcoords="offset points", **style)


def _ellipse_if_known(axis: Any, centre: Array, cov: Array, colour: str) -> None:
    if np.linalg.eigvalsh(cov)[0] > 0:
        ellipse(axis, centre, cov, colour)


def _nodes(axis: Any, nodes: NodePositions, name: str) -> None:
    for role, marker, colour, label in (
        (NodePositions.RECEIVER, "^", RAW, name),
        (NodePositions.TRANSMITTER, "s", RED, "transmitter"),
    ):
        chosen = nodes.role == role
        if chosen.any():
            xy = nodes.positions[chosen, :2] * KM
            axis.plot(*xy.T, marker, color=colour, markersize=8, linestyle="", label=label)
            for number, at in zip(nodes.id[chosen], xy, strict=True):
                axis.annotate(str(number), at, (6, 5), textcoords="offset points", color="#555555")


def _line(axis: Any, positions: Array, colour: str, label: str, width: float = 1.1, alpha: float = 1.0) -> None:
    axis.plot(positions[:, 0], positions[:, 1], color=colour, linewidth=width, alpha=alpha, label=label)


def _positions(series: Series, frame: MapFrame) -> Array:
    """Returns positions (n, 3) in the frame of the picture."""
    return frame.positions(np.array([value.position for value in series.values]))


def _frame(recording: Recording, series: Series, truth: TruePoses | None) -> MapFrame:
    """Returns the series' frame; without the truth the picture is in the estimates' own frame."""
    return frame_of(recording, series, truth) or MAP
