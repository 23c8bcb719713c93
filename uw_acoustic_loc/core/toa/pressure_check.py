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
_SURE = 5.0  # log-likelihood by which a gauge pressure must explain the difference better


class PressureCheck:
    """Refuses pressures that cannot be, and compares the others with the depth that the arrivals alone show."""

    def __init__(self) -> None:
        self._alone: ToaTracker | None = None  # it hears the arrivals, but no pressure
        self._off, self._off_m = 0, math.nan
        self._sentence = ""

    @property
    def warnings(self) -> list[str]:
        """Sentences with the measured figures; none when all is well."""
        found = [self._sentence] if self._sentence else []
        if self._off >= _PINGS:
            gauge = "; a gauge pressure would be" if abs(self._off_m - self._air_m) < 0.3 * self._air_m else ""
            found.append(f"by the pressure the target is {self._off_m:.1f} m above what the arrivals show{gauge}")
        return found

    def use(self, config: ToaConfig, net: ReceiverNet) -> None:
        """Takes over parameters and receivers."""
        self._air_m, _ = height_from_pressure(0.0, 0.0, config.pressure)  # m of water that weigh as much as the air
        if config.pressure.pressure_std > 0 and self._alone is None:
            self._alone = ToaTracker(config, net)
        elif self._alone:
            self._alone.change(config, net)

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

    def compare(self, arrivals: Arrivals, estimate: ToaEstimate | None) -> None:
        """Takes in what the tracker makes of the arrivals with the pressure."""
        if self._alone is None:
            return
        alone = self._alone.update(arrivals)
        if alone is None or estimate is None:
            return
        self._off_m = float(estimate.mean[2] - alone.mean[2])
        variance = float(alone.cov[2, 2] + estimate.cov[2, 2])
        far = abs(self._off_m) > max(_FAR * math.sqrt(variance), _LEAST)
        gauge = self._air_m * (self._off_m - self._air_m / 2) / variance  # log-likelihood over that of no shift
        self._off = self._off + 1 if far or gauge > _SURE else 0
