"""Another package's record: a dataclass and the layout file beside its module."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.bag.rosbags_messages import decode, encode
from uw_acoustic_loc.ros.rclpy_messages import RosMake
from uw_acoustic_loc.wire.codec import codec

CODE = """
from __future__ import annotations
from dataclasses import dataclass
from typing import Any

@dataclass(frozen=True)
class {name}:
    t_ns: int
    depth: {kind}
    flag: {kind}
    frame_id: str = "map"
"""
LAYOUT = "# header: the stamp is of the cast\n\nfloat64 depth   # m, positive down\nuint8   flag\n"
Declare = Callable[..., type]


@pytest.fixture
def declare(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Declare:
    """Makes a record's class in a module of its own."""
    monkeypatch.syspath_prepend(tmp_path)

    def made(name: str, kind: str = "Any", layout: str = LAYOUT, code: str = CODE) -> type:
        (tmp_path / f"module_of_{name}.py").write_text(code.format(name=name, kind=kind))
        if layout:
            (tmp_path / f"{name}.msg").write_text(layout)
        __import__(f"module_of_{name}")
        return getattr(sys.modules[f"module_of_{name}"], name)

    return made


def test_rows_survive_both_ways_of_writing(declare: Declare) -> None:
    kind = declare("Cast")
    value = kind(5, np.array([1.5, 2.5, 3.5]), np.array([0, 1, 2], np.uint8))
    back = [decode(kind, encode(value), 0), codec(kind).decode(codec(kind).encode(RosMake(), value), 0)]
    for one in back:
        assert (one.t_ns, one.frame_id, one.depth.dtype, one.flag.dtype) == (5, "map", np.float64, np.uint8)
        assert one.depth.tolist() == [1.5, 2.5, 3.5]
        assert one.flag.tolist() == [0, 1, 2]


def test_columns_declared_float_are_one_row(declare: Declare) -> None:
    kind = declare("Single", "float")
    assert decode(kind, encode(kind(5, 1.5, 1.0)), 0) == kind(5, 1.5, 1.0)
    rows = declare("Single2", layout=LAYOUT)(5, np.array([1.0, 2.0]), np.array([0, 1], np.uint8))
    with pytest.raises(ValueError, match="Single: must have 1 row, got 2"):
        decode(kind, encode(rows), 0)


def test_a_name_of_ours_may_be_used_again(declare: Declare) -> None:
    kind = declare("Track")
    assert codec(kind).cdr.unpack(encode(kind(5, np.ones(2), np.ones(2, np.uint8)))).depth.tolist() == [1.0, 1.0]


def test_what_is_wrong_is_said_with_the_file(declare: Declare, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"Bare must be a type of core.types, or .* Bare.msg in {tmp_path}"):
        codec(declare("Bare", layout=""))
    with pytest.raises(ValueError, match=r"Listed.msg, line 2: must be one of int8, .*got 'float64\[\] depth'"):
        codec(declare("Listed", layout="uint8 flag\nfloat64[] depth"))
    with pytest.raises(
        ValueError, match="Other must have the fields t_ns, depth, frame_id, got t_ns, depth, flag, frame_"
    ):
        codec(declare("Other", layout="float64 depth"))
    with pytest.raises(ValueError, match=r"int must be a type of core\.types"):
        codec(int)
