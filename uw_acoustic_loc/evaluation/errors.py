"""Estimates paired with the truth at their stamps.

Truth is interpolated: positions linearly, yaw by the shortest way; vehicles are taken as level. What is stamped outside
the truth's span is left out. Estimates in `odom` are carried to `map` first, see `map_from_odom`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.geometry import wrap_angles, yaw_from_quat
from ..core.types import AnyArray, Array, Odometry, Position
from .recording import Recording, Series


@dataclass(frozen=True, eq=False)
class Errors:
    """Estimates with their errors and covariances; for positions in map, in the first D axes."""

    t_ns: AnyArray  # (n,)
    estimate: Array  # (n, 3) position, or (n, 1) angle or speed
    error: Array  # (n, D)
    cov: Array  # (n, D, D), not positive definite where unknown

    @property
    def known(self) -> AnyArray:
        """Whether each covariance is known, (n,)."""
        return np.asarray(np.linalg.eigvalsh(self.cov)[:, 0] > 0)

    @property
    def std(self) -> Array:
        """Standard deviations (n, D), NaN where unknown."""
        variances = np.where(self.known[:, None], np.diagonal(self.cov, axis1=1, axis2=2), np.nan)
        return np.asarray(np.sqrt(variances))

    @property
    def distance(self) -> Array:
        """Lengths of the errors (n,)."""
        return np.asarray(np.linalg.norm(self.error, axis=1))

    @property
    def nees(self) -> Array:
        """NEES divided by D of the estimates with a known covariance; 1 on average if honest."""
        error, cov = self.error[self.known], self.cov[self.known]
        weighted = np.linalg.solve(cov, error[:, :, None])[:, :, 0]
        return np.asarray(np.sum(error * weighted, axis=1) / error.shape[1])


class TruePoses:
    """The poses of an odometry topic, interpolated between its messages."""

    def __init__(self, series: Series) -> None:
        self._t_ns = series.t_ns
        self.positions = np.array([value.position for value in series.values])  # (n, 3)
        self._yaw = np.unwrap([yaw_from_quat(value.quat_xyzw) for value in series.values])

    def covers(self, t_ns: AnyArray) -> AnyArray:
        """Returns (n,) whether the stamps lie between the first pose and the last."""
        return np.asarray((t_ns >= self._t_ns[0]) & (t_ns <= self._t_ns[-1]))

    def at(self, t_ns: AnyArray) -> tuple[Array, Array]:
        """Returns positions (n, 3) and yaw (n,) at stamps (n,)."""
        since, known = (t_ns - self._t_ns[0]) * 1e-9, (self._t_ns - self._t_ns[0]) * 1e-9
        position = np.stack([np.interp(since, known, axis) for axis in self.positions.T], axis=1)
        return position, wrap_angles(np.interp(since, known, self._yaw))


@dataclass(frozen=True, eq=False)
class MapFrame:
    """The pose of a frame in map: turned by yaw, then shifted."""

    origin: Array  # (3,)
    yaw: float

    @property
    def rotation(self) -> Array:
        """The rotation (3, 3) to map."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def positions(self, positions: Array) -> Array:
        """Returns positions (n, 3) in map."""
        return np.asarray(positions @ self.rotation.T + self.origin)

    def covs(self, covs: Array) -> Array:
        """Returns covariances (n, 3, 3) in map; an unknown one (-1) stays unknown."""
        return np.asarray(self.rotation @ covs @ self.rotation.T)


MAP = MapFrame(np.zeros(3), 0.0)


def true_vehicle(recording: Recording, space: str) -> TruePoses | None:
    """Returns the true poses of the vehicle in a namespace; where names differ, of the only vehicle with a truth."""
    paths = list(recording.all("true_vehicle"))
    named = [series for series in paths if series.id == space.rsplit("/", maxsplit=1)[-1]]
    found = named or (paths if len(paths) == 1 else [])
    return TruePoses(found[0]) if found else None


