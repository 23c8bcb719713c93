import numpy as np
import pytest

from uw_acoustic_loc.core.bearing.clicks import click_block, limit_clicks

RATE, BLOCK = 100_000.0, 100


def noise(n=10_000):
    return np.random.default_rng(1).standard_normal(n).astype(np.float32)


@pytest.mark.parametrize("at", [0, 5_000, 5_099, 9_999])
@pytest.mark.parametrize("height", [15.0, -100.0, 1e6])
def test_a_click_is_cut_to_the_noise_around_it(at, height):
    x = noise()
    x[at] += height
    limited, count = limit_clicks(x, BLOCK)
    assert count == 1
    assert np.abs(limited).max() < 5.0
    assert abs(x[at]) > 10.0, "the argument is left as it is"
    others = np.delete(np.arange(10_000), at)
    assert limited[others] == pytest.approx(x[others], abs=1.5)


@pytest.mark.parametrize("onset", [3_000, 3_050, 3_099])
@pytest.mark.parametrize("amplitude", [1.0, 10.0, 1e4])
def test_a_ping_is_left_as_it_is(onset, amplitude):
    x = noise()
    x[onset : onset + 1_000] += np.float32(amplitude) * np.sin(1.5 * np.arange(1_000, dtype=np.float32))
    limited, count = limit_clicks(x, BLOCK)
    assert count == 0
    assert limited is x


def test_noise_and_silence_have_none():
    assert limit_clicks(noise(1_000_000), BLOCK)[1] == 0
    assert limit_clicks(np.zeros(1_000, np.float32), BLOCK)[1] == 0


def test_blocks_are_shorter_than_pings():
    assert click_block(RATE, 0.01) == 100
    assert click_block(RATE, 0.002) == 50
    assert click_block(RATE, 1e-4) == 0
    assert limit_clicks(noise(), 0)[1] == 0
