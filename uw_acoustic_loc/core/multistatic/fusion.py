"""From the detections of one ping, false alarms among them, to fixes: which detections show the same target."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...config import param
from ..types import AnyArray, Array
from .association import Claims, Grouping
from .estimator import METHODS, Noise, SonarNet, check_method, locate
from .model import Likelihood
from .track import Sighting, Track, TrackRules, chi_square_limit


@dataclass(frozen=True)
class MultistaticConfig:
    """Parameters of multistatic_fusion."""

    method: str = param("ml_range_bearing", choices=METHODS, doc="how a fix is found")
    range_noise: str = param(
        "rayleigh", choices=("rayleigh", "gaussian"), doc="rayleigh: echoes are late, 1.913 range_std on average"
    )
    range_std: float = param(40.0, unit="m", low=1e-3, doc="of a range whose std is not given: 0, negative or NaN")
    bearing_std: float = param(0.03, unit="rad", low=1e-6, doc="of a bearing whose std is not given")
    transmitter_position: tuple[float, ...] = param((0.0, 0.0, 0.0), unit="m", length=3, doc="used with receiver_ids")
    receiver_positions: tuple[float, ...] = param((), unit="m", doc="x y z of each receiver; empty = from the topic")
    receiver_ids: tuple[int, ...] = param((), low=0, high=65535)
    sound_speed: float = param(
        1500.0, unit="m/s", low=1350, high=1650, doc="only for when the ping reached the target, not for ranges"
    )
    gate: float = param(4.0, unit="sigma", low=1, high=10, changeable=True, doc="what belongs together")
    min_receivers: int = param(2, low=1, doc="that must agree on a fix or a new track's sighting")
    process_noise: float = param(
        0.002, unit="m^2/s^3", low=0, changeable=True, doc="spectral density of a steady target's acceleration, by axis"
    )
    manoeuvre_noise: float = param(
        0.5, unit="m^2/s^3", low=0, changeable=True, doc="the same while a target manoeuvres"
    )
    speed_std: float = param(5.0, unit="m/s", low=0.01, doc="of a new track, per axis, around 0")
    max_speed: float = param(50.0, unit="m/s", low=0.1, changeable=True, doc="no target is faster: such a track ends")
    confirm_hits: int = param(3, low=1, doc="a track is confirmed by this many sightings ...")
    confirm_pings: int = param(4, low=1, high=100, doc="... in this many pings")
    coast_time: float = param(30.0, unit="s", low=0, changeable=True, doc="a track without detections ends after this")
    seed: int = param(1, low=0, doc="not used: the fusion draws no random numbers")

    def __post_init__(self) -> None:
        if self.confirm_hits > self.confirm_pings:
            raise ValueError(
                f"confirm_hits must be at most confirm_pings, got {self.confirm_hits} of {self.confirm_pings}"
            )

        if len(self.receiver_positions) != 3 * len(self.receiver_ids):
            raise ValueError(
                f"receiver_positions must have 3 numbers for each of the {len(self.receiver_ids)} receiver_ids, "
                f"got {len(self.receiver_positions)}"
            )

    @property
    def rules(self) -> TrackRules:
        """What the tracker needs of this."""
        return TrackRules(
            self.process_noise,
            self.manoeuvre_noise,
            self.speed_std,
            self.confirm_hits,
            self.confirm_pings,
            self.coast_time,
            self.max_speed,
        )


@dataclass(frozen=True, eq=False)
class Echoes:
    """Detections of one ping, a row each, all usable."""

    receiver: AnyArray  # (D,) row of SonarNet.receivers
    range: Array  # (D,) m, as measured
    range_std: Array  # m
    bearing: Array  # rad
    bearing_std: Array  # rad
    snr: Array  # dB, NaN unknown

    def take(self, rows: Sequence[int]) -> Echoes:
        """Some of the rows."""
        r = list(rows)
        return Echoes(
            self.receiver[r], self.range[r], self.range_std[r], self.bearing[r], self.bearing_std[r], self.snr[r]
        )


@dataclass(frozen=True, eq=False)
class TargetFix:
    """One target of one ping."""

    position: Array  # (2,) m
    cov: Array  # (2, 2) m^2
    rows: tuple[int, ...]  # of Echoes
    misfit: float  # sum of squared normalised residuals of `ml_range_bearing`; 2 len(rows) - 2 degrees of freedom


class Fusion:
    """Fixes of a net, ping by ping; it remembers nothing.

    Detections are grouped (see `Grouping`); a group of at least `min_receivers` is fitted as one point, and is a fix
    when the misfit of range sums and bearings lies within the gate. The strongest comes first: most receivers, then
    the highest summed SNR. Its detections are taken away, and the rest is grouped again.

    Raises:
        ValueError: the net does not suit the method.
    """

    def __init__(self, net: SonarNet, config: MultistaticConfig) -> None:
        check_method(net, config.method)
        self.net, self.config = net, config
        self.needed = min(config.min_receivers, len(net.receivers))

    def fixes(self, echoes: Echoes) -> Iterator[TargetFix]:
        """All fixes of a ping, the strongest first, of the likeliest groups."""
        yield from Search(self, echoes).fixes(set(range(len(echoes.receiver))))

    def fit(self, echoes: Echoes, rows: tuple[int, ...]) -> TargetFix | None:
        """One point through a group; None when the detections do not agree or the method finds no point."""
        own = echoes.take(rows)
        net = SonarNet(self.net.transmitter, self.net.receivers[own.receiver])
        noise = self._noise(own)
        found = joint = locate(net, own.range, own.bearing, noise, "ml_range_bearing")
        if not joint.misfit <= chi_square_limit(self.config.gate, max(2 * len(rows) - 2, 1)):
            return None
        if self.config.method != "ml_range_bearing":
            try:
                found = locate(net, own.range, own.bearing, noise, self.config.method)
            except ValueError:  # these receivers alone are too few for the method, or in line
                return None
        return TargetFix(found.positions, found.cov, rows, float(joint.misfit)) if found.converged else None

    def single(self, echoes: Echoes) -> Likelihood:
        """Every detection as a receiver of its own, the ranges' bias removed; (D, 1)."""
        ranges = echoes.range - self._noise(echoes).bias
        weights = echoes.range_std[:, None] ** -2.0, echoes.bearing_std[:, None] ** -2.0
        receivers = self.net.receivers[echoes.receiver]
        return Likelihood(self.net.transmitter, receivers, ranges[:, None], echoes.bearing[:, None], *weights)

    def _noise(self, echoes: Echoes) -> Noise:
        return Noise(echoes.range_std, echoes.bearing_std, self.config.range_noise == "rayleigh")


