"""Why a contour is not used."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

SHOWN = 6
"""Most contours that a sentence names."""

Reason = Literal[
    "too few points",
    "in one place",
    "in one place: a touch of its end",
    "on one line",
    "around no area",
    "repeats another at its height",
    "inside another at its height",
    "crosses another at its height",
    "beside another at its height",
    "unlike its neighbours",
]
"""Why a contour is not used."""


class Dropped(NamedTuple):
    """A contour that is not used."""

    which: int
    """Of the given contours."""
    why: Reason
    height: float | None = None
    """Its height, if it has one, m."""
    off: float = 0.0
    """By how much it contradicts its neighbours, root mean square, m, if that is why."""
    perhaps: bool = False
    """It is unlike them in its size alone, and whole: it may as well have felt what no other
    contour did, a neck or a groove, and nothing tells. It is left out, for a wrong contour
    costs more than a groove that is missed."""


def reasons(dropped: Sequence[Dropped]) -> str:
    """Which contours are not used, and why, as one sentence of bearable length."""
    told = "; ".join(f"contour {one.which}: {one.why}" for one in dropped[:SHOWN])
    return told + (f"; and {len(dropped) - SHOWN} more" if len(dropped) > SHOWN else "")
