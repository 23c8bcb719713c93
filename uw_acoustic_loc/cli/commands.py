"""What each command does, in terms of the layers below. Heavy imports stand inside: `uwloc --help` is quick."""
# ruff: noqa: PLC0415

from __future__ import annotations

import json
import math
import shutil
import sys
import time
from argparse import Namespace
from pathlib import Path

from .console import STDERR, NodeLog, progress


def demo(options: Namespace) -> int:
    """Launches the harbour graph, records, scores, reports."""
    from ..resources import resource
    from ..sim.scenario import load_scenario
    from .recording import load
    from .report import write_report
    from .score import score

    begun = time.monotonic()
    folder: Path = options.output
    if folder.exists():
        shutil.rmtree(folder) if (folder / "bag").exists() else _refuse_folder(folder)
    folder.mkdir(parents=True)
    harbour = resource("config/harbour")
    duration = load_scenario(harbour / "scenario.yaml").duration
    code = _launch(harbour / "graph.yaml", folder / "bag", duration)
    recording = load(folder / "bag")
    scored = score(recording)
    write_report(recording, scored, folder / "report.html")
    (folder / "score.json").write_text(json.dumps(scored, indent=2))
    _print_score(scored, options.json)
    STDERR.print(f"bag {folder / 'bag'}, report {folder / 'report.html'}, {time.monotonic() - begun:.0f} s in all")
    return code


def launch(options: Namespace) -> int:
    """Starts a graph and stays with it."""
    return _launch(options.graph, options.record, options.duration)


def simulate(options: Namespace) -> int:
    """Writes a scenario into a bag."""
    import dataclasses

    from ..bag.simulate import simulate as run
    from ..sim.scenario import load_scenario

    scenario = load_scenario(options.scenario)
    if options.seed >= 0:
        scenario = dataclasses.replace(scenario, seed=options.seed)
    with progress("simulate", scenario.duration) as bar:
        counts = run(scenario, options.output, lambda t_ns: bar((t_ns - scenario.start_ns) * 1e-9))
    STDERR.print(f"{sum(counts.values())} messages on {len(counts)} topics in {options.output}")
    return 0


def score(options: Namespace) -> int:
    """Prints the errors of a bag."""
    from .recording import load
    from .score import score as run

    recording = load(options.bag)
    _print_score(run(recording), options.json)
    return damage_code(list(recording.damage))


def report(options: Namespace) -> int:
    """Writes the report of a bag."""
    from .recording import load
    from .report import write_report
    from .score import score as run

    recording = load(options.bag)
    write_report(recording, run(recording), options.output)
    STDERR.print(f"report in {options.output}")
    return damage_code(list(recording.damage))


def convert_wav(options: Namespace) -> int:
    """Writes a WAV file into a bag."""
    from ..bag.wav import WavSetup
    from ..bag.wav import convert_wav as run

    start_ns = round(options.start * 1e9) if math.isfinite(options.start) else 0
    o, channels = options, _pair(options.channels)
    setup = WavSetup(o.spacing, o.sound_speed, o.full_scale, start_ns, o.frame, o.namespace, channels)
    counts = run(options.wav, options.output, setup)
    STDERR.print(f"{sum(counts.values())} messages on {len(counts)} topics in {options.output}")
    return 0


def info(options: Namespace) -> int:
    """Says what is in a bag."""
    from .info import info as run

    return run(options)


def check(options: Namespace) -> int:
    """Compares a bag with what is expected of it."""
    from .check import check as run

    return run(options)


def reproduce(options: Namespace) -> int:
    """Runs the papers' studies."""
    from .reproduce import reproduce as run

    return run(options)


def plan(options: Namespace) -> int:
    """Draws what a scenario's nets can do."""
    from .plan import plan as run

    return run(options)


def _launch(graph: Path, record: Path | None, duration: float) -> int:
    from ..graph import load_graph
    from ..ros.launcher import Launcher, Run

    with progress("launch", duration) as bar:
        run = Run(record=record, duration=duration, progress=bar if duration else None)
        return Launcher(load_graph(graph), run, NodeLog()).run()


def _print_score(scored: dict[str, object], as_json: bool) -> None:
    from rich.console import Console

    from .score import table

    if as_json:
        print(json.dumps(scored, indent=2))
    else:
        Console().print(table(scored))


def _refuse_folder(folder: Path) -> None:
    raise ValueError(f"{folder} exists and holds no earlier demo: choose another folder with -o")


def damage_code(damage: list[str]) -> int:
    """Says what is wrong with a bag; the exit code that goes with it."""
    for sentence in damage:
        print(f"uwloc: {sentence}", file=sys.stderr)
    return 1 if damage else 0


def _pair(text: str) -> tuple[int, int]:
    parts = text.split(",")
    if len(parts) != 2 or not all(part.strip().isdecimal() for part in parts):
        raise ValueError(f"--channels must be two numbers such as 0,1, got {text!r}")
    return int(parts[0]), int(parts[1])
