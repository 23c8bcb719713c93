"""Parameters: frozen dataclasses whose fields know their unit and range, and the one builder that fills them.

A parameter is declared once, next to its algorithm::

    gate_sigma: float = param(3.0, unit="sigma", low=0.0, doc="innovations beyond this are rejected")

``build`` turns a mapping (ROS parameters, a YAML node) into the dataclass. Whatever is wrong ends as one sentence
that names the place, the key, the value and what is allowed.

Parameters of one concept may stand together in a dataclass of their own, which the config holds as a ``group``. That
is an order for readers of the code alone: in YAML and in ROS every parameter has its own name, without the group's.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass
from types import UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")


@dataclass(frozen=True)
class Limits:
    """What a parameter may be: unit, closed range of each number, names of choices, changeable at run time or not."""

    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    length: int = 0
    changeable: bool = False
    doc: str = ""


def param(
    default: Any = MISSING,
    *,
    unit: str = "",
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
    length: int = 0,
    changeable: bool = False,
    doc: str = "",
) -> Any:
    """A dataclass field with its limits; without a default the key is required."""
    limits = Limits(unit, low, high, choices, length, changeable, doc)
    return dataclasses.field(default=default, metadata={"limits": limits})


def group(kind: type[Any]) -> Any:
    """A dataclass field that holds the parameters of one concept, all of them with a default."""
    return dataclasses.field(default_factory=kind, metadata={"group": kind})


def limits_of(field: dataclasses.Field[Any]) -> Limits:
    """The limits that a field was declared with."""
    limits: Limits = field.metadata.get("limits", Limits())
    return limits


def parameters(cls: type[Any]) -> dict[str, dataclasses.Field[Any]]:
    """The fields of a config and of its groups, by the name that YAML and ROS know them by."""
    found: dict[str, dataclasses.Field[Any]] = {}
    for field in dataclasses.fields(cls):
        inner = parameters(field.metadata["group"]) if "group" in field.metadata else {field.name: field}
        if twice := found.keys() & inner.keys():
            raise TypeError(f"{cls.__name__} declares the parameter {', '.join(sorted(twice))} twice")
        found |= inner
    return found


def values_of(config: Any) -> dict[str, Any]:
    """The values of a config and of its groups by the parameters' names."""
    values: dict[str, Any] = {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        values |= values_of(value) if "group" in field.metadata else {field.name: value}
    return values


def configured(cls: type[T], **values: Any) -> T:
    """`build` for Python code: ``configured(ToaConfig, emission="unknown", bottom_depth=40.0)``."""
    return build(cls, values, cls.__name__)


def changed(config: T, **values: Any) -> T:
    """The config with other values of some parameters, checked as by `build`."""
    return build(type(config), {**values_of(config), **values}, type(config).__name__)


def build(cls: type[T], values: Mapping[str, Any], where: str) -> T:
    """The dataclass `cls` from `values`; `where` names the place in the sentence of a ValueError.

    Nested dataclasses are built from nested mappings, tuples of dataclasses from lists of mappings, groups from the
    values of their parameters.
    """
    if not isinstance(values, Mapping):
        raise ValueError(f"{where} must be a mapping of keys to values, got {values!r}")
    known = parameters(cls)
    for key in values:
        if key not in known:
            raise ValueError(f"{where}: unknown key {str(key)!r}{_nearest(str(key), known)}")
    return _built(cls, values, where)


def _built(cls: type[T], values: Mapping[str, Any], where: str) -> T:
    """From values of which some may belong to other groups."""
    fields = {f.name: f for f in dataclasses.fields(cls) if "group" not in f.metadata}  # type: ignore[arg-type]
    hints = get_type_hints(cls)
    own = [(key, value) for key, value in values.items() if key in fields]
    built = {key: _value(hints[key], value, f"{where}: {key}", limits_of(fields[key])) for key, value in own}
    for name, field in fields.items():
        if name not in built and field.default is MISSING and field.default_factory is MISSING:
            raise ValueError(f"{where}: key '{name}' is missing")
    for field in dataclasses.fields(cls):  # type: ignore[arg-type]
        if "group" in field.metadata:
            built[field.name] = _built(field.metadata["group"], values, where)
    try:
        return cls(**built)
    except ValueError as error:  # a __post_init__ that compares several fields
        raise ValueError(f"{where}: {error}") from None


def _nearest(key: str, known: Mapping[str, Any]) -> str:
    close = difflib.get_close_matches(key, known, n=1)
    return f", did you mean '{close[0]}'?" if close else f", allowed are {', '.join(sorted(known)) or 'none'}"


def _value(kind: Any, value: Any, where: str, limits: Limits) -> Any:
    value = value.tolist() if hasattr(value, "tolist") else value  # numpy's numbers and arrays
    if get_origin(kind) is UnionType:  # `X | None`: a part that may be left out, never written as null
        kind = get_args(kind)[0]
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        return build(kind, value, where)
    if get_origin(kind) is Mapping:
        return _names(value, where)
    if get_origin(kind) is tuple:
        return _sequence(get_args(kind)[0], value, where, limits)
    return _scalar(kind, value, where, limits)


def _names(value: Any, where: str) -> dict[str, str]:
    if not isinstance(value, Mapping) or not all(isinstance(text, str) for pair in value.items() for text in pair):
        raise ValueError(f"{where} must be a mapping of names to names, got {value!r}")
    return dict(value)


def _sequence(kind: Any, value: Any, where: str, limits: Limits) -> tuple[Any, ...]:
    if isinstance(value, str | bytes) or not isinstance(value, Sequence):
        of = "mappings" if dataclasses.is_dataclass(kind) else kind.__name__
        raise ValueError(f"{where} must be a list of {of}, got {value!r}")
    if limits.length and len(value) not in (0, limits.length):
        raise ValueError(f"{where} must have {limits.length} elements, got {len(value)}")
    element = dataclasses.replace(limits, length=0)
    return tuple(_value(kind, item, f"{where}[{i}]", element) for i, item in enumerate(value))


def _scalar(kind: type, value: Any, where: str, limits: Limits) -> Any:
    # YAML writes 3 for 3.0; ROS does not convert an integer parameter, so both are accepted here. bool is an int
    # to Python and never meant as a number.
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if kind is float and number:
        value = _float(value)
    elif type(value) is not kind:
        raise ValueError(f"{where} must be {_words(kind)}, got {value!r}")
    if limits.choices and value not in limits.choices:
        raise ValueError(f"{where} must be one of {', '.join(limits.choices)}, got {value!r}")
    if kind in (int, float) and not (limits.low <= value <= limits.high and abs(value) < math.inf):  # nor NaN
        raise ValueError(f"{where} must be {_range(limits)}, got {value!r}")
    return value


def _float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:  # an integer beyond them, which is in no range
        return math.inf if value > 0 else -math.inf


def _words(kind: type) -> str:
    return {bool: "true or false", int: "a whole number", float: "a number", str: "a string"}.get(kind, kind.__name__)


def _range(limits: Limits) -> str:
    unit = f" {limits.unit}" if limits.unit else ""
    if limits.low > -math.inf and limits.high < math.inf:
        return f"from {limits.low:g} to {limits.high:g}{unit}"
    if limits.low > -math.inf:
        return f"at least {limits.low:g}{unit}"
    return f"at most {limits.high:g}{unit}" if limits.high < math.inf else "a finite number"
