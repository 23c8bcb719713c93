"""The noise that the hydrophones receive: white and ambient noise, snapping shrimp, and the own thrusters."""

from __future__ import annotations

import math

import numpy as np
from scipy import fft

from ..core.impulsive import AlphaStable
from ..core.types import AnyArray, Array
from .acoustics import sine
from .scenario import Hydrophones, Scenario, Thruster
from .trajectory import Trajectory
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
        """Draws (2, size) float32 Pa."""
        spectrum = rng.standard_normal((2, 2 * self._amplitude.size), dtype=np.float32).view(np.complex64)
        return np.asarray(fft.irfft(spectrum * self._amplitude, self._length)[:, : self._size])


class ThrusterNoise:
    """A thruster on its direct path to each hydrophone, which the hull keeps at the same length.

    Its noise is Gaussian, its level that of the vehicle's speed in the middle of the frame, and its strength swings at
    the blade rate, as in DEMON analysis. Lines of amplitude a q^(h - 1) at h times the blade rate add up to
    a sin(p) / (1 - 2 q cos(p) + q^2), p the phase of the first.
    """

    def __init__(self, thruster: Thruster, scenario: Scenario, hydrophones: Array, trajectory: Trajectory) -> None:
        """`hydrophones` (3, 2) in base_link, m."""
        rate = scenario.hydrophones.sample_rate
        self._thruster, self._trajectory, self._rate = thruster, trajectory, rate
        self._size = round(scenario.hydrophones.frame_length * rate)
        self._length = fft.next_fast_len(self._size, real=True)
        self._distance = np.linalg.norm(hydrophones - np.array(thruster.position)[:, None], axis=0)[:, None]  # (2, 1)
        self._delay = self._distance / scenario.environment.sound_speed
        freq: Array = np.asarray(np.fft.rfftfreq(self._length, 1.0 / rate), dtype=np.float64)
        density = _density(freq, thruster.level, thruster.slope)
        self._amplitude = np.sqrt(density * rate * self._length / 4.0).astype(np.float32)
        self._response = (np.exp(-2j * np.pi * freq * self._delay) / self._distance).astype(np.complex64)

    def add(self, pressure: AnyArray, begin: float, rng: np.random.Generator) -> None:
        """Adds the thruster to a frame's pressure (2, N) that begins at a time in s."""
        speed = float(self._trajectory.at(begin + 0.5 * self._size / self._rate).speed[0])
        times = begin + np.arange(self._size) / self._rate
        strength = speed ** (self._thruster.growth / 20)
        pressure += strength * (self._broad_band(times, rng) + self._lines(times - self._delay))

    def _broad_band(self, times: Array, rng: np.random.Generator) -> AnyArray:
        """(2, N) Pa at 1 m/s."""
        spectrum = rng.standard_normal(2 * self._amplitude.size, dtype=np.float32).view(np.complex64)
        source = fft.irfft(spectrum * self._amplitude, self._length)
        source[: self._size] *= 1.0 + self._thruster.modulation * sine(self._blade_turns(times) + 0.25)
        return np.asarray(fft.irfft(fft.rfft(source) * self._response, self._length)[:, : self._size])

    def _lines(self, times: Array) -> AnyArray:
        """(2, N) Pa at 1 m/s at emission times (2, N)."""
        turns, share = self._blade_turns(times), np.float32(10 ** (-self._thruster.line_fall / 20))
        level = math.sqrt(_REFERENCE) * 10 ** (self._thruster.line_level / 20)
        return np.asarray(level / self._distance * sine(turns) / (1 - 2 * share * sine(turns + 0.25) + share**2))

    def _blade_turns(self, times: Array) -> Array:
        return self._trajectory.travelled(times) * (self._thruster.blades * self._thruster.turns_per_metre)


def ambient_density(frequency: Array, env: Environment) -> Array:
    """Returns the one-sided density (n,) in Pa^2/Hz at frequencies (n,) in Hz.

    With 65 dB at 1 kHz and -17 dB/decade it is 48 dB at 10 kHz.
    """
    if env.ambient_level == 0.0:
        return np.zeros(frequency.shape)
    return _density(frequency, env.ambient_level, env.ambient_slope)


def _density(frequency: Array, level: float, slope: float) -> Array:
    """Pa^2/Hz, flat up to 1 kHz, `slope` dB per decade above."""
    decades = np.log10(np.maximum(frequency, 1e3) / 1e3)
    return np.asarray(_REFERENCE * 10 ** ((level + slope * decades) / 10))


def add_snaps(pressure: AnyArray, env: Environment, array: Hydrophones, rng: np.random.Generator) -> None:
    """Adds the snaps of a frame to the pressure (2, N): alpha-stable amplitudes, Poisson in time.

    A snap is a plane wave from a direction uniform over the sphere, so both hydrophones receive it with the TDOA of
    that direction; one that crosses the frame's end is cut there. Amplitudes that follow a stable law make the whole
    noise stable in its tails (Nikias & Shao 1995, ch. 2; Chitre, Potter, Ong 2006 measured alpha near 1.7).
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
