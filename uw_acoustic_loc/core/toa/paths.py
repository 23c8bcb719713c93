"""Which arrivals can be used, and which path each of them came by: direct, over the seabed, over the surface.

A reflected path is a straight one from the receiver's image (Choi 2025, sec. 2): mirrored at z = -D for a flat seabed
of depth D, at z = 0 for the surface.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..types import AnyArray, Array, ArrivalPaths, Arrivals

Predictor = Callable[[Array, AnyArray], tuple[Array, Array]]  # images (n, 3), rows (n,) -> times (n,), covariance


@dataclass(frozen=True, eq=False)
class ReceiverNet:
    """Receivers and their images."""

    index: dict[int, int]  # row of a receiver's id
    images: Array  # (4, M, 3) by path (Arrivals.DIRECT, ...) and row; NaN where a path is not modelled
    sway: Array  # (M,) m^2, variance of each receiver's x

    @cached_property
    def centre(self) -> tuple[float, float]:
        """x and y in m of the middle of the receivers."""
        x, y = self.images[Arrivals.DIRECT, :, :2].mean(axis=0).tolist()
        return x, y

    @cached_property
    def extent(self) -> float:
        """m, the larger side of the box around the receivers."""
        return float(np.ptp(self.images[Arrivals.DIRECT, :, :2], axis=0).max())


@dataclass(frozen=True, eq=False)
class Epoch:
    """The usable arrivals of one ping."""

    t_ns: int
    net: ReceiverNet  # as it was then
    receiver: AnyArray  # (n,) row in the net
    path: AnyArray  # (n,)
    time: Array  # (n,) s
    std: Array  # (n,) s
    snr: Array  # (n,) dB, NaN unknown
    height: tuple[float, float, float] | None = None  # z in m, its variance and age in s, if something measures it

    @cached_property
    def receivers(self) -> frozenset[int]:
        """The rows of the net that are heard."""
        return frozenset(self.receiver.tolist())

    @property
    def images(self) -> Array:
        """(n, 3) where the arrivals seem to come to."""
        return np.asarray(self.net.images[self.path, self.receiver])

    def rows(self, keep: AnyArray | list[int]) -> Epoch:
        """The arrivals selected by a mask or by indices."""
        columns = (self.receiver[keep], self.path[keep], self.time[keep], self.std[keep], self.snr[keep])
        return Epoch(self.t_ns, self.net, *columns, height=self.height)


def make_net(ids: Sequence[int], positions: Array, bottom_depth: float, sway: Array | None = None) -> ReceiverNet:
    """The net of receivers at `positions` (M, 3); a bottom_depth of 0 leaves out the bottom path.

    `sway` (M,) m^2: how well each x is known, if not exactly.

    Raises:
        ValueError: no receiver, a repeated id, or a position that is not finite.
    """
    index = {int(name): row for row, name in enumerate(ids)}
    if not index or len(index) < len(ids):
        raise ValueError(f"receivers must have distinct ids and be at least one, got {list(map(int, ids))}")
    if positions.shape != (len(index), 3) or not np.all(np.isfinite(positions)):
        raise ValueError(f"positions must be {(len(index), 3)} finite numbers, got {positions.tolist()}")
    images = np.full((4, len(index), 3), np.nan)
    images[Arrivals.DIRECT] = positions
    if bottom_depth > 0:
        images[Arrivals.BOTTOM] = positions * [1, 1, -1] - [0, 0, 2 * bottom_depth]
    below = positions[:, 2] < 0  # at the surface the surface path is the direct one
    images[Arrivals.SURFACE, below] = positions[below] * [1, 1, -1]
    return ReceiverNet(index, images, np.zeros(len(index)) if sway is None else sway)


def screen(
    arrivals: Arrivals, net: ReceiverNet, max_delay: float = math.inf, std: float = math.nan
) -> tuple[Epoch, Counter[str]]:
    """The usable rows; how many were refused for which of the REASONS, each once, are repeated or lack a std.

    `std` stands in for one that is not given (0, negative, NaN); an arrival that is no better known than `max_delay`
    says nothing.
    """
    receiver = np.array([net.index.get(name, -1) for name in arrivals.receiver.tolist()], dtype=np.intp)
    path = np.asarray(arrivals.path, dtype=np.intp)
    time, given = np.asarray(arrivals.time, dtype=float), np.asarray(arrivals.std, dtype=float)
    stds = np.where(given > 0, given, std)
    known = (path >= 0) & (path <= Arrivals.SURFACE)
    modelled = known & ((path == 0) | np.isfinite(net.images[np.where(known, path, 0), receiver, 0]))
    passes = (np.isfinite(time), time >= 0, time <= max_delay, stds < max_delay, receiver >= 0, modelled)
    good = np.ones(len(time), dtype=bool)
    refused: Counter[str] = Counter()
    for reason, passed in zip(REASONS, passes, strict=True):
        refused[reason] = int(np.count_nonzero(good & ~passed))
        good &= passed
    usable = Epoch(arrivals.t_ns, net, receiver, path, time, stds, np.asarray(arrivals.snr, dtype=float)).rows(good)
    epoch = _without_repetitions(usable)
    refused["repeated"] = len(usable.time) - len(epoch.time)
    refused["std_not_given"] = int(np.count_nonzero(good & ~(given > 0)))
    return epoch, +refused


REASONS = (
    "not_finite",
    "negative_time",
    "from_the_future",
    "no_information",
    "unknown_receiver",
    "path_not_modelled",
)


def merged(a: Epoch, b: Epoch) -> Epoch:
    """Two messages of one stamp: the receivers report one by one, or a message has come twice."""
    receiver, path = np.concatenate([a.receiver, b.receiver]), np.concatenate([a.path, b.path])
    time, std = np.concatenate([a.time, b.time]), np.concatenate([a.std, b.std])
    snr = np.concatenate([a.snr, b.snr])
    return _without_repetitions(Epoch(a.t_ns, a.net, receiver, path, time, std, snr, height=a.height or b.height))


def _without_repetitions(epoch: Epoch) -> Epoch:
    """Of rows with the same receiver, path and time the first."""
    keys = list(zip(epoch.receiver.tolist(), epoch.path.tolist(), epoch.time.tolist(), strict=True))
    if len(set(keys)) == len(keys):
        return epoch
    return epoch.rows(sorted({key: i for i, key in reversed(list(enumerate(keys)))}.values()))


def ambiguous(epoch: Epoch) -> bool:
    """Whether a path is unlabelled, or the same one twice at a receiver."""
    keys = epoch.receiver * 4 + epoch.path
    return bool((epoch.path == Arrivals.UNKNOWN).any() or len(set(keys.tolist())) < len(keys))


def associate_by_order(epoch: Epoch) -> Epoch:
    """Without a prediction: the earliest unlabelled arrival at a receiver is the direct one, then bottom, surface."""
    taken: set[tuple[int, int]] = set()
    path = np.zeros_like(epoch.path)
    labels, receivers = epoch.path.tolist(), epoch.receiver.tolist()
    for i in np.lexsort((epoch.time, epoch.path == Arrivals.UNKNOWN)).tolist():  # labelled ones first
        options = [labels[i]] if labels[i] else _modelled(epoch.net, receivers[i])
        free = [p for p in options if (receivers[i], p) not in taken]
        if free:
            taken.add((receivers[i], free[0]))
            path[i] = free[0]
    return replace(epoch, path=path).rows(path > 0)


def associate(epoch: Epoch, predictor: Predictor, gate_sigma: float) -> tuple[Epoch, ArrivalPaths, int]:
    """The most likely joint assignment at each receiver, an arrival to a path at most once and the other way round.

    The cost is the joint squared Mahalanobis distance, and gate_sigma^2 for each path that gets no arrival; the
    probability of an assignment is taken as proportional to exp(-cost / 2). Arrivals that no assignment could want are
    left out first; of what remains the strongest are tried for each path. Last comes how many were not tried.
    """
    path, probability, untried = np.zeros_like(epoch.path), np.zeros((4, len(epoch.time))), 0
    for receiver in epoch.receivers:
        rows = np.flatnonzero(epoch.receiver == receiver)
        paths, here = _modelled(epoch.net, receiver), epoch.rows(rows)
        times, cov = predictor(epoch.net.images[paths, receiver], np.full(len(paths), receiver))
        cov[np.diag_indices(len(paths))] += np.square(here.std).mean()
        options, more = _options(here, paths, times, cov, len(paths) * gate_sigma**2)
        untried += more
        chosen, costs = zip(*_assignments(here, options, times, cov, gate_sigma**2), strict=True)
        weights = np.exp(-0.5 * (np.array(costs) - min(costs)))
        for assignment, weight in zip(chosen, weights / weights.sum(), strict=True):
            for p, i in zip(paths, assignment, strict=True):
                probability[p, rows[i]] += weight if i >= 0 else 0.0
        for p, i in zip(paths, chosen[int(np.argmin(costs))], strict=True):
            if i >= 0:
                path[rows[i]] = p
    ids = np.array(list(epoch.net.index), np.uint16)[epoch.receiver]
    believed = ArrivalPaths(epoch.t_ns, ids, epoch.time, *probability[1:].astype(np.float32))
    return replace(epoch, path=path).rows(path > 0), believed, untried


_TRIED = 6  # arrivals for a path


def _options(here: Epoch, paths: list[int], times: Array, cov: Array, limit: float) -> tuple[list[list[int]], int]:
    """For each path the arrivals to try, in their order; and how many within `limit` (squared sigma) are not tried."""
    options, untried = [], 0
    for k, p in enumerate(paths):
        fits = ((here.path == 0) | (here.path == p)) & (np.square(here.time - times[k]) <= limit * cov[k, k])
        rows = np.flatnonzero(fits)
        untried += max(len(rows) - _TRIED, 0)
        strongest = rows[np.argsort(-np.nan_to_num(here.snr[rows]), kind="stable")[:_TRIED]]
        options.append(sorted(strongest.tolist()))
    return options, untried


def _modelled(net: ReceiverNet, receiver: int) -> list[int]:
    return [p for p in (1, 2, 3) if np.isfinite(net.images[p, receiver, 0])]


def _assignments(
    here: Epoch, options: list[list[int]], times: Array, cov: Array, miss: float
) -> Iterator[tuple[tuple[int, ...], float]]:
    """For each path the arrival that it explains, or -1; and the cost. First that of no arrival at all."""
    count = len(options)
    yield (-1,) * count, miss * count
    for used in itertools.chain.from_iterable(itertools.combinations(range(count), k + 1) for k in range(3)):
        information = np.linalg.inv(cov[np.ix_(used, used)])
        for chosen in itertools.product(*(options[k] for k in used)):
            if len(set(chosen)) == len(chosen):
                innovation = here.time[list(chosen)] - times[list(used)]
                cost = float(innovation @ information @ innovation) + miss * (count - len(used))
                yield tuple(dict(zip(used, chosen, strict=True)).get(k, -1) for k in range(count)), cost
