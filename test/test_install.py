"""The package builds and installs as a ROS package with colcon, and finds its data there."""

import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as Tree
from pathlib import Path

import pytest

import uw_acoustic_loc
from uw_acoustic_loc.ros.executables import EXECUTABLES

REPO = Path(__file__).parents[1]
NAME = "uw_acoustic_loc"


@pytest.fixture(scope="module")
def install(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scratch workspace's install folder."""
    workspace = tmp_path_factory.mktemp("ws")
    source = workspace / "src" / NAME
    ignored = shutil.ignore_patterns(".*", "build", "install", "log", "out", "*.egg-info", "__pycache__", "test")
    shutil.copytree(REPO, source, ignore=ignored)
    command = [sys.executable, "-m", "colcon", "build", "--event-handlers", "console_direct+"]
    done = subprocess.run(command, cwd=workspace, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return workspace / "install" / NAME


def test_colcon_installs_executables_and_data(install: Path) -> None:
    installed = {path.name for path in (install / "lib" / NAME).iterdir()}
    assert installed == {*EXECUTABLES, "uwloc"}
    share = install / "share" / NAME
    assert (share / "msg_defs" / "Track.msg").read_text() == (REPO / "msg_defs" / "Track.msg").read_text()
    assert (share / "config" / "harbour" / "graph.yaml").exists()
    assert (install / "share" / "ament_index" / "resource_index" / "packages" / NAME).exists()


def test_the_installed_program_uses_the_installed_data(install: Path) -> None:
    site = next((install / "lib").glob("python3*/site-packages"))
    script = "from uw_acoustic_loc.resources import resource; print(resource('config/harbour'))"
    environment = os.environ | {"PYTHONPATH": str(site)}
    done = subprocess.run(
        [sys.executable, "-c", script], cwd="/", env=environment, capture_output=True, text=True, check=True
    )
    assert Path(done.stdout.strip()) == install / "share" / NAME / "config" / "harbour"


def test_versions_agree() -> None:
    version = Tree.parse(REPO / "package.xml").findtext("version")
    assert version == uw_acoustic_loc.__version__
    assert f'version="{version}"' in (REPO / "setup.py").read_text()
