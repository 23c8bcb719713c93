"""What a run has said of the array, and what it cannot say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..core.geometry import wrap_angle
from ..core.types import Array
from .fit import Fit, fits
from .observed import Observed
from .sources import PAIR, Known, SourceData, sources_of

CORRELATED = 0.95  # estimates correlated by more are named
_AS_LIKELY = 8.0  # nats within which another solution cannot be ruled out
_LEAST_TURN = 0.5  # rad of heading that a run must span to separate the parameters
_USEFUL = {"delay_offset": 0.1, "spacing_scale": 0.03, "array_yaw": 0.1}  # of d/c, 1, rad: larger stds say nothing
_UNITS = {"delay_offset": (1e6, "us"), "spacing_scale": (1.0, ""), "array_yaw": (180.0 / math.pi, "deg")}


@dataclass(frozen=True, eq=False)
class Calibration:
    """The fit that is taken, the parameters that the run has determined, and sentences on all that it has not."""

    seen: Observed
    sources: list[SourceData]
    known: Known
    fit: Fit
    determined: tuple[str, ...]  # of PAIR
    remarks: list[str]

    @property
    def parameters(self) -> dict[str, float | str]:
        """Of the bearing node: what was determined, and the polarity."""
        values = dict(zip(PAIR, map(float, self.fit.pair), strict=True))
        return {**{name: values[name] for name in self.determined}, "invert": self.fit.invert}

    def lines(self) -> list[str]:
        """The estimates with their standard deviations, in display units."""
        said = [
            f"{name} = {shown(name, value)} +- {shown(name, std)}"
            for name, value, std in zip(PAIR, self.fit.pair, self.fit.stds[:3], strict=True)
            if name in self.determined
        ]
        return [*said, f"invert = {self.fit.invert}"]


def calibrate(seen: Observed, known: Known) -> Calibration:
    """Estimates the array's parameters.

    Raises:
        ValueError: too few pings, or a pinger that no band has.
    """
    if unknown := set(known.pinger) - set(seen.config.source_ids):
        raise ValueError(f"pinger {unknown.pop()} must be one of source_ids {', '.join(seen.config.source_ids)}")
    sources = sources_of(seen, known)
    found = fits(seen, sources, known)
    likely = [fit for fit in found if fit.cost < found[0].cost + _AS_LIKELY]
    fit = min(likely, key=lambda one: abs(one.pair.delay_offset))
    determined, remarks = _determined(seen, sources, known, fit)
    for other in likely:
        if other is not fit:
            near = abs(other.pair.delay_offset - fit.pair.delay_offset) < 0.25 * min(s.cycle for s in sources)
            rivals = [name for name in determined if near and _differ(name, fit, other)]
            determined = [name for name in determined if name not in rivals]
            remarks.append(_rival(fit, other, f"{', '.join(rivals)} undetermined" if rivals else ""))
    remarks += _pings(fit)
    return Calibration(seen, sources, known, fit, tuple(determined), remarks)


def shown(name: str, value: float) -> str:
    """A value of PAIR in its display unit."""
    factor, unit = _UNITS[name]
    return f"{value * factor:.3g} {unit}".strip() if name != "spacing_scale" else f"{value:.4f}"


def _determined(seen: Observed, sources: list[SourceData], known: Known, fit: Fit) -> tuple[list[str], list[str]]:
    """Names of what the data alone decide, and sentences on the rest."""
    free = [name for name in PAIR if name not in known.held]
    if len(free) > 1 and (span := _turned(sources)) < _LEAST_TURN:
        turn = f"the heading spans {math.degrees(span):.0f} deg"
        cannot = f"{turn}: {', '.join(free)} cannot be separated; turn by 90 deg or more, or --hold all but one"
        return [], [cannot]
    limits = {name: _USEFUL[name] for name in PAIR}
    limits["delay_offset"] *= seen.info.spacing / seen.sound_speed
    stds = dict(zip(PAIR, fit.stds[:3].tolist(), strict=True))
    weak = [name for name in free if stds[name] > limits[name]]
    said = [f"{name} is not determined: its standard deviation is {shown(name, stds[name])}" for name in weak]
    return [name for name in free if name not in weak], said + _correlations(fit, free)


def _turned(sources: list[SourceData]) -> float:
    """rad, by which the heading differs at most from its mean, twice."""
    axes = np.concatenate([source.poses.rotations[:, :2, 0] for source in sources]) @ np.array([1.0, 1j])
    return float(2.0 * np.abs(np.angle(axes / (axes.mean() or 1.0))).max())


def _correlations(fit: Fit, free: Sequence[str]) -> list[str]:
    rho: Array = fit.cov[:3, :3] / np.maximum(np.outer(fit.stds[:3], fit.stds[:3]), 1e-300)
    pairs = combinations([k for k, name in enumerate(PAIR) if name in free], 2)
    return [
        f"{PAIR[a]} and {PAIR[b]} are correlated by {rho[a, b]:.3f}: the run hardly separates them"
        for a, b in pairs
        if abs(rho[a, b]) > CORRELATED
    ]


def _differ(name: str, a: Fit, b: Fit) -> bool:
    k = PAIR.index(name)
    off = a.values[k] - b.values[k]
    return bool(abs(wrap_angle(off) if name == "array_yaw" else off) > 4.0 * math.hypot(a.stds[k], b.stds[k]))


def _rival(fit: Fit, other: Fit, consequence: str) -> str:
    pair = ", ".join(f"{name} {shown(name, value)}" for name, value in zip(PAIR, other.pair, strict=True))
    nats = f"{other.cost - fit.cost:+.1f} nats"
    return f"invert {other.invert}, {pair} fits as well ({nats}): {consequence or 'the smaller delay is taken'}"


def _pings(fit: Fit) -> list[str]:
    """What is unusual about the pings themselves."""
    left_out, said = int(fit.used.size - fit.used.sum()), []
    if left_out > 0.1 * fit.used.size:
        said.append(f"{left_out} of {fit.used.size} pings do not fit and are left out")
    if fit.scatter > 3.0:
        said.append(f"the pings scatter {fit.scatter:.1f} times as much as noise and phase_std explain")
    return said
