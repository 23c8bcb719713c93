"""Pictures of the buoy tracker's results: those of Choi 2025, and the errors against the bound."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.ticker import FormatStrFormatter

from ...core.types import Array
from ...evaluation.plot import BLUE, GREEN, ORANGE, RAW, RED, TRUTH, Picture, band, canvas, legend_below, picture, style
from . import trials
from .result import Result

RUNS = 50  # behind the pictures
TIME: Array = np.arange(trials.PINGS, dtype=np.float64) * trials.DT
SHOWN = {
    "nominal": (BLUE, "direct and bottom"),
    "outliers": (GREEN, "with outliers"),
    "direct_only": (ORANGE, "direct only"),
}


def draw(seed: int) -> Iterator[tuple[str, Picture]]:
    """All figures by file name."""
    results = {name: trials.trial(trials.VARIANTS[name], RUNS, seed, _quiet) for name in (*SHOWN, "cold_start")}
    with style():
        yield "track", _track(results["nominal"])
        yield "error", _errors(results)
        yield "sound_speed", _sound_speed(results["nominal"])
        yield "bound", _bounds(results)


def _quiet(_: float) -> None:
    """Nobody watches."""


def _track(result: Result) -> Picture:
    """Choi 2025, fig. 1."""
    figure, axes = canvas(1, 2, 4.0)
    true, found = result.truth[0], result.mean[0]
    plan, depth = axes[0]
    for axis, (i, j) in ((plan, (0, 1)), (depth, (0, 2))):
        axis.plot(true[:, i], true[:, j], color=TRUTH, linewidth=2.4, alpha=0.6, label="true track")
        axis.plot(found[:, i], found[:, j], color=BLUE, marker=".", markersize=4, label="estimate")
        axis.set_xlabel("east in map (m)")
    plan.plot(*true[0, :2], "*", color=RED, markersize=11, label="start")
    plan.set_ylabel("north in map (m)")
    plan.set_aspect("equal", adjustable="datalim")
    depth.set_ylabel("z in map (m)")
    depth.plot(true[0, 0], true[0, 2], "*", color=RED, markersize=11)
    legend_below(figure, plan)
    caption = (
        "The first run: from above, and from the south with its own scales (Choi 2025, fig. 1). The buoys stand "
        "0.9 to 1.9 km away; the depth is known from the arrivals over the seabed."
    )
    return picture("Target track", caption, figure)


def _errors(results: dict[str, Result]) -> Picture:
    """Choi 2025, fig. 2."""
    figure, axes = canvas(1, 2, 3.4)
    one, all_runs = axes[0]
    one.plot(TIME, results["nominal"].distance[0], color=BLUE, label=SHOWN["nominal"][1])
    one.plot(TIME, results["outliers"].distance[0], color=GREEN, label=SHOWN["outliers"][1])
    one.set_title("the first run")
    for name in ("nominal", "outliers"):
        colour, label = SHOWN[name]
        low, middle, high = np.percentile(results[name].distance, [5, 50, 95], axis=0)
        all_runs.plot(TIME, middle, color=colour, label=label)
        all_runs.plot(TIME, low, color=colour, linestyle=":", linewidth=0.9)
        all_runs.plot(TIME, high, color=colour, linestyle=":", linewidth=0.9)
    all_runs.set_title(f"{RUNS} runs: median, and 5 and 95 % (dotted)")
    for axis in (one, all_runs):
        axis.axhspan(1.2, 3.5, color=RAW, alpha=0.2, linewidth=0, label="published means of 50 steps")
        axis.set_xlabel("time (s)")
        axis.set_ylabel("error of the position (m)")
        axis.set_ylim(0, None)
    legend_below(figure, one)
    return picture("Position error over time", "Choi 2025, fig. 2, from a prior of 10 m per axis.", figure)


def _sound_speed(result: Result) -> Picture:
    """Choi 2025, fig. 3."""
    figure, axes = canvas(1, 2, 3.2)
    course, error = axes[0]
    course.plot(TIME, result.truth[0, :, 6], color=TRUTH, linewidth=2, alpha=0.6, label="true")
    course.plot(TIME, result.mean[0, :, 6], color=BLUE, label="estimate")
    course.set_ylabel("sound speed (m/s)")
    course.legend()
    std: Array = np.sqrt(result.cov[0, :, 6, 6])
    band(error, TIME, result.error[0, :, 6], std, BLUE)
    error.set_ylabel("error of the sound speed (m/s)")
    error.legend(loc="upper right")
    for axis in (course, error):
        axis.set_xlabel("time (s)")
    return picture("Sound speed", "The first run (Choi 2025, fig. 3), and its error.", figure)


def _bounds(results: dict[str, Result]) -> Picture:
    figure, axes = canvas(1, 2, 3.4)
    parts: tuple[tuple[Any, list[int], str], ...] = (
        (axes[0, 0], [0, 1], "horizontal RMSE (m)"),
        (axes[0, 1], [2], "vertical RMSE (m)"),
    )
    for axis, columns, label in parts:
        for name, (colour, what) in {**SHOWN, "cold_start": (RED, "no prior")}.items():
            error = results[name].error[..., columns]
            axis.plot(TIME, np.sqrt(np.square(error).sum(axis=2).mean(axis=0)), color=colour, label=what)
            axis.plot(TIME, _root(results[name].bound, columns), color=colour, linestyle="--", linewidth=0.9)
        axis.plot([], [], color=TRUTH, linestyle="--", linewidth=0.9, label="posterior Cramer-Rao bound")
        axis.set_xlabel("time (s)")
        axis.set_ylabel(label)
        _log_metres(axis)
    legend_below(figure, axes[0, 0])
    caption = (
        f"Root mean square error of {RUNS} runs after each ping (lines) and the bound (dashed, in the same colour; "
        "for the outliers it is that of good arrivals). Without the arrivals over the seabed the depth stays as "
        "uncertain as it was before."
    )
    return picture("Errors against the posterior Cramer-Rao bound", caption, figure)


def _log_metres(axis: Any) -> None:
    axis.set_yscale("log")
    axis.set_yticks([1, 2, 3, 5, 10])
    axis.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.minorticks_off()


def _root(bound: Array, columns: list[int]) -> Array:
    return np.asarray(np.sqrt(bound[:, columns, columns].sum(axis=1)))
