"""EKF-SLAM that goes through its first minutes again once the gyro's bias is known (an iterated EKF over the track)."""

from __future__ import annotations

import math
from collections.abc import Callable

from .inertial import YAW_BIAS
from .slam import Slam, SlamConfig
from .types import Array

Event = Callable[[Slam], None]


class SlamPasses:
    """As many passes over the first minutes as the yaw gyro's bias needs; `slam` is the latest that is complete.

    Until a pinger is known nothing tells of the bias: the track is drawn, and linearised, with that of the prior. When
    the bias proves to lie elsewhere, a pass linearised there goes through all measurements since the start, several to
    each new one, and takes over when it has caught up.
    """

    def __init__(self, config: SlamConfig) -> None:
        self.slam = Slam(config)
        self._again: Slam | None = None
        self._past: list[Event] | None = []  # None when forgotten
        self._next = 0  # event that the pass under way takes next
        self._begin_ns = 0

    def change(self, config: SlamConfig) -> None:
        """Holds from now on; the past, heard under another configuration, is not gone through again."""
        self.slam.config = config
        self._past = self._again = None

    def on_imu(self, t_ns: int, rates: Array, force: Array) -> None:
        """See `Slam.on_imu`."""
        self._take(t_ns, lambda slam: slam.on_imu(t_ns, rates, force))

    def on_velocity(self, t_ns: int, linear: Array) -> None:
        """See `Slam.on_velocity`."""
        self._take(t_ns, lambda slam: slam.on_velocity(t_ns, linear))

    def on_bearing(self, source_id: str, t_ns: int, bearing: float, variance: float, offset: Array) -> None:
        """See `Slam.on_bearing`."""
        self._take(t_ns, lambda slam: slam.on_bearing(source_id, t_ns, bearing, variance, offset))

    def _take(self, t_ns: int, event: Event) -> None:
        """A measurement that the filter refuses is not remembered."""
        event(self.slam)
        self._begin_ns = self._begin_ns or t_ns
        age = (t_ns - self._begin_ns) * 1e-9
        if age > _MEMORY:
            self._past = self._again = None
        if self._past is None:
            return
        self._past.append(event)
        if self._again is None and self._bent(age):
            self._again, self._next = Slam(self.slam.config, self.slam.joint.mean.item(YAW_BIAS)), 0
        if self._again is not None:
            self._catch_up(self._again, self._past)

    def _bent(self, age: float) -> bool:
        """Whether the bias certainly lies where it turns the track out of what its linearisation bears."""
        joint = self.slam.joint
        if not self.slam.config.gyro_bias_std:
            return False
        shift = abs(joint.mean.item(YAW_BIAS) - self.slam.linearised_at)
        return shift * age > _BEARABLE and shift > _SURE * math.sqrt(joint.cov.item(YAW_BIAS, YAW_BIAS))

    def _catch_up(self, again: Slam, past: list[Event]) -> None:
        for event in past[self._next : self._next + _PACE]:
            event(again)
        self._next += _PACE
        if self._next >= len(past):
            again.restore_prior()
            self.slam, self._again = again, None


_MEMORY = 300.0  # s
_BEARABLE = 0.1  # rad of yaw since the start
_SURE = 3.0  # standard deviations
_PACE = 8  # events of the past to each new one
