"""Stages of other packages: found by their entry points, and what is wrong with one is a sentence that names it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from test.known_run import everything, write_bag
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.survey import survey
from uw_acoustic_loc.bag.usable import uses
from uw_acoustic_loc.stages.build import configure
from uw_acoustic_loc.stages.catalog import is_stage, other_stages, stage_class

CODE = """
from dataclasses import dataclass
from uw_acoustic_loc.config import param
from uw_acoustic_loc.contract import Input, Output, Stage

@dataclass(frozen=True)
class Config:
    gain: float = param(1.0, low=0.0, changeable=True)

@dataclass(frozen=True)
class Late:
    lateness: float = 0.5

class Good(Stage):
    Config = Config
    def __init__(self, config):
        if config.gain == 13:
            raise ValueError("gain must not be 13")
    inputs = outputs = ()

class Clash(Good):
    Config = Late

class Letter:
    Config = Config

class Half(Stage):
    Config = Config
    def __init__(self, config):
        pass
    inputs = ()

class Bare(Good):
    Config = 3

class Bug(Good):
    def __init__(self, config):
        raise KeyError("calibration")

class Odd(Good):
    inputs = (Input("letters", Letter, print),)
"""
ENTRIES = """
[uw_acoustic_loc.stages]
good = their_code:Good
clash = their_code:Clash
odd = their_code:Odd
gone = their_code:Gone
missing = no_such_code:Good
letter = their_code:Letter
half = their_code:Half
bare = their_code:Bare
bug = their_code:Bug
licence = their_licence:Good
bearing = their_code:Good
"""


@pytest.fixture(autouse=True)
def _package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package `their-package` with these entry points."""
    (tmp_path / "their_code.py").write_text(CODE)
    (tmp_path / "their_licence.py").write_text("raise RuntimeError('no licence')")
    about = tmp_path / "their_package-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: their-package\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(ENTRIES)
    monkeypatch.syspath_prepend(tmp_path)
    other_stages.cache_clear()
    yield
    other_stages.cache_clear()


def test_they_are_named_by_package_and_name() -> None:
    assert is_stage("their_package/good")
    assert not is_stage("good")
    assert not is_stage("their_package/other")
    assert stage_class("their_package/bearing").__name__ == "Good"
    assert stage_class("bearing").__name__ == "BearingStage", "nobody takes the place of another package's stage"


def test_a_stage_needs_no_more_than_a_constructor_inputs_and_outputs() -> None:
    stage = configure("their_package/good", {"gain": 2.0, "lateness": 1.0}, "node /good").make()
    assert stage.status().message == "running"
    stage.check(None)
    with pytest.raises(NotImplementedError, match="Good has changeable parameters, it must have `change` too"):
        stage.change(None)


WRONG = {
    (
        "missing",
        "",
    ): "stage their_package/missing: no_such_code:Good cannot be imported (No module named 'no_such_code')",
    ("gone", ""): "stage their_package/gone: their_code:Gone cannot be imported (module 'their_code' has no attribute",
    (
        "letter",
        "",
    ): "their_code:Letter must be a contract.Stage, it has no any_id, inputs, outputs, status, check, change",
    ("half", ""): "their_code:Half must be a contract.Stage, it has no outputs",
    ("bare", ""): "Config of their_code:Bare must be a dataclass, got 3",
    ("licence", ""): "their_licence:Good cannot be imported (no licence)",
    ("clash", ""): "Clash must not have a parameter lateness: every stage has it",
    ("good", "gian"): "unknown key 'gian', did you mean 'gain'?",
    ("good", "gain"): "gain must not be 13",
}


@pytest.mark.parametrize(("name", "key"), WRONG)
def test_what_is_wrong_is_said_with_the_node(name: str, key: str) -> None:
    with pytest.raises(ValueError, match=r"^node /n: ") as caught:
        configure(f"their_package/{name}", {key: 13.0} if key else {}, "node /n")
    assert WRONG[name, key] in str(caught.value)


def test_a_broken_one_takes_nothing_from_the_others(tmp_path: Path) -> None:
    found = {use.estimator: use for use in uses(survey(Bag(write_bag(tmp_path / "bag", everything()))))}
    assert found["bearing_localizer"].ready
    assert found["mooring_tracker"].ready
    assert "cannot be imported" in found["their_package/missing"].unusable["with default parameters"]
    assert found["their_package/bug"].unusable == {"with default parameters": "KeyError 'calibration'"}
    assert "Letter must be a type of core.types, or a record with its Letter.msg in" in str(
        found["their_package/odd"].unusable
    )
