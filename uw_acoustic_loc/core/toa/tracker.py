"""Tracking a pinging target and the sound speed from times of arrival at buoys: extended Kalman filter (Choi 2025).

Deviations from the paper: the gate is on the innovation's own standard deviation and can reopen, because a target
with which half of the receivers have disagreed for some time is acquired again; the first epochs are solved together.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field, replace

import numpy as np

from ..types import AnyArray, Array, ArrivalPaths, Arrivals
from .agreement import Agreement, has_rounds, last_rounds
from .config import ToaConfig
from .model import heard_times, predict, with_clocks, with_height
from .paths import Epoch, ReceiverNet, ambiguous, associate, associate_by_order, merged, screen
from .solver import Start, believable, cold_prior, cold_starts, solve
from .update import ToaEstimate, around, emission_bias, too_open, updated

__all__ = ["ToaConfig", "ToaEstimate", "ToaTracker"]


@dataclass(frozen=True, eq=False)
class _Memory:
    """All that changes from epoch to epoch."""

    t_ns: int = 0
    recent: tuple[Epoch, ...] = ()  # the last few rounds
    prior: tuple[Array, Array] | None = None  # of the first epoch, until the target has been acquired
    estimate: ToaEstimate | None = None  # while tracking
    agreement: Agreement = field(default_factory=Agreement)  # while tracking
    strangers: tuple[Epoch, ...] = ()  # the last ones that were rejected as a whole while tracking
    second: tuple[int, Array] | None = None  # stamp and position (3,) of another target that they fit
    counts: Counter[str] = field(default_factory=Counter)


class ToaTracker:
    """Acquires the target from the last few epochs, then filters epoch by epoch.

    The covariance stays positive definite: an update subtracts a product with its own transpose, and every variance
    keeps the noise's share of it.
    """

    def __init__(self, config: ToaConfig, net: ReceiverNet) -> None:
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
    def second(self) -> tuple[int, Array] | None:
        """Stamp and position (3,) of another target that arrivals fitted which the track has rejected; or None."""
        return self._now.second

    @property
    def counts(self) -> Counter[str]:
        """Arrivals used, gated and refused by reason; messages that came late; targets lost."""
        counts = self._refused.copy()
        counts.update(self._now.counts)
        return counts

    def change(self, config: ToaConfig, net: ReceiverNet) -> None:
        """Goes on with other parameters, or with other receivers or receivers elsewhere from the next epoch on.

        Where clocks are estimated, other receivers are a new start.
        """
        if config.clock_stds and net.index != self._net.index:
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
        epoch, refused = screen(arrivals, self._net, self._config.max_delay, self._config.arrivals.arrival_std)
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
        recent = last_rounds((*self._now.recent, epoch), self._config.start.most_epochs)
        self._now = replace(self._now, t_ns=epoch.t_ns, recent=recent, counts=self._now.counts.copy())
        estimate = self._track(epoch) if self._now.estimate else self._acquire()
        if estimate and not believable(estimate.mean, self._net, self._config):
            self._now.counts["beyond_prior"] += 1
            self._now, estimate = replace(self._now, estimate=None, prior=None), None
        if estimate:
            self._now.counts.update(used=estimate.used, gated=estimate.rejected)
        return estimate

    # --- acquiring ------------------------------------------------------------------------------------------------

    def _acquire(self) -> ToaEstimate | None:
        recent = last_rounds(self._now.recent, self._config.start.start_epochs)
        labelled = [associate_by_order(epoch) for epoch in recent]
        if not any(len(epoch.time) for epoch in labelled):
            return None
        estimate = self._solve(labelled, None)
        if estimate and any(map(ambiguous, recent)):
            sorted_anew = [self._by_prediction(epoch, estimate) for epoch in recent]
            estimate = self._solve([epoch for epoch, _ in sorted_anew], estimate.mean)
            estimate = estimate and replace(estimate, paths=sorted_anew[-1][1])
        if has_rounds(self._now.recent, self._config.start.start_epochs):  # the prior has served, or it is wrong
            self._now = replace(self._now, estimate=estimate, agreement=Agreement(), prior=None)
        return estimate

    def _solve(self, epochs: list[Epoch], start: Array | None) -> ToaEstimate | None:
        """Only with a prior within which the arrivals' rings are straight less than three receivers make a place."""
        t_ns = epochs[-1].t_ns
        prior = self._now.prior
        if prior:
            mean, cov = predict(*prior, (t_ns - epochs[0].t_ns) * 1e-9, self._config)
            wide = any(too_open(epoch, mean, cov) for epoch in epochs)
            starts = around(mean, cov) if wide else mean[None]
        else:
            mean, cov = with_clocks(*cold_prior(self._net, self._config), len(self._net.index), self._config)
            wide, starts = True, cold_starts(self._net, mean)
        if epochs[-1].height:
            mean, cov = with_height(mean, cov, *epochs[-1].height)
        s = solve(epochs, mean, cov, starts if start is None else start[None], self._config)
        emissions = 0 if self._config.emission == "known" else len(epochs)
        if not (_vouched_for(s, emissions) if wide else s.used > s.rejected):
            return None
        return ToaEstimate(t_ns, s.mean, s.cov, s.used, s.rejected, s.cost, s.inside)

    def _by_prediction(self, epoch: Epoch, estimate: ToaEstimate) -> tuple[Epoch, ArrivalPaths | None]:
        mean, cov = predict(estimate.mean, estimate.cov, (epoch.t_ns - estimate.t_ns) * 1e-9, self._config)
        return self._associated(epoch, mean, cov)

    # --- tracking -------------------------------------------------------------------------------------------------

    def _track(self, epoch: Epoch) -> ToaEstimate | None:
        assert self._now.estimate is not None
        dt = (epoch.t_ns - self._now.estimate.t_ns) * 1e-9
        mean, cov = predict(self._now.estimate.mean, self._now.estimate.cov, dt, self._config)
        if len(epoch.receivers) < _PLACE and too_open(epoch, mean, cov):
            return self._wait_for_more(epoch, mean, cov)
        if epoch.height:
            mean, cov = with_height(mean, cov, *epoch.height)
        associated, paths = self._associated(epoch, mean, cov)
        estimate = replace(updated(associated, mean, cov, self._config), paths=paths)
        agreement = self._now.agreement.after(epoch, associated, estimate.accepted)
        self._now = replace(self._now, estimate=estimate, agreement=agreement)
        if not estimate.used and len(epoch.receivers) >= _PLACE:
            self._meet(epoch)
        if agreement.lost(self._config.start.lost_epochs):
            return self._lost()
        if agreement.contested(epoch.t_ns, self._config.start.most_epochs) and (better := self._contested(estimate)):
            self._now = replace(self._now, estimate=better, agreement=Agreement())
            return better
        return estimate

    def _wait_for_more(self, epoch: Epoch, mean: Array, cov: Array) -> ToaEstimate | None:
        """After a silence the arrivals of one receiver leave a ring, which is no normal distribution."""
        self._now = replace(self._now, estimate=None, prior=(mean, cov), recent=(epoch,))
        return self._acquire()

    def _lost(self) -> ToaEstimate | None:
        self._now.counts["lost"] += 1
        self._now = replace(self._now, estimate=None)
        return self._acquire()

    def _meet(self, epoch: Epoch) -> None:
        """Whether epochs that are rejected as a whole are those of another target, on the same topic."""
        strangers = last_rounds((*self._now.strangers, epoch), self._config.start.start_epochs)
        self._now = replace(self._now, strangers=strangers)
        if has_rounds(strangers, self._config.start.start_epochs):
            found = self._solve([associate_by_order(one) for one in strangers], None)
            second = (found.t_ns, found.mean[:3]) if found else self._now.second
            self._now = replace(self._now, strangers=(), second=second)

    def _contested(self, estimate: ToaEstimate) -> ToaEstimate | None:
        """A place that suits more of the last arrivals than the track does, found without it; None if there is none."""
        labelled = [associate_by_order(epoch) for epoch in self._now.recent]
        own, other = self._solve(labelled, estimate.mean), self._solve(labelled, None)
        if other is None or (own and (other.rejected >= own.rejected or other.nis >= own.nis)):
            return None
        self._now.counts["moved"] += 1
        return other

    def _associated(self, epoch: Epoch, mean: Array, cov: Array) -> tuple[Epoch, ArrivalPaths | None]:
        if not ambiguous(epoch):
            return epoch, None
        bias = emission_bias(associate_by_order(epoch), mean, self._config)

        def predictor(images: Array, receiver: AnyArray) -> tuple[Array, Array]:
            times, H = heard_times(mean, images, receiver, bias, bias)
            return times, H @ cov @ H.T

        found, paths, untried = associate(epoch, predictor, self._config.arrivals.gate_sigma)
        self._now.counts.update(unassociated=len(epoch.time) - len(found.time), untried=untried)
        return found, paths


def _vouched_for(solution: Start, emissions: int) -> bool:
    """Whether more arrivals than the rejected ones agree beyond those that any position and emissions would fit."""
    enough = solution.receivers >= (4 if emissions else 3)
    return enough and (not solution.rejected or solution.used - 3 - emissions > solution.rejected)


_PLACE = 3  # receivers whose rings meet in one place
_OLD_NS = 10_000_000_000  # a height is not used after that


def _given_prior(config: ToaConfig, net: ReceiverNet) -> tuple[Array, Array]:
    std = np.array(
        [*config.start.initial_position_std, *config.start.initial_velocity_std, config.water.sound_speed_std]
    )
    mean = np.array([*config.start.initial_position, *config.start.initial_velocity, config.water.start_sound_speed])
    return with_clocks(mean, np.diag(std**2), len(net.index), config)
