"""Multi-target tracking over pings: steady or manoeuvring targets, M of N initiation, coasting."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..types import AnyArray, Array


@dataclass(frozen=True, eq=False)
class Sighting:
    """A position from one ping. It shows the target `delay` s after the stamp, when the ping reached the target."""

    position: Array  # (2,) m
    cov: Array  # (2, 2) m^2
    delay: float  # s


@dataclass(frozen=True)
class TrackRules:
    """How tracks begin, move and end."""

    process_noise: float  # m^2/s^3, spectral density of the white acceleration, per axis
    manoeuvre_noise: float  # m^2/s^3, the same while the target manoeuvres
    speed_std: float  # m/s, of a new track, per axis
    confirm_hits: int  # M
    confirm_pings: int  # N
    coast_time: float  # s without a sighting until a confirmed track ends
    max_speed: float = math.inf  # m/s, of any target


@dataclass(frozen=True, eq=False)
class Track:
    """State x, y, vx, vy at the last ping, a Gaussian for each mode: the target is steady (0) or manoeuvres (1).

    Interacting multiple models (Blom & Bar-Shalom 1988; Bar-Shalom et al. 2001, ch. 11). `id` is 0 until the track is
    confirmed.
    """

    id: int
    means: Array  # (2, 4)
    covs: Array  # (2, 4, 4)
    shares: Array  # (2,) probabilities of the modes
    seen_ns: int  # the last ping with a sighting that was not isolated
    history: tuple[bool, ...]  # sighted or not, at most the last N pings

    @classmethod
    def start(cls, mean: Array, cov: Array, t_ns: int) -> Track:
        """A tentative track, sighted once, whose target manoeuvres as often as any."""
        return cls(0, np.array([mean, mean]), np.array([cov, cov]), _LASTING / _LASTING.sum(), t_ns, (True,))

    @property
    def mean(self) -> Array:
        """(4,) over both modes."""
        mean: Array = self.shares @ self.means
        return mean

    @property
    def cov(self) -> Array:
        """(4, 4) over both modes."""
        apart = self.means - self.mean
        return _mixed(self.shares, self.covs + _outer(apart))

    def predict(self, duration: float, noises: tuple[float, float]) -> Track:
        """Modes mix, then x' = F x, P' = F P F^T + Q, with the `noises` of steady and manoeuvring targets."""
        stay, leave = np.exp(-duration / _LASTING), -np.expm1(-duration / _LASTING)
        switch = np.array([[stay[0], leave[0]], [leave[1], stay[1]]])
        shares = self.shares @ switch
        origins = self.shares * switch.T / shares[:, None]  # (now, before)
        means = origins @ self.means
        F = _constant_velocity(duration)
        covs = [
            F @ _mixed(origin, self.covs + _outer(self.means - mean)) @ F.T + _white_acceleration(duration, noise)
            for origin, mean, noise in zip(origins, means, noises, strict=True)
        ]
        return replace(self, means=means @ F.T, covs=np.array(covs), shares=shares)

    def ahead(self, delay: float) -> tuple[Array, Array]:
        """Position (2,) and its covariance (2, 2), as they will be `delay` s later."""
        H = _look_ahead(delay)
        return H @ self.mean, H @ self.cov @ H.T

    def nis(self, sighting: Sighting) -> float:
        """Normalised innovation squared, 2 on average."""
        position, cov = self.ahead(sighting.delay)
        innovation = sighting.position - position
        return float(innovation @ np.linalg.solve(cov + sighting.cov, innovation))

    def update(self, sighting: Sighting) -> Track:
        """Kalman update of each mode in Joseph's form; modes that predicted the sighting gain."""
        H = _look_ahead(sighting.delay)
        innovations = sighting.position - self.means @ H.T
        S = H @ self.covs @ H.T + sighting.cov
        K = np.linalg.solve(S, H @ self.covs).transpose(0, 2, 1)
        left = np.eye(4) - K @ H
        covs = left @ self.covs @ left.transpose(0, 2, 1) + K @ sighting.cov @ K.transpose(0, 2, 1)
        means = self.means + (K @ innovations[..., None])[..., 0]
        nis = (innovations * np.linalg.solve(S, innovations[..., None])[..., 0]).sum(axis=1)
        logs = np.log(self.shares) - 0.5 * (nis + np.linalg.slogdet(S)[1])
        shares = np.exp(logs - logs.max()) + _TINY
        return replace(self, means=means, covs=(covs + covs.transpose(0, 2, 1)) / 2, shares=shares / shares.sum())

    @property
    def position_std(self) -> float:
        """Root in m of the largest eigenvalue of the position's covariance."""
        return math.sqrt(float(np.linalg.eigvalsh(self.cov[:2, :2])[-1]))


_LASTING = np.array([300.0, 60.0])  # s that a target is steady, and that a manoeuvre lasts, on average
_TINY = 1e-12  # no mode is impossible


class Scan(Protocol):
    """What one ping shows."""

    def assign(self, tracks: Sequence[Track]) -> Sequence[Sighting | None]:
        """What tracks that are predicted to the ping see of their targets, which is then gone for others."""

    def rest(self) -> Iterable[Sighting]:
        """What no track has claimed."""


