"""What the electronics do to a channel is taken back where samples become envelopes."""

import numpy as np
import pytest
from scipy import fft

from uw_acoustic_loc.core.bearing.config import ALIKE, Electronics
from uw_acoustic_loc.core.bearing.gcc import BandSplitter


@pytest.mark.parametrize(("invert", "signs"), [("none", (1, 1)), ("h0", (-1, 1)), ("h1", (1, -1))])
def test_envelopes_of_a_late_or_inverted_channel_are_those_of_a_good_one(invert, signs):
    rate, n, delay = 1e5, 4000, 3.3e-6
    rng = np.random.default_rng(1)
    sound = rng.standard_normal((2, n)) * np.hanning(n)
    late = fft.irfft(fft.rfft(sound[0]) * np.exp(-2j * np.pi * fft.rfftfreq(n, 1 / rate) * delay), n)
    splitters = [BandSplitter(rate, [20e3], [30e3], n, electronics=e) for e in (ALIKE, Electronics(delay, invert))]
    good = splitters[0].split(*sound).values
    found = splitters[1].split(signs[0] * late, signs[1] * sound[1]).values
    assert np.abs(found - good).max() < 1e-3 * np.abs(good).max()
