"""The page of the Python API, run block by block, and the names that it promises."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import uw_acoustic_loc as ua
from uw_acoustic_loc import api

REPO = Path(__file__).parents[1]
PAGE = (REPO / "docs/api.md").read_text(encoding="utf-8")
FIRST, *BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("block", BLOCKS, ids=re.findall(r"^## ([^([\n]*)", PAGE, re.MULTILINE))
def test_a_block_of_the_page_runs(block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(REPO)
    names: dict[str, Any] = {"out": tmp_path}
    exec(compile(FIRST + block, "docs/api.md", "exec"), names)
    assert block.count("\n") <= 10


def test_every_name_is_there_and_documented() -> None:
    for name in api.__all__:
        assert getattr(ua, name).__doc__, name
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = ua.nothing


def test_a_bag_is_named_by_a_text_too() -> None:
    assert "/auv1/odometry" in ua.Bag(str(REPO / "bags/harbour")).topics
    with pytest.raises(ValueError, match="bag nowhere does not exist"):
        ua.Bag("nowhere")


def test_it_needs_no_ros_and_is_imported_when_it_is_used() -> None:
    script = "import sys, uw_acoustic_loc as ua; n = 'numpy' in sys.modules; ua.score; print(n, 'rclpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
