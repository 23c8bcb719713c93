import math

import numpy as np
import pytest

from uw_acoustic_loc.core.bearing.hydrophone_health import HydrophoneHealth
from uw_acoustic_loc.core.types import HydrophoneInfo, Samples

T0, RATE = 10**18, 100_000.0
INFO = HydrophoneInfo(T0, RATE, 0.6, 1500.0, 1e-3)


def frame(k, rate=RATE, gain=(1.0, 1.0), dtype=np.float32, jitter=0):
    x = np.random.default_rng(k).standard_normal((2, 1_000)) * np.array(gain)[:, None]
    x = (x / INFO.scale if dtype == np.int16 else x).astype(dtype)
    return Samples(T0 + round(k * 1e9 * 1_000 / rate) + jitter, x[0], x[1])


def watched(frames):
    health = HydrophoneHealth(INFO, 5.0)
    lives = [health.watch(f) for f in frames]
    return health, lives


@pytest.mark.parametrize("dtype", [np.float32, np.int16])
def test_good_frames_have_no_faults(dtype):
    health, lives = watched([frame(k, dtype=dtype) for k in range(60)])
    assert health.faults == []
    assert all(lives)
    assert health.sample_rate == pytest.approx(RATE)


@pytest.mark.parametrize("dtype", [np.float32, np.int16])
@pytest.mark.parametrize("sign", [1, -1])
def test_full_scale_is_counted_and_named_for_a_while(dtype, sign):
    bad = frame(0, dtype=dtype)
    bad.h1[:7] = sign * (32767 if dtype == np.int16 else 32.767)
    health, _ = watched([bad])
    assert health.full_scale == [0, 7]
    assert health.faults == ["hydrophone 1 clips: 7 samples at full scale so far"]
    for k in range(1, 502):
        health.watch(frame(k, dtype=dtype))
    assert health.faults == []


@pytest.mark.parametrize("gain", [0.0, 1e-3])
@pytest.mark.parametrize("which", [0, 1])
def test_a_dead_channel_is_named(which, gain):
    gains = [1.0, 1.0]
    gains[which] = gain
    health, lives = watched([frame(0, gain=gains)])
    assert lives == [False]
    assert health.faults == [f"hydrophone {which} is dead: its samples do not vary as the other's do"]
    assert health.watch(frame(1))
    assert health.faults == []
    assert health.dead_frames[which] == 1


def test_both_dead_is_said():
    health, _ = watched([frame(0, gain=(0.0, 0.0))])
    assert health.faults == ["hydrophones 0 and 1 are dead: their samples do not vary"]


@pytest.mark.parametrize("true", [96_000.0, 99_800.0, 100_200.0, 48_000.0])
def test_a_wrong_rate_is_said_with_both_numbers(true):
    health, _ = watched([frame(k, rate=true) for k in range(60)])
    assert health.faults == [
        f"sample_rate is 100000 Hz by hydrophones/info and {health.sample_rate:.6g} Hz by the frames' stamps"
    ]
    assert health.sample_rate == pytest.approx(true, rel=1e-5)


def test_lost_frames_and_jitter_of_the_stamps_are_no_wrong_rate():
    rng = np.random.default_rng(1)
    frames = [frame(k, jitter=int(rng.normal(0, 50_000))) for k in range(200) if rng.random() > 0.1]
    health = HydrophoneHealth(INFO, 5.0)
    for f in frames:
        health.watch(f)
        assert health.faults == []


def test_the_rate_is_unknown_at_first():
    assert math.isnan(watched([frame(0), frame(1)])[0].sample_rate)
