"""The topics that have a name here, one row each: for the stages, for scoring, and for `uwloc info`.

A name is relative to the namespace of the node, whichever that is; that of a truth is absolute. `<id>` stands for a
source, a beacon, a mooring, an observer or, behind `/truth`, a vehicle.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from .contract import Emission, Input, Output
from .core.types import (
    ArrivalPaths,
    Arrivals,
    Bearing,
    BodyVelocity,
    Detections,
    HydrophoneInfo,
    Imu,
    NodePositions,
    Odometry,
    Particles,
    Point,
    Position,
    Pressure,
    Samples,
    Scalar,
    Tracks,
)


@dataclass(frozen=True)
class Place:
    """Where a topic of a known name stands."""

    space: str  # its namespace, "" = root
    id: str  # what `<id>` stands for, "" where there is one only


@dataclass(frozen=True)
class KnownTopic:
    """A row of the table."""

    name: str
    kind: type  # the core type
    role: str = ""  # what scoring takes it for, "" = scoring does not read it
    latched: bool = False
    upstream: int = 0  # estimators that it comes through, as a rule
    estimate_in: str = ""  # an estimate, published in the namespace of a "vehicle" or of a "net" of fixed instruments

    def named(self, of: str = "") -> str:
        """The name with its id."""
        return self.name.replace("<id>", of)

    def output(self, of: str = "") -> Output:
        """As a stage publishes it."""
        return Output(self.named(of), self.kind, self.latched)

    def input(
        self,
        handle: Callable[[Any], Iterable[Emission]],
        of: str = "",
        *,
        frame: str = "",
        latched: bool | None = None,
        rewind: float = 0.0,
        until_ns: Callable[[Any], int] | None = None,
        optional: bool = False,
        upstream: int | None = None,
        merge: Callable[[Any, Any], Any] | None = None,
    ) -> Input:
        """As a stage subscribes to it (see `contract.Input`); streams wait for what is latched, unless it says not."""
        return Input(
            self.named(of),
            self.kind,
            handle,
            frame=frame,
            latched=self.latched if latched is None else latched,
            merge=merge,
            rewind=rewind,
            optional=optional,
            upstream=self.upstream if upstream is None else upstream,
            until_ns=until_ns,
        )

    def place(self, topic: str) -> Place | None:
        """Where a topic with this name stands; None for a topic with another name."""
        match = self._pattern.fullmatch(topic)
        groups = match.groupdict() if match else {}
        return Place(groups.get("space") or "", groups.get("id") or "") if match else None

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        space = "" if self.name.startswith("/") else r"(?!/truth/)(?P<space>(?:/[^/]+)*)/"
        return re.compile(space + re.escape(self.name).replace("<id>", "(?P<id>[^/]+)"))


def known(name: str) -> KnownTopic:
    """The row of a name."""
    return _BY_NAME[name]


def find(topic: str) -> tuple[KnownTopic, Place] | None:
    """The row of a full topic name, and where it stands; None when the name has no meaning here."""
    places = ((row, row.place(topic)) for row in TOPICS)
    return next(((row, place) for row, place in places if place), None)


# The first that fits a full name: `slam/odometry` stands before `odometry`, which any namespace may precede.
TOPICS = (
    # truth, for scoring alone
    KnownTopic("/truth/sources/<id>/position", Point, "true_source", latched=True),
    KnownTopic("/truth/beacons/<id>/position", Point, "true_beacon", latched=True),
    KnownTopic("/truth/sonar/targets", Tracks, "true_targets"),
    KnownTopic("/truth/target/odometry", Odometry, "true_target"),
    KnownTopic("/truth/target/sound_speed", Scalar, "true_sound_speed"),
    KnownTopic("/truth/mooring/<id>/odometry", Odometry, "true_mooring"),
    KnownTopic("/truth/<id>/odometry", Odometry, "true_vehicle"),
    # a vehicle and the pingers that it hears
    KnownTopic("hydrophones/info", HydrophoneInfo, latched=True),
    KnownTopic("hydrophones/samples", Samples),
    KnownTopic("imu/data", Imu),
    KnownTopic("dvl/twist", BodyVelocity),
    KnownTopic("pressure", Pressure),
    KnownTopic("slam/sources/<id>/position", Position, "slam_source", estimate_in="vehicle"),
    KnownTopic("slam/odometry", Odometry, "slam", upstream=2, estimate_in="vehicle"),
    KnownTopic("sources/<id>/bearing", Bearing, "bearing", upstream=1, estimate_in="vehicle"),
    KnownTopic("sources/<id>/position", Position, "source", estimate_in="vehicle"),
    KnownTopic("sources/<id>/mirror_position", Position, "mirror", estimate_in="vehicle"),
    KnownTopic("sources/<id>/particles", Particles, estimate_in="vehicle"),
    KnownTopic("beacons/<id>/position", Position, "beacon", estimate_in="vehicle"),
    # nets of fixed instruments
    KnownTopic("buoys/positions", NodePositions, "buoys", latched=True),
    KnownTopic("buoys/arrivals", Arrivals),
    KnownTopic("target/odometry", Odometry, "target", estimate_in="net"),
    KnownTopic("target/sound_speed", Scalar, "sound_speed", estimate_in="net"),
    KnownTopic("target/sound_speed_std", Scalar, "sound_speed_std", estimate_in="net"),
    KnownTopic("target/arrival_paths", ArrivalPaths, estimate_in="net"),
    KnownTopic("sonar/positions", NodePositions, "sonar_nodes", latched=True),
    KnownTopic("sonar/detections", Detections),
    KnownTopic("sonar/fix", Position, "fix", estimate_in="net"),
    KnownTopic("sonar/tracks", Tracks, "tracks", estimate_in="net"),
    KnownTopic("mooring/<id>/offset", Point, "offset"),
    KnownTopic("mooring/<id>/odometry", Odometry, "mooring", upstream=1, estimate_in="net"),
    KnownTopic("observers/<id>/odometry", Odometry),
    KnownTopic("observers/<id>/bearing", Bearing, upstream=1),
    KnownTopic("net/source/odometry", Odometry, "net_source", estimate_in="net"),
    # a vehicle's dead reckoning, by the shortest name of all
    KnownTopic("odometry", Odometry, "odometry"),
)
_BY_NAME = {row.name: row for row in TOPICS}
