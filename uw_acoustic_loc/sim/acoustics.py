"""What a source sends and over which paths it arrives: pulses, image sources, absorption."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

import numpy as np

from ..core.types import AnyArray, Array
from .scenario import Pinger
from .water import Environment

EDGE = 0.1  # share of a pulse taken by each raised-cosine edge
_RINGING = math.log(1e4)  # time constants until a resonator is taken as silent


def images(source: Array, env: Environment) -> tuple[Array, Array]:
    """(3, P) image sources and (P,) amplitude coefficients, the source itself first (Allen & Berkley 1979).

    Two opposite boundaries have the images of `_row`; those of a basin are all triples of them, along each axis one,
    whose bounces add up to no more than the most. Left out are paths whose coefficient is 0 and, in a basin, those
    that are nowhere in it as loud as `floor_db`.
    """
    walls, most = env.walls, env.reflections
    heights = _row(source[2], (0.0, -env.depth), (env.surface_reflection, env.bottom_reflection), most)
    if walls is None:
        positions, gains = _grid([_row(x, (0.0, 0.0), (0.0, 0.0), 0) for x in source[:2]] + [heights], most)
        return positions[:, gains != 0.0], gains[gains != 0.0]
    x, y, _ = walls.to_basin(source)
    along = _row(x, (0.0, walls.length), walls.reflection[:2], most)
    across = _row(y, (0.0, walls.width), walls.reflection[2:], most)
    positions, gains = _grid([along, across, heights], most)
    size = np.array([[walls.length], [walls.width], [-env.depth]])
    nearest = np.linalg.norm(positions - np.clip(positions, np.minimum(size, 0.0), np.maximum(size, 0.0)), axis=0)
    loud = np.abs(gains) >= 10 ** (walls.floor_db / 20) * np.maximum(nearest, 1.0)
    loud[0] = True
    return walls.to_map(positions[:, loud]), gains[loud]


def absorption(frequency: float, env: Environment) -> float:
    """dB/m of sea water at half the depth, frequency in Hz (Francois & Garrison 1982, part II: boric acid, magnesium
    sulphate and pure water).

    50 kHz, 27 degrees C, 35 psu, pH 8.1, 20 m of water: 0.01071 dB/m.
    """
    f, T, S, D = frequency * 1e-3, env.temperature, env.salinity, 0.5 * env.depth
    c = 1412.0 + 3.21 * T + 1.19 * S + 0.0167 * D
    boric = 8.86 / c * 10 ** (0.78 * env.ph - 5.0)
    f1 = 2.8 * math.sqrt(S / 35.0) * 10 ** (4.0 - 1245.0 / (273.0 + T))
    magnesium = 21.44 * S / c * (1.0 + 0.025 * T) * (1.0 - 1.37e-4 * D + 6.2e-9 * D**2)
    f2 = 8.17 * 10 ** (8.0 - 1990.0 / (273.0 + T)) / (1.0 + 0.0018 * (S - 35.0))
    if T <= 20.0:
        water = 4.937e-4 - 2.59e-5 * T + 9.11e-7 * T**2 - 1.5e-8 * T**3
    else:
        water = 3.964e-4 - 1.146e-5 * T + 1.45e-7 * T**2 - 6.5e-10 * T**3
    water *= 1.0 - 3.83e-5 * D + 4.9e-10 * D**2
    return 1e-3 * f**2 * (boric * f1 / (f1**2 + f**2) + magnesium * f2 / (f2**2 + f**2) + water)


def pulse(pinger: Pinger, age: Array, phases: Array | None = None) -> Array:
    """Pressure at 1 m at ages (...) in s, with raised-cosine edges or a resonator's; 0 outside [0, `sounding`].

    A noise pulse is a sum of tones of equal amplitude across the band, 1 / pulse_length apart, with random phases
    (K,) from `tone_phases`: the same at every fractional instant. Its period is the pulse's length.

    Raises:
        ValueError: a noise pulse without phases.
    """
    if pinger.q_factor:
        return np.asarray(pinger.source_level * _resonance(pinger, age), dtype=np.float64)
    share = age / pinger.pulse_length
    edge = np.clip(np.minimum(share, 1.0 - share) / EDGE, 0.0, 1.0)
    if pinger.pulse == "noise":
        wave = _tones(pinger, age, phases)
    elif pinger.pulse == "tone":
        wave = sine(_centre(pinger) * age)
    else:
        wave = sine((pinger.band_low + (_centre(pinger) - pinger.band_low) * share) * age)
    return np.asarray(pinger.source_level * wave * np.square(sine(0.25 * edge)), dtype=np.float64)


def sounding(pinger: Pinger) -> float:
    """Length of a pulse in s with the ringing after it, which ends at -80 dB."""
    ringing = _RINGING * pinger.q_factor / (math.pi * _centre(pinger))
    return pinger.pulse_length + ringing


def tone_phases(pinger: Pinger, rng: np.random.Generator) -> Array:
    """(K,) phases in rad of a noise pulse's tones."""
    count = max(1, round((pinger.band_high - pinger.band_low) * pinger.pulse_length))
    return rng.uniform(0.0, 2 * np.pi, count)


