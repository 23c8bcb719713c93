"""A lost vehicle finds itself again: its pose from bearings of pingers of the map, without a guess to linearise at."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from ..geometry import wrap_angle, wrap_angles
from ..localizer.triangulation import fits
from ..types import Array
from .inertial import YAW
from .joint import Joint, Slot
from .lines import Pose


class SeenPinger(NamedTuple):
    """A bearing of a known pinger, with where the raw track had come to; `images` are the bearing and its mirror."""

    raw: Pose
    offset: Array  # (2,) of the array in the vehicle's frame
    images: tuple[float, ...]  # rad, in the vehicle's frame
    variance: float  # rad^2
    slot: Slot


@dataclass(frozen=True, eq=False)
class Relocated:
    """The vehicle's x, y, yaw (3,), its covariance (3, 3) for a perfect map, and how it moves with the pingers."""

    pose: Array
    cov: Array
    by_pinger: dict[int, Array]  # (3, 2) by the pinger's place in the state
    cost: float


class Relocation:
    """Gathers bearings since the vehicle was lost, until these fit one pose, and only one.

    For every course the lines back from the pingers meet somewhere; Gauss-Newton on the angles follows from the best.
    The pose is taken when all bearings agree, when it is known well against the distances, and when no other place
    explains them nearly as well. `prior` (x, y, yaw and covariance) is what was still known of it.
    """

    def __init__(self, reason: str, prior: tuple[Array, Array], begun: float) -> None:
        self.reason, self.begun = reason, begun  # s, of the raw track
        self._prior: tuple[Array, Array] = prior[0], np.asarray(np.linalg.inv(prior[1]), dtype=float)
        self._sightings: list[SeenPinger] = []
        self._asked = begun - _EVERY  # when `solve` last looked for a pose

    def hear(self, sighting: SeenPinger) -> None:
        """Takes a bearing; the oldest are forgotten, since the raw track drifts."""
        self._sightings = [s for s in self._sightings if sighting.raw.time - s.raw.time < _MEMORY][-_CAPACITY:]
        self._sightings.append(sighting)

    def solve(self, joint: Joint) -> Relocated | None:
        """The pose at the last bearing; None while it is not known, or not asked for with this bearing."""
        pingers, now = {s.slot.start for s in self._sightings}, self._sightings[-1].raw.time
        if len(self._sightings) < _FEWEST or len(pingers) < 2 or now < self._asked + _EVERY:
            return None
        self._asked = now
        problem = _Problem(self._sightings, joint, self._prior)
        found = sorted(
            (problem.refined(start) for start in problem.starts()[:_REFINED]), key=lambda relocated: relocated.cost
        )
        best = found[0]
        others = [f for f in found if _apart(best, f)]
        certain = not others or others[0].cost > best.cost + _LIKELIER
        return best if certain and fits(best.cost, len(self._sightings) - 1) and problem.sharp(best) else None


