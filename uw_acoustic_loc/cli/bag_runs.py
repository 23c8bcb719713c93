"""The commands that run estimators on bags, and the hash that says whether two runs agree."""
# ruff: noqa: PLC0415

from __future__ import annotations

import json
import time
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from .console import STDERR, NodeLog, progress

if TYPE_CHECKING:
    from ..bag.remap import RemappedBag
    from ..stages.runner import Refusal


def process(options: Namespace) -> int:
    """Runs estimators on bags without DDS: on one, or on each of several in a process of its own."""
    from .many_bags import process_many

    if len(options.bag) > 1:
        return process_many(options)
    return _process_one(options.bag[0], options)


def _process_one(path: Path, options: Namespace) -> int:
    from ..bag.process import OfflineRun
    from ..graph import load_graph
    from .commands import damage_code

    bag = _bag(path, options)
    tell = _Refusals()
    run = OfflineRun(bag, load_graph(options.graph), tell)
    for topic in run.missing:
        STDERR.print(f"note: the bag has no {topic}")
    begun = time.monotonic()
    first, last = bag.span()
    with progress("process", (last - first) * 1e-9) as bar:
        counts = run.run(options.output, options.keep_inputs, lambda t_ns: bar((t_ns - first) * 1e-9))
    seconds = time.monotonic() - begun
    speed = (last - first) * 1e-9 / max(seconds, 1e-9)
    STDERR.print(f"{sum(counts.values())} messages in {options.output}, {speed:.0f}x real time")
    tell.summary()
    return damage_code(bag.damage)


def replay(options: Namespace) -> int:
    """Plays a bag to live nodes, records their outputs, and compares what was sent with what arrived."""
    import dataclasses

    from ..bag.reader import Bag
    from ..graph import load_graph
    from ..ros.launcher import Launcher, Run
    from ..ros.replay import player_node, replay_books, without_drivers
    from .commands import damage_code

    bag = _bag(options.bag, options)
    graph = without_drivers(load_graph(options.graph))
    player = player_node(graph, bag, options.rate, options.remap)
    first, last = bag.span()
    with progress("replay", (last - first) * 1e-9) as bar:
        run = Run(record=options.output, player=player, progress=bar)
        launcher = Launcher(dataclasses.replace(graph, clock_rate=0.0), run, NodeLog())
        code = launcher.run()
    books = replay_books(launcher.books, bag, Bag(options.output)) if options.output.exists() else []
    for entry in books:
        STDERR.print(f"{'' if entry.balanced else 'LOST '}{entry.sentence}", markup=False, soft_wrap=True)
    complete = bool(books) and all(entry.balanced for entry in books)
    return max(code, int(not complete), damage_code(bag.damage))


def hash_bag(options: Namespace) -> int:
    """Prints a hash per topic and one in all."""
    from ..bag.fingerprint import fingerprints, overall
    from ..bag.reader import Bag
    from .commands import damage_code

    bag = Bag(options.bag)
    found = fingerprints(bag)
    if options.json:
        topics = {topic: {"n": one.count, "sha256": one.digest} for topic, one in found.items()}
        print(json.dumps({"topics": topics, "all": overall(found)}, indent=2))
    else:
        for topic, one in found.items():
            print(f"{one.digest}  {one.count:7d}  {topic}")
        print(f"{overall(found)}  {sum(one.count for one in found.values()):7d}  all")
    return damage_code(bag.damage)


def _bag(path: Path, options: Namespace) -> RemappedBag:
    from ..bag.reader import Bag
    from ..bag.remap import RemappedBag, remaps

    return RemappedBag(Bag(path), remaps(options.remap))


class _Refusals:
    """Says the first refusal of each kind, counts the rest."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str], int] = {}

    def __call__(self, node: str, refusal: Refusal) -> None:
        key = (node, refusal.topic)
        self._counts[key] = self._counts.get(key, 0) + 1
        if self._counts[key] == 1:
            STDERR.print(f"{node}: {refusal.topic}: {refusal.sentence}", markup=False)

    def summary(self) -> None:
        """How many there were."""
        for (node, topic), count in self._counts.items():
            if count > 1:
                STDERR.print(f"{node}: {count} messages on {topic} were not used", markup=False)
