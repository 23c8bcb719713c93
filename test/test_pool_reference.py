"""The reference pool is what it says: its sound against the pulse in closed form, its truth against its sound."""

import math
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from test.pool_reference import Pool, PoolRun, Tone, Track

POOL = Pool(20.0, 10.0, 4.0)
FREE = replace(POOL, reverberation=0.0)
TONE = Tone("a", (9.0, 6.0, -3.8), 30e3, 0.004, 2.0)
TRACK = Track((3.0, 2.0, -1.0), 0.2, (10.0, 4.0), 1.2, swing=0.1, climb=-0.05)


def envelope(age, tone):
    """1 - (1 + a t) exp(-a t), switched on and off."""
    a = math.pi * tone.frequency / tone.q
    on, off = (np.maximum(t, 0.0) for t in (age, age - tone.length))
    return (1 + a * off) * np.exp(-a * off) - (1 + a * on) * np.exp(-a * on)


def test_the_direct_path_is_the_pulse_at_the_retarded_time():
    """Sample by sample; the spectrum ends 25 kHz from the tone, which rounds the onset by less than 1 %."""
    run = PoolRun(1, FREE, (TONE,), TRACK)
    begin, (_, sound) = run.clean(2)
    t = begin + np.arange(sound.size) / run.sample_rate
    source = np.array(TONE.position)[:, None]
    far = np.linalg.norm(run._hydrophones(t, 1) - source, axis=0)
    age = t - far / FREE.sound_speed - (TONE.offset + 2 * TONE.period)
    level = TONE.level * envelope(age, TONE) / far
    carrier = np.exp(2j * np.pi * TONE.frequency * age)
    turned = np.vdot(level * carrier, sound)  # its phase is drawn
    assert sound == pytest.approx((level * carrier * turned / abs(turned)).real, abs=0.01 * level.max())


def test_the_truth_is_what_the_phase_says():
    """In free field, over the whole pulse: the phase between the hydrophones is 2 pi f TDOA, with the Doppler shift."""
    run = PoolRun(2, FREE, (TONE,), TRACK)
    for k, heard in enumerate(run.truth):
        begin, sound = run.clean(k)
        t = begin + np.arange(sound.shape[1]) / run.sample_rate
        inside = (t > heard.time + 1e-3) & (t < heard.time + 3e-3)
        spectrum = (sound * np.exp(-2j * np.pi * TONE.frequency * t))[:, inside].mean(axis=1)
        phase = np.angle(spectrum[1] / spectrum[0])
        assert phase / (2 * np.pi * TONE.frequency) == pytest.approx(heard.tdoa, abs=2e-8)
        assert math.cos(heard.cone) == pytest.approx(math.cos(heard.azimuth) * math.cos(heard.elevation), abs=1e-3)


def test_images_of_hard_walls_are_mirrored_sources():
    """Without losses the paths are those of a room with coefficients 1 and -1, folded bounce by bounce."""
    pool = replace(POOL, wall_impedance=1e9, floor_impedance=1e9, loss=0.0, ripple=0.0, reverberation=0.02)
    run = PoolRun(1, pool, (TONE,), TRACK)
    images, bounces = run._images(0.0, np.array(TONE.position))
    place = run._hydrophones(np.zeros(1), 0)
    expected = {tuple(np.round(TONE.position, 6)): (0, 0, 0, 0)}
    front = dict(expected)
    for _ in range(9):
        new = {}
        for (x, y, z), (i, j, floor, top) in front.items():
            new[-x, y, z] = new[round(2 * 20.0 - x, 6), y, z] = (i + 1, j, floor, top)
            new[x, -y, z] = new[x, round(2 * 10.0 - y, 6), z] = (i, j + 1, floor, top)
            new[x, y, -z], new[x, y, round(-8.0 - z, 6)] = (i, j, floor, top + 1), (i, j, floor + 1, top)
        front = {point: count for point, count in new.items() if point not in expected}
        expected |= front
    far = 0.02 * pool.sound_speed
    near = {p: n for p, n in expected.items() if np.linalg.norm(np.array(p) - place[:, 0]) < far}
    found = {tuple(p): tuple(n) for p, n in zip(np.round(images.T, 6).tolist(), bounces.T.tolist(), strict=True)}
    assert found == near


def test_noise_has_its_level_its_slope_and_a_diffuse_fields_coherence():
    run = PoolRun(5, FREE, (replace(TONE, level=1e-9),), TRACK)
    run.noise_density = 1.0
    noise = np.concatenate([frame for _, frame in islice(run.frames(), 20)], axis=1)
    parts = noise[:, : noise.shape[1] // 1000 * 1000].reshape(2, -1, 1000) * np.hanning(1000)
    spectrum = np.fft.rfft(parts)
    density = np.sqrt(np.mean(np.abs(spectrum) ** 2, axis=1) * 2 / run.sample_rate / np.square(np.hanning(1000)).sum())
    freq = np.fft.rfftfreq(1000, 1 / run.sample_rate)
    cross = np.mean(spectrum[0] * spectrum[1].conj(), axis=0)
    coherence = cross.real / np.sqrt(np.mean(np.abs(spectrum) ** 2, axis=1).prod(axis=0))
    for f in (10e3, 30e3, 90e3):
        k = np.argmin(np.abs(freq - f))
        assert density[:, k] == pytest.approx(run.noise_density * (f / 30e3) ** -0.6, rel=0.1)  # 4 sigma
        assert coherence[k] == pytest.approx(
            np.sinc(2 * f * run.spacing / FREE.sound_speed), abs=0.1
        )  # 1000 parts, 3 sigma


def test_drawn_runs_lie_within_their_pools():
    for seed in range(4):
        run = PoolRun(seed)
        way = run.track.at(np.arange(0.0, run.track.duration, 0.5))[0]
        size = np.array([[run.pool.length], [run.pool.width]])
        assert np.all((way[:2] > 0.5) & (way[:2] < size - 0.5))
        assert np.all((way[2] < -0.3) & (way[2] > -run.pool.depth + 0.3))
        assert len(run.truth) >= 15
