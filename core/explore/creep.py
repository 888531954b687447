"""Down the walls of a hollow that the pad has bridged, with an edge or a corner of it first."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import DEEP_PRESS, Aim, Stance
from palpate.core.explore.cut import Cut
from palpate.core.explore.path import heading_across

STEEPEST = 1.3
"""No pad is turned farther than this against the chord, rad."""
CORNER = 7.0 / 15.0
"""Shift that leaves one row beyond the slice, at a corner; in widths of the pad."""
STANDOFF, LEAST_REACH = 9.0 / 15.0, 8.0 / 15.0
"""Ways before and past the place, besides the gap's length; in widths of the pad."""


class Way(NamedTuple):
    """One way to hold the pad against a wall."""

    along: float
    """Share of the wall's turn against the chord that the pad is turned: a pad quite along the
    wall meets the other rim first."""
    advance: float
    """How far beyond the last felt point the edge is set, along the wall; in widths of the pad."""
    tilt: float
    """Of the pad: 0 for an edge, else its upper or its lower corner comes first, rad."""


WAYS = (
    Way(0.9, 0.22, 0.0),
    Way(0.9, 0.22, 0.7),
    Way(0.9, 0.22, -0.7),
    Way(0.7, 0.1, 0.0),
    Way(0.5, 0.35, 0.5),
    Way(0.5, 0.35, -0.5),
)
"""The likeliest first; each is tried at both ends. Chosen on slots, wedges and dents."""


def creeping(cut: Cut, ends: Floats, normals: Floats) -> list[Aim]:
    """Touches that follow the walls of a gap inwards from its ends, the likeliest first.

    Parameters
    ----------
    cut : Cut
        The slice and the pad.
    ends : (2, 3) array
        Last felt point before the gap and first one after it, m.
    normals : (2, 3) array
        Outward normals there.
    """
    return [
        _along_wall(cut, ends, normals[number], number, way) for way in WAYS for number in (0, 1)
    ]


def _along_wall(cut: Cut, ends: Floats, normal: Floats, number: int, way: Way) -> Aim:
    """One touch: the pad's edge beyond one end, its body outside the hollow."""
    chord = ends[1, :2] - ends[0, :2]
    length, across = float(np.linalg.norm(chord)), heading_across(chord)
    wall = math.remainder(math.atan2(normal[1], normal[0]) - across, 2.0 * math.pi)
    inwards = 1.0 if number == 0 else -1.0
    heading = across + max(-STEEPEST, min(STEEPEST, way.along * wall))
    beyond = inwards * min(way.advance * cut.width, 0.5 * length)
    place = ends[number, :2] + beyond * _travel(across + wall)
    place = place - inwards * 0.5 * cut.width * _travel(heading)
    shift = CORNER * cut.width * float(np.sign(way.tilt))
    return Aim(
        place,
        heading,
        STANDOFF * cut.width + length,
        max(LEAST_REACH * cut.width, length),
        Stance(way.tilt, shift, DEEP_PRESS),
    )


def _travel(heading: float) -> Floats:
    """Direction of travel (2,) along a wall whose outward normal has an azimuth."""
    return np.array([-math.sin(heading), math.cos(heading)])
