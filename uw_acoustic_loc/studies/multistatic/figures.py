"""Pictures of the multistatic study: maps, a cut, RMSE by distance and by number of receivers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from ...core.types import Array
from ...evaluation.plot import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    RED,
    TRUTH,
    Picture,
    canvas,
    legend_below,
    picture,
    plan,
    style,
)
from . import trials
from .trials import BIASED, PRINTED, Setting

LOOK = {
    "ls": (ORANGE, "s", "LS"),
    "ml_range": (GREEN, "^", "ML, ranges (ML_dist)"),
    "ml_range_bearing": (BLUE, "o", "ML, with bearings (ML_proposed)"),
    "ml_exact": (PURPLE, "v", "exact likelihood"),
}
PAPER = ("ls", "ml_range", "ml_range_bearing")
TRIALS = 100  # of maps and cut
FAR = 6000.0  # m
MANY = (3, 5, 9, 15, 30, 60, 100, 200)  # receivers
LEVELS = (10, 15, 20, 30, 40, 60, 80, 120, 200, 400)  # m
KM = 1e-3


def draw(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """All figures by file name."""
    with style():
        yield "noise", _noise(numbers["noise"])
        yield "map", _map(seed)
        yield "cut", _cut(seed)
        yield "distance", _distance(numbers["distance"])
        yield "receivers", _receivers(numbers["receivers"], seed)


def _noise(rows: Sequence[Mapping[str, float]]) -> Picture:
    figure, axes = canvas(1, len(trials.RANGE_STDS), 2.9, sharey=True)
    for axis, std in zip(axes[0], trials.RANGE_STDS, strict=True):
        _courses(axis, [row for row in rows if row["range_std"] == std], "bearing_std", 1.0)
        axis.set_title(f"range sums {std:g} m")
        axis.set_xlabel("standard deviation of bearings (rad)")
        axis.set_yscale("log")
    axes[0, 0].set_ylabel("mean RMSE (m)")
    _plain_numbers(axes[0, 0])
    legend_below(figure, axes[0, 0])
    caption = (
        "The paper's table 2 as a figure: 3 receivers at 2 km, mean over the grid. The exact likelihood lies just "
        "below the ML of ranges and bearings, which lies upon the bound."
    )
    return picture("RMSE by noise (table 2)", caption, figure)


def _map(seed: int) -> Picture:
    found = trials.errors(Setting(), trials.grid(), TRIALS, seed, PAPER)
    figure, axes = canvas(2, 2, 4.2)
    shown = {LOOK[name][2]: found.rmse[name] for name in PAPER} | {"Cramer-Rao bound": found.bound}
    for axis, (title, rmse) in zip(axes.flat, shown.items(), strict=True):
        _contours(axis, rmse)
        axis.set_title(f"{title}: mean {rmse.mean():.1f} m")
    caption = (
        f"RMSE in m of {TRIALS} trials at targets every 144 m: 3 receivers (triangles) 2 km from the transmitter "
        "(star), range sums 40 m, bearings 0.02 rad (the paper's figure 2; it has no bound). LS is poor between "
        "transmitter and receivers, the ML of ranges poor outside the net."
    )
    return picture("Maps of the RMSE (figure 2)", caption, figure)


def _contours(axis: Any, rmse: Array) -> None:
    x = trials.grid_axis() * KM
    values = rmse.reshape(x.size, x.size)
    axis.contourf(x, x, values, levels=LEVELS, cmap="viridis_r", extend="both", norm="log")
    lines = axis.contour(x, x, values, levels=LEVELS, colors="white", linewidths=0.5)
    axis.clabel(lines, fmt="%g", fontsize=7)
    receivers = Setting().net.receivers * KM
    axis.plot(0.0, 0.0, "*", color=RED, markersize=11, markeredgecolor="white")
    axis.plot(*receivers.T, "^", color=RED, markersize=7, markeredgecolor="white", linestyle="")
    plan(axis, "km")
    axis.grid(visible=False)


def _cut(seed: int) -> Picture:
    x = trials.grid_axis()
    found = trials.errors(Setting(), np.stack([x, np.zeros_like(x)], axis=1), 10 * TRIALS, seed)
    figure, axes = canvas(1, 1, 3.4)
    axis = axes[0, 0]
    for name, (colour, _, label) in LOOK.items():
        axis.plot(x * KM, found.rmse[name], color=colour, label=label)
    axis.plot(x * KM, found.bound, color=TRUTH, linestyle="--", label="Cramer-Rao bound")
    axis.set_yscale("log")
    _plain_numbers(axis)
    axis.set_xlabel("x (km), y = 0")
    axis.set_ylabel("RMSE (m)")
    legend_below(figure, axis)
    caption = (
        f"RMSE of {10 * TRIALS} trials along the x axis (the paper's figure 3), 3 receivers at 2 km, one of them at "
        "x = 2 km; 40 m and 0.02 rad. Between transmitter and that receiver the range sum hardly changes with the "
        "position; the other two receivers settle it, unless LS weighs all alike."
    )
    return picture("RMSE along the x axis (figure 3)", caption, figure)


def _distance(rows: Sequence[Mapping[str, float]]) -> Picture:
    figure, axes = canvas(1, 1, 3.2)
    _courses(axes[0, 0], rows, "distance_m", KM)
    axes[0, 0].set_yscale("log")
    _plain_numbers(axes[0, 0])
    axes[0, 0].set_xlabel("transmitter to receivers (km)")
    axes[0, 0].set_ylabel("mean RMSE (m)")
    legend_below(figure, axes[0, 0])
    caption = (
        "3 receivers, 40 m and 0.02 rad, mean over the grid (the paper's figure 4, which ends at 5 km). As published, "
        "LS rises and both ML fall, until the receivers stand outside the grid."
    )
    return picture("RMSE by distance (figure 4)", caption, figure)


def _receivers(rows: Sequence[Mapping[str, float]], seed: int) -> Picture:
    figure, axes = canvas(1, 3, 3.4)
    near, far, many = axes[0]
    _courses(near, rows, "receivers", 1.0)
    biased = _mean_by_count(trials.COUNTS, Setting().distance, seed, (BIASED, PRINTED))
    labels = (BIASED, "x", "bias left in", 0, 0.84), (PRINTED, "+", r"$\sqrt{N-1}\,\sigma$ removed", 3, 0.93)
    for name, marker, label, at, below in labels:
        near.plot(trials.COUNTS, biased[name], marker=marker, linestyle=":", color=RED, markersize=5)
        near.text(trials.COUNTS[at], below * biased[name][at], label, color=RED, fontsize=8, va="top")
    for name, values in _mean_by_count(trials.COUNTS, FAR, seed, PAPER).items():
        far.plot(trials.COUNTS, values, marker=LOOK[name][1], markersize=4, color=LOOK[name][0])
    ls = _mean_by_count(MANY, FAR, seed, ("ls",))["ls"]
    many.plot(MANY, ls, marker=LOOK["ls"][1], markersize=4, color=LOOK["ls"][0])
    five = _mean_by_count((5,), FAR, seed, ("ml_range_bearing",))["ml_range_bearing"][0]
    many.axhline(five, color=BLUE, linestyle=":")
    many.text(MANY[0], 1.05 * five, "ML_proposed, 5 receivers", color=BLUE, fontsize=8)
    many.set_xscale("log")
    for axis, title in ((near, "(a) 2 km"), (far, "(b) 6 km"), (many, "(c) 6 km, LS up to 200")):
        axis.set_yscale("log")
        _plain_numbers(axis)
        axis.set_title(title)
        axis.set_xlabel("receivers")
    for axis, shown in ((near, trials.COUNTS), (far, trials.COUNTS), (many, MANY[::2])):
        axis.set_xticks(shown, [str(count) for count in shown])
        axis.xaxis.set_minor_locator(NullLocator())
    near.set_ylabel("mean RMSE (m)")
    legend_below(figure, near)
    caption = (
        "Mean RMSE over the grid by number of receivers (the paper's figure 5), 40 m and 0.02 rad; (b), (c) and the "
        "dotted lines: over every fifth row and column. The paper's ML stops improving at 5 to 7 receivers: what it "
        "takes from the range sums, as printed, grows with the number of receivers, and an error that all range sums "
        "share does not average out. With the mean of the Rayleigh error taken out every receiver helps."
    )
    return picture("RMSE by number of receivers (figure 5)", caption, figure)


def _mean_by_count(
    counts: Sequence[int], distance: float, seed: int, methods: tuple[str, ...]
) -> dict[str, list[float]]:
    """Mean RMSE in m over every fifth row and column of the grid."""
    targets = trials.square(trials.grid_axis()[2::5])
    found = [trials.errors(Setting(n, distance), targets, TRIALS, seed, methods) for n in counts]
    return {name: [errors.mean[name] for errors in found] for name in methods}


def _courses(axis: Any, rows: Sequence[Mapping[str, float]], key: str, scale: float) -> None:
    """Every method, and the bound, over one column."""
    x = [row[key] * scale for row in rows]
    for name, (colour, marker, label) in LOOK.items():
        axis.plot(x, [row[name] for row in rows], marker=marker, markersize=4, color=colour, label=label)
    axis.plot(x, [row["crlb"] for row in rows], color=TRUTH, linestyle="--", label="Cramer-Rao bound")


def _plain_numbers(axis: Any) -> None:
    """A logarithmic axis in metres, not in powers of ten."""
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.yaxis.set_minor_locator(NullLocator())
