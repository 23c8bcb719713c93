"""Start of the buoy tracker: the last few epochs solved together by robust nonlinear least squares.

The same solver serves a start from a prior, a start without one, and the return of a lost target. Outliers are let go
by weights whose scale shrinks from what the start point can be wrong by down to the noise (graduated non-convexity,
with Cauchy weights); the covariance is that of the arrivals within the gate at the end. Motion within the few epochs
is straight; what process noise could have added is counted as measurement noise of the older ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..types import AnyArray, Array
from .config import FASTEST, SLOWEST, ToaConfig
from .model import BIAS_STD, by_emission, heard_times, process_noise, water_column
from .paths import Epoch, ReceiverNet


@dataclass(frozen=True, eq=False)
class Start:
    """A solution at the last epoch's stamp."""

    mean: Array  # (D,): 7, and the clocks
    cov: Array  # (D, D)
    used: int  # arrivals within the gate
    rejected: int
    receivers: int  # different ones among the used
    cost: float  # squared residuals in sigma, each at most gate^2, and squared distance from the prior
    inside: AnyArray  # bool, of the last epoch's arrivals


def cold_prior(net: ReceiverNet, config: ToaConfig) -> tuple[Array, Array]:
    """Mean and covariance that say nothing of the horizontal position, and of z that it is in the water."""
    middle, half = water_column(config.water)
    spread = 10 * net.extent + 1000
    mean = np.array([*net.centre, middle, *config.start.initial_velocity, config.water.start_sound_speed])
    std = np.array([spread, spread, half, *config.start.initial_velocity_std, config.water.sound_speed_std])
    return mean, np.diag(std**2)


def believable(mean: Array, net: ReceiverNet, config: ToaConfig) -> bool:
    """Whether a state is within what is known beforehand: near the net, in the water (3 sigma), at no absurd speed."""
    (east, north), spread = net.centre, 10 * net.extent + 1000
    middle, half = water_column(config.water)
    x, y, z, vx, vy, vz, speed = mean[:7].tolist()
    return (
        math.hypot(x - east, y - north) <= spread
        and abs(z - middle) <= 3 * half
        and math.hypot(vx, vy, vz) <= config.start.max_speed
        and SLOWEST <= speed <= FASTEST
    )


def cold_starts(net: ReceiverNet, prior: Array) -> Array:
    """(49, D) start points on a grid over the net and half its extent around it."""
    axis = np.linspace(-1, 1, 7) * max(net.extent, 1.0)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    starts = np.tile(prior, (x.size, 1))
    starts[:, 0] += x
    starts[:, 1] += y
    return starts


def solve(epochs: Sequence[Epoch], mean: Array, cov: Array, starts: Array, config: ToaConfig) -> Start:
    """The best solution from the most promising of `starts` (s, D), given the prior mean (D,) and cov (D, D).

    Prior, starts and solution belong to the last epoch's stamp; every arrival has its path. Where the best solution
    rejects arrivals, more of the starts are tried: another may have a place for all of them.
    """
    problem = _Problem(epochs, mean, cov, config)
    scale = problem.scale(starts)
    if len(starts) > 1:
        starts = starts[np.argsort(problem.costs(starts, scale), kind="stable")]
    best = min((problem.descend(start, scale) for start in starts[:_FIRST]), key=_cost)
    if best.rejected and len(starts) > _FIRST:
        best = min((best, *(problem.descend(start, scale) for start in starts[_FIRST:_MOST])), key=_cost)
    return best


_FIRST, _MOST = 3, 9  # starts that are tried


def _cost(solution: Start) -> float:
    return solution.cost


