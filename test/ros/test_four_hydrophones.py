"""Another package's stage and record (docs/examples/four_hydrophones), installed as ROS 2 does, in every program."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.stats import chi2

from test.known_run import SOURCES, Event, dead_reckoning, pose, t_ns, times, truth, write_bag
from uw_acoustic_loc.core.geometry import wrap_angle
from uw_acoustic_loc.core.types import Array

REPO = Path(__file__).parents[2]
EXAMPLE = REPO / "docs" / "examples" / "four_hydrophones"
SNR = 30.0


@pytest.fixture(scope="module")
def four() -> Iterator[ModuleType]:
    """The example's mathematics, imported here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(EXAMPLE)
        from four_hydrophones import bearing

        yield bearing


@pytest.fixture(scope="module")
def install(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example in a workspace of its own, built by colcon."""
    workspace = tmp_path_factory.mktemp("ws")
    shutil.copytree(EXAMPLE, workspace / "src", ignore=shutil.ignore_patterns("__pycache__"))
    done = subprocess.run(
        [sys.executable, "-m", "colcon", "build"],
        cwd=workspace,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return workspace / "install" / "four_hydrophones"


@pytest.fixture(scope="module")
def bag(four: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Truth, dead reckoning, and a ping of the known run's source a every half second."""
    return write_bag(tmp_path_factory.mktemp("bag") / "in", [*truth(), *dead_reckoning(), *frames(four)])


def frames(four: ModuleType) -> Iterator[Event]:
    config, rng = four.FourBearingConfig("a", 1500.0), np.random.default_rng(1)
    for time in times(2, 59):
        position, yaw = pose(time)
        east, north = (SOURCES["a"] - position)[:2]
        yield t_ns(time + 0.01), "/auv1/hydrophones/four", frame(four, config, math.atan2(north, east) - yaw, rng, time)


def frame(four: ModuleType, config: object, bearing: float, rng: np.random.Generator, time: float = 0.0) -> object:
    """10 ms of a plane wave of noise in the band, in independent white noise."""
    frequencies = np.fft.rfftfreq(1000, 1 / config.sample_rate)
    wave, *noise = rng.normal(size=(5, frequencies.size)) + 1j * rng.normal(size=(5, frequencies.size))
    wave[(frequencies < config.band_low) | (frequencies > config.band_high)] = 0
    ahead = np.array([config.x, config.y]).T @ [math.cos(bearing), math.sin(bearing)] / config.sound_speed
    heard = [math.sqrt(SNR) * wave * np.exp(2j * np.pi * frequencies * lead) for lead in ahead]
    channels = (np.fft.irfft(s + n).astype(np.float32) for s, n in zip(heard, noise, strict=True))
    return four.FourSamples(t_ns(time), *channels)


def run(install: Path, *command: object) -> subprocess.CompletedProcess[str]:
    site = next((install / "lib").glob("python3*/site-packages"))
    path = os.pathsep.join([str(REPO), str(site), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": path}
    return subprocess.run(
        [*map(str, command)], env=environment, capture_output=True, text=True, timeout=120, check=False
    )


def uwloc(install: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    return run(install, sys.executable, "-m", "uw_acoustic_loc", *arguments)


def test_bearings_are_as_good_as_their_variances_say(four: ModuleType) -> None:
    """From every direction; limits of 99 % of a chi-square of all of them."""
    config, rng, pings = four.FourBearingConfig("a", 1500.0), np.random.default_rng(2), 400
    bearings: Array = rng.uniform(-np.pi, np.pi, pings)
    found = [four.bearing_of(frame(four, config, bearing, rng), config) for bearing in bearings]
    errors = np.array([wrap_angle(one.bearing - true) for one, true in zip(found, bearings, strict=True)])
    low, high = chi2.ppf([0.005, 0.995], pings)
    assert low < np.sum(errors**2 / [one.variance for one in found]) < high


def test_noise_is_no_ping_and_a_dead_hydrophone_is_named(four: ModuleType) -> None:
    config, rng = four.FourBearingConfig("a", 1500.0), np.random.default_rng(3)
    noise = (four.FourSamples(1, *rng.normal(size=(4, 1000))) for _ in range(100))
    assert not any(four.bearing_of(frame, config) for frame in noise)
    with pytest.raises(ValueError, match="all four hydrophones must have a sound in the band, got powers"):
        four.bearing_of(four.FourSamples(1, *np.eye(4, 1000)[:3], np.zeros(1000)), config)


def test_offline_and_live_give_the_same_and_the_score_knows_it(
    install: Path, bag: Path, tmp_path: Path, domain: int
) -> None:
    graph = EXAMPLE / "graph.yaml"
    offline, live = tmp_path / "offline", tmp_path / "live"
    done = uwloc(install, "process", bag, "--graph", graph, "-o", offline, "--keep-inputs")
    assert done.returncode == 0, done.stderr
    score = json.loads(uwloc(install, "score", offline, "--json").stdout)
    assert score["bearing"]["a"]["n"] == 119
    assert score["bearing"]["a"]["rmse_deg"] < 0.5, "three wavelengths across, at an SNR of 30"
    assert score["localizer"]["a"]["n"] > 50
    done = uwloc(install, "replay", bag, "--graph", graph, "-o", live, "--rate", 20)
    assert done.returncode == 0, done.stderr
    hashes = [outputs(install, path) for path in (offline, live)]
    assert len(hashes[0]) == 2
    assert hashes[0] == hashes[1]


def outputs(install: Path, path: Path) -> dict[str, str]:
    """Hash by estimated topic."""
    lines = [line.split() for line in uwloc(install, "hash", path).stdout.splitlines()]
    return {topic: digest for digest, _, topic in lines if "/sources/a/" in topic and "truth" not in topic}


def test_info_names_it(install: Path, bag: Path) -> None:
    found = json.loads(uwloc(install, "info", bag, "--json").stdout)["estimators"]
    uses = {use["estimator"]: use for use in found if use["namespace"] == "/auv1"}
    own = uses["four_hydrophones/bearing4"]
    assert (own["ready"], own["inputs"]) == (True, {"hydrophones/four": ["/auv1/hydrophones/four"]})
    assert uses["bearing_localizer"]["after"] == {"sources/<id>/bearing": "four_hydrophones/bearing4"}


WRONG = {
    "source_id: a, sound_sped: 1500.0": "unknown key 'sound_sped', did you mean 'sound_speed'?",
    "source_id: a, sound_speed: 150.0": "sound_speed must be from 1350 to 1650 m/s, got 150.0",
    "source_id: a, sound_speed: 1500.0, x: [0.0, 0.0, 0.0, 0.0]": "x, y must not put all hydrophones on one line",
}


@pytest.mark.parametrize("params", WRONG)
def test_a_wrong_parameter_is_one_sentence_before_anything_runs(
    params: str, install: Path, bag: Path, tmp_path: Path
) -> None:
    (tmp_path / "params.yaml").write_text(f"/**/bearing4: {{ros__parameters: {{{params}}}}}")
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: four_hydrophones/bearing4, params: params.yaml}]")
    for command in (("process", bag, "-o", tmp_path / "out", "--graph"), ("launch",)):
        done = uwloc(install, *command, tmp_path / "graph.yaml")
        assert done.returncode == 1
        assert f"node /bearing4: {WRONG[params]}" in " ".join(done.stderr.split())


def test_ros2_run_starts_the_same(install: Path, domain: int) -> None:
    script = install / "lib" / "four_hydrophones" / "bearing4"
    done = run(install, script, "--ros-args", "-p", "source_id:=a", "-p", "sound_speed:=150.0")
    assert (done.returncode, done.stderr) == (
        1,
        "node /bearing4: sound_speed must be from 1350 to 1650 m/s, got 150.0\n",
    )


def test_a_stage_that_is_not_installed_is_said_to_be_left_out(bag: Path, tmp_path: Path, install: Path) -> None:
    shutil.copy(EXAMPLE / "params.yaml", tmp_path)
    text = (EXAMPLE / "graph.yaml").read_text()
    (tmp_path / "graph.yaml").write_text(text.replace("/bearing4,", "/bearing5, name: bearing4,"))
    done = uwloc(install, "process", bag, "-o", tmp_path / "out", "--graph", tmp_path / "graph.yaml")
    assert "/auv1/bearing4 is left out: four_hydrophones/bearing5 is no estimator" in " ".join(done.stderr.split())


def test_the_page_shows_the_example_as_it_is() -> None:
    page = (REPO / "docs" / "howto_own_stage.md").read_text()
    files = [path.read_text() for path in EXAMPLE.rglob("*") if path.suffix in (".py", ".msg", ".yaml")]
    blocks = re.findall(r"```(?:python|yaml)?\n(.*?)```", page, re.DOTALL)
    shown = [block for block in blocks if not block.startswith("colcon")]
    assert len(shown) == 4
    for block in shown:
        assert any(block in text for text in files), block
