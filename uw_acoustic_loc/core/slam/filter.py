"""EKF-SLAM with bearings of several pingers, an IMU and a Doppler log (Choi et al. 2016, section 3)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..localizer.localizer import independent_share, std_of
from ..localizer.triangulation import PlanarFix
from ..types import Array, Bearing, BodyVelocity, Imu
from .config import SlamConfig
from .gap import bridge
from .inertial import ATTITUDE, GYRO_BIAS, LOG_BIAS, SIZE, VELOCITY, YAW, moved
from .joint import Joint
from .landmark import Landmark, images_of
from .lines import Pose
from .relocation import Relocation, SeenPinger, place
from .velocity_log import VelocityLog


class SourceBearing(NamedTuple):
    """A bearing and whose it is."""

    source_id: str
    bearing: Bearing


Measurement = Imu | BodyVelocity | SourceBearing


class Slam:
    """The vehicle starts at the origin of odom, level, yaw 0. Measurements come in stamp order.

    Biases of the gyro and of the Doppler log are states: as white noise they would make the estimate overconfident.
    Bearing errors with a correlation time count with `independent_share`.
    """

    def __init__(self, config: SlamConfig) -> None:
        self.config = config
        variances = np.zeros(SIZE)
        variances[ATTITUDE] = config.tilt_std**2, config.tilt_std**2, 0.0
        variances[VELOCITY] = _START_SPEED**2
        variances[GYRO_BIAS], variances[LOG_BIAS] = config.gyro_bias_std**2, config.dvl_bias_std**2
        self.joint = Joint(np.zeros(SIZE), variances)
        self.pingers: dict[str, Landmark] = {}
        self.dvl = VelocityLog()
        self.relocation: Relocation | None = None  # while the vehicle is lost
        self.relocations = 0
        self.imu_gaps = 0  # longer than imu_timeout
        self.imu_ahead = 0  # IMU readings in a row from too far in the future
        self.imu_age = 0.0  # s, how old the last IMU reading was when another sensor's came
        self._reading = np.zeros((2, 3))  # angular rate and specific force, held until the next
        self._raw = Pose(0.0, 0.0, 0.0, 0.0)  # dead reckoning with the biases in it
        self._heard_ns: dict[str, int] = {}
        self._begin_ns = self._t_ns = self._imu_ns = self._dvl_ns = self._velocity_ns = 0
        self._interval = 0.0  # s between the last two IMU readings
        self._gathered, self._pending = np.zeros((2, 3)), 0.0  # integral of the readings, and s, not yet in `joint`

    @property
    def angular(self) -> Array:
        """(3,) the last angular rate without its bias."""
        return np.asarray(self._reading[0] - self.joint.mean[GYRO_BIAS])

    @property
    def dvl_age(self) -> float:
        """Time in s since the last velocity that said something, or since the start."""
        return (self._t_ns - (self._velocity_ns or self._begin_ns)) * 1e-9

    def settle(self) -> None:
        """Brings `joint` to the last stamp; it may be some readings of the IMU behind."""
        if self._pending > 0:
            steps, rates, force = math.ceil(self._pending / _LONGEST_STEP), *(self._gathered / self._pending)
            for _ in range(steps):
                self._step(self._pending / steps, rates, force)
            self._gathered[:], self._pending = 0.0, 0.0

    def take(self, measurement: Measurement) -> None:
        """Takes the next measurement.

        An IMU reading holds from its stamp until the next (eq. 9); a velocity over ground corrects by three scalars; a
        bearing corrects (eq. 11-15), or adds a line to a pinger that is not known yet.

        Raises:
            ValueError: a reading that no vehicle can feel, an unusable variance, no recent IMU reading, or a stamp that
                does not advance, or advances by too much.
        """
        match measurement:
            case Imu():
                self._take_imu(measurement)
            case BodyVelocity():
                self._take_velocity(measurement)
            case SourceBearing():
                self._take_bearing(*measurement)

    def position(self, source_id: str) -> PlanarFix | None:
        """Where a pinger is; None while its side or its range is not known."""
        return self.pingers[source_id].fix if source_id in self.pingers else None

    def _take_imu(self, imu: Imu) -> None:
        t_ns = imu.t_ns
        _require_plausible("angular rate", imu.angular, _FASTEST, "rad/s")
        _require_plausible("specific force", imu.acceleration, _HARDEST, "m/s^2")
        if self._imu_ns:
            self._require_near(t_ns)
            self._require_order(t_ns)
            _require_later("IMU reading", t_ns, self._imu_ns)
            self._go_on((t_ns - self._imu_ns) * 1e-9, t_ns)
        self._begin_ns = self._begin_ns or t_ns
        self._reading = np.array((imu.angular, imu.acceleration))
        self._imu_ns, self._t_ns, self.imu_age, self.imu_ahead = t_ns, t_ns, 0.0, 0

    def _take_velocity(self, velocity: BodyVelocity) -> None:
        t_ns = velocity.t_ns
        self._require_imu(t_ns)
        _require_later("velocity", t_ns, self._dvl_ns)
        self._gather(t_ns)
        self.settle()
        self._dvl_ns = t_ns
        if self.dvl.correct(self.joint, velocity, self.config):
            self._velocity_ns = t_ns

    def _take_bearing(self, source_id: str, bearing: Bearing) -> None:
        t_ns, heard_ns = bearing.t_ns, self._heard_ns.get(source_id, 0)
        std = self.config.bearing_std or std_of(bearing.variance)
        self._require_imu(t_ns)
        _require_later("bearing", t_ns, heard_ns)
        self._gather(t_ns)
        self.settle()
        interval = (t_ns - heard_ns) * 1e-9 if heard_ns else math.inf
        share = independent_share(interval, self.config.bearing_correlation_time)
        self._heard_ns[source_id] = t_ns
        landmark = self.pingers.setdefault(source_id, Landmark(self.joint))
        if self.relocation is not None:
            self._relocate(self.relocation, landmark, bearing, std**2 / share)
            return
        landmark.update(self.config, self._raw, bearing.bearing, std, share, bearing.position[:2])
        if self._most_unused():
            self.joint.widen(slice(0, 2), _ASTRAY**2)
            self.joint.widen(slice(YAW, YAW + 1), _TURNED**2)
            self._lose("bearings of most known pingers do not fit")

    def _relocate(self, relocation: Relocation, landmark: Landmark, bearing: Bearing, variance: float) -> None:
        """Bearings of known pingers locate the vehicle; those of others wait until then."""
        if landmark.slot is None:
            return
        images = tuple(images_of(bearing.bearing, self.config))
        relocation.hear(SeenPinger(self._raw, bearing.position[:2], images, variance, landmark.slot))
        found = relocation.solve(self.joint)
        if found is not None:
            place(self.joint, found)
            self.relocation, self.relocations = None, self.relocations + 1

    def _most_unused(self) -> bool:
        """Whether the vehicle, and not a pinger, is wrong: most of the known pingers do not fit."""
        known = [pinger for pinger in self.pingers.values() if pinger.slot is not None]
        wrong = [pinger for pinger in known if pinger.unused_in_a_row >= self.config.reset_after // 5]
        return len(wrong) > 1 and 2 * len(wrong) > len(known)

    def _lose(self, reason: str) -> None:
        """From now on the pose is looked for; what is still known of it, with doubt, is the prior."""
        pose = [0, 1, YAW]
        self.relocation = Relocation(
            reason, (self.joint.mean[pose], self.joint.cov[np.ix_(pose, pose)]), self._raw.time
        )
        for pinger in self.pingers.values():
            pinger.drop_lines()
            pinger.unused_in_a_row = 0

    def _go_on(self, interval: float, t_ns: int) -> None:
        """The readings of one step are taken together; not with those before a gap."""
        self._interval = interval
        if interval > self.config.imu_timeout:
            self._bridge(interval, t_ns)
            return
        self._gather(t_ns)
        if self._pending + interval > _LONGEST_STEP:
            self.settle()

    def _bridge(self, interval: float, t_ns: int) -> None:
        """Lines from before and after a gap do not belong to one known track."""
        self.settle()
        bridge(self.joint, (t_ns - self._t_ns) * 1e-9, self.angular.item(2))
        self._raw = self._raw._replace(time=self._raw.time + (t_ns - self._t_ns) * 1e-9)
        self._t_ns, self.imu_gaps = t_ns, self.imu_gaps + 1
        for pinger in self.pingers.values():
            pinger.drop_lines()
        known = any(pinger.slot is not None for pinger in self.pingers.values())
        if known and (self.relocation is not None or self.joint.cov.item(YAW, YAW) > _TURNED_TOO_FAR**2):
            self._lose(f"the IMU was silent for {interval:.1f} s")

    def _gather(self, t_ns: int) -> None:
        """Lets the held reading last until a stamp."""
        dt = (t_ns - self._t_ns) * 1e-9
        self._gathered += dt * self._reading
        self._t_ns, self._pending = t_ns, self._pending + dt

    def _step(self, dt: float, rates: Array, force: Array) -> None:
        config, joint, interval = self.config, self.joint, self._interval
        gyro = config.gyro_std**2 * interval  # power densities of the held noise
        accelerometer = config.accelerometer_std**2 * interval
        self._raw = self._reckoned(dt, rates.item(2))
        driving, added = np.zeros(12), np.zeros(9)
        driving[GYRO_BIAS], added[VELOCITY] = gyro / dt, accelerometer * dt
        joint.move(*moved(joint.mean, rates, force, dt), driving, added)
        joint.widen(GYRO_BIAS, config.gyro_bias_walk**2 * dt)

    def _reckoned(self, dt: float, rate: float) -> Pose:
        """The raw pose after dt s, from the yaw rate and the log's velocity."""
        raw, get = self._raw, self.joint.mean.item
        u, v = get(VELOCITY.start) + get(LOG_BIAS.start), get(VELOCITY.start + 1) + get(LOG_BIAS.start + 1)
        midway = raw.yaw + rate * dt / 2
        c, s = math.cos(midway), math.sin(midway)
        return Pose(raw.x + (c * u - s * v) * dt, raw.y + (s * u + c * v) * dt, raw.yaw + rate * dt, raw.time + dt)

    def _require_order(self, t_ns: int) -> None:
        if t_ns < self._t_ns:
            raise ValueError(f"stamp {t_ns} ns must not be before {self._t_ns} ns, which has been handled")

    def _require_near(self, t_ns: int) -> None:
        """Stamps that stay far ahead are a clock set forward, or a long gap; odom stays what it was."""
        gap = (t_ns - self._imu_ns) * 1e-9
        self.imu_ahead = self.imu_ahead + 1 if gap > _LONGEST_GAP else 0
        if 0 < self.imu_ahead <= _BELIEVED_AFTER:
            raise ValueError(f"IMU stamp is {gap:.1f} s after the last one, at most {_LONGEST_GAP:g} s are believed")

    def _require_imu(self, t_ns: int) -> None:
        if not self._imu_ns:
            raise ValueError("no IMU reading yet")
        self._require_order(t_ns)
        self.imu_age = (t_ns - self._imu_ns) * 1e-9
        if self.imu_age > self.config.imu_timeout:
            raise ValueError(f"the IMU is {self.imu_age:.3f} s behind, allowed are {self.config.imu_timeout:g} s")


def _require_later(what: str, t_ns: int, last_ns: int) -> None:
    if t_ns <= last_ns:
        raise ValueError(f"{what} at {t_ns} ns must come after the one at {last_ns} ns")


def _require_plausible(what: str, vector: Array, limit: float, unit: str) -> None:
    largest = max(map(abs, vector.tolist()))
    if largest > limit:
        raise ValueError(f"{what} must be at most {limit:g} {unit} on each axis, got {largest:g}")


_START_SPEED = 3.0  # m/s, std per axis before the Doppler log speaks
_LONGEST_STEP = 0.04  # s
_LONGEST_GAP, _BELIEVED_AFTER = 60.0, 3  # s, and stamps in a row that are farther ahead
_TURNED_TOO_FAR = 0.5  # rad of yaw's std, beyond which bearings cannot be linearised
_ASTRAY, _TURNED = 50.0, 2.0  # m and rad of doubt about a pose that no bearing fits
_FASTEST, _HARDEST = 10.0, 100.0  # rad/s, m/s^2; beyond is a fault, one held reading of which would turn the track
