"""`uwloc plan`: what the nets of a scenario can do, as maps."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from ..sim.scenario import Scenario, load_scenario
from .console import STDERR
from .reproduce import write_csv
from .tables import Sheet

if TYPE_CHECKING:
    from .plot import Picture

NETS = ("buoys", "sonar")  # parts of a scenario; each has its module plan_<name>


class Planner(Protocol):
    """What a module plan_<name> offers."""

    def maps(self, scenario: Scenario) -> Iterator[tuple[str, Sheet, Picture]]:
        """File name without suffix, the numbers, and the figure."""


def plan(options: Namespace) -> int:
    """Writes maps of every net that the scenario has, as PNG and CSV, and a page that shows them.

    Raises:
        ValueError: the scenario has none.
    """
    scenario = load_scenario(options.scenario)
    present = [name for name in NETS if getattr(scenario, name)]
    if not present:
        raise ValueError(f"plan: scenario {options.scenario} must have one of {', '.join(NETS)}")
    folder: Path = options.output
    folder.mkdir(parents=True, exist_ok=True)
    parts = [part for name in present for part in _written(name, scenario, folder)]
    (folder / "README.md").write_text("\n".join(parts), encoding="utf-8")
    STDERR.print(f"{folder / 'README.md'}")
    return 0


def _written(name: str, scenario: Scenario, folder: Path) -> Iterator[str]:
    """Writes a net's files and yields its parts of the page."""
    planner = cast(Planner, import_module(f".plan_{name}", __package__))
    for key, sheet, picture in planner.maps(scenario):
        write_csv(sheet, folder / f"{key}.csv")
        (folder / f"{key}.png").write_bytes(picture.png)
        yield f"# {picture.title}\n\n![{picture.title}]({key}.png)\n\n{picture.caption} Numbers: `{key}.csv`.\n"
