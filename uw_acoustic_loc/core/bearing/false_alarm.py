"""Thresholds that noise alone passes at a chosen rate.

Noise is taken as complex Gaussian in both channels. Both tests are energy detectors (Urkowitz 1967), for the waveform
of a ping is unknown: one averages the whole band, the other one bin of its spectrum, where it is the matched filter of
a tone of unknown frequency and phase.
"""

from __future__ import annotations

import math
from functools import lru_cache

from scipy.optimize import brentq
from scipy.special import gammaln, polygamma, psi

_CLUSTER = 24.0  # windows that pass by chance per independent one: a sliding mean has many tries (Aldous 1989)
_STEEPEST = 1e4  # of the tilt of a distribution
MEAN_LOG = float(psi(2.0))  # of |n0|^2 + |n1|^2 in noise of power 1 per channel


def tail(alarms_per_s: float, window: float, tests: float) -> float:
    """Probability per window of `window` s, of which `tests` slide through the sound, quantised to powers of two."""
    exact = alarms_per_s * window / (tests * _CLUSTER)
    return min(float(2.0 ** math.floor(math.log2(exact))), 0.01)


@lru_cache(maxsize=1024)
def log_mean_threshold(count: float, probability: float) -> float:
    """How far the mean of `count` independent log energies lies above that of noise with a probability.

    By the saddlepoint approximation of the tail (Daniels 1987, eq. 3.3); exact to some per cent of the probability.
    """
    wanted = math.log(probability)
    if _log_tail(_STEEPEST, count) > wanted:
        return float(psi(2.0 + _STEEPEST)) - MEAN_LOG
    tilt = brentq(lambda t: _log_tail(t, count) - wanted, 1e-3, _STEEPEST, xtol=1e-3)
    return float(psi(2.0 + tilt)) - MEAN_LOG


def _log_tail(tilt: float, count: float) -> float:
    rate = tilt * psi(2.0 + tilt) - gammaln(2.0 + tilt)
    return float(-count * rate - math.log(1.0 + tilt * math.sqrt(2.0 * math.pi * count * polygamma(1, 2.0 + tilt))))


@lru_cache(maxsize=1024)
def bin_threshold(probability: float) -> float:
    """Energy of a bin of both channels, in noise powers of one, that is passed with a probability: gamma, shape 2."""
    return float(brentq(lambda s: math.log1p(s) - s - math.log(probability), 1e-3, 1e3))
