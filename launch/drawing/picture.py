"""A laid-out wiring: everything with its place, before it is written as SVG."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from palpate.launch.drawing.sketch import Box
from palpate.launch.drawing.strands import Strand

Point = tuple[float, float]
"""To the right and down, in pixels."""


class Rect(NamedTuple):
    """A rectangle."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: Rect) -> bool:
        """Whether they have an area in common."""
        across = self.left < other.right and other.left < self.right
        return across and self.top < other.bottom and other.top < self.bottom


class Label(NamedTuple):
    """One line of text."""

    text: str
    rect: Rect
    """What it covers; its baseline is `DESCENT` above the lower edge."""


@dataclass(frozen=True, slots=True)
class DrawnBox:
    """A node, or a stack of them."""

    box: Box
    rect: Rect
    """The front card."""
    cover: Rect
    """With the cards behind."""


@dataclass(frozen=True, slots=True)
class DrawnStrand:
    """A strand with its labels and lines."""

    strand: Strand
    labels: tuple[Label, ...]
    lines: tuple[tuple[Point, ...], ...]
    """Ways along corners; each ends with an arrow head unless the strand is loose."""
    forks: tuple[Point, ...]
    """Where lines part."""


@dataclass(frozen=True, slots=True)
class Picture:
    """All of it; its upper left corner is (0, 0)."""

    width: float
    height: float
    boxes: tuple[DrawnBox, ...]
    strands: tuple[DrawnStrand, ...]
    sinks: tuple[DrawnBox, ...]
    """Each with the words that it hears everything."""
    signs: Mapping[str, Label]
    """What lines and frames mean, each with a sample on its left."""
