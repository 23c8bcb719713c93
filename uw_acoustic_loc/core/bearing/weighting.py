"""Weightings of the generalized cross-correlation by their standard names (Knapp & Carter 1976, table 1)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..types import AnyArray

WEIGHTINGS = ("cc", "phat", "scot", "roth", "eckart", "ml")
_SMOOTH = 5  # bins over which spectra are averaged before they become weights: a single bin has no coherence
SILENCE = 1e-30  # power that stands for digital silence


def bin_weights(
    g0: NDArray[np.complexfloating[Any, Any]], g1: NDArray[np.complexfloating[Any, Any]], weighting: str
) -> AnyArray:
    """(bins,) from spectra (bins,) that are averaged over neighbouring bins."""
    kernel = np.full(min(_SMOOTH, g0.size), 1.0 / _SMOOTH)
    cross = np.abs(np.convolve(g0 * g1.conj(), kernel, "same"))
    auto_0 = np.convolve(np.abs(g0) ** 2, kernel, "same")
    auto_1 = np.convolve(np.abs(g1) ** 2, kernel, "same")
    tiny = 1e-6 * float(np.sqrt(auto_0.mean() * auto_1.mean())) + SILENCE  # digital silence has no spectrum
    if weighting == "phat":
        return np.asarray(1.0 / (cross + tiny))
    if weighting == "scot":
        return np.asarray(1.0 / (np.sqrt(auto_0 * auto_1) + tiny))
    if weighting == "roth":
        return np.asarray(1.0 / (auto_0 + tiny))
    if weighting == "eckart":
        least = 0.0005  # of the spectrum is noise at least: coherence 0.999
        noise_0, noise_1 = (np.maximum(auto - cross, least * auto + tiny) for auto in (auto_0, auto_1))
        return np.asarray(cross / (noise_0 * noise_1))
    if weighting == "ml":
        coherence = np.minimum(cross**2 / (auto_0 * auto_1 + tiny**2), 0.999)
        return np.asarray(coherence / ((cross + tiny) * (1.0 - coherence)))
    raise ValueError(f"weighting must be one of {', '.join(WEIGHTINGS)}, got {weighting!r}")
