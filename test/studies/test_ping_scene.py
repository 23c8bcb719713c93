import math

import numpy as np
import pytest

from uw_acoustic_loc.studies.bearing.ping_scene import EMISSION, PingScene

BAND = (20e3, 30e3)
CLEAN = PingScene(BAND, multipath=False, impulses=False)
ECHOES = PingScene(BAND, multipath=True, impulses=True)
SILENT = 300.0  # dB


def energy_inside(x, band):
    power = np.abs(np.fft.rfft(x)) ** 2 / x.size
    freq = np.fft.rfftfreq(x.size, 1e-5)
    inside = (freq > band[0]) & (freq <= band[1])
    return 2 * power[inside].sum()


@pytest.mark.parametrize(("band", "kind"), [(BAND, "chirp"), ((24e3, 26e3), "chirp"), ((24e3, 26e3), "tone")])
def test_the_snr_is_energy_over_energy_in_the_band_over_the_ping(band, kind):
    scene, rng = PingScene(band, multipath=False, impulses=False, kind=kind), np.random.default_rng(1)
    signal = scene.frame(math.pi / 2, SILENT, rng).h0
    noise = np.mean([energy_inside(scene.frame(1.5, -10.0, rng).h0[8000:9000], band) for _ in range(200)])
    found = 10 * math.log10(energy_inside(signal, band) / noise)
    bins = 200 * (band[1] - band[0]) * 0.01
    assert found == pytest.approx(-10.0, abs=5 * 4.35 / math.sqrt(bins) + 0.05)


def test_a_noise_pulse_has_the_snr_on_average_and_a_new_waveform_each_time():
    scene, rng = PingScene(BAND, multipath=False, impulses=False, kind="noise"), np.random.default_rng(1)
    frames = [scene.frame(math.pi / 2, SILENT, rng).h0 for _ in range(20)]
    expected = 1000 * 2 * (BAND[1] - BAND[0]) / 1e5 * scene.noise_std(0.0) ** 2
    assert np.mean([energy_inside(x, BAND) for x in frames]) == pytest.approx(expected, rel=0.03)
    assert abs(np.corrcoef(frames[0], frames[1])[0, 1]) < 0.3


@pytest.mark.parametrize("azimuth_deg", [0, 35, 90, 145, 180, -60])
def test_the_tdoa_is_the_true_one(azimuth_deg):
    """The phase of the cross-spectrum, free of sampling, against the exact near-field value; towards +x positive."""
    azimuth = math.radians(azimuth_deg)
    frame = CLEAN.frame(azimuth, SILENT, np.random.default_rng(2))
    cross = np.fft.rfft(frame.h0) * np.fft.rfft(frame.h1).conj()
    omega = 2 * np.pi * np.fft.rfftfreq(frame.h0.size, 1e-5)
    inside = (omega > 2 * np.pi * BAND[0]) & (omega < 2 * np.pi * BAND[1])
    left = np.angle(cross * np.exp(1j * omega * CLEAN.tdoa(azimuth)))[inside]
    assert np.average(left, weights=np.abs(cross[inside])) / 2 / np.pi / 25e3 == pytest.approx(0.0, abs=1e-10)
    far = 0.6 / 1500.0 * math.cos(azimuth) * 60 / math.hypot(60, 7)
    assert CLEAN.tdoa(azimuth) == pytest.approx(far, abs=1e-8)
    assert 0.0 <= CLEAN.bearing(azimuth) <= math.pi


def test_the_bearing_is_that_of_a_cone():
    assert math.degrees(CLEAN.bearing(math.radians(35.0))) == pytest.approx(35.5, abs=0.1)
    assert CLEAN.bearing(math.pi / 2) == pytest.approx(math.pi / 2)
    level = PingScene(BAND, source_depth=5.0, multipath=False, impulses=False)
    assert level.bearing(1.0) == pytest.approx(1.0, abs=2e-5)  # near field: (d / r)^2 / 8


def test_the_direct_path_reaches_1_pa_and_echoes_follow_it():
    direct, all_paths = (s.frame(1.5, SILENT, np.random.default_rng(3)).h0 for s in (CLEAN, PingScene(
        BAND, multipath=True, impulses=False
    )))  # fmt: skip
    assert np.abs(direct).max() == pytest.approx(1.0, abs=0.02)
    first = EMISSION + math.hypot(60, 7) / 1500.0
    echo = EMISSION + math.hypot(60, 17) / 1500.0  # of the surface
    before = np.arange(10_000) < (echo - 0.6 / 1500) * 1e5
    assert np.flatnonzero(np.abs(direct) > 1e-6)[0] == pytest.approx(first * 1e5, abs=25)
    assert np.abs((all_paths - direct)[before]).max() < 1e-6
    assert np.flatnonzero(np.abs(all_paths - direct) > 1e-6)[0] == pytest.approx(echo * 1e5, abs=25)


def test_impulses_raise_the_tails_and_not_the_noise_between():
    snr_db, std = 0.0, ECHOES.noise_std(0.0)
    x = np.concatenate([ECHOES.frame(1.5, snr_db, np.random.default_rng(k)).h0[8000:] for k in range(20)])
    assert np.abs(x).max() > 10 * std
    assert 1.4826 * np.median(np.abs(x)) == pytest.approx(std, rel=0.05)


def test_the_same_generator_gives_the_same_frame():
    a, b, c = (ECHOES.frame(1.0, 0.0, np.random.default_rng(seed), 5) for seed in (7, 7, 8))
    assert np.array_equal(a.h0, b.h0)
    assert np.array_equal(a.h1, b.h1)
    assert not np.array_equal(a.h0, c.h0)
    assert a.t_ns == 5
    assert a.h0.dtype == np.float32
    assert a.h0.shape == (10_000,)
