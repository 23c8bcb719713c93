"""The builder: every way to be wrong ends as one sentence with place, key, value and what is allowed."""

from dataclasses import dataclass

import numpy as np
import pytest

from uw_acoustic_loc.config import build, changed, configured, group, limits_of, param, parameters, values_of


@dataclass(frozen=True)
class Inner:
    x: float = param(unit="m")


@dataclass(frozen=True)
class Example:
    rate: float = param(2.0, unit="Hz", low=0.5, high=10.0)
    count: int = param(3, low=1)
    on: bool = param(False)
    method: str = param("ekf", choices=("ekf", "grid"))
    offsets: tuple[float, ...] = param((0.0, 0.0, 0.0), length=3)
    names: tuple[str, ...] = param(())
    inner: tuple[Inner, ...] = param(())


def test_values_are_taken_over_and_defaults_kept() -> None:
    built = build(Example, {"rate": 3, "names": ["a", "b"], "offsets": np.array([1.0, 2.0, 3.0])}, "node /n")
    assert built == Example(rate=3.0, names=("a", "b"), offsets=(1.0, 2.0, 3.0))
    assert isinstance(built.rate, float)
    assert configured(Example, rate=np.float32(3.0), count=np.int64(2)) == Example(rate=3.0, count=2)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"rat": 1.0}, "node /n: unknown key 'rat', did you mean 'rate'?"),
        ({"zzz": 1.0}, "node /n: unknown key 'zzz', allowed are count, inner, method, names, offsets, on, rate"),
        ({"rate": "fast"}, "node /n: rate must be a number, got 'fast'"),
        ({"rate": True}, "node /n: rate must be a number, got True"),
        ({"rate": float("nan")}, "node /n: rate must be from 0.5 to 10 Hz, got nan"),
        ({"rate": 11.0}, "node /n: rate must be from 0.5 to 10 Hz, got 11.0"),
        ({"rate": 10**400}, "node /n: rate must be from 0.5 to 10 Hz, got inf"),
        ({"rate": np.array([3.0])}, "node /n: rate must be a number, got [3.0]"),
        ({"count": 2.5}, "node /n: count must be a whole number, got 2.5"),
        ({"count": 0}, "node /n: count must be at least 1, got 0"),
        ({"on": 1}, "node /n: on must be true or false, got 1"),
        ({"method": "ukf"}, "node /n: method must be one of ekf, grid, got 'ukf'"),
        ({"offsets": [1.0]}, "node /n: offsets must have 3 elements, got 1"),
        ({"offsets": 1.0}, "node /n: offsets must be a list of float, got 1.0"),
        ({"offsets": np.float64(1.0)}, "node /n: offsets must be a list of float, got 1.0"),
        ({"offsets": b"abc"}, "node /n: offsets must be a list of float, got b'abc'"),
        ({"inner": None}, "node /n: inner must be a list of mappings, got None"),
        ({"names": "ab"}, "node /n: names must be a list of str, got 'ab'"),
        ({"names": ["a", 1]}, "node /n: names[1] must be a string, got 1"),
        ({"inner": [{}]}, "node /n: inner[0]: key 'x' is missing"),
        ({"inner": [3]}, "node /n: inner[0] must be a mapping of keys to values, got 3"),
        ([], "node /n must be a mapping of keys to values, got []"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(values: object, sentence: str) -> None:
    with pytest.raises(ValueError) as caught:
        build(Example, values, "node /n")  # type: ignore[arg-type]
    assert str(caught.value) == sentence


@dataclass(frozen=True)
class Band:
    low: float = param(1.0, unit="Hz", low=0.5, changeable=True)
    high: float = param(2.0, unit="Hz", low=0.5)

    def __post_init__(self) -> None:
        if self.low >= self.high:
            raise ValueError(f"low must be below high {self.high:g}, got {self.low:g}")


@dataclass(frozen=True)
class Grouped:
    name: str = param("a")
    band: Band = group(Band)


@dataclass(frozen=True)
class Twice:
    low: float = param(1.0)
    band: Band = group(Band)


def test_parameters_of_a_group_have_no_other_name_outside_the_code() -> None:
    built = build(Grouped, {"name": "b", "high": 3}, "node /n")
    assert built == Grouped("b", Band(1.0, 3.0))
    assert values_of(built) == {"name": "b", "low": 1.0, "high": 3.0}
    assert [key for key, field in parameters(Grouped).items() if limits_of(field).changeable] == ["low"]
    assert changed(built, low=2.0) == configured(Grouped, name="b", low=2.0, high=3.0)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"hihg": 1.0}, "node /n: unknown key 'hihg', did you mean 'high'?"),
        ({"band": {"low": 1.0}}, "node /n: unknown key 'band', allowed are high, low, name"),
        ({"low": 0.1}, "node /n: low must be at least 0.5 Hz, got 0.1"),
        ({"low": 2.0}, "node /n: low must be below high 2, got 2"),
    ],
)
def test_what_is_wrong_in_a_group_is_said_like_anything_else(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValueError) as caught:
        build(Grouped, values, "node /n")
    assert str(caught.value) == sentence


def test_a_parameter_cannot_be_declared_twice() -> None:
    with pytest.raises(TypeError, match="Twice declares the parameter low twice"):
        parameters(Twice)
