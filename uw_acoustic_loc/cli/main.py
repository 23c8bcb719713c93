"""Commands and their arguments. Exit codes: 0 done, 1 user error (one sentence on stderr), 2 usage."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .. import __version__
from . import bag_runs, commands


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; the one place where a user's error becomes a sentence."""
    options = _parser().parse_args(arguments)
    try:
        code: int = options.run(options)
    except ValueError as error:
        print(f"uwloc: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"uwloc: {error.filename or 'operating system'}: {error.strerror}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("uwloc", description="Acoustic localization for AUVs, live and from bags.")
    parser.add_argument("--version", action="version", version=__version__)
    command = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    for commands_of in (_live, _bags, _verdicts, _planning, _wav):
        commands_of(command)
    return parser


def _live(command: Any) -> None:
    demo = command.add_parser("demo", help="the whole graph on the harbour scenario: bag, table and report")
    demo.add_argument(
        "-o", "--output", type=Path, default=Path("out/demo"), help="folder to be made (default %(default)s)"
    )
    demo.add_argument("--json", action="store_true", help="print the score as JSON")
    demo.set_defaults(run=commands.demo)

    launch = command.add_parser("launch", help="start the nodes of a graph, one process each")
    launch.add_argument("graph", type=Path, metavar="GRAPH.yaml")
    launch.add_argument("--record", type=Path, metavar="BAG", help="record all outputs into a new bag")
    launch.add_argument("--duration", type=float, default=0.0, metavar="S", help="stop after S seconds of the clock")
    launch.set_defaults(run=commands.launch)


def _bags(command: Any) -> None:
    simulate = command.add_parser("simulate", help="measurements and truth of a scenario straight into a bag")
    simulate.add_argument("scenario", type=Path, metavar="SCENARIO.yaml")
    simulate.add_argument("-o", "--output", type=Path, required=True, metavar="BAG")
    simulate.add_argument("--seed", type=int, default=-1, help="instead of the scenario's own")
    simulate.set_defaults(run=commands.simulate)

    process = command.add_parser("process", help="run a graph's estimators on bags, offline")
    _bag_and_graph(process, many=True)
    process.add_argument("--jobs", type=_positive, default=1, metavar="N", help="bags at a time (default %(default)s)")
    process.add_argument("--keep-inputs", action="store_true", help="copy the bag's other topics into the output")
    process.set_defaults(run=bag_runs.process)

    replay = command.add_parser("replay", help="play a bag to a graph's live nodes and record what they say")
    _bag_and_graph(replay)
    replay.add_argument("--rate", type=float, default=1.0, help="x real time; 0 = as fast as the nodes go")
    replay.set_defaults(run=bag_runs.replay)

    hashed = command.add_parser("hash", help="a hash per topic of what a bag says, whatever wrote it")
    hashed.add_argument("bag", type=Path, metavar="BAG")
    hashed.add_argument("--json", action="store_true", help="print JSON instead of lines")
    hashed.set_defaults(run=bag_runs.hash_bag)


def _verdicts(command: Any) -> None:
    score = command.add_parser("score", help="errors of a bag's estimates against its truth")
    score.add_argument("bag", type=Path, metavar="BAG")
    score.add_argument("--json", action="store_true", help="print JSON instead of a table")
    score.set_defaults(run=commands.score)

    report = command.add_parser("report", help="one page with tracks, bearings, errors and rates")
    report.add_argument("bag", type=Path, metavar="BAG")
    report.add_argument("-o", "--output", type=Path, default=Path("report.html"))
    report.set_defaults(run=commands.report)

    info = command.add_parser("info", help="what is in a bag, what is wrong with it, which estimators can use it")
    info.add_argument("bag", type=Path, metavar="BAG")
    info.add_argument("--json", action="store_true", help="print JSON instead of tables")
    info.set_defaults(run=commands.info)

    check = command.add_parser("check", help="a bag against a file of expected counts, rates, values and scores")
    check.add_argument("bag", type=Path, metavar="BAG")
    check.add_argument("expected", type=Path, metavar="EXPECTED.yaml")
    check.add_argument("--json", action="store_true", help="print JSON instead of a table")
    check.set_defaults(run=commands.check)


def _planning(command: Any) -> None:
    reproduce = command.add_parser("reproduce", help="the papers' tables and figures, theirs beside ours")
    reproduce.add_argument("name", metavar="NAME", help="a study, or all")
    reproduce.add_argument(
        "-o", "--output", type=Path, default=Path("out/reproduce"), metavar="DIR", help="default %(default)s"
    )
    reproduce.add_argument("--runs", type=int, default=0, metavar="N", help="of the Monte Carlo; 0 = the study's own")
    reproduce.add_argument("--seed", type=int, default=1)
    reproduce.add_argument("--json", action="store_true", help="print the numbers and draw nothing")
    reproduce.set_defaults(run=commands.reproduce)

    plan = command.add_parser("plan", help="maps of the accuracy that a scenario's nets can reach")
    plan.add_argument("scenario", type=Path, metavar="SCENARIO.yaml")
    plan.add_argument("-o", "--output", type=Path, default=Path("out/plan"), metavar="DIR", help="default %(default)s")
    plan.set_defaults(run=commands.plan)


def _wav(command: Any) -> None:
    wav = command.add_parser("convert-wav", help="a WAV recording of two hydrophones into a bag for the bearing node")
    wav.add_argument("wav", type=Path, metavar="IN.wav")
    wav.add_argument("-o", "--output", type=Path, required=True, metavar="BAG")
    wav.add_argument("--spacing", type=float, required=True, metavar="D", help="m between the hydrophones")
    wav.add_argument("--sound-speed", type=float, default=1500.0, metavar="C", help="m/s (default %(default)s)")
    wav.add_argument("--full-scale", type=float, default=1.0, metavar="PA", help="Pa of the largest sample")
    wav.add_argument("--start", type=float, default=1_780_272_000.0, metavar="UNIX_S", help="of the first sample")
    wav.add_argument("--frame", type=float, default=0.1, metavar="S", help="length of a frame (default %(default)s)")
    wav.add_argument("--namespace", default="auv1", help="of the topics (default %(default)s)")
    wav.add_argument("--channels", default="0,1", metavar="I,J", help="of hydrophone 0 (-x) and 1 (+x), from 0")
    wav.set_defaults(run=commands.convert_wav)


def _bag_and_graph(parser: argparse.ArgumentParser, many: bool = False) -> None:
    parser.add_argument("bag", type=Path, metavar="BAG", nargs="+" if many else None)
    parser.add_argument("--graph", type=Path, required=True, metavar="GRAPH.yaml")
    where = "the bag to be made" + (", or the folder for those of several bags" if many else "")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help=where)
    parser.add_argument(
        "--remap", action="append", default=[], metavar="FROM:=TO", help="another name for a topic of the bag"
    )


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise ValueError
    return number
