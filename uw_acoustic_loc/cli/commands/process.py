"""`uwloc process`: estimators on bags, offline, on one or on each of several in a process of its own."""
# ruff: noqa: PLC0415

from __future__ import annotations

import os
import time
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from ..bag_and_graph import add_bag_and_graph, open_bag
from ..console import damage_code, progress, say

if TYPE_CHECKING:
    from ...stages.runner import Refusal

HELP = "run a graph's estimators on bags, offline"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    add_bag_and_graph(parser, many=True)
    parser.add_argument("--jobs", type=_positive, default=1, metavar="N", help="bags at a time (default %(default)s)")
    parser.add_argument("--allow-unused", action="store_true", help="exit 0 though an estimator used no message")
    parser.add_argument("--keep-inputs", action="store_true", help="copy the bag's other topics into the output")


def run(options: Namespace) -> int:
    """Runs estimators on bags without DDS."""
    from ..many_bags import process_many

    if len(options.bag) > 1:
        return process_many(options)
    return _process_one(options.bag[0], options)


def _process_one(path: Path, options: Namespace) -> int:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # as in a node: other numbers of threads round differently
        os.environ.setdefault(name, "1")
    from ...bag.process import OfflineRun
    from ...graph import load_graph

    bag = open_bag(path, options)
    refusals = Refusals()
    run = OfflineRun(bag, load_graph(options.graph), refusals)
    for node in run.left_out:
        say(f"note: {node.full_name} is left out: {node.executable} is no estimator that is installed here")
    for topic in run.missing:
        say(f"note: the bag has no {topic}")
    begun = time.monotonic()
    first, last = bag.span()
    with progress("process", (last - first) * 1e-9) as bar:
        counts = run.run(options.output, options.keep_inputs, lambda t_ns: bar((t_ns - first) * 1e-9))
    seconds = time.monotonic() - begun
    speed = (last - first) * 1e-9 / max(seconds, 1e-9)
    say(f"{sum(counts.values())} messages in {options.output}, {speed:.0f}x real time")
    refusals.summary()
    idle = [f"{name} {why}" for name, runner in run.pipeline.runners.items() if (why := runner.idle_reason())]
    for sentence in idle:
        say(sentence)
    return 1 if idle and not options.allow_unused else damage_code(bag.damage)


class Refusals:
    """Prints the first refusal of each kind and counts the rest."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str], int] = {}

    def __call__(self, node: str, refusal: Refusal) -> None:
        key = (node, refusal.topic)
        self._counts[key] = self._counts.get(key, 0) + 1
        if self._counts[key] == 1:
            say(f"{node}: {refusal.topic}: {refusal.sentence}")

    def summary(self) -> None:
        """Prints how many there were."""
        for (node, topic), count in self._counts.items():
            if count > 1:
                say(f"{node}: {count} messages on {topic} were not used")


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise ValueError
    return number
