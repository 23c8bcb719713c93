"""Reads YAML files: graphs, parameters, scenarios, expectations, all by the rules of ROS.

rcl does not read YAML as PyYAML does: `1e-2` is a number and `08` too, `n` is false, and a list has one kind of
elements. What a node would take for something else offline than live is read here as rcl reads it, or refused.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import yaml

YAML_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml's where there is one, which is ten times as fast
_BOOLS = {
    **dict.fromkeys(("y", "Y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"), True),
    **dict.fromkeys(("n", "N", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"), False),
}
_INTEGER = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)")  # strtol's, base 0
_DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")  # these two: strtod's
_HEXADECIMAL = re.compile(r"[+-]?0[xX]([0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)([pP][+-]?[0-9]+)?")
_SPECIAL = re.compile(r"([+-]?)(?:\.(?:inf|Inf|INF)|(?i:inf|infinity))|\.(?:nan|NaN|NAN)|[+-]?(?i:nan)(?:\(\w*\))?")
_STRING_TAG = "tag:yaml.org,2002:str"
_KINDS = {bool: "true or false", int: "a whole number", float: "a number with a point", str: "a string"}


class _Loader(YAML_LOADER):  # type: ignore[misc, valid-type]
    """Leaves it open what a plain scalar is."""

    def resolve(self, _kind: type[yaml.Node], _value: str, _implicit: Any) -> str:
        return ""


def load_yaml(path: Path, what: str, of_node: bool = False) -> Any:
    """Returns the content of a YAML file; ValueError with one sentence when it cannot be read.

    `of_node`: the file holds parameters of nodes, and rcl reads it, too. It refuses an empty value, a list within a
    list, and one of several kinds; an empty list, which has no kind, is good for any parameter that may be empty.
    """
    try:
        root = yaml.compose(path.read_text(encoding="utf-8"), _Loader)
        return _Reader(of_node).value(root) if root else None
    except OSError as error:
        raise ValueError(f"{what} {path} cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{what} {path} is not valid YAML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise ValueError(f"{what} {path} is nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{what} {path}, {error}") from None


def plain_scalar(text: str) -> bool | int | float | str:
    """What a scalar without quotes is to rcl: what C's strtol, to base 0, and strtod take, else a string."""
    if text in _BOOLS:
        return _BOOLS[text]
    if _INTEGER.fullmatch(text):
        number = int(text, 0 if "x" in text.lower() else 8 if text.lstrip("+-").startswith("0") else 10)
        if -(1 << 63) <= number < 1 << 63:
            return number
    return _double(text)


def _double(text: str) -> float | str:
    if special := _SPECIAL.fullmatch(text):
        return float(f"{special[1]}inf") if special[1] is not None else float("nan")
    if _DECIMAL.fullmatch(text):
        value, zero = float(text), not re.search("[1-9]", text.lower().partition("e")[0])
    elif _HEXADECIMAL.fullmatch(text):
        value, zero = _from_hex(text), not re.search("[1-9a-f]", text.lower().partition("p")[0].partition("x")[2])
    else:
        return text
    in_range = zero or sys.float_info.min <= abs(value) <= sys.float_info.max
    return value if in_range else text


def _from_hex(text: str) -> float:
    try:
        return float.fromhex(text)
    except OverflowError:
        return float("inf")


class _Reader:
    """From the nodes of a YAML document to values."""

    def __init__(self, of_node: bool) -> None:
        self._of_node = of_node
        self._seen: set[int] = set()

    def value(self, node: yaml.Node) -> Any:
        if id(node) in self._seen:
            raise ValueError(f"{_line(node)}: an alias (*) must not be used, ROS knows none")
        self._seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node)
        return self._list(node) if isinstance(node, yaml.SequenceNode) else self._scalar(node)

    def _mapping(self, node: yaml.MappingNode) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode) or not key.value:
                raise ValueError(f"{_line(key)}: a key must be a name")
            if key.value in found:
                raise ValueError(f"{_line(key)}: key '{key.value}' is there twice")
            found[key.value] = self.value(value)
        return found

    def _list(self, node: yaml.SequenceNode) -> list[Any]:
        items = [self.value(item) for item in node.value]
        if self._of_node:
            _check_list(node, items)
        return items

    def _scalar(self, node: Any) -> Any:
        plain = node.style not in ("'", '"')
        if plain and not node.value:
            if self._of_node:
                raise ValueError(f"{_line(node)}: a value is missing")
            return None
        name = not self._of_node and node.value in "yYnN"  # a topic, say: in a graph, which rcl does not read
        return plain_scalar(node.value) if plain and not name and node.tag != _STRING_TAG else node.value


def _check_list(node: yaml.SequenceNode, items: list[Any]) -> None:
    """Refuses what rcl does, and lists in lists, which it makes something else of."""
    if inner := [item for item in items if type(item) not in _KINDS]:
        raise ValueError(f"{_line(node)}: a list must hold numbers or strings, it holds {inner[0]!r}")
    kinds = {type(item): part.value for part, item in zip(node.value, items, strict=True)}
    if len(kinds) > 1:
        words = " and ".join(f"'{text}', which is {_KINDS[kind]}" for kind, text in kinds.items())
        raise ValueError(
            f"{_line(node)}: a list must have elements of one kind, it has {words} (in quotes all are strings)"
        )


def _line(node: yaml.Node) -> str:
    return f"line {node.start_mark.line + 1}"
