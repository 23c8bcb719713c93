"""Pictures over time: bearings, offsets, errors with their 3-sigma bands, and NEES with its 95 % band."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.special import chdtri

from ..core.types import AnyArray, Array
from .errors import Errors, TruePoses, mooring_errors, source_errors, target_errors, vehicle_errors
from .errors_bearing import bearing_errors
from .errors_net import fix_errors, sound_speed_errors
from .plot import BLUE, CYCLE, GREEN, ORANGE, PURPLE, RAW, RED, TRUTH, Picture, band, canvas, legend_below, picture
from .recording import Recording, Series

Named = list[tuple[str, Errors]]


class Traces:
    """The pictures over time of one recording; seconds count from its first message."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._start_ns = recording.span[0]

    def pictures(self) -> Iterator[Picture]:
        """Yields the pictures whose topics are in the bag."""
        drawn = (self._bearings, self._localizer, self._slam, self._toa, self._multistatic, self._moorings, self._nees)
        for draw in drawn:
            yield from draw()

    def _time(self, t_ns: AnyArray) -> Array:
        return np.asarray((t_ns - self._start_ns) * 1e-9)

    def _bearings(self) -> Iterator[Picture]:
        found = list(self._recording.all("bearing"))
        if not found:
            return
        figure, axes = canvas(len(found), 2, 1.75, sharex=True)
        for (left, right), series in zip(axes, found, strict=True):
            errors = bearing_errors(self._recording, series)
            self._bearing(left, series, errors)
            left.set_ylabel(f"{self._recording.label(series.space, series.id)}, bearing (°)")
            if errors:
                self._band(right, errors, 0, BLUE, np.degrees(1.0))
                right.set_ylabel("error (°)")
            else:
                right.set_axis_off()
        _time_axes(axes)
        legend_below(figure, *axes[0])
        caption = (
            "In base_link, counter-clockwise from ahead. Of two bearings with one stamp the nearer one has the error."
        )
        yield picture("Bearings", caption, figure)

    def _bearing(self, axis: Any, series: Series, errors: Errors | None) -> None:
        bearings = np.degrees([value.bearing for value in series.values])
        axis.plot(self._time(series.t_ns), bearings, ".", color=BLUE, markersize=2.5, label="bearing")
        if errors:
            truth = errors.estimate[:, 0] - errors.error[:, 0]
            truth = np.degrees(np.arctan2(np.sin(truth), np.cos(truth)))
            truth[1:][np.abs(np.diff(truth)) > 180] = np.nan  # no stroke across the wrap
            axis.plot(self._time(errors.t_ns), truth, color=TRUTH, linewidth=0.9, label="truth")

    def _localizer(self) -> Iterator[Picture]:
        if found := self._named("source", source_errors):
            figure = self._east_north(found, RED)
            yield picture("Pingers from bearings and odometry", _BAND + " The odometry's drift is in it.", figure)

    def _slam(self) -> Iterator[Picture]:
        for series in self._recording.all("slam"):
            if errors := vehicle_errors(self._recording, series):
                yield self._slam_vehicle(series, errors)
        if found := self._named("slam_source", source_errors):
            yield picture("Pingers from SLAM", _BAND, self._east_north(found, BLUE))

    def _slam_vehicle(self, series: Series, errors: Errors) -> Picture:
        figure, axes = canvas(1, 3, 2.5)
        for k, name in enumerate(("east", "north")):
            self._band(axes[0, k], errors, k, BLUE)
            axes[0, k].set_ylabel(f"{name} error (m)")
        right = axes[0, 2]
        odometry = self._recording.one("odometry", series.space)
        if odometry and (drift := vehicle_errors(self._recording, odometry)):
            right.plot(self._time(drift.t_ns), drift.distance, color=ORANGE, label="dead reckoning")
        right.plot(self._time(errors.t_ns), errors.distance, color=BLUE, label="SLAM")
        right.set_ylabel("horizontal error (m)")
        _time_axes(axes)
        legend_below(figure, *axes[0, 1:])
        title = f"Vehicle from SLAM, {series.space.strip('/')}".rstrip(", ")
        return picture(title, _BAND, figure)

    def _toa(self) -> Iterator[Picture]:
        target, speed = self._recording.one("target"), self._recording.one("sound_speed")
        errors = target_errors(self._recording, target) if target else None
        if errors is None:
            return
        figure, axes = canvas(2, 2, 2.0, sharex=True)
        for k, name in enumerate(("east", "north", "up")):
            self._band(axes.flat[k], errors, k, GREEN)
            axes.flat[k].set_ylabel(f"{name} error (m)")
        speed_errors = sound_speed_errors(self._recording, speed) if speed else None
        if speed_errors:
            self._band(axes[1, 1], speed_errors, 0, PURPLE)
            axes[1, 1].set_ylabel("sound speed error (m/s)")
        else:
            axes[1, 1].set_axis_off()
        _time_axes(axes)
        legend_below(figure, axes[0, 0])
        yield picture("Target and sound speed from the buoys", _BAND, figure)

    def _multistatic(self) -> Iterator[Picture]:
        if found := self._named("fix", fix_errors):
            figure = self._east_north([("fix", found[0][1])], PURPLE, "o")
            caption = _BAND + " Each fix against the nearest true target."
            yield picture("Single-ping fixes of the sonar net", caption, figure)

    def _moorings(self) -> Iterator[Picture]:
        found = list(self._recording.all("mooring"))
        if not found:
            return
        figure, axes = canvas(len(found), 2, 2.4, sharex=True)
        for (left, right), series in zip(axes, found, strict=True):
            self._offset(left, series)
            if errors := mooring_errors(self._recording, series):
                self._band(right, errors, 0, BLUE)
                right.set_ylabel("error (m)")
            else:
                right.set_axis_off()
        _time_axes(axes)
        legend_below(figure, *axes[0])
        yield picture("Mooring offsets", _BAND + " Impulses beyond the axis are cut off.", figure)

    def _offset(self, axis: Any, series: Series) -> None:
        estimate = np.array([value.position[0] for value in series.values])
        if raw := self._recording.one("offset", series.space, series.id):
            measured = np.array([value.position[0] for value in raw.values])
            axis.plot(self._time(raw.t_ns), measured, ".", color=RAW, markersize=3, label="measured")
        if true := self._recording.one("true_mooring", name=series.id):
            axis.plot(
                self._time(true.t_ns),
                TruePoses(true).positions[:, 0],
                color=TRUTH,
                linewidth=2,
                alpha=0.6,
                label="truth",
            )
        axis.plot(self._time(series.t_ns), estimate, color=BLUE, label="filtered")
        reach = 4 * np.ptp(estimate) + 0.1
        axis.set_ylim(np.median(estimate) - reach, np.median(estimate) + reach)
        axis.set_ylabel(f"{series.id}, offset (m)")

    def _nees(self) -> Iterator[Picture]:
        panels = [(title, self._named(role, errors_of)) for title, role, errors_of in _NEES_PANELS]
        panels = [(title, [(n, e) for n, e in named if e.known.any()]) for title, named in panels]
        panels = [(title, named) for title, named in panels if named]
        if not panels:
            return
        figure, axes = canvas((len(panels) + 1) // 2, 2, 1.9, sharex=True)
        for axis in axes.flat[len(panels) :]:
            axis.set_axis_off()
        for axis, (title, named) in zip(axes.flat, panels, strict=False):
            self._nees_panel(axis, named)
            axis.set_title(title)
        _time_axes(axes)
        yield picture("NEES", _NEES_CAPTION, figure)

    def _nees_panel(self, axis: Any, named: Named) -> None:
        dims = named[0][1].error.shape[1]
        axis.axhspan(chdtri(dims, 0.975) / dims, chdtri(dims, 0.025) / dims, color=RAW, alpha=0.25, linewidth=0)
        axis.axhline(1.0, color=TRUTH, linewidth=0.6)
        for k, (name, errors) in enumerate(named):
            nees = np.maximum(errors.nees, 1e-4)
            axis.plot(self._time(errors.t_ns[errors.known]), nees, color=CYCLE[k % 6], linewidth=0.8, label=name)
        axis.set_yscale("log")
        axis.minorticks_off()
        axis.set_ylim(bottom=1e-2)
        axis.set_ylabel("NEES / dim")
        if len(named) > 1:
            axis.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=min(len(named), 6))

    def _named(self, role: str, errors_of: Any) -> Named:
        """Returns the errors of a role's series that have a truth, under their names in the score."""
        found = ((s, errors_of(self._recording, s)) for s in self._recording.all(role))
        return [(self._recording.label(s.space, s.id or "vehicle"), errors) for s, errors in found if errors]

    def _east_north(self, named: Named, colour: str, marker: str = "") -> Any:
        figure, axes = canvas(len(named), 2, 1.75, sharex=True)
        for row, (name, errors) in zip(axes, named, strict=True):
            for k, axis in enumerate(row):
                self._band(axis, errors, k, colour, marker=marker)
                axis.set_ylabel(f"{name}, {('east', 'north')[k]} error (m)")
        _time_axes(axes)
        legend_below(figure, axes[0, 0])
        return figure

    def _band(self, axis: Any, errors: Errors, k: int, colour: str, scale: float = 1.0, marker: str = "") -> None:
        band(axis, self._time(errors.t_ns), scale * errors.error[:, k], scale * errors.std[:, k], colour, marker)


def _time_axes(axes: AnyArray) -> None:
    for axis in axes[-1]:
        axis.set_xlabel("time since the start (s)")


_BAND = "Error in map with its 3-sigma band as the estimator gives it."
_NEES_CAPTION = (
    "Squared error in units of the covariance, divided by its dimension; grey: where 95 % of honest estimates lie."
    " Estimates of a filter that follow each other are not independent: what stays above the band is overconfident."
)
_NEES_PANELS = (
    ("pingers, localizer", "source", source_errors),
    ("vehicle, SLAM", "slam", vehicle_errors),
    ("pingers, SLAM", "slam_source", source_errors),
    ("target, buoys (3-D position)", "target", target_errors),
    ("target, sonar net", "fix", fix_errors),
    ("mooring", "mooring", mooring_errors),
)
