"""Parameters of bearing-only SLAM."""

from __future__ import annotations

from dataclasses import dataclass

from ...config import param
from ..localizer.config import check_ranges, check_source_ids


@dataclass(frozen=True)
class SlamConfig:
    """Parameters of bearing-only SLAM."""

    source_ids: tuple[str, ...] = param(doc="the pingers, each with its topic sources/<id>/bearing")
    method: str = param("ekf", choices=("ekf",))
    bearing_noise: str = param("gaussian", choices=("gaussian", "student_t"), doc="student_t: outliers count for less")
    bearing_std: float = param(0.0, unit="rad", low=0, high=3, changeable=True, doc="0 = the message's own variance")
    bearing_correlation_time: float = param(
        0.5, unit="s", low=0, high=1e4, changeable=True, doc="of the bearing errors; 0 = independent bearings"
    )
    range_min: float = param(2.0, unit="m", low=1e-3, doc="a pinger is not nearer than this when it starts")
    range_max: float = param(200.0, unit="m", low=1e-3, doc="nor farther than this")
    start_share: float = param(
        0.07, low=0.01, high=0.3, changeable=True, doc="a pinger starts when its range is known to this share of itself"
    )
    start_memory: float = param(
        300.0, unit="s", low=10, high=3600, changeable=True, doc="for which bearings of a pinger not known yet are kept"
    )
    array_yaw: float = param(0.0, unit="rad", low=-3.15, high=3.15, doc="of the array's +x in base_link")
    mirror: bool = param(False, doc="the side of the array is not known: carry both until a turn has settled it")
    mirror_probability: float = param(1e-3, low=1e-12, high=0.4, doc="a side less probable than this is dropped")
    gyro_std: float = param(0.01, unit="rad/s", low=1e-9, doc="white, per sample")
    gyro_bias_std: float = param(0.002, unit="rad/s", low=0, doc="at the start")
    gyro_bias_walk: float = param(1e-5, unit="rad/s per sqrt(s)", low=0)
    accelerometer_std: float = param(0.1, unit="m/s^2", low=1e-9, doc="white, per sample")
    dvl_std: float = param(0.005, unit="m/s", low=1e-9, doc="white, per sample and axis")
    dvl_bias_std: float = param(0.005, unit="m/s", low=0, doc="constant, per axis")
    tilt_std: float = param(0.02, unit="rad", low=1e-6, doc="how level the vehicle is at the start")
    gate_sigma: float = param(5.0, unit="sigma", low=1, changeable=True, doc="measurements beyond this are not used")
    reset_after: int = param(30, low=2, doc="so many unused bearings in a row restart the pinger")
    imu_timeout: float = param(0.5, unit="s", low=0.01, doc="DVL and bearings need an IMU message not older than this")
    seed: int = param(1, low=0)

    def __post_init__(self) -> None:
        check_source_ids(self.source_ids)
        check_ranges(self.range_min, self.range_max)
