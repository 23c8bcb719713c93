import numpy as np
import pytest

from uw_acoustic_loc.sim.converter import convert, scale
from uw_acoustic_loc.sim.scenario import Hydrophones

PRESSURE = np.array([[0.5, -0.25, 3.0, -3.0], [0.5, -0.25, 3.0, -3.0]], np.float32)


def test_counts_are_rounded_and_clipped():
    array = Hydrophones(full_scale=2.0)
    counts = convert(PRESSURE, array)
    assert counts.dtype == np.int16
    assert counts[0].tolist() == [8192, -4096, 32767, -32767]
    assert counts[0, :2] * scale(array) == pytest.approx(PRESSURE[0, :2], abs=scale(array) / 2)


def test_the_second_channel_has_its_own_gain_before_it_clips():
    array = Hydrophones(full_scale=2.0, format="float32", channel_gain_db=6.0)
    h0, h1 = convert(PRESSURE, array)
    assert h0.tolist() == [0.5, -0.25, 2.0, -2.0]
    assert h1 == pytest.approx(np.array([0.5 * 10**0.3, -0.25 * 10**0.3, 2.0, -2.0]))
    assert PRESSURE[1].tolist() == [0.5, -0.25, 3.0, -3.0]
