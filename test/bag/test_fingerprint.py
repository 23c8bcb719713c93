"""The hash sees every value and every message, and nothing else."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from uw_acoustic_loc.bag.fingerprint import Fingerprint, fingerprints, overall
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import BagMake, serialize
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.core.types import Point, Scalar
from uw_acoustic_loc.wire.codec import codec

Message = tuple[str, str, bytes]  # topic, type, data


def encoded(topic: str, value: Point | Scalar) -> Message:
    form = codec(type(value))
    return topic, form.msgtype, serialize(form.encode(BagMake(), value), form.msgtype)


def point(second: int, x: float = 1.0, frame: str = "map") -> Message:
    return encoded("/point", Point(second * 1_000_000_000, [x, 2.0, 3.0], frame))


def hashes(path: Path, messages: Sequence[Message]) -> dict[str, Fingerprint]:
    with BagWriter(path) as writer:
        for k, (topic, msgtype, data) in enumerate(messages):
            writer.add_topic(topic, msgtype)
            writer.write(topic, k + 1, data)
    return fingerprints(Bag(path))


def test_messages_may_stand_in_any_order_and_at_any_time(tmp_path: Path) -> None:
    number = encoded("/number", Scalar(1, 5.0))
    one = hashes(tmp_path / "one", [point(1), point(2), number])
    assert one == hashes(tmp_path / "two", [number, point(2), point(1)])
    assert one["/point"].count == 2


def test_padding_does_not_count(tmp_path: Path) -> None:
    topic, msgtype, data = point(1, frame="odom")
    text_end = data.index(b"odom\0") + 5  # three numbers of eight bytes follow, aligned
    dirty = data[:text_end] + b"\xaa" * (len(data) - 24 - text_end) + data[-24:]
    clean = hashes(tmp_path / "clean", [(topic, msgtype, data)])
    assert dirty != data
    assert hashes(tmp_path / "dirty", [(topic, msgtype, dirty)]) == clean


def test_every_change_shows(tmp_path: Path) -> None:
    given = [point(1), point(2)]
    others = {
        "value": [point(1), point(2, x=1.0 + 2**-52)],
        "stamp": [point(1), point(3)],
        "missing": [point(1)],
        "twice": [point(1), point(2), point(2)],
        "frame": [point(1), point(2, frame="odom")],
    }
    found = {name: overall(hashes(tmp_path / name, messages)) for name, messages in others.items()}
    found["given"] = overall(hashes(tmp_path / "given", given))
    assert len(set(found.values())) == len(others) + 1


def test_without_a_stamp_the_order_counts(tmp_path: Path) -> None:
    numbers = [encoded("/number", Scalar(1, value)) for value in (1.0, 2.0)]
    assert hashes(tmp_path / "there", numbers) != hashes(tmp_path / "back", numbers[::-1])


def test_diagnostics_stand_outside(tmp_path: Path) -> None:
    empty = serialize(BagMake()("std_msgs/msg/String", data="x"), "std_msgs/msg/String")
    told = ("/diagnostics", "std_msgs/msg/String", empty)
    assert hashes(tmp_path / "with", [point(1), told]) == hashes(tmp_path / "without", [point(1)])


def test_types_that_nobody_knows_are_hashed_as_they_are(tmp_path: Path) -> None:
    found = [hashes(tmp_path / text, [("/own", "my_msgs/msg/Own", text.encode())]) for text in ("a", "b")]
    assert found[0] != found[1]


def test_the_command_prints_a_line_per_topic_and_one_in_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = hashes(tmp_path / "bag", [point(1), encoded("/number", Scalar(1, 5.0))])
    assert main(["hash", str(tmp_path / "bag")]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines == [
        [found["/number"].digest, "1", "/number"],
        [found["/point"].digest, "1", "/point"],
        [overall(found), "2", "all"],
    ]
