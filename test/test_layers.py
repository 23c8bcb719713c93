"""The import arrow: every layer imports only from those below it, and core only numpy and scipy."""

import ast
import sys
from pathlib import Path

import pytest

import uw_acoustic_loc

PACKAGE = Path(uw_acoustic_loc.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))

# layer -> layers of the package that it may import (itself included)
BELOW = {
    "config": {"config"},
    "contract": {"contract"},
    "resources": {"resources"},
    "yaml_file": {"yaml_file"},
    "core": {"core", "config"},
    "sim": {"sim", "core", "config", "contract", "resources", "yaml_file"},
    "wire": {"wire", "core", "resources"},
    "stages": {"stages", "core", "config", "contract"},
    "graph": {"graph", "config", "yaml_file"},
    "wiring": {"wiring", "graph", "sim", "stages", "core", "config", "contract"},
    "bag": {"bag", "wiring", "graph", "sim", "stages", "wire", "core", "config", "contract", "yaml_file"},
    "ros": {"ros", "bag", "wiring", "graph", "sim", "stages", "wire", "core", "config", "contract"},
    "cli": {
        *("cli", "ros", "bag", "wiring", "graph", "sim", "stages", "wire", "core", "config", "contract", "resources"),
        "yaml_file",
    },
}
OUTSIDE = {
    "core": {"numpy", "scipy"},
    "config": set(),
    "contract": set(),
    "stages": {"numpy"},
    "wire": {"numpy"},
    "sim": {"numpy", "scipy"},
    "bag": {"numpy", "scipy", "yaml", "lz4", "mcap", "zstandard", "rosbags"},
    "cli": {"numpy", "scipy", "yaml", "rich", "matplotlib"},
}


def imports(module: Path) -> set[str]:
    """Absolute names of what a module imports, wherever in the file."""
    package = ["uw_acoustic_loc", *module.relative_to(PACKAGE).parts[:-1]]
    found = set()
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            found |= {f"{stem}.{alias.name}" for alias in node.names} if stem == "uw_acoustic_loc" else {stem}
    return found


def layer(name: str) -> str:
    return name.split(".")[1] if "." in name else ""


@pytest.mark.parametrize("module", MODULES, ids=lambda m: str(m.relative_to(PACKAGE)))
def test_a_module_imports_only_from_layers_below(module: Path) -> None:
    own = module.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if own.startswith("__"):
        return
    used = {layer(name) for name in imports(module) if name.startswith("uw_acoustic_loc.")} - {"__version__"}
    assert used <= BELOW[own], f"{own} must not import {used - BELOW[own]}"
    outside = {name.split(".")[0] for name in imports(module) if not name.startswith("uw_acoustic_loc")}
    third_party = outside - set(sys.stdlib_module_names)
    if own in OUTSIDE:
        assert third_party <= OUTSIDE[own], f"{own} must not import {third_party - OUTSIDE[own]}"


def test_only_ros_imports_rclpy() -> None:
    users = {m.relative_to(PACKAGE).parts[0] for m in MODULES if any(n.startswith("rclpy") for n in imports(m))}
    assert users == {"ros"}
