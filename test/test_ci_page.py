"""docs/ci.md can be copied: its example of expectations loads, and its workflows' commands are the program's."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

from uw_acoustic_loc.cli.main import _parser
from uw_acoustic_loc.evaluation.check import load_expected

REPO = Path(__file__).parents[1]
BLOCKS = re.findall(r"```yaml\n(.*?)```", (REPO / "docs" / "ci.md").read_text(), re.DOTALL)
JOBS: dict[str, Any] = {
    name: job for block in BLOCKS for name, job in (yaml.safe_load(block).get("jobs") or {}).items()
}


def commands(job: Any) -> list[list[str]]:
    """Arguments of each call of the program."""
    lines = [shlex.split(line) for step in job["steps"] for line in step.get("run", "").splitlines()]
    installed = [words[1:] for words in lines if words[:1] == ["uwloc"]]
    return installed + [words[3:] for words in lines if words[:3] == ["python3", "-m", "uw_acoustic_loc"]]


@pytest.mark.parametrize("name", ["ros", "pip"])
def test_commands_are_the_programs(name: str) -> None:
    found = [_parser().parse_args(words) for words in commands(JOBS[name])]
    made = {options.output for options in found if "output" in options}
    assert len(found) >= 2
    for options in found:
        for path in (getattr(options, key, None) for key in ("graph", "expected")):
            assert path is None or "my_package" in str(path) or (REPO / path).is_file()
        for bag in options.bag if isinstance(options.bag, list) else [options.bag]:
            assert bag in made or "my_package" in str(bag) or (REPO / bag).is_dir()


def test_the_example_of_expectations_loads(tmp_path: Path) -> None:
    (tmp_path / "expected.yaml").write_text(next(block for block in BLOCKS if "scores:" in block))
    assert load_expected(tmp_path / "expected.yaml").topics
