"""Params-files mean offline what they mean to rcl: the reader against rclpy itself, value by value."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

from uw_acoustic_loc.graph import load_graph, params_of
from uw_acoustic_loc.resolved_graph import resolve_node
from uw_acoustic_loc.ros.parameters import ParameterNode

TAKEN = [
    "1",
    "-1",
    "+1",
    "-0",
    "0x1F",
    "010",
    "08",
    "0b11",
    "0o17",
    "1_000",
    "1e-2",
    "18e3",
    "1.",
    ".5",
    ".5e3",
    "1E5",
    "1e400",
    "1e-310",
    "1d3",
    "1e",
    "0x",
    "++1",
    "0x1p3",
    "0x1F.8",
    "9223372036854775807",
    "9223372036854775808",
    "-9223372036854775809",
    "0xFFFFFFFFFFFFFFFF",
    ".nan",
    ".NaN",
    "nan(1)",
    "NaN",
    ".inf",
    "-.inf",
    "+.inf",
    "inf",
    "-INF",
    "infinity",
    ".Nan",
    "y",
    "Y",
    "yes",
    "on",
    "oN",
    "off",
    "n",
    "No",
    "TRUE",
    "yEs",
    "~",
    "null",
    "=",
    "<<",
    "2024-06-01",
    "1:30",
    "1,5",
    "abc",
    "'1'",
    '"on"',
    "''",
    '"a\\tb"',
    "[1,2]",
    "[1e3,2.]",
    "['a',b]",
    "[on,off]",
    "['']",
    "[~]",
    "[1,]",
    "[]",
    "[010,0x10]",
]
TAKEN += [
    "!!str 1",
    "!!float 3",
    "!!bool on",
    "! 3",
    "|\n      text",
    "|-\n      3",
    "&a 3",
    "[a,\n        b c]",
    "1 # c",
]
REFUSED = ["", "[1, 2.5]", "[n, e]", "[1, '1']", "[true, 1]", "[1, ~]", "[[1], [2]]", "[,]", "- 1", "!!str", "[[], 1]"]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "params.yaml"


def as_live(file: Path, name: str) -> dict[str, Any]:
    arguments = ["--ros-args", "--disable-external-lib-logs", "--params-file", str(file)]
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = ParameterNode(name)
        given = node.get_parameters_by_prefix("")
        found = {key: parameter.value for key, parameter in given.items() if key.startswith("p")}
        found |= {key: [] for key in node.empty}
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    return found


def plain(value: Any) -> Any:
    """With the kind, and comparable: NaN is NaN, an array a list."""
    items = value if isinstance(value, str | bool | int | float) else [plain(item) for item in value]
    return (type(items).__name__, repr(items))


def test_values_are_those_of_rclpy(domain: int, file: Path) -> None:
    lines = "".join(f"    p{k}: {text}\n" for k, text in enumerate(TAKEN))
    file.write_text(f"some:\n  ros__parameters:\n{lines}", encoding="utf-8")
    live = as_live(file, "some")
    offline = params_of(file, "/some")
    different = {
        TAKEN[int(key[1:])]: (offline[key], value) for key, value in live.items() if not same(offline[key], value)
    }
    assert not different
    assert live.keys() == offline.keys()
    assert len(live) == len(TAKEN) > 70


def same(one: Any, other: Any) -> bool:
    return bool(plain(one) == plain(other))


@pytest.mark.parametrize("text", REFUSED)
def test_what_rclpy_refuses_is_refused(text: str, domain: int, file: Path) -> None:
    file.write_text(f"some:\n  ros__parameters:\n    p: {text}\n")
    with pytest.raises(ValueError, match=str(file)) as caught:
        params_of(file, "/some")
    assert "\n" not in str(caught.value)
    if text != "[[], 1]":  # of which rcl makes something else
        with pytest.raises(rclpy_implementation.RCLError):
            as_live(file, "some")
    rclpy.try_shutdown()


FREQUENCIES = "band_low: [18e3], band_high: [22e3], pulse_length: 1e-2"
SENTENCES = {
    f"source_ids: [n, e], {FREQUENCIES}": "'n', which is true or false and 'e', which is a string",
    f"source_ids: off, {FREQUENCIES}": "source_ids must be a list of str, got False",
    f"source_ids: , {FREQUENCIES}": "a value is missing",
    f"source_ids: ['1'], {FREQUENCIES}": "sources/1/bearing is no topic of ROS",
    f"source_ids: [a], lateness: [], {FREQUENCIES}": "lateness must be a number, got []",
    f"source_ids: [a], lateness: {{}}, {FREQUENCIES}": "'lateness' must have a value",
    "source_ids: [a, b], band_low: [18000, 26000.5]": "has '18000', which is a whole number and '26000.5'",
}


@pytest.mark.parametrize(("values", "sentence"), SENTENCES.items())
def test_offline_and_live_say_the_same(values: str, sentence: str, domain: int, file: Path) -> None:
    file.write_text(f"bearing: {{ros__parameters: {{{values}}}}}")
    arguments = ["--ros-args", "--disable-external-lib-logs", "--params-file", str(file)]
    command = [sys.executable, "-m", "uw_acoustic_loc.ros", "bearing", *arguments]
    live = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert live.returncode == 1
    (file.parent / "graph.yaml").write_text(f"nodes: [{{executable: bearing, params: {file.name}}}]")
    with pytest.raises(ValueError, match=re.escape(sentence)) as offline:
        resolve_node(load_graph(file.parent / "graph.yaml").nodes[0])
    assert live.stderr == f"{offline.value}\n"


def test_an_empty_list_is_good_live_where_it_is_offline(domain: int, file: Path) -> None:
    file.write_text("toa_tracker: {ros__parameters: {p_ids: []}}")
    assert as_live(file, "toa_tracker") == params_of(file, "/toa_tracker") == {"p_ids": []}
