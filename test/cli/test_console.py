"""Texts from outside never steer the terminal, and are never taken for markup."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.writer import Writer

from uw_acoustic_loc.cli.console import STDERR, NodeLog, SafeConsole, complain
from uw_acoustic_loc.cli.main import main

EVIL = "\x1b]0;pwn\x07\x9b2J\r[/red][bold]\u202e\udcff"


def steering(text: str) -> list[str]:
    return [
        mark for mark in text if (ord(mark) < 32 and mark not in "\n\t") or 0x7F <= ord(mark) < 0xA0 or mark in "\u202e"
    ]


def test_no_control_character_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    complain(f"{EVIL}\nuwloc: all is well")
    STDERR.print(f"note: {EVIL}\nsecond")
    NodeLog()("/node", EVIL)
    SafeConsole().print(EVIL)
    said = capsys.readouterr()
    assert steering(said.err + said.out) == []
    assert len(said.err.splitlines()) == 3
    assert said.err.count("[/red][bold]") == 3


@pytest.mark.parametrize("command", ["info", "hash", "score"])
def test_names_in_a_bag_are_printed_without_control_characters(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = EVIL.replace("\udcff", "")
    with (tmp_path / "x.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        channel = writer.register_channel(f"/{name}\n", "cdr", writer.register_schema(f"{name}/msg/T", "ros2msg", b"x"))
        writer.add_message(channel, 1, b"\0\1\0\0", 1)
        writer.add_metadata(name, {name: name})
        writer.finish()
    assert main([command, str(tmp_path / "x.mcap")]) == 0
    said = capsys.readouterr()
    assert steering(said.out + said.err) == []
