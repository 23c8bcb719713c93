"""Damaged bags through every command: exit code 0, 1 or 2, one sentence per damage, and whole messages stay whole."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from test.bag.foreign import COUNT, VARIANTS, expected, write_mcap
from test.fuzz.bag_damage import damaged
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.cli.main import main

SEED = 20260601
BAGS = {
    "bare": lambda folder: write_mcap(folder / "x.mcap", use_chunking=False, enable_crcs=False),
    **{name: VARIANTS[name] for name in ("zstd chunks", "lz4 chunks", "plain chunks", "no summary", "zstd file")},
    **{name: VARIANTS[name] for name in ("no chunks", "sqlite3", "sqlite3, zstd messages", "sqlite3, zstd file")},
}
CHECKED = {"zstd chunks", "lz4 chunks", "plain chunks", "no summary", "zstd file"}  # every message is under a CRC
GRAPH = """
nodes:
  - {executable: mooring_tracker, params: params.yaml, remap: {mooring/buoy1/offset: /a}}
"""
ORIGINAL = Counter(expected())


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {name: make(tmp_path_factory.mktemp("whole")) for name, make in BAGS.items()}


@pytest.mark.parametrize("part", range(4))
def test_damaged_bags(bags: dict[str, Path], part: int, tmp_path: Path) -> None:
    for case in range(25 * part, 25 * (part + 1)):
        run(case, bags, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(20))
def test_many_damaged_bags(bags: dict[str, Path], part: int, tmp_path: Path) -> None:
    for case in range(100 * part, 100 * (part + 1)):
        run(case, bags, tmp_path)


FOREIGN = Path(__file__).parents[3] / "shared" / "data" / "foreign_bags"


@pytest.mark.slow
@pytest.mark.skipif(not FOREIGN.exists(), reason="the test data folder foreign_bags is not beside the repository")
def test_foreign_bags_pass_every_command(tmp_path: Path) -> None:
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: mooring_tracker, params: params.yaml}]")
    (tmp_path / "params.yaml").write_text("mooring_tracker: {ros__parameters: {mooring_ids: [buoy1]}}")
    for bag in sorted(FOREIGN.iterdir()):
        for arguments in (("info", bag), ("hash", bag), ("score", bag), ("report", bag, "-o", tmp_path / "r.html")):
            assert uwloc(bag.name, *arguments) == (0, []), f"{bag.name}: {arguments[0]}"
        code, lines = uwloc(bag.name, "process", bag, "--graph", tmp_path / "graph.yaml", "-o", tmp_path / bag.name)
        assert (code, len(lines)) == (1, 1)
        assert "none of the topics that the graph needs" in lines[0]


def run(case: int, bags: dict[str, Path], folder: Path) -> None:
    """One bag, damaged as the number of the case says, through all commands."""
    rng = np.random.default_rng([SEED, case])
    name = list(bags)[case % len(bags)]
    bag = folder / f"case{case}" / bags[name].name
    bag.parent.mkdir()
    (shutil.copytree if bags[name].is_dir() else shutil.copyfile)(bags[name], bag)
    files = sorted(bag.iterdir()) if bag.is_dir() else [bag]
    file = next(f for f in files if f.name == "metadata.yaml") if rng.random() < 0.1 and len(files) > 1 else files[0]
    file.write_bytes(damaged(file.read_bytes(), rng))
    about = f"case {case} ({name}, {file.name})"
    said = commands(bag, about, case)
    if said is not None:
        check_messages(bag, about, name in CHECKED and file.name != "metadata.yaml", bool(said))
    shutil.rmtree(bag.parent)


def commands(bag: Path, about: str, case: int) -> list[str] | None:
    """Runs them; returns what was said of the bag's damage, None for a bag that cannot be read at all."""
    (bag.parent / "graph.yaml").write_text(GRAPH)
    (bag.parent / "params.yaml").write_text("mooring_tracker: {ros__parameters: {mooring_ids: [buoy1]}}")
    expectation = {"name": "/a", "count": [1, COUNT], "values": [{"field": "point.x", "range": [0, COUNT]}]}
    (bag.parent / "expected.yaml").write_text(json.dumps({"topics": [expectation]}))
    code, damage = uwloc(about, "info", bag)
    others = [("hash", bag), ("hash", bag, "--json"), ("score", bag), ("score", bag, "--json"), ("info", bag, "--json")]
    others.append(("report", bag, "-o", bag.parent / "report.html"))
    arguments = others[case % len(others)]
    found, lines = uwloc(about, *arguments)
    if "sqlite3" not in about:  # whose index of times may say other than its table
        assert (found, len(lines)) == (code, len(damage)), f"{about}: {arguments[0]} differs from info"
    graph = ("--graph", bag.parent / "graph.yaml")
    keep = [] if case % 2 else ["--keep-inputs"]
    processed, lines = uwloc(about, "process", bag, *graph, "-o", bag.parent / "out", *keep)
    if "sqlite3" not in about:
        assert processed >= code, f"{about}: process exits with {processed}"
        assert len(lines) in (1, len(damage)), f"{about}: process says {lines}"
    uwloc(about, "check", bag, bag.parent / "expected.yaml")
    readable = code == 0 or bag.is_dir() or len(damage) != 1 or "the rest is read" in damage[0]
    return damage if readable else None


def uwloc(about: str, *arguments: str | Path) -> tuple[int, list[str]]:
    """Exit code and sentences on stderr of a command; it must not fail otherwise."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main([str(argument) for argument in arguments])
        except Exception as error:
            raise AssertionError(f"{about}: {arguments[0]} fails with {error!r}") from error
    lines = [line for line in err.getvalue().splitlines() if line.startswith("uwloc: ")]
    assert code in (0, 1, 2), f"{about}: {arguments[0]} exits with {code}"
    assert (code == 0) == (not lines), f"{about}: {arguments[0]} exits with {code} and says {lines}"
    for text in (out.getvalue(), err.getvalue()):
        assert not any(ord(mark) < 32 and mark not in "\n\t" for mark in text), f"{about}: {arguments[0]}: {text!r}"
    assert len(lines) <= 3 or arguments[0] == "check", f"{about}: {arguments[0]}: {lines}"
    return code, lines


def check_messages(bag: Path, about: str, checked: bool, damage: bool) -> None:
    """What is under a checksum is read as it was or not at all; elsewhere a fault costs a few messages."""
    try:
        found = Counter((r.topic, r.t_ns, r.data) for r in Bag(bag).records())
    except ValueError:
        return
    foreign = found - ORIGINAL
    if checked:
        assert not foreign, f"{about}: messages that were never written"
        assert damage or found == ORIGINAL, f"{about}: messages are missing in silence"
    elif not damage:
        assert sum(foreign.values()) <= 8, f"{about}: {sum(foreign.values())} messages differ in silence"
