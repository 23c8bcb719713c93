"""`uwloc demo`: the whole graph on the harbour scenario."""
# ruff: noqa: PLC0415

from __future__ import annotations

import json
import shutil
import time
from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..console import say
from .launch import launch_graph
from .score import print_score

HELP = "the whole graph on the harbour scenario: bag, table and report"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/demo"), help="folder to be made (default %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print the score as JSON")


def run(options: Namespace) -> int:
    """Launches the harbour graph, records, scores, reports."""
    from ...evaluation.recording import load
    from ...evaluation.report import write_report
    from ...evaluation.score import score
    from ...resources import resource
    from ...sim.scenario import load_scenario

    begun = time.monotonic()
    folder: Path = options.output
    if folder.exists():
        shutil.rmtree(folder) if (folder / "bag").exists() else _refuse_folder(folder)
    folder.mkdir(parents=True)
    harbour = resource("config/harbour")
    duration = load_scenario(harbour / "scenario.yaml").duration
    code = launch_graph(harbour / "graph.yaml", folder / "bag", duration, bag_is_vital=True)
    recording = load(folder / "bag")
    scored = score(recording)
    write_report(recording, scored, folder / "report.html")
    (folder / "score.json").write_text(json.dumps(scored, indent=2))
    print_score(scored, options.json)
    say(f"bag {folder / 'bag'}, report {folder / 'report.html'}, {time.monotonic() - begun:.0f} s in all")
    return code


def _refuse_folder(folder: Path) -> None:
    raise ValueError(f"{folder} exists and holds no earlier demo: choose another folder with -o")
