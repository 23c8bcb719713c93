import pytest

from uw_acoustic_loc.core.toa.config import mackenzie


def test_the_check_value_of_the_formula() -> None:
    assert mackenzie(25.0, 35.0, 1000.0) == pytest.approx(1550.744, abs=5e-4)


@pytest.mark.parametrize(("at", "slope"), [((10.0, 35.0, 0.0), (3.6, 1.24, 0.0163))])
def test_it_rises_with_temperature_salinity_and_depth(
    at: tuple[float, float, float], slope: tuple[float, float, float]
) -> None:
    for k, expected in enumerate(slope):
        more = [value + (k == i) for i, value in enumerate(at)]
        assert mackenzie(*more) - mackenzie(*at) == pytest.approx(expected, rel=0.02)