class Tracker:
    """`step` takes what one ping shows and returns the confirmed tracks at the ping's stamp.

    Confirmed tracks choose before tentative ones. An isolated sighting among misses, as a false alarm gives it, does
    not prolong a track's life. A tentative track is dropped as soon as it can no longer collect M sightings in its
    first N pings.
    """

    def __init__(self, rules: TrackRules) -> None:
        self.rules = rules
        self.nis: tuple[float, ...] = ()  # of the confirmed tracks' last updates; 2 on average
        self._tracks: list[Track] = []
        self._t_ns: int | None = None
        self._confirmed = 0

    def step(self, t_ns: int, scan: Scan) -> list[Track]:
        """Predicts to `t_ns`, updates, begins and ends tracks.

        Raises:
            ValueError: `t_ns` is not after the ping before.
        """
        if self._t_ns is not None and t_ns <= self._t_ns:
            raise ValueError(f"t_ns must be after the ping before, {self._t_ns}, got {t_ns}")
        duration = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * 1e-9
        self._t_ns, self.nis = t_ns, ()
        noises = self.rules.process_noise, self.rules.manoeuvre_noise
        predicted = [track.predict(duration, noises) for track in self._tracks]
        tracks = [track for confirmed in (True, False) for track in self._update(predicted, confirmed, scan, t_ns)]
        tracks += [self._begin(sighting, t_ns) for sighting in scan.rest()]
        self._tracks = [self._confirm(track) for track in tracks if self._alive(track, t_ns)]
        return self.confirmed

    @property
    def confirmed(self) -> list[Track]:
        """The confirmed tracks after the last step."""
        return [track for track in self._tracks if track.id]

    @property
    def tentative(self) -> int:
        """How many tracks wait for confirmation."""
        return sum(track.id == 0 for track in self._tracks)

    def _update(self, tracks: list[Track], confirmed: bool, scan: Scan, t_ns: int) -> list[Track]:
        group = [track for track in tracks if (track.id > 0) is confirmed]
        pairs = list(zip(group, scan.assign(group), strict=True))
        if confirmed:
            self.nis = tuple(track.nis(seen) for track, seen in pairs if seen)
        return [self._carry_on(track, seen, t_ns) for track, seen in pairs]

    def _carry_on(self, track: Track, sighting: Sighting | None, t_ns: int) -> Track:
        history = (*track.history, sighting is not None)[-self.rules.confirm_pings :]
        if sighting is None:
            return replace(track, history=history)
        isolated = sum(history) < min(2, self.rules.confirm_hits)
        return replace(track.update(sighting), history=history, seen_ns=track.seen_ns if isolated else t_ns)

    def _begin(self, sighting: Sighting, t_ns: int) -> Track:
        cov = np.zeros((4, 4))
        cov[2:, 2:] = self.rules.speed_std**2 * np.eye(2)
        cov[:2, :2] = sighting.cov + sighting.delay**2 * cov[2:, 2:]
        cov[:2, 2:] = cov[2:, :2] = -sighting.delay * cov[2:, 2:]
        return Track.start(np.array([*sighting.position, 0.0, 0.0]), cov, t_ns)

    def _alive(self, track: Track, t_ns: int) -> bool:
        if not math.hypot(*track.mean[2:].tolist()) <= self.rules.max_speed:
            return False
        if track.id:
            return (t_ns - track.seen_ns) * 1e-9 <= self.rules.coast_time
        return track.history.count(False) <= self.rules.confirm_pings - self.rules.confirm_hits

    def _confirm(self, track: Track) -> Track:
        if track.id or sum(track.history) < self.rules.confirm_hits:
            return track
        self._confirmed += 1
        return replace(track, id=(self._confirmed - 1) % _IDS + 1)


_IDS = 65535  # ids are uint16, 0 is "not confirmed"


def chi_square_limit(sigma: float, dof: AnyArray | int) -> float:
    """The chi-square value exceeded as rarely as a Gaussian exceeds mean + `sigma` (Wilson and Hilferty 1931).

    `chi_square_limit(3.0, 2)` is 13.5, exactly 13.2; up to 4 sigma it is within 6 %.
    """
    spread = 2 / (9 * dof)
    return float(dof * (1 - spread + sigma * math.sqrt(spread)) ** 3)


def _mixed(shares: Array, of: Array) -> Array:
    """Sum over the modes."""
    mixed: Array = np.tensordot(shares, of, axes=1)
    return mixed


def _outer(apart: Array) -> Array:
    """(2, 4, 4) of (2, 4)."""
    return apart[:, :, None] * apart[:, None, :]


def _look_ahead(delay: float) -> Array:
    return np.hstack([np.eye(2), delay * np.eye(2)])


def _constant_velocity(duration: float) -> Array:
    return np.kron(np.array([[1.0, duration], [0.0, 1.0]]), np.eye(2))


def _white_acceleration(duration: float, density: float) -> Array:
    """Bar-Shalom et al. 2001, eq. 6.2.2-12."""
    T = duration
    return density * np.kron(np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]]), np.eye(2))
