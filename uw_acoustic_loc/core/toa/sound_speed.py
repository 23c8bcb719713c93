"""Sound speed of sea water."""

from __future__ import annotations


def mackenzie(temperature: float, salinity: float, depth: float) -> float:
    """m/s at a temperature in deg C, a salinity in psu and a depth in m (Mackenzie 1981), good to 0.07 m/s.

    For 2 to 30 deg C, 25 to 40 psu, down to 8000 m; at 25 deg C, 35 psu and 1000 m 1550.744 m/s.
    """
    t, s, d = temperature, salinity - 35, depth
    of_temperature = 4.591 * t - 5.304e-2 * t**2 + 2.374e-4 * t**3
    of_depth = 1.630e-2 * d + 1.675e-7 * d**2 - 7.139e-13 * t * d**3
    return 1448.96 + of_temperature + 1.340 * s - 1.025e-2 * t * s + of_depth
