"""Tracking a pinging target and the sound speed from times of arrival at buoys: extended Kalman filter (Choi 2025).

Deviations from the paper: the gate is on the innovation's own standard deviation and can reopen, because a target
with half the arrivals rejected for several epochs is acquired anew; the first epochs are solved together.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field, replace

import numpy as np

from ..types import AnyArray, Array, ArrivalPaths, Arrivals
from .clock import heard_times, with_clocks
from .config import ToaConfig
from .epoch import ToaEstimate, emission_bias, updated
from .model import predict, with_height
from .paths import Epoch, Net, ambiguous, associate, associate_by_order, merged, screen
from .solver import Start, cold_prior, cold_starts, solve

__all__ = ["ToaConfig", "ToaEstimate", "ToaTracker"]


@dataclass(frozen=True, eq=False)
class _Memory:
    """All that changes from epoch to epoch."""

    t_ns: int = 0
    recent: tuple[Epoch, ...] = ()  # the last few
    prior: tuple[Array, Array] | None = None  # of the first epoch, until the target has been acquired
    estimate: ToaEstimate | None = None  # while tracking
    misled: int = 0  # epochs in a row with half of the arrivals rejected, or more
    counts: Counter[str] = field(default_factory=Counter)


class ToaTracker:
    """Acquires the target from the last few epochs, then filters epoch by epoch.

    The covariance stays positive definite: an update subtracts a product with its own transpose, and every variance
    keeps the noise's share of it.
    """

    def __init__(self, config: ToaConfig, net: Net) -> None:
        self._config, self._net = config, net
        self._now = _Memory(prior=None if config.start.cold_start else _given_prior(config, net))
        self._history: deque[tuple[_Memory, Epoch]] = deque()  # what was known before an epoch, and the epoch
        self._height: tuple[int, float, float] | None = None
        self._refused: Counter[str] = Counter()

    @property
    def tracking(self) -> bool:
        """False while the target is being acquired."""
        return self._now.estimate is not None

    @property
    def counts(self) -> Counter[str]:
        """Arrivals used, gated and refused by reason; messages that came late; targets lost."""
        counts = self._refused.copy()
        counts.update(self._now.counts)
        return counts

    def change(self, config: ToaConfig, net: Net) -> None:
        """Goes on with other parameters, or with other receivers or receivers elsewhere from the next epoch on.

        Where clocks are estimated, other receivers are a new start.
        """
        if config.receivers.buoy_clock_offset_std > 0 and net.index != self._net.index:
            self._now, self._history = _Memory(counts=self._now.counts), deque()
        self._config, self._net = config, net

    def measure_height(self, t_ns: int, z: float, variance: float) -> None:
        """A height of the target in m, from a pressure sensor say; it is used once, with the arrivals that follow."""
        self._height = (t_ns, z, variance)

    def update(self, arrivals: Arrivals) -> ToaEstimate | None:
        """The estimate at the latest stamp that has been seen, None while the target is not found.

        Late arrivals are put where they belong and the epochs after them are gone through again; those of a stamp
        that has been seen belong to that epoch.

        Raises:
            ValueError: a stamp older than the last one by more than `rewind`.
        """
        epoch, refused = screen(arrivals, self._net, self._config.max_delay)
        later = self._taken_back(epoch.t_ns)
        self._refused.update(refused)
        epoch = replace(epoch, height=self._height_at(epoch.t_ns))
        if later and later[0].t_ns == epoch.t_ns:
            epoch = merged(later.pop(0), epoch)
        self._refused["late_used"] += bool(later)
        for one in (epoch, *later):
            estimate = self._step(one)
        return estimate

    def _height_at(self, t_ns: int) -> tuple[float, float, float] | None:
        """The last measured height with its variance and age, unless it is used or old."""
        if self._height is None or not 0 <= t_ns - self._height[0] < _OLD_NS:
            return None
        measured_ns, z, variance = self._height
        self._height = None
        return z, variance, (t_ns - measured_ns) * 1e-9

    def _taken_back(self, t_ns: int) -> list[Epoch]:
        """Undoes all epochs from `t_ns` on, and returns them."""
        age = (self._now.t_ns - t_ns) * 1e-9
        if self._history and age > self._config.rewind:
            raise ValueError(
                f"arrivals must not be more than {self._config.rewind:g} s older than the last epoch, got {age:g} s"
            )
        undone: list[Epoch] = []
        while self._history and self._history[-1][1].t_ns >= t_ns:
            self._now, epoch = self._history.pop()
            undone.insert(0, epoch)
        return undone

    def _step(self, epoch: Epoch) -> ToaEstimate | None:
        self._history.append((self._now, epoch))
        while self._history[0][1].t_ns < epoch.t_ns - self._config.rewind * 1e9:
            self._history.popleft()
        recent = (*self._now.recent, epoch)[-self._config.start.start_epochs :]
        self._now = replace(self._now, t_ns=epoch.t_ns, recent=recent, counts=self._now.counts.copy())
        estimate = self._track(epoch) if self._now.estimate else self._acquire()
        if estimate:
            self._now.counts.update(used=estimate.used, gated=estimate.rejected)
        return estimate

    # --- acquiring ------------------------------------------------------------------------------------------------

    def _acquire(self) -> ToaEstimate | None:
        labelled = [associate_by_order(epoch) for epoch in self._now.recent]
        if not any(len(epoch.time) for epoch in labelled):
            return None
        estimate = self._solve(labelled, None)
        if estimate and any(map(ambiguous, self._now.recent)):
            sorted_anew = [self._by_prediction(epoch, estimate) for epoch in self._now.recent]
            estimate = self._solve([epoch for epoch, _ in sorted_anew], estimate.mean)
            estimate = estimate and replace(estimate, paths=sorted_anew[-1][1])
        if len(self._now.recent) == self._config.start.start_epochs:  # the prior has served, or it is wrong
            self._now = replace(self._now, estimate=estimate, misled=0, prior=None)
        return estimate

    def _solve(self, epochs: list[Epoch], start: Array | None) -> ToaEstimate | None:
        t_ns = epochs[-1].t_ns
        prior = self._now.prior
        if prior:
            mean, cov = predict(*prior, (t_ns - epochs[0].t_ns) * 1e-9, self._config)
            starts = mean[None]
        else:
            mean, cov = with_clocks(*cold_prior(self._net, self._config), len(self._net.index), self._config)
            starts = cold_starts(self._net, mean)
        if epochs[-1].height:
            mean, cov = with_height(mean, cov, *epochs[-1].height)
        solution = solve(epochs, mean, cov, starts if start is None else start[None], self._config)
        emissions = 0 if self._config.emission == "known" else len(epochs)
        if not (solution.used > solution.rejected if prior else _vouched_for(solution, emissions)):
            return None
        return ToaEstimate(t_ns, solution.mean, solution.cov, solution.used, solution.rejected, solution.cost)

    def _by_prediction(self, epoch: Epoch, estimate: ToaEstimate) -> tuple[Epoch, ArrivalPaths | None]:
        mean, cov = predict(estimate.mean, estimate.cov, (epoch.t_ns - estimate.t_ns) * 1e-9, self._config)
        return self._associated(epoch, mean, cov)

    # --- tracking -------------------------------------------------------------------------------------------------

    def _track(self, epoch: Epoch) -> ToaEstimate | None:
        assert self._now.estimate is not None
        dt = (epoch.t_ns - self._now.estimate.t_ns) * 1e-9
        mean, cov = predict(self._now.estimate.mean, self._now.estimate.cov, dt, self._config)
        if epoch.height:
            mean, cov = with_height(mean, cov, *epoch.height)
        associated, paths = self._associated(epoch, mean, cov)
        estimate = replace(updated(associated, mean, cov, self._config), paths=paths)
        misled = self._now.misled + 1 if estimate.rejected >= max(estimate.used, 1) else 0
        self._now = replace(self._now, estimate=estimate, misled=misled)
        if misled < self._config.start.lost_epochs:
            return estimate
        self._now.counts["lost"] += 1
        self._now = replace(self._now, estimate=None)
        return self._acquire()

    def _associated(self, epoch: Epoch, mean: Array, cov: Array) -> tuple[Epoch, ArrivalPaths | None]:
        if not ambiguous(epoch):
            return epoch, None
        bias = emission_bias(associate_by_order(epoch), mean, self._config)

        def predictor(images: Array, receiver: AnyArray) -> tuple[Array, Array]:
            times, H = heard_times(mean, images, receiver, bias, bias)
            return times, H @ cov @ H.T

        found, paths = associate(epoch, predictor, self._config.arrivals.gate_sigma)
        self._now.counts["unassociated"] += len(epoch.time) - len(found.time)
        return found, paths


def _vouched_for(solution: Start, emissions: int) -> bool:
    """Whether more arrivals than the rejected ones agree beyond those that any position and emissions would fit."""
    enough = solution.receivers >= (4 if emissions else 3)
    return enough and (not solution.rejected or solution.used - 3 - emissions > solution.rejected)


_OLD_NS = 10_000_000_000  # a height is not used after that


def _given_prior(config: ToaConfig, net: Net) -> tuple[Array, Array]:
    std = np.array(
        [*config.start.initial_position_std, *config.start.initial_velocity_std, config.water.sound_speed_std]
    )
    mean = np.array([*config.start.initial_position, *config.start.initial_velocity, config.water.start_sound_speed])
    return with_clocks(mean, np.diag(std**2), len(net.index), config)
