import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from uw_acoustic_loc.sim.rays import LinearProfile


def by_snell(profile: LinearProfile, flat: float, z1: float, z2: float) -> float:
    """Travel time of the ray that descends all the way: horizontal range and time as integrals over depth."""

    def reach(p: float) -> float:
        return quad(lambda z: p * c(z) / np.sqrt(1 - (p * c(z)) ** 2), z2, z1)[0]

    def c(z: float) -> float:
        return float(profile.speed(np.array(z)))

    fastest = max(c(z1), c(z2))
    p = brentq(lambda p: reach(p) - flat, 0.0, (1 - 1e-12) / fastest, xtol=1e-16)
    return float(quad(lambda z: 1 / (c(z) * np.sqrt(1 - (p * c(z)) ** 2)), z2, z1)[0])


@pytest.mark.parametrize("gradient", [-0.5, -0.05, 0.0, 0.017, 0.5])
def test_arcs_take_the_time_of_snells_rays(gradient: float) -> None:
    profile = LinearProfile(1500.0, gradient)
    for flat, z1, z2 in ((300.0, -5.0, -180.0), (20.0, 0.0, -200.0), (900.0, 0.0, -400.0)):
        found = float(profile.time(np.array(flat), np.array(z1), np.array(z2)))
        assert found == pytest.approx(by_snell(profile, flat, z1, z2), rel=1e-9)


def test_in_even_water_the_bottom_path_is_that_of_the_image() -> None:
    flat, z1, z2 = np.array([300.0, 1500.0]), np.array([-60.0, -10.0]), np.zeros(2)
    expected = np.hypot(flat, z1 - (-400.0 - z2)) / 1480.0
    assert LinearProfile(1480.0, 0.0).bottom_time(flat, z1, z2, 200.0) == pytest.approx(expected, rel=1e-10)


def test_the_bottom_path_obeys_the_law_of_reflection() -> None:
    """A small step of the reflecting point to either side takes longer."""
    profile, z1, z2, floor = LinearProfile(1500.0, -0.1), np.array(-60.0), np.array(0.0), np.array(-200.0)
    least = float(profile.bottom_time(np.array(800.0), z1, z2, 200.0))
    points = np.linspace(0, 800, 801)
    assert least <= (profile.time(points, z1, floor) + profile.time(800 - points, z2, floor)).min()
