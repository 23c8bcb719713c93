"""Pictures of the mooring tracker under impulsive noise: single runs, spread by filter, the noise's density."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...core.impulsive import LikelihoodTable
from ...core.mooring.estimator import MooringConfig
from ...evaluation.plot import BLUE, GREEN, ORANGE, RAW, RED, TRUTH, Picture, canvas, legend_below, picture, style
from . import trials

_LIMITS = (-6.0, 8.0)  # m, as in the paper
_CHOICE = 25  # runs


_LOOK = {"kf": ("+", RED, "Kalman filter"), "particle": (".", BLUE, "particle filter")}


def draw(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """All figures by file name."""
    with style():
        yield "runs", _runs(seed)
        yield "spread", _spread(numbers["table"])
        yield "likelihood", _likelihood()


def _runs(seed: int) -> Picture:
    figure, axes = canvas(2, 3, 2.5, sharex=True, sharey=True)
    for axis, fraction in zip(axes.flat, trials.FRACTIONS, strict=True):
        _run(axis, fraction, seed)
        axis.set_title(f"e = {fraction:g}")
    for axis in axes[-1]:
        axis.set_xlabel("time (s)")
    for axis in axes[:, 0]:
        axis.set_ylabel("offset (m)")
    axes[0, 0].set_ylim(*_LIMITS)
    legend_below(figure, axes[0, 0])
    caption = (
        f"Figures 1 to 6 of Lee et al. 2013: a run for each share e of impulses, of {_CHOICE} the one with the Kalman "
        "filter's median error. Triangles at the edge are measurements beyond it. The Kalman filter follows the "
        "impulses, the particle filter does not."
    )
    return picture("Single runs", caption, figure)


def _run(axis: Any, fraction: float, seed: int) -> None:
    truth = trials.simulate(fraction, _CHOICE, seed)
    tracked = {name: trials.track(name, fraction, truth, seed) for name in ("kf", "particle")}
    run = int(np.argsort(tracked["kf"].settled.std(axis=0))[_CHOICE // 2])
    time, measured = trials.TIMES, truth.measured[:, run]
    low, high = _LIMITS
    edge = np.clip(measured, low + 0.3, high - 0.3)
    axis.plot(time, truth.offset[:, run], "o-", color=TRUTH, markersize=3, label="truth")
    for inside, marker in ((measured < low, "v"), (measured > high, "^")):
        axis.plot(time[inside], edge[inside], marker, color=RAW, markersize=4)
    inside = (measured >= low) & (measured <= high)
    axis.plot(time[inside], measured[inside], "x", color=RAW, markersize=4, label="measured")
    for name, (marker, colour, label) in _LOOK.items():
        look = {"marker": marker, "markersize": 5, "linewidth": 0.8}
        axis.plot(time, tracked[name].offset[:, run], color=colour, label=label, **look)


def _spread(table: list[dict[str, float]]) -> Picture:
    figure, axes = canvas(1, 1, 3.6)
    axis = axes[0, 0]
    e = [row["e"] for row in table]
    for key, colour, label in (
        ("kf_std", RED, "Kalman filter"),
        ("kf_gated_std", ORANGE, "Kalman filter, 3-sigma gate"),
        ("particle_std", BLUE, "100 particles"),
    ):
        axis.plot(e, [row[key] for row in table], "o-", color=colour, markersize=4, label=label)
    axis.plot(e, [row["reference_std"] for row in table], "s", color=TRUTH, mfc="none", label="5000 particles")
    for column, colour, label in ((2, RED, "EKF, paper"), (3, BLUE, "ODPF, paper")):
        axis.plot(e, [trials.PAPER[x][column] for x in e], "x", color=colour, markersize=6, label=label)
    axis.set_yscale("log")
    axis.set_xlabel("share e of impulses")
    axis.set_ylabel("standard deviation of the error (m)")
    legend_below(figure, axis)
    caption = (
        "Standard deviation of the error from 2 s on, all runs together. The paper's are those of one run each, with "
        "values of f, g, u and process noise that are not known."
    )
    return picture("Spread of the error", caption, figure)


def _likelihood() -> Picture:
    figure, axes = canvas(1, 2, 3.0)
    x = np.linspace(-30, 60, 4501)
    for fraction, colour in ((0.0, RAW), (0.1, GREEN), (0.5, BLUE)):
        noise = MooringConfig(impulse_fraction=fraction).expected_noise
        density = noise.density(x)
        axes[0, 0].semilogy(x, np.maximum(density, 1e-12), color=colour, label=f"e = {fraction:g}")
        near = np.abs(x) < 3
        axes[0, 1].plot(x[near], np.log(LikelihoodTable(noise)(x[near])), color=colour, label=f"e = {fraction:g}")
    axes[0, 0].set_ylim(1e-6, 1)
    axes[0, 1].set_ylim(-10, 0.5)
    axes[0, 0].set_ylabel("density (1/m)")
    axes[0, 1].set_ylabel("log likelihood")
    for axis in axes[0]:
        axis.set_xlabel("error of the measurement (m)")
    legend_below(figure, axes[0, 0])
    caption = (
        "The noise's density, and near zero the logarithm of the table that weights the particles. Without impulses "
        "each metre more costs more than the one before; with them a measurement beyond 2 m says next to nothing."
    )
    return picture("Density and likelihood", caption, figure)
