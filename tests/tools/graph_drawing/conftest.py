from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.graph import Graph
from palpate.launch.launch_file import describe
from palpate.launch.launch_source import EXPLORE
from palpate.tools.graph_drawing.sketch import Box, Sketch, Wire


@pytest.fixture(scope="session")
def explore_graph() -> Callable[[int], Graph]:
    """The shipped graph with so many fingers."""
    return lambda fingers: (
        describe(EXPLORE, {"fingers": SourceMapped(fingers, "")}, Path("out")).graph
    )


@pytest.fixture
def any_sketch() -> Callable[[int], Sketch]:
    """A graph of some boxes with wires at random, to themselves and back as well."""

    def make(seed: int) -> Sketch:
        rng = random.Random(seed)
        boxes = [
            Box(
                text="n" * rng.randint(1, 20),
                kind="a.b" * rng.randint(0, 4),
                title="",
                count=rng.randint(1, 8),
            )
            for _ in range(rng.randint(1, 12))
        ]
        wires = [
            Wire(
                source=rng.randrange(len(boxes)),
                targets=tuple(
                    sorted(rng.sample(range(len(boxes)), rng.randint(0, min(4, len(boxes)))))
                ),
                labels=tuple("/t" * rng.randint(1, 12) for _ in range(rng.randint(1, 3))),
                title="",
                latched=rng.random() < 0.3,
            )
            for _ in range(rng.randint(0, 25))
        ]
        sinks = [Box(text="sink", title="") for _ in range(rng.randint(0, 2))]
        return Sketch(tuple(boxes), tuple(wires), tuple(sinks))

    return make