class Search:
    """The fixes of one ping. What has been found out about a group is kept from one search to the next."""

    def __init__(self, fusion: Fusion, echoes: Echoes) -> None:
        self._fusion, self._echoes = fusion, echoes
        self.single = fusion.single(echoes)
        self._grouping = Grouping(self.single, echoes.receiver, fusion.config.gate)
        self._snr = np.nan_to_num(echoes.snr).tolist()
        self._fits: dict[tuple[int, ...], TargetFix | None] = {}
        self.left_out = 0  # groups that were not tried

    def fixes(self, free: set[int]) -> Iterator[TargetFix]:
        """Fixes of the `free` rows, the strongest first."""
        free, tried, self.left_out = set(free), set[tuple[int, ...]](), 0
        needed = self._fusion.needed
        if len(free) < needed:
            return
        while groups := [g for g in self._grouping.groups(free) if len(g) >= needed and g not in tried]:
            if len(tried) >= _TRIED:
                self.left_out = len(groups)
                return
            best = max(groups, key=lambda group: (len(group), sum(self._snr[row] for row in group), group))
            tried.add(best)
            if best not in self._fits:
                self._fits[best] = self._fusion.fit(self._echoes, best)
            if fix := self._fits[best]:
                free -= set(best)
                yield fix


_TRIED = 20  # groups of a ping


class PingScan:
    """The scan of one ping: a confirmed track lives on any detection, a new one needs `min_receivers` at once."""

    def __init__(self, fusion: Fusion, echoes: Echoes, search: Search | None = None) -> None:
        self._fusion, self._search = fusion, search or Search(fusion, echoes)
        self._free = set(range(len(echoes.receiver)))
        config = fusion.config
        self._claims = Claims(self._search.single, echoes.receiver, config.gate, config.sound_speed)

    def assign(self, tracks: Sequence[Track]) -> list[Sighting | None]:
        """See `Scan`."""
        claimed = self._claims.rows(tracks, self._free)
        return [self._take(track, rows) for track, rows in zip(tracks, claimed, strict=True)]

    def rest(self) -> Iterator[Sighting]:
        """See `Scan`."""
        for fix in self._search.fixes(self._free):
            outward = float(np.hypot(*(fix.position - self._fusion.net.transmitter)))
            yield Sighting(fix.position, fix.cov, outward / self._fusion.config.sound_speed)

    def _take(self, track: Track, rows: list[int]) -> Sighting | None:
        if len(rows) < (1 if track.id else self._fusion.needed):
            return None
        self._free -= set(rows)
        return self._claims.sighting(track, rows)
