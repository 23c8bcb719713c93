"""Offline run of a bag with hydrophone frames, the whole chain and each estimator alone, against real time.

The bag is the harbour scenario's: two hydrophones at 100 kHz, IMU at 100 Hz, three pingers of 10 pings/s, four buoys, a
sonar net and a mooring. Estimators that take what others publish get it from a bag made by the whole chain. Time is the
processor time of this one process, writing the bag included, the least of a few runs: a busy machine only adds to it.
"""

from __future__ import annotations

import dataclasses
import os
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ["OMP_NUM_THREADS"] = "1"

from uw_acoustic_loc.bag.process import OfflineRun
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.simulate import simulate
from uw_acoustic_loc.graph import Graph, load_graph
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.sim.scenario import load_scenario
from uw_acoustic_loc.stages.catalog import STAGES

GOAL = 50.0  # times real time, for the whole chain
RUNS = 3


def main() -> int:
    graph = load_graph(resource("config/harbour/graph.yaml"))
    scenario = load_scenario(resource("config/harbour/scenario.yaml"))
    with TemporaryDirectory() as name:
        folder = Path(name)
        simulate(scenario, folder / "measured", lambda _t_ns: None)
        processor_time(folder / "measured", graph, folder / "whole", keep=True)
        whole = min(processor_time(folder / "measured", graph, folder / f"again{k}") for k in range(RUNS))
        print(f"## Offline: {scenario.duration:g} s of the harbour, times real time\n")
        print("| | s | speed | goal |\n|---|---|---|---|")
        for node in (node for node in graph.nodes if node.executable in STAGES):
            alone = dataclasses.replace(graph, nodes=(node,))
            line(node.executable, processor_time(folder / "whole", alone, folder / node.name), scenario.duration)
        good = line("whole chain", whole, scenario.duration, GOAL)
    print()
    return int(not good)


def processor_time(bag: Path, graph: Graph, out: Path, keep: bool = False) -> float:
    """s, of a run without the start of the program."""
    run = OfflineRun(Bag(bag), graph, lambda node, refusal: print(node, refusal.sentence, file=sys.stderr))
    begun = time.process_time()
    run.run(out, keep, lambda _t_ns: None)
    return time.process_time() - begun


def line(name: str, seconds: float, duration: float, goal: float = 0.0) -> bool:
    good = duration / seconds >= goal
    shown = f">= {goal:g}{'' if good else ' **missed**'}" if goal else ""
    print(f"| {name} | {seconds:.2f} | {duration / seconds:.0f} | {shown} |")
    return good


if __name__ == "__main__":
    sys.exit(main())
