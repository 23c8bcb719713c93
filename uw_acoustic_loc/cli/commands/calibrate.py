"""`uwloc calibrate`: delay offset, spacing, yaw and polarity of a pair of hydrophones, from a recorded run."""
# ruff: noqa: PLC0415

from __future__ import annotations

import math
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..bag_and_graph import add_bag_and_graph, open_bag
from ..console import damage_code, progress
from .process import Refusals

if TYPE_CHECKING:
    from ...calibration.sources import Known
    from ...calibration.verdict import Calibration
    from ...resolved_graph import ResolvedStage

HELP = "delay offset, spacing, yaw and polarity of the hydrophones, from a run with a pinger"
_HOLDABLE = ("delay_offset", "spacing_scale", "array_yaw")


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    add_bag_and_graph(parser, output="the params-file to be made for the bearing node")
    parser.add_argument("--node", metavar="NAME", help="full name of the bearing node, where the graph has several")
    where = "where a pinger lies, in the odometry's frame, m; once per pinger that is known"
    parser.add_argument("--pinger", action="append", type=_pinger, default=[], metavar="ID=X,Y,Z", help=where)
    below = "how much deeper than the array the pingers lie, m (default: estimated)"
    parser.add_argument("--depth", type=float, default=math.nan, metavar="M", help=below)
    at = (
        "direction in base_link, counter-clockwise from ahead, of a clap or a tone far from the vehicle that lies still"
    )
    parser.add_argument("--bearing", type=float, default=math.nan, metavar="DEG", help=at)
    hold = "a parameter that keeps the graph's value; with --bearing, where one direction gives one number, the default"
    parser.add_argument(
        "--hold", action="append", choices=_HOLDABLE, metavar="PARAMETER", help=f"{hold} is all but delay_offset"
    )
    parser.add_argument("--plot", type=Path, metavar="PNG", help="draw the angles before and after")


def run(options: Namespace) -> int:
    """Calibrates a pair of hydrophones."""
    from ...calibration.observed import observe
    from ...calibration.verdict import calibrate

    bag, node, known = open_bag(options.bag, options), _bearing_node(options), _known(options)
    first, last = bag.span()
    refusals = Refusals()
    with progress("calibrate", (last - first) * 1e-9) as bar:
        seen = observe(
            bag,
            node,
            not math.isnan(known.bearing),
            partial(refusals, node.node.full_name),
            lambda t_ns: bar((t_ns - first) * 1e-9),
        )
    refusals.summary()
    found = calibrate(seen, known)
    if options.plot:
        from ...calibration.figure import before_after

        options.plot.write_bytes(before_after(found))
    _write(options, node, found)
    return damage_code(bag.damage)


def _write(options: Namespace, node: ResolvedStage, found: Calibration) -> None:
    from ...calibration.params_file import params_text

    counts = ", ".join(f"{len(source.pings)} of {source.name}" for source in found.sources)
    lines = [*found.lines(), *(f"note: {remark}" for remark in found.remarks)]
    print("\n".join([f"pings: {counts}", *lines]))
    head = [f"calibrated on {options.bag.name}, pings: {counts}", *lines]
    text = params_text(node.node.full_name, node.node.params, found.parameters, head)
    options.output.write_text(text)


def _bearing_node(options: Namespace) -> ResolvedStage:
    from ...graph import load_graph
    from ...resolved_graph import resolve_stage

    nodes = [node for node in load_graph(options.graph).nodes if node.executable == "bearing"]
    names = ", ".join(node.full_name for node in nodes) or "none"
    if options.node:
        nodes = [node for node in nodes if node.full_name == options.node]
    if len(nodes) != 1:
        wanted = f"--node must name one of the bearing nodes of graph {options.graph}"
        raise ValueError(f"{wanted} ({names}), got {options.node or 'none'}")
    return resolve_stage(nodes[0])


def _known(options: Namespace) -> Known:
    from ...calibration.sources import PAIR, Known

    still = not math.isnan(options.bearing)
    if still and (options.pinger or not math.isnan(options.depth)):
        raise ValueError("--bearing is for a vehicle that lies still: it goes without --pinger and --depth")
    held = tuple(options.hold or (PAIR[1:] if still else ()))
    return Known(dict(options.pinger), options.depth, math.radians(options.bearing), held)


def _pinger(text: str) -> tuple[str, tuple[float, float, float]]:
    name, _, numbers = text.partition("=")
    try:
        x, y, z = (float(number) for number in numbers.split(","))
    except ValueError:
        raise ArgumentTypeError(f"a pinger must be ID=X,Y,Z in m, got '{text}'") from None
    return name, (x, y, z)