def pings(pinger: Pinger, begin: float, end: float) -> range:
    """Indices of the pings that start in [begin, end); ping k starts at offset + k period, k >= 0."""
    first = max(0, math.ceil((begin - pinger.offset) / pinger.period))
    return range(first, max(first, math.ceil((end - pinger.offset) / pinger.period)))


def sine(turns: Array) -> AnyArray:
    """float32 sine; whole turns are taken off before, so that its error is 2e-7 whatever their number."""
    rest = np.rint(turns)
    np.subtract(turns, rest, out=rest)
    rest *= 2 * np.pi
    return np.asarray(np.sin(rest.astype(np.float32)))


def _centre(pinger: Pinger) -> float:
    return 0.5 * (pinger.band_low + pinger.band_high)


def _resonance(pinger: Pinger, age: Array) -> Array:
    """A tone of amplitude 1 after a resonator, H(s) = (w / Q) s / (s^2 + (w / Q) s + w^2) with w that of the tone.

    It answers to sin(w t + p) from t = 0 on with sin(w t + p) - Im(z exp(a t)), its pole a = -d + j v, d = w / (2 Q),
    and z = (w cos p - d sin p) / v + j sin p, by partial fractions of the Laplace transforms. A pulse is such a tone,
    and the same tone taken off again when the pulse ends.
    """
    frequency, length, damping = _centre(pinger), pinger.pulse_length, 0.5 / pinger.q_factor
    own, phase = math.sqrt(1.0 - damping**2), 2 * math.pi * frequency * length
    rising = complex(1.0 / own, 0.0)
    ringing = rising * cmath.exp(2 * math.pi * frequency * length * complex(-damping, own))
    ringing -= complex((math.cos(phase) - damping * math.sin(phase)) / own, math.sin(phase))
    over = age >= length
    since = np.maximum(age - length * over, 0.0)
    turns = own * frequency * since + over * (cmath.phase(ringing) / (2 * math.pi))
    free = np.exp((-2 * math.pi * frequency * damping * since).astype(np.float32)) * sine(turns)
    wave = sine(frequency * age) * ~over - np.where(over, abs(ringing), abs(rising)) * free
    return np.asarray(wave * ((age > 0.0) & (age <= sounding(pinger))))


def _row(place: float, ends: tuple[float, float], coefficients: Sequence[float], most: int) -> tuple[Array, Array]:
    """(2 most + 1,) images between two opposite boundaries and their coefficients, in the order of their bounces.

    A path of n bounces leaves towards the first boundary or towards the second and then alternates: two per n.
    """
    paths = [(place, 1.0), (place, 1.0)]
    row = paths[:1]
    for bounce in range(most):
        sides = [(first + bounce) % 2 for first in range(2)]
        paths = [(2.0 * ends[k] - at, gain * coefficients[k]) for k, (at, gain) in zip(sides, paths, strict=True)]
        row += paths
    at, gains = np.array(row).T
    return at, gains


def _grid(rows: Sequence[tuple[Array, Array]], most: int) -> tuple[Array, Array]:
    """(3, P) triples of the rows' images with at most so many bounces in all, and the products of coefficients."""
    bounces = [(np.arange(gains.size) + 1) // 2 for _, gains in rows]
    k = np.nonzero(np.add.outer(np.add.outer(bounces[0], bounces[1]), bounces[2]) <= most)
    positions = np.stack([at[i] for (at, _), i in zip(rows, k, strict=True)])
    return positions, np.asarray(np.prod([gains[i] for (_, gains), i in zip(rows, k, strict=True)], axis=0))


def _tones(pinger: Pinger, age: Array, phases: Array | None) -> Array:
    """Sum of all tones with mean square 1/2, by Horner's rule on the powers of one tone."""
    if phases is None:
        raise ValueError("phases must be (K,) for a noise pulse, got None")
    step = (pinger.band_high - pinger.band_low) / phases.size
    turn = np.exp(2j * np.pi * step * age)
    total = np.zeros(age.shape, complex)
    for weight in np.exp(1j * phases[::-1]):
        total *= turn
        total += weight
    total *= np.exp(2j * np.pi * (pinger.band_low + 0.5 * step) * age)
    return np.asarray(total.imag / math.sqrt(phases.size))
