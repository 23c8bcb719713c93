"""The likelihood of positions given range sums and bearings: one column per fix, one row per receiver."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np

from ..types import AnyArray, Array


@dataclass(frozen=True, eq=False)
class Moments:
    """Negative log-likelihood at (x, y) with its descent direction and its information; every field is (M,)."""

    x: Array
    y: Array
    cost: Array
    gx: Array  # minus the gradient
    gy: Array
    xx: Array  # G^T R^-1 G
    xy: Array
    yy: Array
    nearest: Array  # distance to the nearest receiver, in range_std

    def moved(self) -> Moments:
        """After a full Gauss-Newton step (eq. 11, 23); the cost to second order, the derivatives as before it."""
        step_x, step_y = solve_2x2(self.xx, self.xy, self.yy, self.gx, self.gy)
        cost = self.cost - 0.5 * (self.gx * step_x + self.gy * step_y)
        return replace(self, x=self.x + step_x, y=self.y + step_y, cost=cost)

    def step(self, damping: Array) -> tuple[Array, Array]:
        """Damped Gauss-Newton step."""
        extra = damping * (self.xx + self.yy)
        return solve_2x2(self.xx + extra, self.xy, self.yy + extra, self.gx, self.gy)

    def decrement(self) -> Array:
        """Squared length of the undamped step, in standard deviations of the estimate."""
        step_x, step_y = self.step(np.zeros(()))
        return self.gx * step_x + self.gy * step_y

    def cov(self) -> tuple[Array, Array, Array]:
        """xx, xy, yy of the inverse information."""
        return inverse_2x2(self.xx, self.xy, self.yy)

    def where(self, better: AnyArray, other: Moments) -> Moments:
        """These moments where `better`, the other ones elsewhere."""
        return Moments(*(np.where(better, mine, theirs) for mine, theirs in self._with(other)))

    def put(self, chosen: AnyArray, other: Moments) -> Moments:
        """These moments, but for the `chosen` columns, which `other` has."""
        merged = [mine.copy() for mine, _ in self._with(other)]
        for column, (_, theirs) in zip(merged, self._with(other), strict=True):
            column[chosen] = theirs
        return Moments(*merged)

    def _with(self, other: Moments) -> list[tuple[Array, Array]]:
        return [(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)]


class Legs(NamedTuple):
    """What a position (M,) has to do with each receiver (N, M) and with the transmitter (M,)."""

    dx: Array  # (N, M) m, from the receiver
    dy: Array
    distance: Array  # (N, M) m
    ex: Array  # (M,) unit vector from the transmitter
    ey: Array
    total: Array  # (N, M) m, the range sum


def _gaussian() -> Array:
    return np.empty((0, 1))


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Measurements of M fixes at N receivers, Gaussian with weights 1 / variance; or exact Rayleigh ranges."""

    transmitter: Array  # (2,)
    receivers: Array  # (N, 2)
    ranges: Array  # (N, M); bias removed when Gaussian, as measured when Rayleigh
    bearings: Array  # (N, M)
    range_weight: Array  # (N, 1) 1 / m^2
    bearing_weight: Array  # (N, 1) 1 / rad^2; 0 = bearings do not count
    scale: Array = field(default_factory=_gaussian)  # (N, 1) m of Rayleigh range errors; empty = Gaussian

    def without_bearings(self) -> Likelihood:
        """The same with range sums alone."""
        return replace(self, bearing_weight=np.zeros_like(self.bearing_weight))

    def cost(self, x: Array, y: Array) -> Array:
        """(M,) negative log-likelihood up to a constant."""
        legs = self.legs(x, y)
        range_cost, _, _ = self._range_terms(self.ranges - legs.total)
        turn = self.turn(legs.dx, legs.dy)
        cost: Array = (range_cost + 0.5 * self.bearing_weight * turn * turn).sum(axis=0)
        return cost

    def moments(self, x: Array, y: Array) -> Moments:
        """Cost, descent direction and information at (x, y), each (M,).

        Rows of G: the range sum's gradient is the sum of the unit vectors from transmitter and receiver (eq. 14), the
        bearing's the unit vector across over the distance (eq. 20). Ranges and bearings are stacked (eq. 24), rows and
        residuals z divided by their standard deviations.
        """
        legs = self.legs(x, y)
        inverse = 1.0 / legs.distance
        ux, uy = legs.dx * inverse, legs.dy * inverse
        Gx, Gy, z = (np.empty((2, *self.ranges.shape)) for _ in range(3))
        cost, z[0], root = self._range_terms(self.ranges - legs.total)
        Gx[0], Gy[0] = root * (ux + legs.ex), root * (uy + legs.ey)
        root = np.sqrt(self.bearing_weight)
        z[1], lever = root * self.turn(legs.dx, legs.dy), root * inverse
        Gx[1], Gy[1] = -lever * uy, lever * ux
        cost = cost.sum(axis=0) + 0.5 * _dot(z[1:], z[1:])
        nearest = (legs.distance * np.sqrt(self.range_weight)).min(axis=0)
        return Moments(x, y, cost, _dot(Gx, z), _dot(Gy, z), _dot(Gx, Gx), _dot(Gx, Gy), _dot(Gy, Gy), nearest)

    def information(self, x: Array, y: Array, least: Array) -> tuple[Array, Array, Array]:
        """(N, M) xx, xy, yy of each receiver's G^T R^-1 G; singular upon its baseline.

        A distance below `least` (N, 1) counts as that.
        """
        legs = self.legs(x, y)
        _, _, root = self._range_terms(self.ranges - legs.total)
        ux, uy = legs.dx / legs.distance, legs.dy / legs.distance
        gx, gy = root * (ux + legs.ex), root * (uy + legs.ey)
        across = self.bearing_weight / np.maximum(legs.distance, least) ** 2
        turned = across * uy
        return gx * gx + turned * uy, gx * gy - turned * ux, gy * gy + across * ux * ux

    def cov(self, at: Moments) -> tuple[Array, Array, Array]:
        """(M,) xx, xy, yy of the inverse information at a fix.

        A fix knows its distance to a receiver no better than range_std, so one upon a receiver must not take the
        bearing for a sharp position: distances count as range_std at least.
        """
        cov = at.cov()
        near = np.flatnonzero(at.nearest < 1.0)
        columns = self.columns(near)
        information = columns.information(at.x[near], at.y[near], 1.0 / np.sqrt(self.range_weight))
        for term, better in zip(cov, inverse_2x2(*(part.sum(axis=0) for part in information)), strict=True):
            term[near] = better
        return cov

    def at_node(self, at: Moments) -> AnyArray:
        """(M,) where a fix lies upon a node, up to a fraction of range_std.

        The likelihood has a cusp there: a search may rightly end upon it with a gradient that is not zero.
        """
        outward = np.hypot(at.x - self.transmitter[0], at.y - self.transmitter[1]) * np.sqrt(self.range_weight.max())
        upon: AnyArray = np.minimum(at.nearest, outward) < _UPON
        return upon

    def columns(self, chosen: AnyArray) -> Likelihood:
        """The same for some of the fixes."""
        return replace(self, ranges=self.ranges[:, chosen], bearings=self.bearings[:, chosen])

    def rows(self, chosen: AnyArray) -> Likelihood:
        """The same with some of the receivers, ranges Gaussian."""
        weights = self.range_weight[chosen], self.bearing_weight[chosen]
        return Likelihood(
            self.transmitter, self.receivers[chosen], self.ranges[chosen], self.bearings[chosen], *weights
        )

    def legs(self, x: Array, y: Array) -> Legs:
        """Of positions (M,)."""
        dx, dy = x - self.receivers[:, :1], y - self.receivers[:, 1:]
        ex, ey = x - self.transmitter[0], y - self.transmitter[1]
        distance = np.sqrt(dx * dx + dy * dy) + _TINY
        outward = np.sqrt(ex * ex + ey * ey) + _TINY
        return Legs(dx, dy, distance, ex / outward, ey / outward, distance + outward)

    def turn(self, dx: Array, dy: Array) -> Array:
        """(N, M) measured bearing minus that of (dx, dy), in [-pi, pi]."""
        turn = self.bearings - np.arctan2(dy, dx)
        turn -= (2 * np.pi) * np.rint(turn / (2 * np.pi))
        return turn

    def _range_terms(self, error: Array) -> tuple[Array, Array, Array]:
        """(N, M) cost, its slope over the root of its curvature, and that root: error / std and 1 / std if Gaussian."""
        if not self.scale.size:
            root = np.sqrt(self.range_weight)
            z = root * error
            return 0.5 * z * z, z, root
        cost, slope, curvature = rayleigh_terms(error, self.scale)
        root = np.sqrt(curvature)
        return cost, slope / root, root


