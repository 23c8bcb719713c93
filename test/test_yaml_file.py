"""A file that cannot be read is one sentence, whatever is in it."""

from pathlib import Path

import pytest

from uw_acoustic_loc.graph import load_graph
from uw_acoustic_loc.sim.scenario import load_scenario


@pytest.mark.parametrize("load", [load_graph, load_scenario])
@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"\xff\xfe\x00", "is not valid YAML"),
        (b"nodes: [", "is not valid YAML"),
        (None, "cannot be read: No such file"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(load, content, reason, tmp_path: Path) -> None:
    path = tmp_path / "some.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"{path} {reason}") as raised:
        load(path)
    assert "\n" not in str(raised.value)
