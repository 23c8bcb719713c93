"""Maps of the accuracy that a scenario's nets can reach, and the page that shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from ..evaluation.plot import Picture
from ..evaluation.tables import Sheet, write_csv
from ..sim.scenario import Scenario
from . import buoys, sonar

Maps = Callable[[Scenario], Iterator[tuple[str, Sheet, Picture]]]  # file name without suffix, numbers, figure
NETS: dict[str, Maps] = {"buoys": buoys.maps, "sonar": sonar.maps}  # by the part of the scenario that they are about


def write_maps(scenario: Scenario, name: str, folder: Path) -> Path:
    """Writes maps of every net that the scenario has, as PNG and CSV; returns the page that shows them.

    Raises:
        ValueError: the scenario, called `name`, has none.
    """
    present = [maps for net, maps in NETS.items() if getattr(scenario, net)]
    if not present:
        raise ValueError(f"plan: scenario {name} must have one of {', '.join(NETS)}")
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / "README.md"
    parts = [part for maps in present for part in _written(maps, scenario, folder)]
    page.write_text("\n".join(parts), encoding="utf-8")
    return page


def _written(maps: Maps, scenario: Scenario, folder: Path) -> Iterator[str]:
    """Writes a net's files and yields its parts of the page."""
    for key, sheet, picture in maps(scenario):
        write_csv(sheet, folder / f"{key}.csv")
        (folder / f"{key}.png").write_bytes(picture.png)
        yield f"# {picture.title}\n\n![{picture.title}]({key}.png)\n\n{picture.caption} Numbers: `{key}.csv`.\n"
