"""What the program says on stderr: whole sentences in one line each, whatever is in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from test.known_run import t_ns, write_bag
from uw_acoustic_loc.cli.console import say
from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.core.types import Point


def graph(path: Path, executable: str) -> Path:
    path.write_text(f"nodes:\n  - {{executable: {executable}}}\n", encoding="utf-8")
    return path


def test_a_sentence_is_one_line_and_its_brackets_stay(capsys: pytest.CaptureFixture[str]) -> None:
    sentence = "messages in dives/a[1][/b], " + "and more of them, " * 20
    say(sentence)
    assert capsys.readouterr().err == f"{sentence}\n"


def test_refusals_and_names_in_brackets_are_one_line_each(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    values = [1.0, np.nan]
    events = [(t_ns(k), "/mooring/buoy1/offset", Point(t_ns(k), np.full(3, value))) for k, value in enumerate(values)]
    bag, out = write_bag(tmp_path / "bag", events), tmp_path / "[/x]"
    assert (
        main(["process", str(bag), "--graph", str(graph(tmp_path / "g.yaml", "mooring_tracker")), "-o", str(out)]) == 0
    )
    refusal, done = capsys.readouterr().err.splitlines()
    assert refusal.endswith("must be finite, got [nan, nan, nan]")
    assert done.startswith(f"1 messages in {out}, ")


def test_a_graph_without_an_installed_estimator_names_what_it_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag", [(t_ns(0.0), "/p", Point(t_ns(0.0), np.zeros(3)))])
    code = main(["process", str(bag), "--graph", str(graph(tmp_path / "g.yaml", "depths/depth")), "-o", "none"])
    assert code == 1
    assert "no estimator that is installed here, it has depths/depth; installed are bearing" in capsys.readouterr().err


def test_a_bag_without_estimates_is_said_to_have_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_bag(tmp_path / "bag", [(t_ns(0.0), "/p", Point(t_ns(0.0), np.zeros(3)))])
    assert main(["score", str(bag)]) == 0
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("nothing to score: ")
