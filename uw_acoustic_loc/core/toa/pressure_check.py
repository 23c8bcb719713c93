"""Whether a target's pressure sensor gives what it should: the absolute pressure, in Pa."""

from __future__ import annotations

import math

from ..types import Arrivals
from .config import ToaConfig
from .model import height_from_pressure, water_column
from .paths import ReceiverNet
from .tracker import ToaEstimate, ToaTracker

_UNITS = {"mbar": 1e2, "kPa": 1e3, "dbar": 1e4, "bar": 1e5}  # Pa
_THIN = 0.9  # of the air's pressure: no absolute pressure under water is lower
_DEEPEST = 1.2e8  # Pa
_FAR, _PINGS = 4.0, 3  # standard deviations of the arrivals' own depth, and pings in a row, of a wrong depth
_LEAST = 1.0  # m
_SURE = 7.0  # log-likelihood by which the arrivals must speak for a gauge pressure


class PressureCheck:
    """Refuses pressures that cannot be, and compares the others with what the arrivals show.

    Two more trackers hear the arrivals: one without pressure, and one that takes it for a gauge pressure.
    """

    def __init__(self) -> None:
        self._alone: ToaTracker | None = None
        self._gauge: ToaTracker | None = None
        self._off, self._off_m, self._for_gauge = 0, math.nan, 0.0
        self._sentence = ""

    @property
    def warnings(self) -> list[str]:
        """Sentences with the measured figures; none when all is well."""
        found = [self._sentence] if self._sentence else []
        if self._for_gauge > _SURE:
            found.append(
                f"the arrivals fit a target {self._air_m:.1f} m below what the pressure says, "
                f"{self._off_m:.1f} m by themselves: a gauge pressure?"
            )
        elif self._off >= _PINGS:
            found.append(f"by the pressure the target is {self._off_m:.1f} m above what the arrivals show")
        return found

    def use(self, config: ToaConfig, net: ReceiverNet) -> None:
        """Takes over parameters and receivers."""
        self._config = config
        self._air_m, _ = height_from_pressure(0.0, 0.0, config.pressure)  # m of water that weigh as much as the air
        if config.pressure.pressure_std > 0 and not self._alone:
            self._alone, self._gauge = ToaTracker(config, net), ToaTracker(config, net)
        for tracker in (self._alone, self._gauge):
            if tracker:
                tracker.change(config, net)

    def admit(self, pressure: float, config: ToaConfig) -> None:
        """Raises ValueError with the likely reason for a pressure in Pa that no target under water has."""
        self._sentence, air = "", config.pressure.surface_pressure
        if _THIN * air <= pressure <= _DEEPEST:
            return
        column = -2 * water_column(config.water)[0]
        most = air * (1 + column / height_from_pressure(0.0, 0.0, config.pressure)[0])
        units = [unit for unit, pascal in _UNITS.items() if _THIN * air <= pressure * pascal <= most]
        likely = f"in {' or '.join(units)}, or a gauge pressure?" if units else "a gauge pressure?"
        self._sentence = (
            f"pressure must be absolute and in Pa, from that of the air ({air:g}) up, got {pressure:g}: {likely}"
        )
        raise ValueError(self._sentence)

    def measure_height(self, t_ns: int, z: float, variance: float) -> None:
        """The height that the tracker is given."""
        if self._gauge:
            self._gauge.measure_height(t_ns, z - self._air_m, variance)

    def compare(self, arrivals: Arrivals, estimate: ToaEstimate | None) -> None:
        """Takes in what the tracker makes of the arrivals with the pressure."""
        if not (self._alone and self._gauge):
            return
        alone, gauge = self._alone.update(arrivals), self._gauge.update(arrivals)
        if estimate and alone:
            self._off_m = float(estimate.mean[2] - alone.mean[2])
            std = math.sqrt(alone.cov[2, 2] + estimate.cov[2, 2])
            self._off = self._off + 1 if abs(self._off_m) > max(_FAR * std, _LEAST) else 0
        if estimate and gauge and self._alone.tracking:
            gain = (self._misfit(estimate) - self._misfit(gauge)) / 2
            self._for_gauge = min(max(self._for_gauge + gain, 0.0), 2 * _SURE)

    def _misfit(self, estimate: ToaEstimate) -> float:
        return estimate.nis + estimate.rejected * self._config.arrivals.gate_sigma**2
