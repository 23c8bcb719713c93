"""Maps of the accuracy with which buoys can position a vehicle, with and without the bottom path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from ..core.toa.bound import PingNoise, ping_bound
from ..core.toa.model import BIAS_STD
from ..core.toa.paths import make_net
from ..core.types import Array, Arrivals
from ..evaluation.plot import RED, Picture, canvas, picture, plan, style
from ..evaluation.tables import Sheet
from ..sim.scenario import Buoys, Scenario

POINTS = 61  # along a map's side
MARGIN = 0.5  # on every side, of the net's extent
PATHS = {"direct": [Arrivals.DIRECT], "direct and bottom": [Arrivals.DIRECT, Arrivals.BOTTOM]}
EMISSIONS = {"known": 0.0, "unknown": BIAS_STD}  # s, standard deviation of the instant
KM = 1e-3


@dataclass(frozen=True, eq=False)
class _Map:
    """Bounds of one ping by path, (POINTS, POINTS), rows by y."""

    x: Array  # (POINTS,) m
    y: Array  # (POINTS,) m
    horizontal: dict[str, Array]
    vertical: dict[str, Array]


def maps(scenario: Scenario) -> Iterator[tuple[str, Sheet, Picture]]:
    """Yields maps for a known and for an unknown instant of emission.

    Raises:
        ValueError: the scenario has no buoys.
    """
    if scenario.buoys is None or not scenario.buoys.nodes:
        raise ValueError("plan: buoys must have at least one node")
    buoys, water = scenario.buoys, scenario.environment
    for emission, std in EMISSIONS.items():
        bounds = _map(scenario, buoys, PingNoise(buoys.toa_std, water.sound_speed_range, std))
        dilution = _map(scenario, buoys, PingNoise(1 / water.sound_speed, 0.0, std))
        title = f"Position from one ping at the buoys, emission {emission}"
        yield f"buoys_emission_{emission}", _sheet(title, bounds, dilution), _picture(title, bounds, scenario, buoys)


def _z(scenario: Scenario) -> float:
    """Returns the map's z in m: the vehicle's, or the middle of the water."""
    return scenario.vehicle.z if scenario.vehicle else -scenario.environment.depth / 2


def _map(scenario: Scenario, buoys: Buoys, noise: PingNoise) -> _Map:
    water, positions = scenario.environment, np.array([[node.x, node.y, node.z] for node in buoys.nodes])
    net = make_net([node.id for node in buoys.nodes], positions, water.depth)
    x, y = _axes(positions)
    targets = np.stack([*(grid.ravel() for grid in np.meshgrid(x, y)), np.full(POINTS**2, _z(scenario))], axis=1)
    found = _Map(x, y, {}, {})
    for name, paths in PATHS.items():
        variances = ping_bound(targets, net.images[paths].reshape(-1, 3), water.sound_speed, noise)
        found.horizontal[name] = np.sqrt(variances[:, 0] + variances[:, 1]).reshape(POINTS, POINTS)
        found.vertical[name] = np.sqrt(variances[:, 2]).reshape(POINTS, POINTS)
    return found


def _axes(positions: Array) -> tuple[Array, Array]:
    low, high = positions[:, :2].min(axis=0), positions[:, :2].max(axis=0)
    half = max(float((high - low).max()), 100.0) * (0.5 + MARGIN)
    x, y = (np.linspace(middle - half, middle + half, POINTS) for middle in (low + high) / 2)
    return x, y


def _sheet(title: str, bounds: _Map, dilution: _Map) -> Sheet:
    """Returns standard deviations and dilution of precision (m per m of range error at a known sound speed)."""
    columns, values = ["x_m", "y_m"], list(np.meshgrid(bounds.x, bounds.y))
    for path in PATHS:
        name = path.replace(" ", "_")
        columns += [f"{name}_horizontal_m", f"{name}_vertical_m", f"{name}_hdop", f"{name}_vdop"]
        values += [bounds.horizontal[path], bounds.vertical[path], dilution.horizontal[path], dilution.vertical[path]]
    table = np.stack([value.ravel() for value in values], axis=1)
    return Sheet(title, tuple(columns), tuple(tuple(f"{number:.4g}" for number in row) for row in table))


def _picture(title: str, bounds: _Map, scenario: Scenario, buoys: Buoys) -> Picture:
    with style():
        figure, axes = canvas(2, 2, 3.9)
        _row(figure, axes[0], bounds, bounds.horizontal, "horizontal", buoys)
        _row(figure, axes[1], bounds, bounds.vertical, "vertical", buoys)
        water = scenario.environment
        caption = (
            f"Cramer-Rao bound at z = {_z(scenario):g} m, seabed at {water.depth:g} m, {1e3 * buoys.toa_std:g} ms per "
            f"arrival, sound speed known to {water.sound_speed_range:g} m/s, nothing known of the position before. "
            "A filter that follows the vehicle does better; white: the arrivals do not determine it. The dilution of "
            "precision in the file is for a known sound speed."
        )
        return picture(title, caption, figure)


def _row(figure: Any, axes: Any, bounds: _Map, values: dict[str, Array], name: str, buoys: Buoys) -> None:
    """Draws a row in the same colours for every path: two decades at most, from the best value on."""
    least, most = _span(np.stack(list(values.values())))
    for axis, (path, value) in zip(axes, values.items(), strict=True):
        shown = np.ma.masked_invalid(value)
        look = {"norm": LogNorm(least, most), "cmap": "viridis_r", "shading": "nearest"}
        mesh = axis.pcolormesh(bounds.x * KM, bounds.y * KM, shown, **look)
        for node in buoys.nodes:
            axis.plot(node.x * KM, node.y * KM, "^", color=RED, markersize=7, markeredgecolor="white")
        axis.set_title(f"{name}, {path} (triangles: buoys)")
        plan(axis, "km")
    label = f"{name} standard deviation (m)"
    bar = figure.colorbar(mesh, ax=list(axes), label=label, extend="max", ticks=LogLocator(subs=(1.0, 2.0, 5.0)))
    bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    bar.ax.yaxis.set_minor_locator(NullLocator())


def _span(values: Array) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    least = float(finite.min()) if finite.size else 1.0
    return least, float(np.clip(finite.max(initial=0.0), 1.5 * least, 100 * least))
