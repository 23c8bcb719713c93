"""A second pool, to judge the bearing node with: made otherwise than the package's simulator, with none of its code.

    run = PoolRun(seed=7)                  # a drawn pool, pinger, array and track; or PoolRun(seed, pool=..., ...)
    write_bag(path, run.events())          # known_run.write_bag; then `uwloc process` and `uwloc score`
    for begin, samples in run.frames():    # (s, (2, N) float32 Pa)
    run.truth                              # per ping: arrival, TDOA, cone angle, azimuth, elevation, range

How it differs from the package's simulator:

- sound is made in the frequency domain, path by path: a closed spectrum of the pulse, scaled by each path's own Doppler
  factor, instead of samples of the pulse at retarded times;
- the pulse is an envelope after two equal resonators, 1 - (1 + a t) exp(-a t), on a tone of random phase;
- walls and floor have an impedance, so that a coefficient depends on the angle and turns negative at grazing, and a
  loss that grows with frequency; the surface has ripples, whose loss grows with frequency and steepness (Eckart 1953);
- images come from closed forms instead of bounce after bounce, as many as arrive within `reverberation`;
- noise is coloured, continuous, and coherent between the hydrophones as a diffuse field is, sin(kd) / (kd);
- the vehicle turns with a smooth yaw rate, may change its depth, and may roll and pitch.

Frame: map, ENU; the corner at the origin, x in [0, length], y in [0, width], z in [-depth, 0]. Absorption in the water
is left out: in fresh water it is below 1 dB/km at these frequencies.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy import fft
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from uw_acoustic_loc.core.types import AnyArray, Array, HydrophoneInfo, Odometry, Point, Samples

START_NS = 1_790_000_000_000_000_000
FULL = 15e3, 25e3  # Hz from the tone: the spectrum is whole within the first, and fades to nothing at the second
FLOOR = 1e-3  # of the direct path's level, below which a path is left out
CENTRE = 30e3  # Hz, of the noise's level and the walls' loss


@dataclass(frozen=True)
class Pool:
    """A rectangular pool. Impedances are relative to water; tiled concrete has 3 to 6."""

    length: float  # m, along x
    width: float  # m, along y
    depth: float  # m
    sound_speed: float = 1481.0  # m/s
    wall_impedance: float = 4.5
    floor_impedance: float = 4.0
    loss: float = 0.08  # nepers per bounce at 30 kHz, in proportion to frequency
    ripple: float = 1.5e-3  # m, rms height of the surface
    reverberation: float = 0.12  # s of paths after the emission; 0 = the direct path alone


@dataclass(frozen=True)
class Tone:
    """A pinger."""

    id: str
    position: tuple[float, float, float]  # m
    frequency: float  # Hz
    length: float  # s, switched on
    period: float  # s
    offset: float = 0.3  # s
    level: float = 200.0  # Pa at 1 m
    q: float = 15.0  # of both resonators

    def spectrum(self, away: Array) -> Array:
        """Of the complex envelope, at frequencies `away` from the tone, Pa / Hz at 1 m."""
        a = math.pi * self.frequency / self.q
        gate = self.length * np.sinc(away * self.length) * np.exp(-1j * np.pi * away * self.length)
        return np.asarray(self.level * gate / np.square(1 + 2j * np.pi * away / a))


@dataclass(frozen=True)
class Track:
    """Two legs and a turn between them, the yaw rate a raised cosine; depth changes evenly, attitude swings."""

    start: tuple[float, float, float]  # m
    heading: float  # rad, of the first leg
    legs: tuple[float, float]  # s
    turn: float  # rad, positive to port
    turn_time: float = 8.0  # s
    speed: float = 0.4  # m/s
    climb: float = 0.0  # m/s
    swing: float = 0.0  # rad, of roll and pitch

    @property
    def duration(self) -> float:
        return sum(self.legs) + self.turn_time

    def __post_init__(self) -> None:
        t = np.arange(-1.0, self.duration + 1.0, 1e-3)
        share = np.clip((t - self.legs[0]) / self.turn_time, 0.0, 1.0)
        yaw = self.heading + self.turn * (share - np.sin(2 * np.pi * share) / (2 * np.pi))
        steps = 1e-3 * self.speed * np.exp(1j * yaw)
        path = np.cumsum(steps) - 0.5 * steps  # trapezoids
        path += complex(*self.start[:2]) - np.interp(0.0, t, path)
        z = self.start[2] + self.climb * t
        knots = np.stack([path.real, path.imag, z, yaw])[:, ::20]
        object.__setattr__(self, "_spline", CubicSpline(t[::20], knots, axis=1))

    def at(self, time: Array) -> tuple[Array, Rotation]:
        """(3, n) m and attitudes at times (n,) s."""
        x, y, z, yaw = self._spline(time)  # type: ignore[attr-defined]
        roll, pitch = self.swing * np.sin(2 * np.pi * time / 3.1), self.swing * np.sin(2 * np.pi * time / 4.3 + 1.0)
        return np.stack([x, y, z]), Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1))


@dataclass(frozen=True)
class Heard:
    """Truth of one ping, by its direct path."""

    id: str
    time: float  # s, when it reached the middle of the array
    tdoa: float  # s, arrival at hydrophone 0 minus arrival at hydrophone 1
    cone: float  # rad from the array's +x: acos(c tdoa / spacing)
    azimuth: float  # rad in base_link, counter-clockwise
    elevation: float  # rad in base_link, positive up
    range: float  # m


@dataclass
class PoolRun:
    """A run; what is not given is drawn from the seed, in the ranges of `draw`."""

    seed: int
    pool: Pool | None = None
    tones: tuple[Tone, ...] = ()
    track: Track | None = None
    spacing: float = 0.0  # m; 0 = 0.45 wavelengths of the first tone
    snr_db: float = 30.0  # of the first tone's direct path at the middle of the run, in 2 kHz during the pulse
    noise_slope: float = -12.0  # dB per decade
    sample_rate: float = 500e3  # Hz
    frame_length: float = 0.1  # s
    truth: list[Heard] = field(init=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng([self.seed, 0])
        self.pool = self.pool or Pool(rng.uniform(18, 30), rng.uniform(9, 15), rng.uniform(2.5, 5.5))
        self.track = self.track or draw_track(self.pool, rng)
        self.tones = self.tones or (draw_tone(self.pool, self.track, rng),)
        self.spacing = self.spacing or 0.45 * self.pool.sound_speed / self.tones[0].frequency
        self._size = round(self.frame_length * self.sample_rate)
        self._arrivals = sorted((emission, tone) for tone in self.tones for emission in self._emissions(tone))
        self.truth = [self._heard(emission, tone) for emission, tone in self._arrivals]
        far = float(np.median([h.range for h in self.truth if h.id == self.tones[0].id]))
        self.noise_density = self.tones[0].level / far / math.sqrt(2 * 2e3) * 10 ** (-self.snr_db / 20)  # Pa / sqrt(Hz)

    def events(self, space: str = "/auv1") -> Iterator[tuple[int, str, object]]:
        """What a driver and a navigation filter would publish, and the truth; odometry is exact, in `odom`."""
        yield START_NS, f"{space}/hydrophones/info", self.info
        for tone in self.tones:
            yield START_NS, f"/truth/sources/{tone.id}/position", Point(START_NS, np.array(tone.position))
        for time in np.arange(0.0, self.track.duration, 0.05):
            yield t_ns(time), f"{space}/odometry", self._odometry(time, "odom")
            yield t_ns(time), f"/truth{space}/odometry", self._odometry(time, "map")
        for begin, (h0, h1) in self.frames():
            end = begin + self.frame_length
            yield t_ns(end), f"{space}/hydrophones/samples", Samples(t_ns(begin), h0, h1)

    @property
    def info(self) -> HydrophoneInfo:
        return HydrophoneInfo(START_NS, self.sample_rate, self.spacing, self.pool.sound_speed, 1.0)

    def frames(self) -> Iterator[tuple[float, AnyArray]]:
        """Begin in s and (2, N) Pa of each frame."""
        waiting, sounding = list(self._arrivals), []
        noise = self._noise(0)
        for k in range(int(self.track.duration / self.frame_length)):
            following = self._noise(k + 1)
            frame = noise[:, self._size :] + following[:, : self._size]
            noise, first = following, k * self._size
            while waiting and waiting[0][0] * self.sample_rate < first + self._size:
                sounding.append(self._received(*waiting.pop(0)))
            sounding = [(at, sound) for at, sound in sounding if at + sound.shape[1] > first]
            for at, sound in sounding:
                low, high = max(at, first), min(at + sound.shape[1], first + self._size)
                if low < high:
                    frame[:, low - first : high - first] += sound[:, low - at : high - at]
            yield first / self.sample_rate, frame

    def clean(self, ping: int) -> tuple[float, AnyArray]:
        """Begin in s and (2, N) Pa of ping k of `truth` alone, without noise, with all its echoes."""
        first, sound = self._received(*self._arrivals[ping])
        return first / self.sample_rate, sound

    def _emissions(self, tone: Tone) -> Array:
        return np.arange(tone.offset, self.track.duration - 0.3, tone.period)

    def _hydrophones(self, time: Array, channel: int) -> Array:
        place, attitude = self.track.at(time)
        return place + attitude.apply([(channel - 0.5) * self.spacing, 0.0, 0.0]).T

    def _reach(self, emission: float, images: Array, channel: int) -> Array:
        """(M,) s when the sound of images (3, M) reaches a hydrophone: t = emission + |x(t) - image| / c."""
        time = np.full(images.shape[1], emission)
        for _ in range(6):  # the error shrinks by v / c each time
            apart = self._hydrophones(time, channel) - images
            time = emission + np.sqrt((apart**2).sum(axis=0)) / self.pool.sound_speed
        return time

    def _heard(self, emission: float, tone: Tone) -> Heard:
        source, c = np.array(tone.position)[:, None], self.pool.sound_speed
        t0, t1 = (float(self._reach(emission, source, channel)[0]) for channel in range(2))
        time = 0.5 * (t0 + t1)
        place, attitude = self.track.at(np.array([time]))
        ahead = attitude.inv().apply((source - place).T)[0]
        far = float(np.linalg.norm(ahead))
        cone = math.acos(max(-1.0, min(1.0, c * (t0 - t1) / self.spacing)))
        return Heard(tone.id, time, t0 - t1, cone, math.atan2(ahead[1], ahead[0]), math.asin(ahead[2] / far), far)

    def _received(self, emission: float, tone: Tone) -> tuple[int, AnyArray]:
        """First sample and (2, N) Pa of a ping with all its echoes."""
        rate, c = self.sample_rate, self.pool.sound_speed
        turned = np.exp(2j * np.pi * np.random.default_rng([self.seed, 1, round(emission * 1e6)]).random())
        images, bounces = self._images(emission, np.array(tone.position))
        nearest = np.linalg.norm(images[:, 0] - self._hydrophones(np.array([emission]), 0)[:, 0]) / c
        first = math.floor((emission + nearest - 2e-3) * rate)
        tail = tone.length + 12 * tone.q / (math.pi * tone.frequency)
        count = fft.next_fast_len(math.ceil((self.pool.reverberation + tail + 8e-3) * rate), real=True)
        freq = np.arange(count // 2 + 1) * (rate / count)
        bins = np.flatnonzero(np.abs(freq - tone.frequency) < FULL[1])
        fade = np.clip((FULL[1] - np.abs(freq[bins] - tone.frequency)) / (FULL[1] - FULL[0]), 0.0, 1.0)
        spectra = np.zeros((2, freq.size), complex)
        for channel in range(2):
            total = _sum(tone, freq[bins], self._paths(emission, images, bounces, channel, first / rate))
            spectra[channel, bins] = 0.5 * rate * turned * total * np.sin(0.5 * np.pi * fade) ** 2
        return first, fft.irfft(spectra, count).astype(np.float32)

    def _images(self, emission: float, source: Array) -> tuple[Array, Array]:
        """(3, M) images that matter, the source first, and (4, M) bounces: at walls along x and y, floor, surface."""
        pool = self.pool
        far = pool.sound_speed * pool.reverberation
        x, y, h = source[0], source[1], source[2] + pool.depth
        sides = [_line(s, size, far) for s, size in zip((x, y, h), (pool.length, pool.width, pool.depth), strict=True)]
        grid = np.meshgrid(*(np.arange(len(side)) for side in sides), indexing="ij")
        (xs, ys, zs) = (side[k.ravel()] for side, k in zip(sides, grid, strict=True))
        images = np.stack([xs[:, 0], ys[:, 0], zs[:, 0] - pool.depth])
        bounces = np.stack([xs[:, 1:].sum(axis=1), ys[:, 1:].sum(axis=1), zs[:, 1], zs[:, 2]])
        apart = self._hydrophones(np.array([emission]), 0) - images
        gain, linear, square = _loss(pool, apart, bounces)
        level = np.abs(gain) * np.exp(-linear * CENTRE - square * CENTRE**2)
        direct = np.flatnonzero(bounces.sum(axis=0) == 0)[0]
        loud = (level > FLOOR * level[direct]) & (np.linalg.norm(apart, axis=0) < far)
        loud[direct] = False
        keep = np.concatenate([[direct], np.flatnonzero(loud)])
        return images[:, keep], bounces[:, keep]

    def _paths(self, emission: float, images: Array, bounces: Array, channel: int, begin: float) -> Array:
        """(5, n) of paths (3, n): delay after `begin`, Doppler factor, gain, coefficients of f and f^2 in its loss."""
        time, c = self._reach(emission, images, channel), self.pool.sound_speed
        apart = self._hydrophones(time, channel) - images
        moved = self._hydrophones(time + 5e-4, channel) - self._hydrophones(time - 5e-4, channel)
        doppler = 1.0 - (apart * moved).sum(axis=0) / np.linalg.norm(apart, axis=0) / 1e-3 / c
        return np.stack([time - begin, doppler, *_loss(self.pool, apart, bounces)])

    def _noise(self, k: int) -> AnyArray:
        """(2, 2 N) Pa from frame k - 1 on, faded in and out so that neighbours add up to a steady noise."""
        rng, count = np.random.default_rng([self.seed, 2, k]), 2 * self._size
        freq = np.arange(count // 2 + 1) * (self.sample_rate / count)
        density = self.noise_density * (np.maximum(freq, 500.0) / CENTRE) ** (self.noise_slope / 20)
        spectrum = rng.standard_normal((2, 2 * freq.size), dtype=np.float32).view(np.complex64)
        common = np.sinc(2 * freq * self.spacing / self.pool.sound_speed)
        spectrum[1] = common * spectrum[0] + np.sqrt(1.0 - common**2) * spectrum[1]
        wave = fft.irfft(spectrum * (density * math.sqrt(self.sample_rate * count / 4.0)).astype(np.float32), count)
        return np.asarray(wave * np.sin(np.pi * (np.arange(count) + 0.5) / count).astype(np.float32))

    def _odometry(self, time: float, frame: str) -> Odometry:
        """Of base_link; `odom` is where it starts, turned by its first heading."""
        (place, attitude), (start, _) = self.track.at(np.array([time])), self.track.at(np.zeros(1))
        after, _ = self.track.at(np.array([time + 1e-3]))
        later = self.track.at(np.array([time + 1e-3]))[1]
        linear = attitude.inv().apply((after - place).T)[0] / 1e-3
        angular = (attitude.inv() * later).as_rotvec()[0] / 1e-3
        if frame == "odom":
            back = Rotation.from_euler("z", -self.track.heading)
            place, attitude = back.apply((place - start).T).T, back * attitude
        pose = (place[:, 0].copy(), attitude.as_quat()[0])
        return Odometry(t_ns(time), *pose, linear, angular, 1e-8 * np.eye(6), 1e-8 * np.eye(6), frame)


def t_ns(time: float) -> int:
    return START_NS + round(time * 1e9)


def draw_track(pool: Pool, rng: np.random.Generator) -> Track:
    """Along one long side, then across; half of them mirrored, so that the turn is to starboard."""
    z = -rng.uniform(0.5, 0.35 * pool.depth + 0.3)
    first = pool.length - 6.0
    second = pool.width - 4.5
    speed, turn_time = 0.4, 8.0
    legs = (first / speed - 0.5 * turn_time, second / speed - 0.5 * turn_time)
    if rng.random() < 0.5:
        return Track((2.5, 1.5, z), 0.0, legs, 0.5 * math.pi, turn_time, speed)
    return Track((2.5, pool.width - 1.5, z), 0.0, legs, -0.5 * math.pi, turn_time, speed)


def draw_tone(pool: Pool, track: Track, rng: np.random.Generator) -> Tone:
    """On the floor, at least 1.5 m from the track over ground."""
    way = track.at(np.arange(0.0, track.duration, 0.5))[0]
    while True:
        x, y = rng.uniform(1.0, pool.length - 1.0), rng.uniform(1.0, pool.width - 1.0)
        if np.hypot(way[0] - x, way[1] - y).min() > 1.5:
            break
    place = (x, y, -pool.depth + rng.uniform(0.1, 1.0))
    q = rng.uniform(8.0, 25.0)
    return Tone("a", place, rng.uniform(26e3, 38e3), rng.uniform(1.3e-3, 8e-3), rng.choice([1.0, 2.0]), q=q)


def _loss(pool: Pool, apart: Array, bounces: Array) -> tuple[Array, Array, Array]:
    """(n,) gains of paths (3, n) with bounces (4, n), and the coefficients of f and f^2 in their loss in nepers."""
    far = np.linalg.norm(apart, axis=0)
    cos = np.abs(apart) / far
    gain = np.where(bounces[3] % 2, -1.0, 1.0) / far
    for k, zeta in enumerate((pool.wall_impedance, pool.wall_impedance, pool.floor_impedance)):
        gain = gain * ((zeta * cos[k] - 1.0) / (zeta * cos[k] + 1.0)) ** bounces[k]
    linear = pool.loss / CENTRE * bounces[:3].sum(axis=0)
    square = bounces[3] * 2.0 * np.square(2 * np.pi * pool.ripple * cos[2] / pool.sound_speed)
    return gain, linear, square


def _line(place: float, size: float, far: float) -> Array:
    """(n, 3) images between 0 and `size`, no farther than `far`, and their bounces at 0 and at `size`."""
    n = np.arange(-math.ceil(far / (2 * size)) - 1, math.ceil(far / (2 * size)) + 2)
    even = np.stack([2 * n * size + place, np.abs(n), np.abs(n)], axis=1)
    odd = np.stack([2 * n * size - place, np.abs(n - 1), np.abs(n)], axis=1)
    return np.concatenate([even, odd])


def _sum(tone: Tone, freq: Array, paths: Array) -> Array:
    """(bins,) spectrum of all paths (5, n), at evenly spaced frequencies; the pulse's own is scaled by Doppler factors.

    It is worked out for some factors and taken linearly between them: 1 Hz apart at 0.4 m/s and 30 kHz, an error below
    1e-3 of a pulse of 8 ms. Delays and losses are products of a factor per block of frequencies and one within it:
    the loss of a bounce at the surface then is in error by 0.3 % at most.
    """
    nodes = np.linspace(paths[1].min() - 1e-9, paths[1].max() + 1e-9, 17)
    cells = np.searchsorted(nodes, paths[1]) - 1
    size = math.ceil(math.sqrt(freq.size))
    blocks, within = freq[0] + (freq[1] - freq[0]) * size * np.arange(size), freq[:size] - freq[0]
    total = np.zeros(freq.size, complex)
    for k in np.unique(cells):
        delay, doppler, gain, linear, square = paths[:, cells == k, None]
        coarse = np.exp(-(linear + 2j * np.pi * delay) * blocks - square * blocks**2)
        fine = np.exp(-(linear + 2 * square * CENTRE + 2j * np.pi * delay) * within)
        share = (doppler - nodes[k]) / (nodes[k + 1] - nodes[k])
        for weight, node in ((1.0 - share, nodes[k]), (share, nodes[k + 1])):
            heard = ((gain * weight * coarse).T @ fine).ravel()[: freq.size]
            total += heard * tone.spectrum(freq / node - tone.frequency) / node
    return total
