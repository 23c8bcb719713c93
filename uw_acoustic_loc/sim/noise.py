"""What the hydrophones hear when nothing pings: white and ambient noise, and snapping shrimp."""

from __future__ import annotations

import numpy as np
from scipy import fft

from ..core.impulsive import AlphaStable
from ..core.types import AnyArray, Array
from .scenario import Hydrophones
from .water import Environment

_REFERENCE = 1e-12  # Pa^2, of levels in dB re 1 uPa
_SNAP_FREQUENCY = 20e3  # Hz, where a snap's spectrum is highest
_SNAP_HALF = 50e-6  # s to either side, where a snap has fallen below 1e-3


class GaussianNoise:
    """White noise of the converter and ambient noise of the sea, independent at each hydrophone and in each frame.

    Ambient noise is flat up to 1 kHz and falls from there by the environment's slope (Wenz 1962: 5 to 6 dB per octave
    for wind noise). Both are one Gaussian spectrum, drawn in the frequency domain.
    """

    def __init__(self, env: Environment, array: Hydrophones, size: int) -> None:
        self._size, self._length = size, fft.next_fast_len(size, real=True)
        freq: Array = np.asarray(np.fft.rfftfreq(self._length, 1.0 / array.sample_rate), dtype=np.float64)
        density = 2.0 * array.noise_std**2 / array.sample_rate + ambient_density(freq, env)
        self._amplitude = np.sqrt(density * array.sample_rate * self._length / 4.0).astype(np.float32)

    def draw(self, rng: np.random.Generator) -> AnyArray:
        """(2, size) float32 Pa."""
        spectrum = rng.standard_normal((2, 2 * self._amplitude.size), dtype=np.float32).view(np.complex64)
        return np.asarray(fft.irfft(spectrum * self._amplitude, self._length)[:, : self._size])


def ambient_density(frequency: Array, env: Environment) -> Array:
    """Pa^2/Hz, one-sided, at frequencies (n,) in Hz. 65 dB at 1 kHz and -17 dB/decade: 48 dB at 10 kHz."""
    if env.ambient_level == 0.0:
        return np.zeros(frequency.shape)
    decades = np.log10(np.maximum(frequency, 1e3) / 1e3)
    return np.asarray(_REFERENCE * 10 ** ((env.ambient_level + env.ambient_slope * decades) / 10))


def add_snaps(pressure: AnyArray, env: Environment, array: Hydrophones, rng: np.random.Generator) -> None:
    """Adds the snaps of a frame to the pressure (2, N): alpha-stable amplitudes, Poisson in time.

    A snap is a plane wave from a direction uniform over the sphere, so both hydrophones hear it with the TDOA of that
    direction; one that crosses the frame's end is cut there. Amplitudes that follow a stable law make the noise as a
    whole stable in its tails (Nikias & Shao 1995, ch. 2; Chitre, Potter, Ong 2006 measured alpha near 1.7).
    """
    size, rate = pressure.shape[1], array.sample_rate
    count = int(rng.poisson(env.snap_rate * size / rate))
    time = rng.uniform(0.0, size / rate, count)
    half_tdoa = (0.5 * array.spacing / env.sound_speed) * rng.uniform(-1.0, 1.0, count)
    amplitude = AlphaStable(env.snap_alpha, scale=env.snap_scale).draw(rng, count)
    for channel, arrival in enumerate((time + half_tdoa, time - half_tdoa + array.channel_delay)):
        first = np.ceil((arrival - _SNAP_HALF) * rate)
        index = first[:, None] + np.arange(int(2 * _SNAP_HALF * rate) + 1)
        wave = amplitude[:, None] * snap(index / rate - arrival[:, None])
        inside = (index >= 0) & (index < size)
        np.add.at(pressure[channel], index[inside].astype(np.intp), wave[inside].astype(pressure.dtype))


def snap(time: Array) -> Array:
    """A snap's pressure with peak 1 at time 0: a Ricker wavelet (Ricker 1953), one broad octave around 20 kHz."""
    u = np.square(np.pi * _SNAP_FREQUENCY * time)
    return np.asarray((1.0 - 2.0 * u) * np.exp(-u))
