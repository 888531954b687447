from __future__ import annotations

import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest

from palpate.launch import scale
from palpate.tools.sweep.results import FIGURES, FRAMES, Row, page_text

from .conftest import RECORD


class Parts(HTMLParser):
    """What a page is made of; raises if an element is closed that is not open."""

    VOID = ("meta", "link", "rect", "path", "circle")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def all(self, tag: str, name: str = "") -> list[dict[str, str | None]]:
        return [its for one, its in self.found if one == tag and name in (its.get("class") or "")]


@pytest.fixture
def rows(tmp_path: Path):
    """Four runs, of which one missed its goal and one failed."""
    found = []
    for number, planner in enumerate(("predicted", "uniform", "<own>", "uniform"), 1):
        folder = tmp_path / "runs" / str(number)
        folder.mkdir(parents=True)
        (folder / "summary.json").write_text("{}")
        asked = {"scene": "a&b", "planner.planner": planner, "seed": 0}
        more = {"rms_m": 1e-4 / number, "touches": 40 * number, "folder": f"runs/{number}"}
        found.append(Row(number, asked, {**RECORD, **more}))
    found[1].record["exit_code"] = 1
    failed = {"exit_code": 3, "status": "died", "reason": "no <luck>", "folder": "runs/4"}
    found[3].record.update(dict.fromkeys(FIGURES) | failed)
    return found


def test_each_dot_and_each_row_leads_to_its_run(rows, tmp_path):
    text = page_text("my sweep", rows, tmp_path)
    parts = Parts(text)
    links = {its["href"] for its in parts.all("a")}
    assert links == {f"runs/{n}/{file}" for n in range(1, 5) for file in ("", "summary.json")}
    assert all((tmp_path / link).exists() for link in links if link)
    assert len(parts.all("figure")) == 3
    assert len(parts.all("circle", "dot")) == 3 * 3 * len(FRAMES)
    assert len(parts.all("circle", "open")) == 3 * len(FRAMES)
    assert len(parts.all("tr")) == 5


def test_it_needs_no_network_and_names_are_no_markup(rows, tmp_path):
    text = page_text("<sweep>", rows, tmp_path)
    assert not re.search(r"https?:|src=|@import|url\(", text)
    assert "<own>" not in text and "&lt;own&gt;" in text
    assert "no <luck>" not in text
    assert "&lt;sweep&gt;: 4 runs" in text
    assert "1 run without a model" in text


def test_the_front_goes_down_from_the_cheapest_run(rows, tmp_path):
    front = Parts(page_text("s", rows, tmp_path)).all("path", "front")[0]["d"]
    numbers = [float(x) for x in re.findall(r"[\d.]+", front or "")]
    assert numbers[0::2] == sorted(numbers[0::2])  # to the right
    assert numbers[1::2] == sorted(numbers[1::2])  # and down, for pixels are counted from above


def test_several_scenes_are_shown_in_shares_of_their_heights(rows, tmp_path):
    assert "error, mm" in page_text("s", rows, tmp_path)
    rows[0].asked["scene"] = "other"
    text = page_text("s", rows, tmp_path)
    assert "error, % of the height" in text
    assert len(Parts(text).all("path", "front")) == 2 * 3 * len(FRAMES)


def test_nothing_measured_is_a_page_without_pictures(rows, tmp_path):
    assert Parts(page_text("s", rows[3:], tmp_path)).all("figure") == []
    assert Parts(page_text("s", [], tmp_path)).all("tr") != []


@pytest.mark.parametrize("values", [[1e-5, 3.0], [51.0], [40.0, 45.0], [0.0], [1.0, 1e5], [7, 90]])
def test_an_axis_has_some_round_numbers_within_it(values):
    axis = scale(values, 66.0, 884.0)
    ticks = axis.ticks(12)
    assert 4 <= len(ticks) <= 12
    assert ticks == sorted(ticks)
    assert all(axis.low <= tick <= axis.high for tick in ticks)
    places = [axis.at(value) for value in values]
    assert all(66.0 < place < 884.0 for place in places)
    assert places == sorted(places)


@pytest.mark.parametrize("most", [1.3, 90.0, 1e4])
def test_numbers_of_an_axis_do_not_touch_at_any_width(rows, tmp_path, most):
    rows[0].record["touches"] = 40.0 * most
    pictures = re.findall(r"<svg.*?</svg>", page_text("s", rows, tmp_path), re.DOTALL)
    assert len(pictures) == 3 * len(FRAMES)
    for picture in pictures:
        found = re.findall(r'"mid" x="([\d.]+)" y="[\d.]+">([^<]+)<', picture)
        spans = sorted(
            (float(x) - 4.0 * len(told), float(x) + 4.0 * len(told)) for x, told in found
        )
        assert len(spans) >= 2
        assert all(left[1] < right[0] for left, right in pairwise(spans))
