"""Pictures of bearing-only localization: bearings, distance errors per sample, and what the particles know."""

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
    SKY,
    TRUTH,
    Picture,
    canvas,
    legend_below,
    picture,
    style,
)
from . import trials

PAPER = {
    "triangulation": (RAW, "two lines"),
    "ekf": (ORANGE, "EKF from (50, 50) m"),
    "particle_filter": (BLUE, "particle filter"),
    "bayes_grid": (TRUTH, "exact (grid)"),
}
OURS = {
    "ekf_drawn_start": (ORANGE, "EKF in x, y, start drawn from the prior"),
    "ekf_log_polar": (RED, "log-polar EKF from (50, 50) m"),
    "ekf_bank": (GREEN, "EKF bank"),
    "least_squares": (SKY, "least squares"),
    "particle_filter_gaussian": (PURPLE, "particle filter, Gaussian likelihood"),
    "bayes_grid": (TRUTH, "exact (grid)"),
}
_NUMBER = np.arange(trials.SAMPLES)
_TICKS = [1, 2, 5, 10, 20, 50, 100, 200]
_SHOTS = (0, 5, 10, 15, 20)


def draw(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """All figures by file name."""
    with style():
        yield "azimuth", _azimuths(seed)
        yield "simulation", _distances("simulation", numbers["simulation"], seed, "13")
        yield "sea_trial", _distances("sea_trial", numbers["sea_trial"], seed, "16")
        yield "ours", _ours(numbers)
        yield "cloud", _clouds(seed)


def _first_run(key: str, seed: int) -> tuple[trials.SimulatedCourse, Any]:
    course = trials.COURSES[key]
    return course, trials.bearings(course, 1, np.random.default_rng([seed, list(trials.COURSES).index(key)]))


def _azimuths(seed: int) -> Picture:
    figure, axes = canvas(1, 2, 3.0, sharey=True)
    for axis, key in zip(axes[0], trials.COURSES, strict=True):
        course, heard = _first_run(key, seed)
        axis.plot(_NUMBER, np.degrees(course.truth), color=TRUTH, label="true azimuth")
        axis.plot(_NUMBER, np.degrees(heard[0]), "x", color=RED, label="measured azimuth")
        axis.set_title(course.title)
        axis.set_xlabel("sample")
        axis.set_xticks(_NUMBER[::5])
    axes[0, 0].set_ylabel("azimuth (°)")
    legend_below(figure, axes[0, 0])
    caption = (
        "True and measured azimuth of one run, errors uniform within 10 degrees (Shin et al. 2013, fig. 12; the sea "
        "trial's own bearings, their fig. 15, are not published, so its errors here are the simulation's)."
    )
    return picture("Azimuths", caption, figure)


def _distances(key: str, found: Mapping[str, Any], seed: int, number: str) -> Picture:
    figure, axes = canvas(1, 3, 3.2, sharey=True)
    single = dict(trials.answers(key, trials.COURSES[key], 1, seed))
    for name, (colour, label) in PAPER.items():
        error = np.abs(single[name][0] - trials.COURSES[key].source)
        for axis, values in zip(axes[0], (error, found[name]["rmse_m"], found[name]["median_m"]), strict=True):
            axis.plot(_NUMBER, values, color=colour, label=label, linestyle="--" if name == "bayes_grid" else "-")
    for axis, title in zip(axes[0], ("one run", "RMSE over the runs", "median over the runs"), strict=True):
        _log_metres(axis, title)
    axes[0, 0].set_ylabel("distance error (m)")
    legend_below(figure, axes[0, 0])
    caption = (
        f"Distance error at each sample (Shin et al. 2013, fig. {number}), logarithmic; what is beyond 300 m "
        "is cut off. Particle filter and grid begin with a source anywhere from 1 to 140 m along the first bearing, "
        "the EKF at a guess."
    )
    return picture(f"Distance errors: {trials.COURSES[key].title}", caption, figure)


def _ours(numbers: Mapping[str, Any]) -> Picture:
    figure, axes = canvas(1, 2, 3.4, sharey=True)
    for axis, key in zip(axes[0], ("rmse_m", "median_m"), strict=True):
        for name, (colour, label) in OURS.items():
            style_ = "--" if name == "bayes_grid" else "-"
            axis.plot(_NUMBER, numbers["simulation"][name][key], color=colour, label=label, linestyle=style_)
        _log_metres(axis, {"rmse_m": "RMSE over the runs", "median_m": "median over the runs"}[key])
    axes[0, 0].set_ylabel("distance error (m)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    caption = "The simulation with what the paper does not have: this package's own methods, and its EKF without luck."
    return picture("Other methods, same bearings", caption, figure)


def _log_metres(axis: Any, title: str) -> None:
    axis.set_title(title)
    axis.set_yscale("log")
    axis.set_ylim(1.0, 300.0)
    axis.set_yticks(_TICKS, [str(tick) for tick in _TICKS])
    axis.minorticks_off()
    axis.set_xticks(_NUMBER[::5])
    axis.set_xlabel("sample")


def _clouds(seed: int) -> Picture:
    course, heard = _first_run("simulation", seed)
    figure, axes = canvas(1, len(_SHOTS), 3.4, sharex=True, sharey=True)
    for axis, (number, xy, mean) in zip(axes[0], _snapshots(course, heard[0], seed), strict=True):
        axis.plot(*xy, ".", color=BLUE, markersize=1.5, alpha=0.35, label="particles")
        axis.plot(mean.real, mean.imag, "+", color=RED, markersize=9, markeredgewidth=1.6, label="estimate")
        axis.plot(course.source.real, course.source.imag, "o", color=TRUTH, fillstyle="none", label="source")
        axis.plot(course.vehicle.real[: number + 1], 0 * _NUMBER[: number + 1], color=GREEN, lw=3, label="vehicle")
        axis.set_title(f"sample {number}")
        axis.set_aspect("equal")
        axis.set_xlabel("x (m)")
    axes[0, 0].set_ylabel("y (m)")
    legend_below(figure, axes[0, 0])
    caption = (
        "The particles of one run, in the frame of the source (Shin et al. 2013, fig. 11): uniform in area "
        "along the first bearing, then cut by each further one. The range stays open until the bearings cross."
    )
    return picture("What the particles know", caption, figure)


def _snapshots(course: trials.SimulatedCourse, heard: Any, seed: int) -> Iterator[tuple[int, Any, complex]]:
    rays = trials.rays(course, heard)
    state = trials.particles(rays[0], "uniform", np.random.default_rng([seed, 0, 0]))
    for k, ray in enumerate(rays):
        if k:
            state.update(ray)
        if k in _SHOTS:
            yield k, state.cloud(trials.PARTICLES)[0], complex(*state.estimate().mean)