_TINY = 1e-6  # m: keeps a position upon a receiver finite
_UPON = 0.05  # range_std


def _dot(a: Array, b: Array) -> Array:
    """(M,) sum over kinds and receivers."""
    total: Array = np.einsum("knm,knm->m", a, b)
    return total


def rayleigh_terms(error: Array, scale: Array) -> tuple[Array, Array, Array]:
    """-log p = u^2/2 - log u, u = error / scale, its derivative by the error and its second derivative.

    Below _EDGE the logarithm goes on as its second-order expansion, so that a search may start beyond the hard edge.
    """
    u = error / scale
    inside = np.maximum(u, _EDGE)
    beyond = np.minimum(u - _EDGE, 0.0) / _EDGE
    cost = 0.5 * u * u - np.log(inside) - beyond + 0.5 * beyond * beyond
    slope = u - (1.0 - beyond) / inside
    return cost, slope / scale, (1.0 + 1.0 / (inside * inside)) / (scale * scale)


_EDGE = 0.02  # 2e-4 of all errors are smaller


def solve_2x2(xx: Array, xy: Array, yy: Array, bx: Array, by: Array) -> tuple[Array, Array]:
    """Solution of the symmetric positive semidefinite system; 0 where it is singular."""
    determinant = xx * yy - xy * xy
    regular = determinant > _SINGULAR * (xx + yy) ** 2
    scale = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=regular)
    return (yy * bx - xy * by) * scale, (xx * by - xy * bx) * scale


def inverse_2x2(xx: Array, xy: Array, yy: Array) -> tuple[Array, Array, Array]:
    """xx, xy, yy of the inverse of a symmetric matrix; infinite variances where it is singular."""
    determinant = xx * yy - xy * xy
    regular = determinant > _SINGULAR * (xx + yy) ** 2
    scale = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=regular)
    return np.where(regular, yy * scale, np.inf), -xy * scale, np.where(regular, xx * scale, np.inf)


_SINGULAR = 1e-14