class _Problem:
    """Least squares of bearings over the pose (x, y, yaw) at the last of them."""

    def __init__(self, sightings: list[SeenPinger], joint: Joint, prior: tuple[Array, Array]) -> None:
        now = sightings[-1].raw
        self._slots = [s.slot.start for s in sightings]
        self._pingers = np.array([joint.mean[s.slot.part] for s in sightings])
        self._map = np.array([joint.cov[s.slot.part, s.slot.part] for s in sightings])
        self._images = np.array([s.images for s in sightings])
        self._variance = np.array([s.variance for s in sightings])
        self._turned = np.array([s.raw.yaw - now.yaw for s in sightings])
        track = np.array([s.raw.at(s.offset) for s in sightings]) - (now.x, now.y)
        c, s = math.cos(now.yaw), math.sin(now.yaw)
        self._track = track @ np.array([[c, -s], [s, c]])  # where the array was, in the vehicle's frame now
        self._prior = prior

    def starts(self) -> list[Array]:
        """Poses for courses all round, the likeliest first."""
        names = sorted(set(self._slots))
        which = np.array([names.index(slot) for slot in self._slots])
        sides = list(product(range(self._images.shape[1]), repeat=min(len(names), _SIDES)))
        found = []
        for side in sides:
            chosen = np.array([side[k] if k < len(side) else 0 for k in which])
            bearings = self._images[np.arange(len(which)), chosen] + self._turned
            for yaw in np.arange(_COURSES) * (2 * math.pi / _COURSES):
                pose = self._meeting(yaw, bearings + yaw)
                found.append((self._cost(pose)[0], pose))
        return [pose for _, pose in sorted(found, key=lambda pair: pair[0])]

    def refined(self, pose: Array) -> Relocated:
        """Gauss-Newton steps, bearings beyond three sigma counting for less (Huber)."""
        for _ in range(_ITERATIONS):
            error, H, weight = self._linear(pose)
            information = H.T * weight @ H + self._prior[1]
            pull = H.T @ (weight * error) + self._prior[1] @ self._off(pose)
            pose = pose + np.linalg.solve(information + _DAMPING * np.diag(np.diag(information)), pull)
        error, H, weight = self._linear(pose)
        cov = np.asarray(np.linalg.inv(H.T * weight @ H + self._prior[1]), dtype=float)
        by_pinger: dict[int, Array] = {}
        for k, slot in enumerate(self._slots):
            moved = cov @ np.outer(H[k] * weight[k], H[k, :2])  # a pinger moves its bearings as minus the vehicle does
            by_pinger[slot] = by_pinger.get(slot, np.zeros((3, 2))) + moved
        pose[2] = wrap_angle(pose[2])
        return Relocated(pose, cov, by_pinger, self._cost(pose)[0])

    def sharp(self, found: Relocated) -> bool:
        """Whether a pose is known well enough to linearise at."""
        nearest = float(np.min(np.hypot(*(self._pingers - found.pose[:2]).T)))
        spread = math.sqrt(found.cov[0, 0] + found.cov[1, 1])
        return spread < _KNOWN * nearest and found.cov[2, 2] < _KNOWN_YAW**2

    def _meeting(self, yaw: float, bearings: Array) -> Array:
        """The pose of this yaw from which the lines to the pingers pass them nearest."""
        normals = np.stack([-np.sin(bearings), np.cos(bearings)], axis=1)
        c, s = math.cos(yaw), math.sin(yaw)
        back = self._pingers - self._track @ np.array([[c, s], [-s, c]])
        A = normals.T @ normals + 1e-9 * np.eye(2)
        return np.array([*np.linalg.solve(A, normals.T @ np.einsum("ij,ij->i", normals, back)), yaw])

    def _geometry(self, pose: Array) -> tuple[Array, Array, Array]:
        """Offsets to the pingers (n, 2), of the array from the vehicle now (n, 2), and the innovations (n,)."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        along = self._track @ np.array([[c, s], [-s, c]])
        offset = self._pingers - pose[:2] - along
        predicted = np.arctan2(offset[:, 1], offset[:, 0]) - pose[2] - self._turned
        errors = wrap_angles(self._images - predicted[:, None])
        nearest = np.abs(errors).argmin(axis=1)
        return offset, along, errors[np.arange(len(errors)), nearest]

    def _linear(self, pose: Array) -> tuple[Array, Array, Array]:
        """Innovations (n,), their Jacobian with respect to the pose (n, 3), and weights (n,)."""
        offset, along, error = self._geometry(pose)
        squared = np.square(offset).sum(axis=1) + 1e-6
        on = np.stack([offset[:, 1], -offset[:, 0]], axis=1) / squared[:, None]
        on_yaw = on[:, 1] * along[:, 0] - on[:, 0] * along[:, 1] - 1.0
        mapped = self._variance + np.einsum("ij,ijk,ik->i", on, self._map, on)
        weight = np.minimum(1.0, 3 * np.sqrt(mapped) / np.maximum(np.abs(error), 1e-12)) / mapped
        return error, np.column_stack([on, on_yaw]), weight

    def _cost(self, pose: Array) -> tuple[float, Array]:
        error, _, weight = self._linear(pose)
        off = self._off(pose)
        return float(weight @ np.square(error) + off @ self._prior[1] @ off), error

    def _off(self, pose: Array) -> Array:
        off = self._prior[0] - pose
        off[2] = wrap_angle(off[2])
        return np.asarray(off)


def place(joint: Joint, found: Relocated) -> None:
    """Gives the vehicle the pose that was found, with what it has in common with the pingers."""
    pose, A = [0, 1, YAW], np.zeros((3, joint.mean.size))
    for start, by_pinger in found.by_pinger.items():
        A[:, start : start + 2] = by_pinger
    rows = A @ joint.cov
    corner = found.cov + rows @ A.T
    joint.cov[pose], joint.cov[:, pose] = rows, rows.T
    joint.cov[np.ix_(pose, pose)] = (corner + corner.T) / 2
    joint.mean[pose] = found.pose


def _apart(one: Relocated, other: Relocated) -> bool:
    """Whether two solutions are different places, and not the same one reached twice."""
    off = other.pose - one.pose
    off[2] = wrap_angle(off[2])
    return float(off @ np.linalg.solve(one.cov + other.cov, off)) > 9.0


_MEMORY, _CAPACITY = 10.0, 90  # s, bearings
_FEWEST, _EVERY = 12, 0.4  # bearings, s
_COURSES, _SIDES, _REFINED = 48, 3, 12
_ITERATIONS, _DAMPING = 12, 1e-3
_KNOWN, _KNOWN_YAW = 0.25, 0.2  # of the distance; rad
_LIKELIER = 12.0
