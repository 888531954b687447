from __future__ import annotations

from pathlib import Path

import pytest

from palpate.launch.cli import main as cli


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
