"""The array's parameters from TDOAs and poses, with the pingers' positions as nuisance (docs/calibration.md)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import least_squares

from ..core.geometry import wrap_angle
from ..core.types import AnyArray, Array
from .model import Pair, jacobian, predicted
from .observed import Maxima, Observed, ObservedPing
from .search import starts
from .sources import PAIR, Known, SourceData

SCALE_STD, YAW_STD = 0.1, 2.0  # 1 and rad, beforehand: so wide that the data decide
_REJECTED = 4.0  # robust standard deviations beyond which a ping is left out
_ROUNDS = 6
_STEPS = 25  # of each round's fit
_Loss = Literal["linear", "cauchy"]


@dataclass(frozen=True, eq=False)
class Fit:
    """Estimates under one polarity. Arrays over `pings` are in the order of the sources."""

    opposite: bool
    values: Array  # (3 + 3 S,) PAIR, then x, y and square of depth of every source
    cov: Array  # of them; 0 where a value is held
    cost: float  # minus log-posterior, but for what all fits share
    tdoas: Array  # (n,) s, the maxima that belong to the pings
    residuals: Array  # (n,) s
    used: AnyArray  # (n,) bool
    scatter: float  # residuals over the standard deviations that noise and phase_std explain
    memory: float  # pings over which errors are alike

    @property
    def pair(self) -> Pair:
        """The estimates that the bearing node takes."""
        return Pair(*self.values[:3])

    def delayed(self, by: float) -> Array:
        """The values with another delay offset."""
        return np.concatenate([[self.values[0] + by], self.values[1:]])

    @property
    def invert(self) -> str:
        """The parameter of that name; which of the two channels it is, sound cannot say."""
        return "h1" if self.opposite else "none"

    @property
    def stds(self) -> Array:
        """(3 + 3 S,) standard deviations."""
        return np.asarray(np.sqrt(np.diag(self.cov)))


def fits(seen: Observed, sources: Sequence[SourceData], known: Known) -> list[Fit]:
    """The best fit under each polarity and within each cycle of the carrier, the likeliest first."""
    problems = [_Problem(seen, sources, known, opposite) for opposite in (False, True)]
    found: list[Fit] = []
    for problem in problems:
        for start in problem.starts():
            _keep(found, problem.solve(start), problem.cycle)
    best = min(found, key=lambda fit: fit.cost)
    for problem in problems if problems[0].free[0] else ():
        for cycles in _CYCLES[problem.opposite != best.opposite]:
            _keep(found, problem.solve(best.delayed(cycles * problem.cycle)), problem.cycle)
    return sorted(found, key=lambda fit: fit.cost)


_CYCLES = {False: (-1.0, 1.0), True: (-0.5, 0.5)}  # of the carrier, to fits that are as good for a pure tone


def _keep(found: list[Fit], fit: Fit, cycle: float) -> None:
    """Adds a fit, or puts it in the place of a worse one that is the same solution."""
    same = [k for k, f in enumerate(found) if f.opposite == fit.opposite and _alike(f, fit, cycle)]
    if not same:
        found.append(fit)
    elif fit.cost < found[same[0]].cost:
        found[same[0]] = fit


def _alike(a: Fit, b: Fit, cycle: float) -> bool:
    return (
        abs(a.pair.delay_offset - b.pair.delay_offset) < 0.25 * cycle
        and abs(wrap_angle(a.pair.array_yaw - b.pair.array_yaw)) < 0.2
        and abs(a.pair.spacing_scale - b.pair.spacing_scale) < 0.05
    )


class _Problem:
    """Residuals and priors of all sources under one polarity."""

    def __init__(self, seen: Observed, sources: Sequence[SourceData], known: Known, opposite: bool) -> None:
        c = seen.config
        self._sources, self.opposite = sources, opposite
        self.cycle = min(source.cycle for source in sources)
        maxima = [[_of(ping, opposite) for ping in source.pings] for source in sources]
        self._tdoas = [np.array([m.tdoas for m in found]) for found in maxima]
        self._costs = [np.array([m.costs for m in found]) for found in maxima]
        self._stds = [
            np.hypot([m.std for m in found], c.noise.phase_std * source.cycle / (2 * math.pi))
            for source, found in zip(sources, maxima, strict=True)
        ]
        places, stds = zip(*(source.place for source in sources), strict=True)
        own = (c.electronics.delay_offset, c.array.spacing_scale, c.array.array_yaw)
        spread = (self.cycle, SCALE_STD, YAW_STD)
        held = [0.0 if name in known.held else std for name, std in zip(PAIR, spread, strict=True)]
        self._prior, self._prior_std = np.concatenate([own, *places]), np.concatenate([held, *stds])
        self.free = self._prior_std > 0

    def starts(self) -> Iterator[Array]:
        """Where to begin."""
        return starts(self._prior, self.free[:3], self._sources, self._tdoas, self._costs)

    def solve(self, start: Array) -> Fit:
        """Assigns maxima and fits them in turn; the loss of far ones is bounded until the last rounds."""
        values, scale, memory = start.copy(), 1.0, 1.0
        for _ in range(_ROUNDS):
            chosen = self._chosen(values, scale)
            values = self._fitted(values, chosen, np.ones(chosen.size, bool), scale, "cauchy")
        for _ in range(3):
            chosen = self._chosen(values, scale)
            scaled = self._scaled(values, chosen)
            spread = 1.4826 * float(np.median(np.abs(scaled)))
            used = np.abs(scaled) <= _REJECTED * max(spread, 1e-3)
            values = self._fitted(values, chosen, used, scale, "linear")
            scaled = self._scaled(values, chosen)
            freedom = max(int(used.sum()) - int(self.free.sum()), 1)
            scale = max(math.sqrt(float(np.square(scaled[used]).sum()) / freedom), 1e-3)
        memory = _memory(np.where(used, scaled, 0.0), [len(source.pings) for source in self._sources])
        cov = self._cov(values, used, scale * math.sqrt(memory))
        values[2] = wrap_angle(values[2])
        return Fit(
            self.opposite,
            values,
            cov,
            self._cost(values, scale, memory),
            chosen,
            scaled * np.concatenate(self._stds),
            used,
            scale,
            memory,
        )

    def _model(self, values: Array) -> list[Array]:
        pair, places = Pair(*values[:3]), values[3:].reshape(-1, 3)
        return [predicted(s.poses, pair, *place[:, None])[0] for s, place in zip(self._sources, places, strict=True)]

    def _losses(self, values: Array, scale: float) -> list[Array]:
        """Per source (n, P) minus log-likelihood of each maximum."""
        parts = zip(self._model(values), self._tdoas, self._costs, self._stds, strict=True)
        return [
            0.5 * np.square((tdoas - model[:, None]) / (scale * std[:, None])) + costs
            for model, tdoas, costs, std in parts
        ]

    def _chosen(self, values: Array, scale: float) -> Array:
        """(n,) the likeliest maximum of each ping."""
        best = [loss.argmin(axis=1) for loss in self._losses(values, scale)]
        return np.concatenate([t[np.arange(len(k)), k] for t, k in zip(self._tdoas, best, strict=True)])

    def _cost(self, values: Array, scale: float, memory: float) -> float:
        """Of all pings, none of which counts for more than an outlier, and of what was assumed beforehand."""
        losses = np.concatenate([loss.min(axis=1) for loss in self._losses(values, scale)])
        off = (values - self._prior)[self.free] / self._prior_std[self.free]
        pings = float(np.minimum(losses, 0.5 * _REJECTED**2).sum()) + losses.size * math.log(scale)
        return pings / memory + 0.5 * float(off @ off)

    def _scaled(self, values: Array, chosen: Array) -> Array:
        return np.asarray((chosen - np.concatenate(self._model(values))) / np.concatenate(self._stds))

    def _residuals(self, values: Array, chosen: Array, used: AnyArray, scale: float) -> Array:
        free = self.free
        prior = (values[free] - self._prior[free]) / self._prior_std[free]
        return np.concatenate([self._scaled(values, chosen)[used] / scale, prior])

    def _fitted(self, values: Array, chosen: Array, used: AnyArray, scale: float, loss: _Loss) -> Array:
        full = values.copy()

        def residuals(part: Array) -> Array:
            full[self.free] = part
            return self._residuals(full, chosen, used, scale)

        def derivatives(part: Array) -> Array:
            full[self.free] = part
            return self._jacobian(full, used, scale)

        units = 0.1 * self._prior_std[self.free]
        found = least_squares(
            residuals, values[self.free], derivatives, x_scale=units, loss=loss, f_scale=3.0, max_nfev=_STEPS
        )
        full[self.free] = found.x
        return full

    def _jacobian(self, values: Array, used: AnyArray, scale: float) -> Array:
        """Of `_residuals`."""
        pair, places = Pair(*values[:3]), values[3:].reshape(-1, 3)
        rows = np.zeros((used.size, values.size))
        begin = 0
        for k, (source, place, std) in enumerate(zip(self._sources, places, self._stds, strict=True)):
            own = jacobian(source.poses, pair, place) / -(scale * std[:, None])
            rows[begin : begin + len(own), :3], rows[begin : begin + len(own), 3 + 3 * k : 6 + 3 * k] = np.hsplit(
                own, 2
            )
            begin += len(own)
        return np.vstack([rows[used][:, self.free], np.diag(1.0 / self._prior_std[self.free])])

    def _cov(self, values: Array, used: AnyArray, scale: float) -> Array:
        """Inverse of the information of residuals and priors."""
        std = self._prior_std[self.free]
        whitened = self._jacobian(values, used, scale) * std
        cov = np.zeros((values.size, values.size))
        cov[np.ix_(self.free, self.free)] = np.linalg.inv(whitened.T @ whitened) * np.outer(std, std)
        return cov


def _of(ping: ObservedPing, opposite: bool) -> Maxima:
    return ping.opposite if opposite else ping.alike


def _memory(scaled: Array, counts: Sequence[int]) -> float:
    """Sum of the correlations of neighbouring residuals, up to the first that is within noise: 1 if independent."""
    parts = np.split(scaled, np.cumsum(counts)[:-1])
    power, total = float(np.square(scaled).sum()), 1.0
    for lag in range(1, max(counts) // 4):
        rho = sum(float(part[lag:] @ part[:-lag]) for part in parts) / max(power, 1e-12)
        if rho < 2.0 / math.sqrt(scaled.size):
            break
        total += 2.0 * rho
    return total
