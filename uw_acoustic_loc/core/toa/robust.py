"""How much of a measurement counts when its noise is impulsive: a weight for filters that take Gaussian noise.

A weight w in (0, 1] divides the measurement's variance (iteratively reweighted least squares, one step), where a gate
knows 0 and 1 only.
"""

from __future__ import annotations

import numpy as np

from ..impulsive import ImpulsiveNoise
from ..types import Array

_LEAST = 1e-6


def mixture_weights(innovations: Array, predicted_var: Array, noise: ImpulsiveNoise) -> Array:
    """Probability of each error (n,) to be of the noise's Gaussian part, the Bayes rule for its two parts.

    `predicted_var` (n,) is that of the predicted measurement, without the noise; impulses are taken to be far wider.
    """
    if noise.fraction == 0:
        return np.ones(np.shape(innovations))
    S = predicted_var + noise.std**2
    gaussian = (1 - noise.fraction) * np.exp(-0.5 * np.square(innovations) / S) / np.sqrt(2 * np.pi * S)
    impulse = noise.fraction * noise.impulse.density(innovations / noise.std) / noise.std
    return np.asarray(np.maximum(gaussian / np.maximum(gaussian + impulse, 1e-300), _LEAST))


def student_t_weights(innovations: Array, predicted_var: Array, std: Array | float, dof: float) -> Array:
    """The same for Student-t noise of `dof` degrees of freedom and scale `std` (Lange, Little, Taylor 1989).

    A weight does not exceed 1: a small innovation makes nothing more precise than it is.
    """
    nis = np.square(innovations) / (predicted_var + np.square(std))
    return np.asarray(np.minimum((dof + 1) / (dof + nis), 1.0))
