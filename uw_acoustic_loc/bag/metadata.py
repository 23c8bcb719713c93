"""metadata.yaml of a rosbag2 folder: its files and topics with their counts, and QoS profiles as text."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import yaml

ROS_DISTRO = "jazzy"
_ABOUT = "rosbag2_bagfile_information"


@dataclass(frozen=True)
class Earlier:
    """What a folder holds already, as metadata.yaml describes it."""

    files: list[dict[str, Any]] = field(default_factory=list)
    topics: list[dict[str, Any]] = field(default_factory=list)


def earlier(folder: Path) -> Earlier:
    """The files of a bag that goes on; what a recorder wrote that was killed has not been counted."""
    try:
        about = yaml.safe_load((folder / "metadata.yaml").read_text())[_ABOUT]
        known, topics = {str(file["path"]): file for file in about["files"]}, about["topics_with_message_count"]
    except (OSError, yaml.YAMLError, KeyError, TypeError):
        known, topics = {}, []
    names = [f"{folder.name}_{k}.mcap" for k in range(len(list(folder.glob("*.mcap"))))]
    return Earlier([known.get(name, described(name, 0, 0, 0)) for name in names], topics)


def described(name: str, count: int, first: int, last: int) -> dict[str, Any]:
    """A file's entry: messages, first and last log time in ns."""
    start, duration = {"nanoseconds_since_epoch": first}, {"nanoseconds": last - first}
    return {"path": name, "starting_time": start, "duration": duration, "message_count": count}


def metadata_text(before: Earlier, own: dict[str, Any], topics: list[dict[str, Any]]) -> str:
    """The content of metadata.yaml: the files that were there, and the new one with its topics."""
    files = [*before.files, own]
    spans = [_span(file) for file in files if file["message_count"]]
    first, last = min((span[0] for span in spans), default=0), max((span[1] for span in spans), default=0)
    about = {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": last - first},
        "starting_time": {"nanoseconds_since_epoch": first},
        "message_count": sum(file["message_count"] for file in files),
        "topics_with_message_count": _together([*before.topics, *topics]),
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file["path"] for file in files],
        "files": files,
        "custom_data": None,
        "ros_distro": ROS_DISTRO,
    }
    return str(yaml.safe_dump({_ABOUT: about}, sort_keys=False))


def _span(file: dict[str, Any]) -> tuple[int, int]:
    first = int(file["starting_time"]["nanoseconds_since_epoch"])
    return first, first + int(file["duration"]["nanoseconds"])


def _together(topics: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One entry per topic and type, with all messages."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for topic in topics:
        key = (topic["topic_metadata"]["name"], topic["topic_metadata"]["type"])
        count = found[key]["message_count"] if key in found else 0
        found[key] = {"topic_metadata": topic["topic_metadata"], "message_count": count + topic["message_count"]}
    return list(found.values())


@cache
def qos_text(latched: bool) -> str:
    """The profile of a topic that is written here."""
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