class _Problem:
    """Residuals and Gauss-Newton steps over all epochs; unknowns: the state, and each epoch's bias when unknown."""

    def __init__(self, epochs: Sequence[Epoch], mean: Array, cov: Array, config: ToaConfig) -> None:
        self._config = config
        self._images = np.concatenate([e.images for e in epochs])
        self._time = np.concatenate([e.time for e in epochs])
        self._variance = np.concatenate([e.std**2 for e in epochs])
        self._sway = np.concatenate([e.net.sway[e.receiver] for e in epochs])
        self._receiver = np.concatenate([e.receiver for e in epochs])
        self._epoch = np.repeat(np.arange(len(epochs)), [len(e.time) for e in epochs])
        self._epochs = len(epochs)
        since = np.array([(e.t_ns - epochs[-1].t_ns) * 1e-9 for e in epochs])
        self._since = since[self._epoch]
        Q = [np.diag(process_noise(-age, config.process))[[0, 1, 2, 6]] for age in since]
        self._walk = np.array(Q)[self._epoch]
        self._biases = len(epochs) if config.emission == "unknown" else 0
        self._mean = np.concatenate([mean, np.zeros(self._biases)])
        self._information = np.zeros((self._mean.size, self._mean.size))
        self._size = len(mean)
        self._information[: self._size, : self._size] = np.linalg.inv(cov)

    def scale(self, starts: Array) -> float:
        """By how many s the best of the start points may be wrong."""
        if len(starts) > 1:
            return float(np.ptp(starts[:, :2], axis=0).max()) / 6 / self._config.water.start_sound_speed
        cov = np.linalg.inv(self._information[: self._size, : self._size])
        return float(np.sqrt(np.trace(cov[:3, :3]) + np.max(self._variance) * starts[0, 6] ** 2) / starts[0, 6])

    def costs(self, starts: Array, scale: float) -> Array:
        """(s,) of the start points (s, 7): the logarithms of Cauchy densities of `scale` s."""
        paths = starts[:, None, :3] + starts[:, None, 3:6] * self._since[:, None] - self._images
        late = self._time - np.sqrt(np.square(paths).sum(axis=2)) / starts[:, 6:7]
        for k in range(self._biases):
            if (here := self._epoch == k).any():
                late[:, here] -= np.median(late[:, here], axis=1, keepdims=True)
        return np.asarray(np.log1p(np.square(late / scale)).sum(axis=1))

    def residuals(self, state: Array) -> tuple[Array, Array, Array]:
        """Residuals (n,), Jacobian (n, D + biases) and variances (n,) at a state (D + biases,)."""
        own, bias = state[: self._size], state[self._size :][self._epoch] if self._biases else 0.0
        times, rows = heard_times(own, self._images, self._receiver, bias, self._since + bias)
        jacobian = np.zeros((len(times), self._mean.size))
        jacobian[:, : self._size] = rows
        if self._biases:
            jacobian[np.arange(len(times)), self._size + self._epoch] = by_emission(own, rows)
        return self._time - times, jacobian, self._variances(rows)

    def descend(self, start: Array, scale: float) -> Start:
        """Iterations with a shrinking scale, then with the arrivals within the gate alone."""
        x = np.concatenate([start, self._median_biases(start)]) if self._biases else start.copy()
        noise = float(np.sqrt(self._variance.min()))
        while scale > noise:
            r, J, variance = self.residuals(x)
            x = self._step(x, r, J, 1 / (variance * (1 + np.square(r) / np.maximum(scale**2, variance))))
            scale /= 2
        for _ in range(4):
            r, J, variance = self.residuals(x)
            inside = np.square(r) <= self._config.arrivals.gate_sigma**2 * variance
            x = self._step(x, r, J, inside / variance)
        return self._solution(x)

    def _solution(self, x: Array) -> Start:
        r, J, variance = self.residuals(x)
        squares, limit = np.square(r) / variance, self._config.arrivals.gate_sigma**2
        inside = squares <= limit
        cov = np.linalg.inv(self._normal(J, inside / variance))[: self._size, : self._size]
        used = int(inside.sum())
        receivers = len(set(self._receiver[inside].tolist()))
        off = x - self._mean
        cost = float(np.minimum(squares, limit).sum() + off @ self._information @ off)
        last = inside[self._epoch == self._epochs - 1]
        return Start(x[: self._size].copy(), (cov + cov.T) / 2, used, len(r) - used, receivers, cost, last)

    def _step(self, x: Array, r: Array, J: Array, weights: Array) -> Array:
        gradient = J.T @ (weights * r) + self._information @ (self._mean - x)
        moved = x + np.linalg.solve(self._normal(J, weights), gradient)
        moved[2] = -abs(moved[2])  # receivers on the surface cannot tell a target from its mirror image in the air
        return np.asarray(moved)

    def _normal(self, J: Array, weights: Array) -> Array:
        information = self._information.copy()
        k = np.arange(self._size, information.shape[0])
        information[k, k] = BIAS_STD**-2
        return information + (J.T * weights) @ J

    def _variances(self, rows: Array) -> Array:
        """Noise, and what the receiver's place and process noise since an older epoch do, seen along each row."""
        walked = (np.square(rows[:, [0, 1, 2, 6]]) * self._walk).sum(axis=1)
        return np.asarray(self._variance + np.square(rows[:, 0]) * self._sway + walked)

    def _median_biases(self, state: Array) -> Array:
        late = self._time - heard_times(state, self._images, self._receiver, lag=self._since)[0]
        return np.array([_median(late[self._epoch == k]) for k in range(self._biases)])


def _median(values: AnyArray) -> float:
    return float(np.median(values)) if len(values) else 0.0
