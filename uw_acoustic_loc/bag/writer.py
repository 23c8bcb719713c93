"""Writes a rosbag2 bag: one MCAP file with CRCs, message definitions and QoS profiles, and its metadata.yaml."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import yaml
from mcap.writer import CompressionType, Writer

from .types import definition


class BagWriter:
    """A new bag folder at `path`. What is written before an interruption stays readable.

    Raises:
        ValueError: `path` exists already, or cannot be made.
    """

    def __init__(self, path: Path, metadata: dict[str, str] | None = None) -> None:
        if path.exists():
            raise ValueError(f"bag {path} exists already: choose another name or remove it")
        try:
            path.mkdir(parents=True)
        except OSError as error:
            raise ValueError(f"bag {path} cannot be made: {error.strerror}") from None
        self.path = path
        self._file: BinaryIO = (path / f"{path.name}_0.mcap").open("wb")
        self._writer = Writer(self._file, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self._writer.start(profile="ros2", library="uw_acoustic_loc")
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._topics: dict[str, dict[str, Any]] = {}
        self._first, self._last = 0, 0
        if metadata:
            self._writer.add_metadata("uw_acoustic_loc", metadata)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def counts(self) -> dict[str, int]:
        """Messages written per topic."""
        return {name: topic["message_count"] for name, topic in self._topics.items()}

    def add_topic(self, name: str, msgtype: str, latched: bool = False) -> None:
        """Declares a topic; again is harmless."""
        if name in self._channels:
            return
        text, type_hash = definition(msgtype)
        if msgtype not in self._schemas:
            self._schemas[msgtype] = self._writer.register_schema(msgtype, "ros2msg", text.encode())
        self._channels[name] = self._writer.register_channel(
            name, "cdr", self._schemas[msgtype], {"offered_qos_profiles": _qos_text(latched)}
        )
        described = {
            "name": name,
            "type": msgtype,
            "serialization_format": "cdr",
            "offered_qos_profiles": [_qos(latched)],
            "type_description_hash": type_hash,
        }
        self._topics[name] = {"topic_metadata": described, "message_count": 0}

    def write(self, name: str, t_ns: int, data: bytes, published_ns: int = 0) -> None:
        """Appends a message of a declared topic: the instant it was received, its CDR bytes."""
        self._writer.add_message(self._channels[name], t_ns, data, published_ns or t_ns)
        self._topics[name]["message_count"] += 1
        self._first = min(self._first or t_ns, t_ns)
        self._last = max(self._last, t_ns)

    def close(self) -> None:
        """Finishes the file and writes metadata.yaml."""
        if self._file.closed:
            return
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._file.close()
        (self.path / "metadata.yaml").write_text(yaml.safe_dump(self._metadata(), sort_keys=False))

    def _metadata(self) -> dict[str, Any]:
        count = sum(self.counts.values())
        start, duration = {"nanoseconds_since_epoch": self._first}, {"nanoseconds": self._last - self._first}
        name = f"{self.path.name}_0.mcap"
        about = {
            "version": 9,
            "storage_identifier": "mcap",
            "duration": dict(duration),
            "starting_time": dict(start),
            "message_count": count,
            "topics_with_message_count": list(self._topics.values()),
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [name],
            "files": [{"path": name, "starting_time": start, "duration": duration, "message_count": count}],
            "custom_data": None,
            "ros_distro": "jazzy",
        }
        return {"rosbag2_bagfile_information": about}


@cache
def _qos_text(latched: bool) -> str:
    return str(yaml.safe_dump([_qos(latched)], sort_keys=False))


def _qos(latched: bool) -> dict[str, Any]:
    forever = {"sec": 9223372036, "nsec": 854775807}
    return {
        "history": "keep_last",
        "depth": 1 if latched else 10,
        "reliability": "reliable",
        "durability": "transient_local" if latched else "volatile",
        "deadline": dict(forever),
        "lifespan": dict(forever),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(forever),
        "avoid_ros_namespace_conventions": False,
    }
