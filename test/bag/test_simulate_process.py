"""Scenario to bag to estimates, offline: reproducible, complete, and refusals do not stop it."""

import dataclasses
from collections import Counter, defaultdict
from pathlib import Path

import pytest

from uw_acoustic_loc.bag.pipeline import Pipeline
from uw_acoustic_loc.bag.process import OfflineRun
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import decode
from uw_acoustic_loc.bag.simulate import simulate
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.graph import Graph, load_graph
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.sim.scenario import Scenario, load_scenario
from uw_acoustic_loc.stages.runner import Refusal


def nothing(_t_ns: int) -> None:
    pass


def refusing(node: str, refusal: Refusal) -> None:
    raise AssertionError(f"{node}: {refusal}")


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return dataclasses.replace(load_scenario(resource("config/harbour/scenario.yaml")), duration=6.0)


@pytest.fixture(scope="module")
def measured(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "measured"
    simulate(scenario, path, nothing)
    return path


def contents(path: Path) -> list[tuple[str, int, bytes]]:
    return [(r.topic, r.t_ns, r.data) for r in Bag(path).records()]


def test_the_same_seed_gives_the_same_bag_and_another_seed_another(
    scenario: Scenario, measured: Path, tmp_path: Path
) -> None:
    simulate(scenario, tmp_path / "again", nothing)
    assert contents(tmp_path / "again") == contents(measured)
    simulate(dataclasses.replace(scenario, seed=2), tmp_path / "other", nothing)
    other = contents(tmp_path / "other")
    assert other != contents(measured)
    assert Counter(topic for topic, _, _ in other).keys() == Counter(t for t, _, _ in contents(measured)).keys()


def test_rates_are_the_scenarios(scenario: Scenario, measured: Path) -> None:
    counts = Counter(topic for topic, _, _ in contents(measured))
    assert counts["/auv1/hydrophones/samples"] == 60
    assert abs(counts["/auv1/imu/data"] - 600) <= 1
    assert abs(counts["/auv1/dvl/twist"] - 30) <= 1
    assert counts["/buoys/positions"] == counts["/auv1/hydrophones/info"] == 1


def test_a_run_is_reproducible_and_refuses_nothing(measured: Path, tmp_path: Path) -> None:
    graph = load_graph(resource("config/harbour/graph.yaml"))
    for name in ("one", "two"):
        OfflineRun(Bag(measured), graph, refusing).run(tmp_path / name, keep_inputs=True, progress=nothing)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    topics = {topic for topic, _, _ in contents(tmp_path / "one")}
    assert {t for t, _, _ in contents(measured)} < topics, "inputs and truth are kept"
    assert {"/auv1/sources/a/bearing", "/auv1/slam/odometry", "/target/odometry", "/sonar/fix"} < topics


@pytest.mark.parametrize("remap", [{}, {"odometry": "slam/odometry"}], ids=["chain", "loop"])
@pytest.mark.parametrize("tick_ns", [1, 10**9], ids=["fine", "coarse"])
def test_batches_make_no_difference(tick_ns: int, remap: dict[str, str], measured: Path) -> None:
    """Log times may stand still: a recorder's are those of a simulated clock."""
    graph = load_graph(resource("config/harbour/graph.yaml"))
    nodes = [dataclasses.replace(n, remap=remap if n.executable == "bearing" else n.remap) for n in graph.nodes]
    graph = dataclasses.replace(graph, nodes=tuple(nodes))
    assert published(graph, measured, 1 << 30, tick_ns) == published(graph, measured, 1, tick_ns)


def published(graph: Graph, bag: Path, size: int, tick_ns: int) -> dict[str, list[tuple[int, bytes]]]:
    """Log times and CDR per topic when so many messages are handed over at once."""
    found: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    pipeline = Pipeline(graph, lambda t_ns, topic, data: found[topic].append((t_ns, data)), lambda *_: None)
    kinds = pipeline.inputs
    records = Bag(bag).records([*kinds])
    messages = [(r.t_ns // tick_ns * tick_ns, r.topic, decode(kinds[r.topic], r.data, r.t_ns)) for r in records]
    for k in range(0, len(messages), size):
        pipeline.push(messages[k : k + size])
    pipeline.flush(messages[-1][0])
    return found


def test_damaged_messages_are_counted_and_the_rest_is_used(measured: Path, tmp_path: Path) -> None:
    topic = "/mooring/buoy1/offset"
    with BagWriter(tmp_path / "damaged") as writer:
        for k, record in enumerate(Bag(measured).records([topic])):
            writer.add_topic(topic, record.msgtype)
            writer.write(topic, record.t_ns, record.data[:20] if k == 3 else record.data)
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: mooring_tracker, params: params.yaml}]")
    (tmp_path / "params.yaml").write_text("mooring_tracker: {ros__parameters: {mooring_ids: [buoy1]}}")
    told: list[Refusal] = []
    run = OfflineRun(Bag(tmp_path / "damaged"), load_graph(tmp_path / "graph.yaml"), lambda _, r: told.append(r))
    counts = run.run(tmp_path / "out", keep_inputs=False, progress=nothing)
    given = sum(1 for _ in Bag(measured).records([topic]))
    assert counts == {"/mooring/buoy1/odometry": given - 1}
    assert [refusal.topic for refusal in told] == ["mooring/buoy1/offset"]
    assert "cannot be decoded" in told[0].sentence


def test_a_bag_without_any_needed_topic_is_refused(measured: Path, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "empty"):
        pass
    with pytest.raises(ValueError, match="has none of the topics that the graph needs"):
        OfflineRun(Bag(tmp_path / "empty"), load_graph(resource("config/harbour/graph.yaml")), refusing)
