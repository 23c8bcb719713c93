"""Multi-target tracking over pings: constant velocity, manoeuvres, M of N initiation, coasting."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from .types import AnyArray, Array


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


@dataclass(frozen=True, eq=False)
class Track:
    """Gaussian state x, y, vx, vy at the last ping; `id` is 0 until the track is confirmed."""

    id: int
    mean: Array  # (4,)
    cov: Array  # (4, 4)
    seen_ns: int  # the last ping with a sighting
    history: tuple[bool, ...]  # sighted or not, at most the last N pings
    surprise: float = 0.0  # fading sum of NIS - 2; honest predictions keep it around 0
    manoeuvres: bool = False  # from when sightings lay further from the predictions than chance, until surprise is over

    def predict(self, duration: float, process_noise: float) -> Track:
        """x' = F x, P' = F P F^T + Q; Q of white acceleration (Bar-Shalom et al. 2001, eq. 6.2.2-12)."""
        F, Q = _constant_velocity(duration, process_noise)
        return replace(self, mean=F @ self.mean, cov=F @ self.cov @ F.T + Q)

    def ahead(self, delay: float) -> tuple[Array, Array, Array]:
        """Position (2,) and covariance (2, 2) as they will be `delay` s later, and H (2, 4), which looks ahead."""
        H = np.hstack([np.eye(2), delay * np.eye(2)])
        return H @ self.mean, H @ self.cov @ H.T, H

    def innovation(self, sighting: Sighting) -> tuple[Array, Array, Array]:
        """Innovation (2,), its covariance S (2, 2), and H (2, 4)."""
        position, cov, H = self.ahead(sighting.delay)
        return sighting.position - position, cov + sighting.cov, H

    def update(self, sighting: Sighting) -> Track:
        """Kalman update in Joseph's form."""
        innovation, S, H = self.innovation(sighting)
        K = np.linalg.solve(S, H @ self.cov).T
        left = np.eye(4) - K @ H
        cov = left @ self.cov @ left.T + K @ sighting.cov @ K.T
        surprise = _FADING * self.surprise + _nis(innovation, S) - 2.0
        manoeuvres = surprise > (0.0 if self.manoeuvres else _SURPRISED)
        mean, cov = self.mean + K @ innovation, (cov + cov.T) / 2
        return replace(self, mean=mean, cov=cov, surprise=surprise, manoeuvres=manoeuvres)

    @property
    def position_std(self) -> float:
        """Root in m of the largest eigenvalue of the position's covariance."""
        return math.sqrt(float(np.linalg.eigvalsh(self.cov[:2, :2])[-1]))


_FADING = 0.75  # four sightings' worth
_SURPRISED = 9.0  # three of its standard deviations, 2 / sqrt(1 - _FADING^2)


class Scan(Protocol):
    """What one ping shows."""

    def claim(self, tracks: Sequence[Track]) -> Sequence[Sighting | None]:
        """What tracks that are predicted to the ping see of their targets, which is then gone for others."""

    def rest(self) -> Iterable[Sighting]:
        """What no track has claimed."""


class Tracker:
    """`step` takes what one ping shows and returns the confirmed tracks at the ping's stamp.

    A target that manoeuvres is predicted with more process noise (adjustable level: Bar-Shalom et al. 2001, ch. 11).
    Confirmed tracks choose before tentative ones. A tentative track is dropped as soon as it can no longer collect M
    sightings in its first N pings.
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
        predicted = [track.predict(duration, self._noise(track)) for track in self._tracks]
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

    def _noise(self, track: Track) -> float:
        steady, moving = self.rules.process_noise, self.rules.manoeuvre_noise
        return max(steady, moving) if track.manoeuvres else steady

    def _update(self, tracks: list[Track], confirmed: bool, scan: Scan, t_ns: int) -> list[Track]:
        group = [track for track in tracks if (track.id > 0) is confirmed]
        pairs = list(zip(group, scan.claim(group), strict=True))
        if confirmed:
            self.nis = tuple(_nis(*track.innovation(seen)[:2]) for track, seen in pairs if seen)
        return [self._carry_on(track, seen, t_ns) for track, seen in pairs]

    def _carry_on(self, track: Track, sighting: Sighting | None, t_ns: int) -> Track:
        history = (*track.history, sighting is not None)[-self.rules.confirm_pings :]
        if sighting is None:
            return replace(track, history=history)
        return replace(track.update(sighting), history=history, seen_ns=t_ns)

    def _begin(self, sighting: Sighting, t_ns: int) -> Track:
        cov = np.zeros((4, 4))
        cov[2:, 2:] = self.rules.speed_std**2 * np.eye(2)
        cov[:2, :2] = sighting.cov + sighting.delay**2 * cov[2:, 2:]
        cov[:2, 2:] = cov[2:, :2] = -sighting.delay * cov[2:, 2:]
        return Track(0, np.array([*sighting.position, 0.0, 0.0]), cov, t_ns, (True,))

    def _alive(self, track: Track, t_ns: int) -> bool:
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


def _nis(innovation: Array, S: Array) -> float:
    return float(innovation @ np.linalg.solve(S, innovation))


def _constant_velocity(duration: float, process_noise: float) -> tuple[Array, Array]:
    T = duration
    F = np.kron(np.array([[1.0, T], [0.0, 1.0]]), np.eye(2)).astype(float)
    Q = process_noise * np.kron(np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]]), np.eye(2)).astype(float)
    return F, Q
