"""Errors of the buoys' sound speed and of the sonar net's single-ping fixes."""

from __future__ import annotations

import numpy as np

from ..core.types import AnyArray, Array, NodePositions, Position, Tracks
from ..sim.targets import met_by_ping
from .errors import Errors
from .recording import Recording, Series

SOUND_SPEED = 1500.0  # m/s, from transmitter to target; 3 % of it move a fix of a target of 10 m/s at 3 km by 0.6 m


def sound_speed_errors(recording: Recording, series: Series) -> Errors | None:
    """Returns errors in m/s against the last true value at each log time (the message has no stamp)."""
    true = recording.one("true_sound_speed")
    if true is None:
        return None
    last = np.searchsorted(true.t_ns, series.t_ns, side="right") - 1
    after = last >= 0
    if not after.any():
        return None
    values = np.array([value.value for value in series.values])[after, None]
    truth = np.array([value.value for value in true.values])[last[after], None]
    return Errors(series.t_ns[after], values, values - truth, _variances(recording, series)[after])


def _variances(recording: Recording, series: Series) -> Array:
    """Returns the variances (n, 1, 1) of sound speeds by the std logged at the same time; -1 is unknown."""
    stds = recording.one("sound_speed_std", series.space)
    known = {value.t_ns: value.value**2 for value in stds.values} if stds else {}
    return np.array([known.get(int(t_ns), -1.0) for t_ns in series.t_ns])[:, None, None]


def fix_errors(recording: Recording, series: Series) -> Errors | None:
    """Returns horizontal errors of single-ping fixes against the nearest true target of the same stamp.

    A fix is where the ping met the target, its stamp is the ping's transmission. So the truth is moved along its
    velocity by the ping's travel time from the transmitter, where sonar/positions has one.
    """
    true = recording.one("true_targets")
    if true is None:
        return None
    targets = {value.t_ns: value for value in true.values if value.x.size}
    fixes = [fix for fix in series.values if fix.t_ns in targets]
    if not fixes:
        return None
    transmitter = _transmitter(recording.one("sonar_nodes", series.space))
    errors = np.array([_nearest(fix, _where_met(targets[fix.t_ns], transmitter)) for fix in fixes])
    positions, covs = np.array([fix.position for fix in fixes]), np.array([fix.cov for fix in fixes])
    return Errors(_stamps(fixes), positions, errors, covs[:, :2, :2])


def track_count(series: Series) -> int:
    """Counts the different tracks."""
    return len({int(number) for tracks in series.values for number in tracks.id})


def _nearest(fix: Position, targets: Array) -> Array:
    """Returns the error (2,) against the nearest of targets (T, 3)."""
    errors = (fix.position - targets)[:, :2]
    return np.asarray(errors[np.argmin(np.hypot(*errors.T))])


def _where_met(targets: Tracks, transmitter: Array | None) -> Array:
    """Returns where the ping met the targets, (T, 3)."""
    positions = np.stack([targets.x, targets.y, targets.z], axis=1)
    if transmitter is None:
        return positions
    velocities = np.stack([targets.vx, targets.vy, targets.vz], axis=1)
    return met_by_ping(transmitter, len(positions), lambda t: positions + velocities * t[:, None], SOUND_SPEED)


def _transmitter(nodes: Series | None) -> Array | None:
    if nodes is None:
        return None
    last: NodePositions = nodes.values[-1]
    sending = last.positions[last.role == NodePositions.TRANSMITTER]
    return sending[0] if len(sending) else None


def _stamps(fixes: list[Position]) -> AnyArray:
    return np.array([fix.t_ns for fix in fixes], dtype=np.int64)
