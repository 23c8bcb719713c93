"""Parameters of the bearing localizer."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ...config import param
from ..pose_history import RESET_MOVE
from .bearing_noise import NOISES


@dataclass(frozen=True)
class LocalizerConfig:
    """Parameters of the bearing localizer."""

    source_ids: tuple[str, ...] = param(doc="the sources to locate, each with its topic sources/<id>/bearing")
    method: str = param("ekf", choices=("triangulation", "ekf", "particle_filter"))
    bearing_noise: str = param(
        "mixture", choices=NOISES, doc="of ekf and particle_filter; an ekf takes uniform for gaussian"
    )
    bearing_std: float = param(0.0, unit="rad", low=0, high=3, changeable=True, doc="0 = the message's own variance")
    bearing_correlation_time: float = param(
        0.5, unit="s", low=0, high=1e4, changeable=True, doc="of the bearing errors; 0 = independent bearings"
    )
    range_min: float = param(1.0, unit="m", low=1e-3, doc="a source is not nearer than this when first heard")
    range_max: float = param(200.0, unit="m", low=1e-3, doc="nor farther than this")
    array_yaw: float = param(0.0, unit="rad", low=-3.15, high=3.15, doc="of the array's +x in base_link")
    mirror: bool = param(True, doc="the side of the array is not known: carry both")
    mirror_probability: float = param(1e-3, low=1e-12, high=0.4, doc="a side less probable than this is dropped")
    process_noise: float = param(
        0.1, unit="m per sqrt(s)", low=0, doc="how fast odom drifts at the source (or the source wanders in it)"
    )
    source_speed_std: float = param(
        0.0, unit="m/s", low=0, high=100, doc="per axis, of a source on a straight course; 0 = still; for the ekf"
    )
    gate_sigma: float = param(5.0, unit="sigma", low=1, changeable=True, doc="bearings beyond this are not used")
    reset_after: int = param(30, low=2, doc="so many unused bearings in a row restart the source")
    odometry_timeout: float = param(1.0, unit="s", low=0.01, doc="bearings need odometry not older than this")
    odometry_jump: float = param(
        RESET_MOVE, unit="m", low=0.01, doc="odometry this far (and 3 m/s) off its own velocity was reset or glitched"
    )
    particles: int = param(2000, low=10, high=1_000_000)
    lines: int = param(400, low=4, high=100_000, doc="bearing lines that triangulation remembers")
    seed: int = param(1, low=0)

    def __post_init__(self) -> None:
        check_source_ids(self.source_ids)
        check_ranges(self.range_min, self.range_max)
        if self.lines % 2:
            raise ValueError(f"lines must be even, got {self.lines}")
        if self.source_speed_std and self.method != "ekf":
            raise ValueError(f"source_speed_std needs method ekf, got {self.source_speed_std:g} with {self.method}")


def check_source_ids(source_ids: tuple[str, ...]) -> None:
    """Ids become parts of topic names.

    Raises:
        ValueError: there is none, one is repeated, or one is not a topic name.
    """
    if not source_ids:
        raise ValueError("source_ids must name at least one source, got none")
    for k, source_id in enumerate(source_ids):
        if not re.fullmatch(r"[A-Za-z_]\w*", source_id, re.ASCII):
            raise ValueError(f"source_ids must be letters, digits and _, not starting with a digit, got {source_id!r}")
        if source_id in source_ids[:k]:
            raise ValueError(f"source_ids must differ, got {source_id!r} twice")


def check_ranges(range_min: float, range_max: float) -> None:
    """Raises ValueError unless range_min is below range_max."""
    if range_min >= range_max:
        raise ValueError(f"range_min must be below range_max, got {range_min:g} and {range_max:g} m")
