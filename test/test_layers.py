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
    "version": {"version"},
    "resources": {"resources"},
    "yaml_file": {"yaml_file"},
    "core": {"core", "config"},
    "sim": {"sim", "core", "config", "contract", "resources", "yaml_file"},
    "wire": {"wire", "core", "resources"},
    "topics": {"topics", "core", "contract"},
    "stages": {"stages", "topics", "core", "config", "contract"},
    "graph": {"graph", "config", "yaml_file"},
    "resolved_graph": {"resolved_graph", "graph", "sim", "stages", "wire", "config", "contract"},
    "bag": {
        *("bag", "resolved_graph", "graph", "sim", "stages", "topics", "wire", "core", "config", "contract"),
        "yaml_file",
    },
    "ros": {"ros", "bag", "resolved_graph", "graph", "sim", "stages", "topics", "wire", "core", "config", "contract"},
    "evaluation": {"evaluation", "bag", "stages", "topics", "sim", "wire", "core", "config", "contract", "yaml_file"},
    "calibration": {
        *("calibration", "evaluation", "bag", "resolved_graph", "stages", "core", "config", "contract"),
    },
    "planning": {"planning", "evaluation", "sim", "core", "config"},
    "studies": {"studies", "evaluation", "planning", "sim", "core", "config", "resources"},
    "cli": {
        *("cli", "calibration", "studies", "planning", "evaluation", "ros", "bag", "resolved_graph", "graph", "sim"),
        *("stages", "core", "config", "resources", "yaml_file"),
    },
}
PLOTS = {"numpy", "scipy", "rich", "matplotlib"}
OUTSIDE: dict[str, set[str]] = {
    "core": {"numpy", "scipy"},
    "config": set(),
    "contract": set(),
    "topics": set(),
    "stages": {"numpy"},
    "wire": {"numpy"},
    "sim": {"numpy", "scipy"},
    "bag": {"numpy", "scipy", "yaml", "lz4", "mcap", "zstandard", "rosbags", "soundfile"},
    "evaluation": {*PLOTS, "yaml"},
    "calibration": {"numpy", "scipy", "yaml"},
    "planning": PLOTS,
    "studies": PLOTS,
    "cli": {"yaml", "rich"},
}
# an estimator of core -> the other estimators that it imports
ESTIMATORS = {"slam": {"localizer"}}


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
    if own.startswith("__") or own == "api":  # what the package offers from all its layers
        return
    used = {layer(name) for name in imports(module) if name.startswith("uw_acoustic_loc.")} - {"__version__", "version"}
    assert used <= BELOW[own], f"{own} must not import {used - BELOW[own]}"
    outside = {name.split(".")[0] for name in imports(module) if not name.startswith("uw_acoustic_loc")}
    third_party = outside - set(sys.stdlib_module_names)
    if own in OUTSIDE:
        assert third_party <= OUTSIDE[own], f"{own} must not import {third_party - OUTSIDE[own]}"


def test_only_ros_imports_rclpy() -> None:
    users = {m.relative_to(PACKAGE).parts[0] for m in MODULES if any(n.startswith("rclpy") for n in imports(m))}
    assert users == {"ros"}


def test_an_estimator_of_core_imports_another_only_where_the_table_says_so() -> None:
    for folder in sorted(path for path in (PACKAGE / "core").iterdir() if (path / "__init__.py").exists()):
        names = {name for module in folder.glob("*.py") for name in imports(module)}
        others = {name.split(".")[2] for name in names if name.startswith("uw_acoustic_loc.core.")} - {folder.name}
        estimators = {other for other in others if (PACKAGE / "core" / other).is_dir()}
        assert estimators == ESTIMATORS.get(folder.name, set()), f"core/{folder.name} imports core/{estimators}"


def test_no_folder_has_more_than_sixteen_files() -> None:
    counts = {folder: len(list(folder.glob("*.py"))) for folder in PACKAGE.rglob("*") if folder.is_dir()}
    assert {folder.name: count for folder, count in counts.items() if count > 16} == {}


def test_there_is_no_import_circle() -> None:
    """Counting those under TYPE_CHECKING, in functions, and by import_module with a name in the code."""
    graph = {dotted(module): uses(module) for module in MODULES}
    while leaves := [name for name, used in graph.items() if not used & graph.keys()]:
        for leaf in leaves:
            del graph[leaf]
    assert not graph, f"modules in or above a circle: {sorted(graph)}"


def dotted(module: Path) -> str:
    parts = ["uw_acoustic_loc", *module.relative_to(PACKAGE).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def uses(module: Path) -> set[str]:
    """Modules of the package that a module imports; `from package import module` counts as the module."""
    known = {dotted(m) for m in MODULES}
    package = ["uw_acoustic_loc", *module.relative_to(PACKAGE).parts[:-1]]
    found = set()
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            found |= {f"{stem}.{a.name}" if f"{stem}.{a.name}" in known else stem for a in node.names}
    return (found & known) - {dotted(module), "uw_acoustic_loc"}
