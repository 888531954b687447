from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

from palpate.launch.graph import Graph
from palpate.tools.cli import command_line as cli
from palpate.tools.graph_drawing.sketch import Box, Sketch, Wire, sketch_of
from palpate.tools.graph_drawing.svg import draw

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


def test_the_picture_is_written_and_nothing_is_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.run(["launch", "explore.yaml", "fingers:=2", "--graph", "wiring.svg"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["wiring.svg"]
    assert "simulator × 2" in (tmp_path / "wiring.svg").read_text(encoding="utf-8")


@pytest.mark.parametrize("arguments", [["--graph"], ["--graph", "-"]])
def test_without_a_file_the_picture_goes_to_standard_output(
    capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert cli.run(["launch", "explore.yaml", *arguments]) == 0
    said = capsys.readouterr().out
    assert said.startswith("<svg ") and said.endswith("</svg>\n")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wiring.png", "wiring.png: the picture is SVG, and its name must end in .svg"),
        ("none/wiring.svg", "none/wiring.svg: cannot be written: there is no folder none"),
    ],
)
def test_a_file_that_cannot_be_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.run(["launch", "explore.yaml", "--graph", name]) == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_the_arguments_are_shown_and_nothing_is_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.run(["launch", "explore.yaml", "-s"]) == 0
    assert "fingers" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_the_picture_in_the_documentation_is_that_of_the_shipped_graph(
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = Path(__file__).parents[3] / "docs" / "figures" / "graph.svg"
    assert cli.run(["launch", "explore.yaml", "--graph"]) == 0
    said = capsys.readouterr().out
    # Titles name the run directory, which is another each time.
    assert _without_titles(said) == _without_titles(page.read_text(encoding="utf-8"))


def _without_titles(text: str) -> str:
    return "".join(part.rpartition("</title>")[2] for part in text.split("<title>"))
