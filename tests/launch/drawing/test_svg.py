from __future__ import annotations

import re
from collections.abc import Callable
from xml.etree import ElementTree

import pytest

from palpate.launch.drawing.sketch import Box, Sketch, Wire, sketch_of
from palpate.launch.drawing.svg import draw
from palpate.launch.graph import Graph

SVG = "{http://www.w3.org/2000/svg}"


def test_the_picture_is_one_file_of_valid_xml(explore_graph: Callable[[int], Graph]) -> None:
    text = draw(sketch_of(explore_graph(3)), "Wiring of explore.yaml")
    root = ElementTree.fromstring(text)
    assert root.tag == f"{SVG}svg"
    assert root.findtext(f"{SVG}title") == "Wiring of explore.yaml"
    assert text.count("http") == 1  # its own namespace: nothing is fetched
    assert not re.search(r"<image|<script|@import|url\(|@font-face", text)


def test_every_node_and_every_wire_has_a_title(explore_graph: Callable[[int], Graph]) -> None:
    graph = explore_graph(1)
    root = ElementTree.fromstring(draw(sketch_of(graph), "t"))
    titles = "\n".join(title.text or "" for title in root.iter(f"{SVG}title"))
    for topic, said in graph.topics().items():
        assert f"{topic}: {said.__name__}, " in titles
    for entry in graph.entries:
        assert f"{entry.name}: palpate.nodes.{entry.name} {{" in titles


def test_the_picture_has_colours_for_dark_pages(explore_graph: Callable[[int], Graph]) -> None:
    text = draw(sketch_of(explore_graph(1)), "t")
    light, dark = text.split("@media (prefers-color-scheme: dark)")
    coloured = re.compile(r"^(\.[\w. ]+) \{[^}]*#", re.MULTILINE)
    assert set(coloured.findall(light)) == set(coloured.findall(dark.partition("</style>")[0]))


def test_text_is_held_to_the_width_that_was_kept_for_it() -> None:
    wire = Wire(source=0, targets=(), labels=("/a/long/topic",), title="")
    root = ElementTree.fromstring(draw(Sketch((Box(text="a", title=""),), (wire,), ()), "t"))
    assert all(float(text.get("textLength", "0")) > 0.0 for text in root.iter(f"{SVG}text"))


@pytest.mark.parametrize("text", ['<b> & "c"', "\x00\x1b", "\ud800", "]]>", "\ufffe"])
def test_no_name_breaks_the_picture(text: str) -> None:
    box = Box(text="a", kind=text, title=text)
    wire = Wire(source=0, targets=(0,), labels=(text,), title=text, latched=True)
    ElementTree.fromstring(draw(Sketch((box,), (wire,), (box,)), text))


def test_a_graph_without_wires_is_drawn() -> None:
    box = Box(text="alone", title="alone")
    root = ElementTree.fromstring(draw(Sketch((box,), (), ()), "t"))
    assert [text.text for text in root.iter(f"{SVG}text")] == ["alone"]
