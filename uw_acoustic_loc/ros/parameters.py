"""ROS parameters of a node from its config dataclasses: declared with ranges, checked by the one builder."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ..config import build, limits_of, parameters, values_of
from ..graph import own_parameters
from .qos import check_overrides
from .spin import Stop, one_line


def make_node(executable: str) -> ParameterNode:
    """A node with the parameters of command line and params-files.

    Raises:
        Stop: ROS cannot use its name, or a value of `qos_overrides` is none.
    """
    try:
        node = ParameterNode(executable)
        check_overrides(_given(node), (), f"node {node.get_fully_qualified_name()}")
    except (ValueError, RuntimeError, NameValidationException) as error:
        raise Stop(1, f"{executable}: {one_line(error)}") from None
    return node


class ParameterNode(Node):
    """A node that has declared every parameter it was given: one that nobody knows can then be refused.

    rclpy cannot declare an empty list, which has no type; here it is one all the same.
    """

    def __init__(self, name: str) -> None:
        self.empty: list[str] = []
        super().__init__(name, automatically_declare_parameters_from_overrides=True)

    def declare_parameters(self, namespace: str, parameters: Any, ignore_override: bool = False) -> Any:
        """Declares all but empty lists, and notes those."""
        self.empty += [name for name, value, *_ in parameters if value is None]
        typed = [one for one in parameters if one[1] is not None]
        return super().declare_parameters(namespace, typed, ignore_override)


def given_parameters(node: ParameterNode) -> dict[str, Any]:
    """What the command line and params-files gave, without rclpy's own parameters."""
    return own_parameters(_given(node))


def _given(node: ParameterNode) -> dict[str, Any]:
    given: dict[str, Any] = node.get_parameters_by_prefix("")
    empty: dict[str, Any] = {name: [] for name in node.empty}
    return empty | {name: parameter.value for name, parameter in given.items()}


def declare(node: Node, config: Any, prefix: str = "") -> None:
    """Declares every parameter of a config with its value, unit and range (replacing what rclpy declared untyped)."""
    values = values_of(config)
    for own_name, field in parameters(type(config)).items():
        name = prefix + own_name
        if node.has_parameter(name):
            node.undeclare_parameter(name)
        value = list(values[own_name]) if isinstance(values[own_name], tuple) else values[own_name]
        node.declare_parameter(name, value, _descriptor(name, field, value), ignore_override=True)


def on_change(node: Node, config: Any, allow: Callable[[Any], None], apply: Callable[[Any], None]) -> None:
    """Checks run-time changes with the builder and `allow`, refuses what cannot change, `apply`s the new config."""
    current = [config]
    known = parameters(type(config)).keys()
    changeable = {name for name, field in parameters(type(config)).items() if limits_of(field).changeable}

    def rebuilt(given: list[Parameter]) -> Any:
        values = values_of(current[0]) | {p.name: p.value for p in given if p.name in known}
        return build(type(config), values, f"node {node.get_fully_qualified_name()}")

    def check(given: list[Parameter]) -> SetParametersResult:
        for parameter in given:
            if parameter.name in known - changeable:
                reason = f"{parameter.name} cannot change while the node runs, only {', '.join(sorted(changeable))} can"
                return SetParametersResult(successful=False, reason=reason)
        try:
            allow(rebuilt(given))
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def changed(given: list[Parameter]) -> None:
        if any(parameter.name in known for parameter in given):
            current[0] = rebuilt(given)
            apply(current[0])

    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(changed)


def _descriptor(name: str, field: dataclasses.Field[Any], value: Any) -> ParameterDescriptor:
    limits = limits_of(field)
    text = ", ".join(part for part in (limits.doc, limits.unit) if part)
    # An empty list has no type of its own in rclpy, and 3 may be meant as 3.0: the builder checks types instead.
    descriptor = ParameterDescriptor(name=name, description=text, dynamic_typing=not isinstance(value, str | bool))
    descriptor.additional_constraints = f"one of {', '.join(limits.choices)}" if limits.choices else ""
    if isinstance(value, float) and (limits.low > -math.inf or limits.high < math.inf):
        low, high = max(limits.low, -1.7e308), min(limits.high, 1.7e308)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif isinstance(value, int) and not isinstance(value, bool) and limits.low > -math.inf:
        high = int(min(limits.high, 2**63 - 1))
        descriptor.integer_range = [IntegerRange(from_value=int(limits.low), to_value=high)]
    return descriptor
