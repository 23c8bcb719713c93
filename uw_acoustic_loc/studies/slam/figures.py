"""Pictures of bearing-only SLAM: Choi, Lee, Choi 2016, figures 7 to 10, from simulated runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...evaluation.plot import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    RAW,
    RED,
    TRUTH,
    Picture,
    canvas,
    ellipse,
    legend_below,
    picture,
    style,
)
from . import trials
from .trials import SlamRun, Snapshot

COLOURS = {"s1": ORANGE, "s2": GREEN, "s3": PURPLE}
SHOWN = 12  # runs in the picture of errors
_MARGIN = 4.0  # m around the pingers and the path


def draw(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """All figures by file name."""
    runs = [trials.trial(trials.WHITE, k, seed) for k in range(min(SHOWN, numbers["runs"]))]
    with style():
        yield "bearings", _bearings(runs[0])
        yield "snapshots", _snapshots(runs[0])
        yield "track", _track(runs[0])
        yield "error", _errors(runs)


def _bearings(run: SlamRun) -> Picture:
    figure, axes = canvas(1, 1, 3.2)
    axis = axes[0, 0]
    for name, heard in run.heard.items():
        look = {"marker": ".", "markersize": 2, "linestyle": "", "color": COLOURS[name]}
        axis.plot(heard[:, 0], np.degrees(heard[:, 1]), label=f"pinger {name}", **look)
    axis.set_xlabel("time (s)")
    axis.set_ylabel("bearing from the bow (°)")
    axis.set_ylim(-180, 180)
    axis.set_yticks(np.arange(-180, 181, 60))
    legend_below(figure, axis)
    caption = (
        "What the filter hears in the first run: 10 bearings a second of each pinger with white errors of 5 degrees "
        "(Choi et al., fig. 7). It passes s3 at 2 m after 27 s, s2 at 5.5 m after 62 s, and turns back after 90 s."
    )
    return picture("Bearings of three pingers", caption, figure)


def _snapshots(run: SlamRun) -> Picture:
    figure, axes = canvas(1, 3, 3.8, sharey=True)
    last = len(run.snapshots) - 1
    first = next((k for k, s in enumerate(run.snapshots) if len(s.pingers) == len(trials.PLACES)), last // 2)
    for axis, k in zip(axes[0], (first, last // 2, last), strict=True):
        _map(axis, run, k)
        for name, fix in run.snapshots[k].pingers.items():
            ellipse(axis, fix.mean, fix.cov, COLOURS[name])
            axis.plot(*fix.mean, "+", color=RED, markersize=8, label="pingers, estimated")
        _boat(axis, run.snapshots[k])
        axis.set_title(f"{run.snapshots[k].time:.0f} s")
    axes[0, 0].set_ylabel("north in map (m)")
    legend_below(figure, axes[0, 2])
    caption = (
        "The first run: when the range of the last pinger has become known, at half time and at the end (Choi et al., "
        "fig. 8); 2-sigma ellipses. A pinger is not drawn before its range is known."
    )
    return picture("SLAM as the boat moves", caption, figure)


def _map(axis: Any, run: SlamRun, k: int) -> None:
    """The path so far, the dead-reckoned one, and the true places of the pingers."""
    estimated = np.array([s.vehicle.mean for s in run.snapshots[: k + 1]])
    axis.plot(*run.truth[: k + 1].T, color=TRUTH, linewidth=2.5, alpha=0.3, label="true path")
    axis.plot(*run.reckoned[: k + 1].T, color=RAW, label="dead reckoning")
    axis.plot(*estimated.T, color=BLUE, label="SLAM")
    x, y = np.array(list(trials.PLACES.values())).T
    axis.plot(x, y, "D", color=TRUTH, markersize=4, markerfacecolor="none", label="pingers, true")
    points = np.vstack([run.truth, run.reckoned, np.stack([x, y], axis=1)])
    axis.set_xlim(points[:, 0].min() - _MARGIN, points[:, 0].max() + _MARGIN)
    axis.set_ylim(points[:, 1].min() - _MARGIN, points[:, 1].max() + _MARGIN)
    axis.set_aspect("equal")
    axis.set_xlabel("east in map (m)")


def _boat(axis: Any, snapshot: Snapshot) -> None:
    x, y = snapshot.vehicle.mean
    axis.plot(x, y, marker=(3, 0, np.degrees(snapshot.heading) - 90), markersize=8, color=BLUE, linestyle="")


def _track(run: SlamRun) -> Picture:
    figure, axes = canvas(1, 2, 3.2)
    time = np.array([s.time for s in run.snapshots])
    estimated = np.array([s.vehicle.mean for s in run.snapshots])
    for axis, k, name in ((axes[0, 0], 0, "east"), (axes[0, 1], 1, "north")):
        axis.plot(time, run.truth[:, k], color=TRUTH, linewidth=2.5, alpha=0.3, label="truth")
        axis.plot(time, run.reckoned[:, k], color=RAW, label="dead reckoning")
        axis.plot(time, estimated[:, k], color=BLUE, label="SLAM")
        axis.set_xlabel("time (s)")
        axis.set_ylabel(f"{name} in map (m)")
    legend_below(figure, axes[0, 0])
    return picture("Position of the boat", "The first run (Choi et al., fig. 9).", figure)


def _errors(runs: list[SlamRun]) -> Picture:
    figure, axes = canvas(1, 2, 3.2)
    both, close = axes[0]
    for run in runs:
        time = np.array([s.time for s in run.snapshots])
        both.plot(time, run.drift, color=RAW, linewidth=0.8, label="dead reckoning")
        for axis in (both, close):
            axis.plot(time, run.error, color=BLUE, linewidth=0.8, label="SLAM")
    both.set_ylabel("error of the position (m)")
    close.set_ylabel("error of the position, SLAM alone (m)")
    for axis in (both, close):
        axis.set_xlabel("time (s)")
        axis.set_ylim(bottom=0)
    legend_below(figure, both)
    caption = (
        f"The first {len(runs)} runs (Choi et al., fig. 10). Dead reckoning is drawn off by the bias of its gyro and, "
        "on the way back, first towards the truth. SLAM drifts too until the first pinger's range is known, and errs "
        "least when the boat has heard the pingers from the other side."
    )
    return picture("Error of the boat's position", caption, figure)
