"""The pages can be followed: every link and every file that they name exists, and the contract names every topic."""

import re
from pathlib import Path

import pytest

from uw_acoustic_loc.cli.main import COMMANDS
from uw_acoustic_loc.stages.catalog import STAGES
from uw_acoustic_loc.topics import TOPICS

REPO = Path(__file__).parents[1]
DOCS = REPO / "docs"
PAGES = sorted(page for where in ("*.md", "docs/*.md", "bags/**/*.md", "benchmarks/*.md") for page in REPO.glob(where))


def text(page: Path) -> str:
    """Without fenced blocks, whose files may be the reader's own."""
    return re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)


def links(page: Path) -> set[str]:
    found = re.findall(r"\]\(([^)\s]+)\)", text(page))
    return {link for link in found if not re.match(r"https?:", link)}


def named_files(page: Path) -> set[str]:
    """Paths of sources, pages, records and set-ups outside links; one with a placeholder or a star is none."""
    prose = re.sub(r"\[[^]]*\]\([^)]*\)", "", text(page))
    files = re.findall(r"(?<![\w<>*/.{-])[\w./-]+\.(?:py|md|msg)\b", prose)
    return {*files, *re.findall(r"(?<![\w/])(?:config|bags)/[\w./-]*\w", prose)}


def anchors(page: Path) -> set[str]:
    """Of headings, as forges make them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPO)))
def test_links_lead_somewhere(page: Path) -> None:
    for link in links(page):
        target, _, anchor = link.partition("#")
        file = page.parent / target if target else page
        assert file.exists(), f"{page.name} links to {target}"
        assert not anchor or anchor in anchors(file), f"{page.name} links to {link}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPO)))
def test_named_files_exist(page: Path) -> None:
    places = (page.parent, REPO, REPO / "uw_acoustic_loc")
    missing = {name for name in named_files(page) if not any((place / name).exists() for place in places)}
    assert not missing, f"{page.name} names {missing}"


def test_every_page_can_be_reached_from_the_index() -> None:
    reached = {(DOCS / link.partition("#")[0]).resolve() for link in links(DOCS / "index.md")}
    assert {page for page in PAGES if page.parent == DOCS and page.name != "index.md"} <= reached


def test_every_estimator_has_a_page() -> None:
    assert {name for name in STAGES if not (DOCS / f"{name}.md").exists()} == set()


def test_the_contract_names_every_topic_record_and_command() -> None:
    contract = (DOCS / "contract.md").read_text()
    named = {name.lstrip("/").replace("<vehicle>", "<id>") for name in re.findall(r"`([\w/<>]+)`", contract)}
    assert {topic.name for topic in TOPICS if topic.name.lstrip("/") not in named} == set()
    assert {file.stem for file in (REPO / "msg_defs").glob("*.msg") if f"[{file.stem}]" not in contract} == set()
    assert {name for name in COMMANDS if f"`uwloc {name}" not in contract} == set()
