import numpy as np
import pytest

from uw_acoustic_loc.core.bearing.config import BearingConfig
from uw_acoustic_loc.core.bearing.detection import PingDetector
from uw_acoustic_loc.core.bearing.frame_joiner import FrameJoiner
from uw_acoustic_loc.core.bearing.gcc import BandSplitter
from uw_acoustic_loc.core.bearing.listener import Listener, check_frame
from uw_acoustic_loc.core.types import HydrophoneInfo, Samples

RATE, PULSE, T0 = 100_000.0, 0.01, 10**18
BAND = (20_000.0, 26_000.0)
ALARMS = 0.3 / 3600
INFO = HydrophoneInfo(T0, RATE, 0.6, 1500.0, 1e-3)


def sound(onsets, duration, noise=0.1, amplitude=1.0, seed=0):
    """Both channels (2, n) with a chirp at each onset, in s."""
    rng = np.random.default_rng(seed)
    x = noise * rng.standard_normal((2, round(duration * RATE)))
    t = np.arange(x.shape[1]) / RATE
    for onset in onsets:
        age = t - onset
        wave = np.sin(2 * np.pi * (BAND[0] + (BAND[1] - BAND[0]) / (2 * PULSE) * age) * age)
        x += np.where((age >= 0) & (age < PULSE), amplitude * wave, 0.0)
    return x.astype(np.float32)


def config(band):
    return BearingConfig(("p",), band[:1], band[1:])


def frames(x, length):
    cuts = range(0, x.shape[1] - length + 1, length)
    return [Samples(T0 + round(1e9 * k / RATE), x[0, k : k + length], x[1, k : k + length]) for k in cuts]


def heard(frames_, band=BAND):
    listener = Listener(INFO, config(band), 1500.0)
    return [p for f in frames_ for p in listener.hear(f, 0.0, "cc", 4)]


@pytest.mark.parametrize("length", [1000, 3000, 10_000, 50_000])
@pytest.mark.parametrize("offset", [0.0, 0.0903, 0.0951, 0.0999])
def test_each_ping_is_heard_once_wherever_frames_cut_it(length, offset):
    onsets = np.arange(0.11, 0.85, 0.1) + offset
    pings = heard(frames(sound(onsets, 1.2), length))
    times = np.array([(p.t_ns - T0) * 1e-9 for p in pings])
    assert times == pytest.approx(onsets[: times.size], abs=5e-4)
    assert times.size == onsets.size


def test_the_snr_is_that_in_the_band_over_the_pulse():
    snr_db = 10 * np.log10(0.5 / (0.1**2 * (BAND[1] - BAND[0]) / (RATE / 2)))
    pings = heard(frames(sound(np.arange(0.11, 1.9, 0.1), 2.0), 10_000))
    assert np.mean([p.snr_db for p in pings]) == pytest.approx(snr_db, abs=0.5)


def test_an_echo_is_not_a_ping():
    x = sound(np.arange(0.1, 0.9, 0.1), 1.0) + sound(np.arange(0.12, 0.9, 0.1), 1.0, noise=0.0, amplitude=0.7)
    assert len(heard(frames(x, 10_000))) == 8


@pytest.mark.parametrize("sigmas", [10.0, 30.0, 100.0, 1000.0])
@pytest.mark.parametrize("band", [BAND, (24e3, 26e3), (20e3, 40e3)])
def test_clicks_are_not_pings(sigmas, band):
    """One sample far out of the noise; in the band it rings, but not as long as a ping lasts."""
    x = sound([], 10.0)
    without = len(heard(frames(x, 10_000), band))  # in 2 kHz, noise alone passes 2 dB now and then
    x[:, 5_000::25_003] += np.float32(0.1 * sigmas)
    assert abs(len(heard(frames(x, 10_000), band)) - without) <= 1


@pytest.mark.parametrize("length", [1e-4, 3e-4])
def test_a_burst_shorter_than_a_ping_is_none(length):
    """An in-band knock at the level of a ping, a hundred times; beyond a millisecond it might be a ping."""
    x, wave = sound([], 10.0), np.sin(2 * np.pi * 23e3 * np.arange(round(length * RATE)) / RATE)
    for begin in range(5_000, 990_000, 10_000):
        x[:, begin : begin + wave.size] += wave.astype(np.float32)
    assert len(heard(frames(x, 10_000))) <= 5


def test_pings_are_heard_between_clicks():
    onsets = np.arange(0.11, 3.9, 0.1)
    x = sound(onsets, 4.0)
    x[:, 3_000::10_000] += 10.0  # 80 ms before each ping, a hundred standard deviations
    times = np.array([(p.t_ns - T0) * 1e-9 for p in heard(frames(x, 10_000))])
    assert times.size == onsets.size
    assert times == pytest.approx(onsets, abs=5e-4)


