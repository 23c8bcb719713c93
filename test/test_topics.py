"""The table of topics: all that our nodes publish and subscribe to stands in it, and full names find their row."""

from pathlib import Path

import pytest

from uw_acoustic_loc.contract import ANY_ID, Input, Output
from uw_acoustic_loc.sim.catalog import SOURCES, DriverConfig, configured_scenario, make_source
from uw_acoustic_loc.stages.build import configure
from uw_acoustic_loc.stages.catalog import STAGES, stage_class
from uw_acoustic_loc.topics import TOPICS, KnownTopic, find


def row_of(topic: Input | Output) -> KnownTopic:
    found = find(topic.topic if topic.topic.startswith("/") else f"/auv1/{topic.topic}")
    assert found, f"{topic.topic} is not in the table"
    assert found[0].kind is topic.kind
    return found[0]


@pytest.mark.parametrize("executable", STAGES)
def test_what_an_estimator_hears_and_publishes_is_in_the_table(executable: str) -> None:
    stage = configure(executable, stage_class(executable).any_id, executable).make()
    for wanted in stage.inputs:
        row = row_of(wanted)
        assert wanted.topic == row.named(ANY_ID)
        assert not row.name.startswith("/truth/"), "no estimator may see the truth"
        assert row.latched == wanted.latched
    for output in stage.outputs:
        row = row_of(output)
        assert row.estimate_in
        assert output == row.output(ANY_ID)


@pytest.mark.parametrize("executable", SOURCES)
def test_what_a_driver_publishes_is_in_the_table(executable: str) -> None:
    for output in make_source(executable, configured_scenario(DriverConfig(), Path())).outputs:
        row = row_of(output)
        assert row.latched == output.latched
        assert not row.estimate_in


@pytest.mark.parametrize("row", TOPICS, ids=lambda row: row.name)
def test_no_row_stands_in_the_shade_of_one_before_it(row: KnownTopic) -> None:
    for space in ("",) if row.name.startswith("/") else ("/", "/auv1/", "/fleet/auv1/"):
        found = find(space + row.named("a"))
        assert found
        assert found[0] is row
        assert found[1].space == space.rstrip("/")
        assert found[1].id == ("a" if "<id>" in row.name else "")


def test_each_role_is_one_row() -> None:
    roles = [row.role for row in TOPICS if row.role]
    assert len(roles) == len(set(roles))


@pytest.mark.parametrize(
    "topic", ["/odometry_raw", "/truth/odometry", "/auv1/sources/position", "/sources/a/b/bearing"]
)
def test_other_names_have_no_row(topic: str) -> None:
    assert find(topic) is None
