"""The bags that come along: as their checksums say, made again by their script, and processed as expected."""

import hashlib
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.cli.main import main

REPO = Path(__file__).parents[2]
BAGS = REPO / "bags"


def test_checksums() -> None:
    listed = dict(reversed(line.split()) for line in (BAGS / "SHA256SUMS").read_text().splitlines())
    assert set(listed) == {str(file.relative_to(BAGS)) for file in BAGS.rglob("*.mcap")}
    for name, digest in listed.items():
        assert hashlib.sha256((BAGS / name).read_bytes()).hexdigest() == digest, name


def test_the_script_makes_the_harbour_bag_again(tmp_path: Path) -> None:
    script = [sys.executable, str(BAGS / "make_harbour.py"), str(tmp_path / "harbour")]
    subprocess.run(script, check=True, cwd=REPO)
    again, ours = (Counter((r.topic, r.t_ns) for r in Bag(p / "harbour").records()) for p in (tmp_path, BAGS))
    assert {topic for topic, _ in again} == {topic for topic, _ in ours}
    for topic in {topic for topic, _ in ours} - {"/buoys/arrivals"}:  # whose log times are measurements
        assert {t for name, t in again if name == topic} == {t for name, t in ours if name == topic}, topic


@pytest.mark.parametrize("name", ["harbour", "lasker_ac109"])
def test_offline_outputs_are_as_expected(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    graph = str(REPO / "config" / name / "graph.yaml")
    assert main(["process", str(BAGS / name), "--graph", graph, "-o", str(tmp_path / "out"), "--keep-inputs"]) == 0
    for expected in sorted((BAGS / name).glob("expected*.yaml")):
        capsys.readouterr()
        code = main(["check", str(tmp_path / "out"), str(expected)])
        assert code == 0, capsys.readouterr().err


def test_the_recorded_sound_is_as_expected(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["check", str(BAGS / "fish_array"), str(BAGS / "fish_array" / "expected.yaml")])
    assert code == 0, capsys.readouterr().err
