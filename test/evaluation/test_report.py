"""The report: one file that needs nothing else, with the sections that the bag has."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from test import known_run as run
from uw_acoustic_loc.evaluation.recording import Recording, Traffic, load
from uw_acoustic_loc.evaluation.report import write_report
from uw_acoustic_loc.evaluation.score import score


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    recording = load(run.write_bag(folder / "bag", run.everything()))
    write_report(recording, score(recording), folder / "deep" / "report.html")
    return (folder / "deep" / "report.html").read_text()


def write(recording, tmp_path):
    write_report(recording, score(recording), tmp_path / "report.html")
    return (tmp_path / "report.html").read_text()


class Tags(HTMLParser):
    """Fails on tags that are not closed in order."""

    def __init__(self):
        super().__init__()
        self.open, self.attributes = [], []

    def handle_starttag(self, tag, attrs):
        self.attributes += attrs
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.attributes += attrs

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_it_is_well_formed_and_needs_nothing_else(page):
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    linked = [value for name, value in tags.attributes if name in ("src", "href", "srcset")]
    assert linked
    assert all(value.startswith("data:image/png;base64,") for value in linked)
    assert not re.search(r"https?://|@import|<script|url\(", page)
    assert len(page) < 5_000_000


def test_all_sections_of_a_full_bag(page):
    titles = re.findall(r"<h2>(.*?)</h2>", page)
    for wanted in ("Bearings", "Plan view of auv1", "Plan view of the buoys", "Plan view of the sonar net", "NEES"):
        assert wanted in titles
    for wanted in ("Vehicle from SLAM, auv1", "Mooring offsets", "Single-ping fixes of the sonar net"):
        assert wanted in titles
    assert any(title.startswith("Topics") for title in titles)


def test_pictures_are_png_with_names(page):
    pictures = re.findall(r'<img alt="([^"]+)" src="data:image/png;base64,([^"]+)">', page)
    assert len(pictures) == len(re.findall("<img", page)) == 11
    assert all(base64.b64decode(data).startswith(b"\x89PNG") for _, data in pictures)


def test_every_topic_is_listed(page):
    for topic in ("/auv1/sources/a/bearing", "/truth/target/sound_speed", "/sonar/tracks"):
        assert f"<th>{topic}</th>" in page


def test_bearings_alone_are_shown_without_truth(recorded, tmp_path):
    page = write(recorded(run.bearings(np.random.default_rng(1))), tmp_path)
    titles = re.findall(r"<h2>(.*?)</h2>", page)
    assert titles[0] == "Bearings"
    assert len(titles) == 2  # and the topics


def test_a_vehicle_without_truth_is_drawn_in_odom(recorded, tmp_path):
    rng = np.random.default_rng(1)
    page = write(recorded([*run.dead_reckoning(), *run.slam(rng), *run.localizer(rng)]), tmp_path)
    titles = re.findall(r"<h2>(.*?)</h2>", page)
    assert titles[0] == "Plan view of auv1"
    assert len(titles) == 2


def test_an_empty_bag(recorded, tmp_path):
    page = write(recorded([]), tmp_path)
    assert "0 messages" in page
    assert "<img" not in page


def test_what_was_wrong_with_the_bag_is_said_and_escaped(tmp_path):
    traffic = {"/a": Traffic("x/msg/Y", np.array([1, 2], dtype=np.int64))}
    recording = Recording("<b>", traffic, refused={"/a": "2 not read: <junk>"}, damage=("bag stopped & ended",))
    page = write(recording, tmp_path)
    assert "<h1>&lt;b&gt;</h1>" in page
    assert "/a: 2 not read: &lt;junk&gt;" in page
    assert "bag stopped &amp; ended" in page
