"""Maps of the accuracy with which the sonar net can position a target from one ping."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from ..core.multistatic.bound import cramer_rao, dilution, position_error
from ..core.multistatic.estimator import Noise, SonarNet
from ..core.types import Array
from ..evaluation.plot import RED, Picture, canvas, picture, plan, style
from ..evaluation.tables import Sheet
from ..sim.scenario import Scenario, Sonar

POINTS = 81  # along a map's side
MARGIN = 1.5  # times the farthest receiver's distance from the transmitter, to every side of it
KM = 1e-3


def maps(scenario: Scenario) -> Iterator[tuple[str, Sheet, Picture]]:
    """Yields one map; its sheet has the same numbers.

    Raises:
        ValueError: the scenario has no receivers.
    """
    if scenario.sonar is None or not scenario.sonar.receivers:
        raise ValueError("plan: sonar must have at least one receiver")
    sonar, title = scenario.sonar, "Target from one ping of the sonar net"
    net, noise = _net(sonar), _noise(sonar)
    axes = _axes(net)
    targets = np.stack(np.meshgrid(*axes), axis=-1)
    values = {
        "range sums and bearings": position_error(cramer_rao(net, targets, noise)),
        "range sums alone": position_error(cramer_rao(net, targets, noise, bearings=False)),
    }
    yield "sonar", _sheet(title, targets, values, dilution(net, targets)), _picture(title, axes, values, sonar)


def _net(sonar: Sonar) -> SonarNet:
    transmitter = np.array([sonar.transmitter.x, sonar.transmitter.y])
    return SonarNet(transmitter, np.array([[node.x, node.y] for node in sonar.receivers]))


def _noise(sonar: Sonar) -> Noise:
    count = len(sonar.receivers)
    return Noise(np.full(count, sonar.range_std), np.full(count, sonar.bearing_std), sonar.range_noise == "rayleigh")


def _axes(net: SonarNet) -> tuple[Array, Array]:
    half = MARGIN * max(float(np.hypot(*(net.receivers - net.transmitter).T).max()), 100.0)
    x, y = (np.linspace(middle - half, middle + half, POINTS) for middle in net.transmitter)
    return x, y


def _sheet(title: str, targets: Array, values: dict[str, Array], dop: Array) -> Sheet:
    columns = ("x_m", "y_m", *(f"{name.replace(' ', '_')}_m" for name in values), "range_dop")
    table = np.stack([*np.moveaxis(targets, -1, 0), *values.values(), dop], axis=-1).reshape(-1, len(columns))
    return Sheet(title, columns, tuple(tuple(f"{number:.4g}" for number in row) for row in table))


def _picture(title: str, axes: tuple[Array, Array], values: dict[str, Array], sonar: Sonar) -> Picture:
    best = min(float(value[np.isfinite(value)].min(initial=np.inf)) for value in values.values())
    least = best if np.isfinite(best) else 1.0
    with style():
        figure, panels = canvas(1, 2, 4.2)
        for panel, (name, value) in zip(panels[0], values.items(), strict=True):
            mesh = _map(panel, axes, value, sonar, LogNorm(least, 30 * least))
            panel.set_title(name)
        bar = figure.colorbar(mesh, ax=list(panels[0]), label="position error (m)", extend="max", shrink=0.8)
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        bar.ax.yaxis.set_minor_locator(NullLocator())
        return picture(title, _caption(sonar), figure)


def _map(panel: Any, axes: tuple[Array, Array], value: Array, sonar: Sonar, norm: Any) -> Any:
    x, y = (axis * KM for axis in axes)
    mesh = panel.pcolormesh(x, y, np.ma.masked_invalid(value), norm=norm, cmap="viridis_r", shading="nearest")
    for node in sonar.receivers:
        panel.plot(node.x * KM, node.y * KM, "^", color=RED, markersize=7, markeredgecolor="white")
    panel.plot(
        sonar.transmitter.x * KM, sonar.transmitter.y * KM, "*", color=RED, markersize=11, markeredgecolor="white"
    )
    plan(panel, "km")
    panel.grid(visible=False)
    return mesh


def _caption(sonar: Sonar) -> str:
    return (
        "Cramer-Rao bound of the horizontal position error (root of the trace) when every receiver detects the echo. "
        "Star: transmitter, triangles: receivers; "
        f"range sums {sonar.range_std:g} m, bearings {sonar.bearing_std:g} rad. "
        "Colours span a factor of 30 from the best value; white: not determined. How far an echo is detected, and what "
        "the direct blast masks, is not part of it. The dilution of precision in the file is metres of error per metre "
        "of range-sum error, ranges alone."
    )
