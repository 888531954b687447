"""Charts: the same figure is the same file, readable on light and dark pages, in any font."""

import re
from itertools import pairwise
from xml.etree import ElementTree

import pytest

from palpate.launch import charts
from palpate.launch.files.source_map import InputError

SVG = "{http://www.w3.org/2000/svg}"
NOTE = {"dot": 'a <dot> & "more"'}


@charts.styled
def figure_of(values=(1.0, 20.0, 300.0), size=(320.0, 240.0)):
    figure = charts.new_figure(*size)
    axes = figure.subplots()
    axes.loglog(values, values, "o-", color=charts.BLUE, gid="dot", label="$5 < $6")
    axes.set(xlabel="cost, s", ylabel="error, mm")
    axes.grid()
    figure.legend()
    charts.log_ticks(axes)
    return figure


@pytest.fixture(scope="module")
def text():
    return charts.svg_text(figure_of(), "What <it> is", NOTE)


def test_same_figure_is_same_text(text):
    assert text == charts.svg_text(figure_of(), "What <it> is", NOTE)
    assert not re.search(r"\b20\d\d-\d\d", text)  # no date


def test_text_is_text_with_its_title_size_and_notes(text):
    root = ElementTree.fromstring(text)
    assert root.get("aria-label") == root.findtext(f"{SVG}title") == "What <it> is"
    assert {one.text for one in root.iter(f"{SVG}title")} == {"What <it> is", *NOTE.values()}
    texts = {one.text for one in root.iter(f"{SVG}text")}
    assert {"cost, s", "error, mm", "$5 < $6", "1", "10", "100"} < texts
    assert [float((root.get(side) or "").removesuffix("pt")) for side in ("width", "height")] == [
        240.0, 180.0,
    ]  # fmt: skip


def test_picture_is_self_contained_for_light_and_dark_pages(text):
    assert not re.search(r"<image|<script|@import|@font-face|url\((?!#)", text)
    assert {*re.findall(r"https?://[\w.]+", text)} == {"http://www.w3.org"}  # its namespaces
    style, body = text.split("</style>", 1)
    for used in {*re.findall(r"(?:fill|stroke): #\w+", body)} - {f"stroke: {charts.GREY}"}:
        assert f'[style*="{used}"]' in style
    assert len(text) < 20_000


@pytest.mark.parametrize("width", [358.0, 670.0])
@pytest.mark.parametrize("most", [1.01, 1.3, 90.0, 1e4, 1e12])
def test_numbers_of_an_axis_do_not_touch(width, most):
    figure = figure_of((40.0, 40.0 * most), (width, 330.0))
    figure.canvas.draw()
    for axis, end in ((figure.axes[0].xaxis, "x"), (figure.axes[0].yaxis, "y")):
        labels = [one for one in axis.get_ticklabels() if one.get_text()]
        spans = [one.get_window_extent() for one in labels]
        low, high = f"{end}0", f"{end}1"
        assert len(spans) >= 2
        assert all(getattr(a, high) < getattr(b, low) for a, b in pairwise(spans))


def test_figure_is_written_whole_or_refused(tmp_path):
    path = charts.write_figure(figure_of(), tmp_path / "new" / "one.svg", "one")
    assert path.read_text("utf-8").startswith("<svg ")
    assert charts.write_figure(figure_of(), tmp_path / "one.png").read_bytes()[1:4] == b"PNG"
    (tmp_path / "two.png").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        charts.write_figure(figure_of(), tmp_path / "two.png")
