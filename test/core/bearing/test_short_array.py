"""Pairs of hydrophones half a wavelength apart: one carrier cycle fits between them."""

import math

import numpy as np
import pytest

from uw_acoustic_loc.core.bearing.config import BearingConfig, BearingNoise
from uw_acoustic_loc.core.bearing.estimator import BearingEstimator
from uw_acoustic_loc.studies.bearing.ping_scene import PingScene

BAND = (28.5e3, 31.5e3)


def scene(spacing=0.019, pulse_length=0.004):
    return PingScene(
        BAND,
        spacing=spacing,
        sample_rate=5e5,
        pulse_length=pulse_length,
        kind="tone",
        source_depth=5.0,
        multipath=False,
        impulses=False,
    )


def errors(scene_, azimuth, snr_db, pings, filter_, **config):
    """(n, 2) error and published standard deviation in degrees of the pings at one azimuth."""
    state = BearingEstimator(
        BearingConfig(("p",), BAND[:1], BAND[1:], filter_, noise=BearingNoise(elevation_std=0.0), **config), scene_.info
    )
    rng, t_ns = np.random.default_rng([5, round(math.degrees(azimuth))]), scene_.info.t_ns
    frames = (scene_.frame(azimuth, snr_db, rng, t_ns + k * 10**8) for k in range(pings))
    found = [b for f in frames for _, b in state.process(f)]
    assert len(found) == pings
    return np.degrees([(b.bearing - scene_.bearing(azimuth), math.sqrt(b.variance)) for b in found])


@pytest.mark.parametrize("filter_", ["none", "particle", "histogram"])
@pytest.mark.parametrize("spacing", [0.014, 0.019, 0.0235])
def test_every_angle_is_right_in_free_field(filter_, spacing):
    """At 40 dB. Near end-fire a maximum of the next cycle lies beyond the largest lag, and must not win.

    There the bearing's own standard deviation is what `phase_std` leaves: up to 15 degrees at end-fire itself.
    """
    for deg in (3, 10, 20, 40, 90, 150, 170, 177):
        error, std = errors(scene(spacing), math.radians(deg), 40.0, 3, filter_)[-1]
        assert abs(error) < ((1.0 if spacing > 0.015 else 1.5) if 20 <= deg <= 160 else 9.0)
        assert abs(error) < 2.0 * std
