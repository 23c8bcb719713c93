"""The live graph over DDS in real time: how soon a bearing follows its last sample, what is lost, what it costs.

The harbour scenario without /clock: two hydrophones at 100 kHz in frames of 100 ms, three pingers of 10 pings/s, IMU
at 100 Hz; every node is a process of its own as `uwloc launch` starts it, with the recorder. Latency is from the end of
the frame that completes a ping, when its last sample exists, to the bearing's arrival at the recorder. Processor time
is the kernel's count per process; the start of the nodes and their end are left out. The goal is for everything that
runs: estimators, simulated drivers, recorder and launcher.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np

from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import decode
from uw_acoustic_loc.core.types import Array, Bearing, HydrophoneInfo
from uw_acoustic_loc.graph import Graph, load_graph
from uw_acoustic_loc.resolved_graph import resolve_stage
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.ros.orchestrator.command_line import LEAD_S
from uw_acoustic_loc.ros.orchestrator.launcher import Launcher, LaunchOptions
from uw_acoustic_loc.ros.report import Reports
from uw_acoustic_loc.sim.catalog import SOURCES
from uw_acoustic_loc.stages.catalog import STAGES

SECONDS = 30.0
SETTLED_S = 3.0  # of the scenario, before processor time counts
P99_MS, CPU_PERCENT = 20.0, 40.0
FRAMES, INFO, ODOMETRY = (f"/auv1/{topic}" for topic in ("hydrophones/samples", "hydrophones/info", "odometry"))


class Meter:
    """Processor time of each node between two instants after the start; then ends the run."""

    def __init__(self) -> None:
        self._begin = time.monotonic() + LEAD_S + SETTLED_S
        self._first: dict[str, float] = {}
        self._others = 0.0
        self.percent: dict[str, float] = {}  # of one core
        self.others = 0.0

    def look(self, _simulated_s: float) -> None:
        """Called by the launcher again and again."""
        now = time.monotonic()
        if not self._first and now >= self._begin:
            self._begin, self._first, self._others = now, processor_times(), busy()
        elif self._first and not self.percent and now >= self._begin + SECONDS:
            used, whole = processor_times(), busy() - self._others
            self.percent = {who: 100 * (s - self._first[who]) / (now - self._begin) for who, s in used.items()}
            self.others = 100 * whole / (now - self._begin) - sum(self.percent.values())
            signal.raise_signal(signal.SIGINT)


def processor_times() -> dict[str, float]:
    """s, of this process and each that it has started, by the executable's name."""
    found = {"launcher": sum(os.times()[:2])}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            words = (folder / "cmdline").read_text().split("\0")
        except OSError:  # it has ended
            continue
        if int(fields[1]) == os.getpid():
            found[words[words.index("--ros-args") - 1]] = sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")
    return found


def busy() -> float:
    """s, of all processors together."""
    user, nice, system = map(int, Path("/proc/stat").read_text().split()[1:4])
    return (user + nice + system) / os.sysconf("SC_CLK_TCK")


def main() -> int:
    os.environ.setdefault("ROS_DOMAIN_ID", "87")
    with TemporaryDirectory() as name:
        graph, bag = realtime_harbour(Path(name)), Path(name, "bag")
        meter = Meter()
        options = LaunchOptions(bag, progress=meter.look)
        launcher = Launcher(graph, options, lambda who, text: print(who, text, file=sys.stderr))
        code = launcher.run()
        late_ms = 1e-6 * latency_ns(bag, graph)
        print(f"## Live: {SECONDS:g} s of the harbour in real time\n")
        print("| | | goal |\n|---|---|---|")
        good = line("latency p50, ms", float(np.percentile(late_ms, 50)))
        good &= line("latency p99, ms", float(np.percentile(late_ms, 99)), P99_MS)
        good &= frames(launcher.reports)
        good &= processors(meter)
    print()
    return int(code != 0 or not good)


def realtime_harbour(folder: Path) -> Graph:
    """The harbour's graph without its clock."""
    for file in resource("config/harbour").glob("*.yaml"):
        (folder / file.name).write_text(file.read_text())
    graph = folder / "graph.yaml"
    graph.write_text(graph.read_text().replace("clock_rate: 5.0", "clock_rate: 0.0"))
    return load_graph(graph)


def latency_ns(path: Path, graph: Graph) -> Array:
    """Of each bearing, after the end of the frame that completed it."""
    ends = dict(completed(path, graph))
    bag = Bag(path)
    topics = [topic for topic in bag.topics if topic.endswith("/bearing")]
    arrived = [(r.topic, decode(Bearing, r.data, r.t_ns).t_ns, r.t_ns) for r in bag.records(topics)]
    return np.array([arrival_ns - ends[topic, t_ns] for topic, t_ns, arrival_ns in arrived])


def completed(path: Path, graph: Graph) -> Iterator[tuple[tuple[str, int], int]]:
    """Topic and stamp of each bearing, with the end of the frame that completed it: the estimator is run again."""
    stage = resolve_stage(next(node for node in graph.nodes if node.executable == "bearing"))
    names = {output.topic: topic for topic, output in stage.outputs.items()}
    inputs = {stage.node.resolve(i.topic): i for i in stage.make_stage().inputs}
    for record in Bag(path).records([INFO, FRAMES]):
        value = decode(inputs[record.topic].kind, record.data, record.t_ns)
        emissions = list(inputs[record.topic].handle(value))
        if isinstance(value, HydrophoneInfo):
            rate = value.sample_rate
            continue
        end_ns = value.t_ns + round(1e9 * value.h0.size / rate)
        yield from (((names[topic], said.t_ns), end_ns) for topic, said in emissions if isinstance(said, Bearing))


def frames(reports: Reports) -> bool:
    """Whether everyone who wants frames got all of them."""
    sent = reports["/auv1/hydrophone_driver"].sent[FRAMES].count
    print(f"| frames sent | {sent} | |")
    readers = {name: report.taken[FRAMES].count for name, report in reports.items() if FRAMES in report.taken}
    for name, taken in readers.items():
        print(f"| frames in {name} | {taken} | {sent}{'' if taken == sent else ' **missed**'} |")
    return all(taken == sent for taken in readers.values())


def processors(meter: Meter) -> bool:
    """Percent of one core."""
    for name, percent in sorted(meter.percent.items(), key=lambda item: -item[1]):
        line(f"CPU of {name}, % of a core", percent)
    sums = {
        what: sum(meter.percent[n] for n in names) for what, names in (("estimators", STAGES), ("drivers", SOURCES))
    }
    for what, percent in sums.items():
        line(f"CPU of all {what}", percent)
    good = line("CPU of all processes", sum(meter.percent.values()), CPU_PERCENT)
    line("others on this machine", meter.others)
    return good


def line(name: str, value: float, goal: float = 0.0) -> bool:
    good = not goal or value <= goal
    print(f"| {name} | {value:.1f} | {f'<= {goal:g}' if goal else ''}{'' if good else ' **missed**'} |")
    return good


if __name__ == "__main__":
    sys.exit(main())
