"""Draw the wiring of a graph into a file, or to standard output."""

from __future__ import annotations

import sys
from pathlib import Path

from palpate.launch.drawing.sketch import sketch_of
from palpate.launch.drawing.svg import draw
from palpate.launch.graph import Graph
from palpate.launch.located import InputError
from palpate.launch.whole_files import write_whole


def write_picture(graph: Graph, path: Path, title: str) -> None:
    """Draw the resolved wiring as SVG.

    Parameters
    ----------
    graph : Graph
        The graph.
    path : Path
        A file whose name ends in .svg, or ``-`` for standard output.
    title : str
        What the picture shows.

    Raises
    ------
    InputError
        If the graph could not run, or the file cannot be written; then none has changed.
    """
    to_screen = str(path) == "-"
    if not to_screen and path.suffix != ".svg":
        raise InputError(f"--graph: {path}: the picture is SVG, and its name must end in .svg")
    text = draw(sketch_of(graph), title)
    if to_screen:
        sys.stdout.write(text)
    else:
        write_whole({path: lambda part: part.write_text(text, encoding="utf-8")})