def test_a_faint_ping_is_heard():
    """0 dB in the band over the pulse."""
    onsets = np.arange(0.11, 9.9, 0.1)
    amplitude = 0.1 * np.sqrt(2 * (BAND[1] - BAND[0]) / (RATE / 2))
    assert len(heard(frames(sound(onsets, 10.0, amplitude=amplitude), 10_000))) > 0.9 * onsets.size


@pytest.mark.parametrize("delay", [0.006, 0.012, 0.03])
def test_the_direct_path_is_the_first_even_when_its_echo_is_louder(delay):
    onsets = np.arange(0.11, 2.9, 0.1)
    x = sound(onsets, 3.0) + sound(onsets + delay, 3.0, noise=0.0, amplitude=1.6)
    times = np.array([(p.t_ns - T0) * 1e-9 for p in heard(frames(x, 10_000))])
    assert times.size >= onsets.size - 1
    assert np.max(np.abs(times[:, None] - onsets).min(axis=1)) < 1e-3


def test_noise_alone_is_rarely_a_ping():
    """At 2 dB, 4.5 standard deviations of the mean of 60 logarithms, over 1000 windows none is expected."""
    assert len(heard(frames(sound([], 10.0), 10_000))) <= 1


def test_the_noise_power_is_found_beside_pings():
    x = sound(np.arange(0.05, 4.9, 0.1), 5.0)
    splitter, detector = BandSplitter(RATE, [BAND[0]], [BAND[1]], 12_000), PingDetector(PULSE, 1, ALARMS)
    joiner = FrameJoiner(RATE, 0.02)
    for frame in frames(x, 10_000):
        block = joiner.join(frame)
        envelopes = splitter.split(block.h0, block.h1)
        detector.detect(envelopes, block.t_ns, 0.0, [[]])
    true = 2 * 0.1**2 * float(splitter.noise_width[0]) / (RATE / 2)  # an envelope has twice the power of its signal
    assert detector.noise_power(0) == pytest.approx(true, rel=0.15)


def test_a_gap_does_not_join_what_does_not_belong_together():
    x = sound([0.095, 0.295], 0.4)
    every = frames(x, 10_000)
    assert len(heard(every)) == 2
    assert len(heard([every[0], every[2], every[3]])) == 1  # of the first ping the middle is lost
    joiner = FrameJoiner(RATE, 0.02)
    sizes = [joiner.join(f).h0.size for f in (every[0], every[1], every[3])]
    assert sizes == [10_000, 12_000, 10_000]
    assert joiner.gaps == 1


def test_counts_are_scaled():
    x = sound([0.03], 0.1)
    counts = np.round(x / 1e-3).astype(np.int16)
    floats, ints = (heard(frames(y, 10_000))[0] for y in (x, counts))
    assert ints.t_ns == floats.t_ns
    assert ints.snr_db == pytest.approx(floats.snr_db, abs=0.1)
    assert ints.correlation.tdoas[0] == pytest.approx(floats.correlation.tdoas[0], abs=1e-8)


@pytest.mark.parametrize(
    ("h0", "h1", "sentence"),
    [
        (np.zeros(5), np.zeros(4), r"samples h0 and h1 must be two \(N,\), N > 0, got \(5,\) and \(4,\)"),
        (np.zeros(0), np.zeros(0), r"samples h0 and h1 must be two \(N,\), N > 0, got \(0,\) and \(0,\)"),
        (np.zeros(5), np.array([0, np.nan, np.inf, 0, 0]), "samples h1 must be finite, got 2 that are not"),
        (np.array([0.0, -1e12, 0.0]), np.zeros(3), r"samples h0 must be within 1e\+10 Pa, got 1e\+12 Pa"),
        (np.zeros(5, np.int32), np.zeros(5), "samples h0 must be int16 counts or float Pa, got int32"),
    ],
)
def test_error_sentences(h0, h1, sentence):
    with pytest.raises(ValueError, match=sentence):
        check_frame(Samples(T0, h0, h1))


def test_overlaps_are_counted_and_not_joined():
    every = frames(sound([], 0.4), 10_000)
    joiner = FrameJoiner(RATE, 0.02)
    joiner.join(every[0])
    early = Samples(every[1].t_ns - 30_000_000, every[1].h0, every[1].h1)
    assert joiner.join(early).h0.size == 10_000
    with pytest.raises(ValueError, match="samples must begin after the frame before"):
        joiner.join(early)
    assert (joiner.gaps, joiner.overlaps) == (0, 2)


def test_a_refused_band_leaves_the_listener_as_it_was():
    listener = Listener(INFO, config(BAND), 1500.0)
    with pytest.raises(ValueError, match="band must be"):
        listener.tune([(40e3, 60e3)])
    assert len([p for f in frames(sound([0.03], 0.1), 10_000) for p in listener.hear(f, 0.0, "cc", 4)]) == 1