def map_from_odom(recording: Recording, space: str, truth: TruePoses) -> MapFrame | None:
    """Returns the pose of `odom` in map.

    `odom` is the pose of base_link at the start of the run, where dead reckoning and SLAM begin with 0, 0, 0 and yaw 0.
    So the true pose at the first odometry (else slam) stamp, less the pose that this message reports, is map <- odom;
    that pose is zero unless the recording began after the run did.
    """
    series = recording.one("odometry", space) or recording.one("slam", space)
    if series is None or not truth.covers(series.t_ns).any():
        return None
    first: Odometry = series.values[int(np.argmax(truth.covers(series.t_ns)))]
    true_position, true_yaw = truth.at(np.array([first.t_ns]))
    turn = MapFrame(np.zeros(3), float(true_yaw[0]) - yaw_from_quat(first.quat_xyzw))
    return MapFrame(true_position[0] - turn.positions(first.position), turn.yaw)


def frame_of(recording: Recording, series: Series, truth: TruePoses | None) -> MapFrame | None:
    """Returns the pose in map of a series' frame, map itself or the vehicle's odom; None when it is not known."""
    if series.values[0].frame_id.split("/")[-1] == "map":
        return MAP
    return map_from_odom(recording, series.space, truth) if truth else None


def source_errors(recording: Recording, series: Series) -> Errors | None:
    """Returns horizontal errors of a pinger's estimated position."""
    true = recording.source(series.id)
    frame = frame_of(recording, series, true_vehicle(recording, series.space))
    if true is None or frame is None:
        return None
    return _errors(series.t_ns, _estimates(series, frame), true.values[-1].position, 2)


def vehicle_errors(recording: Recording, series: Series) -> Errors | None:
    """Returns horizontal errors of a vehicle's odometry, corrected or not."""
    truth = true_vehicle(recording, series.space)
    frame = frame_of(recording, series, truth)
    return _path_errors(series, frame, truth, 2) if truth and frame else None


def target_errors(recording: Recording, series: Series) -> Errors | None:
    """Returns errors in 3-D of the buoys' target."""
    true = recording.one("true_target")
    return _path_errors(series, MAP, TruePoses(true), 3) if true else None


def mooring_errors(recording: Recording, series: Series) -> Errors | None:
    """Returns errors along x of a mooring's offset, estimated or measured."""
    true = recording.one("true_mooring", name=series.id)
    if true is None:
        return None
    matched, index = _same_stamp(series.t_ns, true.t_ns)
    positions, covs = _estimates(series, MAP)
    offsets = np.array([value.position for value in true.values])[index]
    return _errors(series.t_ns[matched], (positions[matched], covs[matched]), offsets, 1) if matched.any() else None


def _path_errors(series: Series, frame: MapFrame, truth: TruePoses, dims: int) -> Errors | None:
    inside = truth.covers(series.t_ns)
    if not inside.any():
        return None
    t_ns = series.t_ns[inside]
    positions, covs = _estimates(series, frame)
    return _errors(t_ns, (positions[inside], covs[inside]), truth.at(t_ns)[0], dims)


def _errors(t_ns: AnyArray, estimates: tuple[Array, Array], truth: Array, dims: int) -> Errors:
    positions, covs = estimates
    return Errors(t_ns, positions, (positions - truth)[:, :dims], covs[:, :dims, :dims])


def _estimates(series: Series, frame: MapFrame) -> tuple[Array, Array]:
    """Returns positions (n, 3) and covariances (n, 3, 3) in map."""
    positions = np.array([value.position for value in series.values])
    covs = np.array([_cov(value) for value in series.values])
    return frame.positions(positions), frame.covs(covs)


def _cov(value: object) -> Array:
    if isinstance(value, Odometry):
        return value.pose_cov[:3, :3]
    return value.cov if isinstance(value, Position) else -np.eye(3)


def _same_stamp(t_ns: AnyArray, true_ns: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Returns which stamps the truth has too, and the rows where it has them."""
    index = np.minimum(np.searchsorted(true_ns, t_ns), len(true_ns) - 1)
    matched = true_ns[index] == t_ns
    return matched, index[matched]
