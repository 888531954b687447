from __future__ import annotations

from pathlib import Path

import pytest

from palpate.launch.launch_path import EXPLORE
from palpate.launch.located import InputError
from palpate.launch.show_args import show_args


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def rows(text: str) -> list[str]:
    """Lines of the table, with one blank between two words."""
    return [" ".join(line.split()) for line in text.splitlines()[2:]]


def test_the_arguments_of_the_shipped_graph_are_shown_with_default_and_comment() -> None:
    shown = rows(show_args(EXPLORE))
    assert "scene vase name of a shipped scene, or a path" in shown
    assert "seed $(scene.seed)" in shown
    assert "record true keep every message in topics.mcap" in shown


@pytest.mark.parametrize(
    ("line", "row"),
    [
        ("a: 'x # y'  # real", "a x # y real"),
        ("a: it's # so", "a it's so"),
        ("a:  # empty", "a null empty"),
        ("a: ''", 'a ""'),
        ("a: 0.5\n  # of its own", "a 0.5"),
        ("{a: 1}  # all", "a 1"),
    ],
)
def test_a_comment_is_what_stands_behind_the_argument(tmp_path: Path, line: str, row: str) -> None:
    path = written(tmp_path, "graph.yaml", f"args:\n  {line}\nnodes: {{}}\nends: x\n")
    assert rows(show_args(path)) == [row]


def test_a_file_without_arguments_says_so(tmp_path: Path) -> None:
    path = written(tmp_path, "graph.yaml", "nodes: {}\nends: x\n")
    assert show_args(path) == f"{path} takes no arguments"


def test_of_python_the_parameters_of_describe_are_shown_and_it_is_not_called(
    tmp_path: Path,
) -> None:
    text = (
        "def describe(turns: int = 3, *, name, out: str, speed: 'float | None' = None, **more):\n"
    )
    path = written(tmp_path, "graph.py", text + "    raise SystemExit('called')\n")
    assert rows(show_args(path)) == [
        "turns int 3",
        "name required",
        "speed float | None None",
    ]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("graph.yaml", "args: [1]\n", "args must be a map of names to defaults"),
        ("graph.yaml", "args: {a: &b 1}\n", "anchors and aliases"),
        ("graph.py", "describe = 3", "has no function describe"),
        ("graph.py", "1 / 0", "ZeroDivisionError"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused(
    tmp_path: Path, name: str, text: str, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        show_args(written(tmp_path, name, text))
