"""The gutters between the columns, and the upright lines in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from palpate.launch.drawing import sizes
from palpate.launch.drawing.strands import Strand

_SIDE = 6.0


@dataclass(frozen=True, slots=True)
class Gutter:
    """The upright lines between two columns, from the gutter's left edge."""

    leaving: Mapping[Strand, float]
    """Of what comes from the column on the left and takes a lane."""
    bend: float
    """From here on lines to the next column may change their height."""
    bend_width: float
    """Within so much; 0 if all are straight."""
    entering: Mapping[Strand, float]
    """Of what comes from a lane into the column on the right."""
    width: float
    """Of the whole gutter."""


def gutter_of(
    number: int, strands: Sequence[Strand], left: int, right: int, *, bends: bool
) -> Gutter:
    """The gutter left of column `number`.

    Lines are put in the order in which those of one side do not cross each other.

    Parameters
    ----------
    number : int
        Number of the column on its right.
    strands : sequence of Strand
        All that there are.
    left, right : int
        Boxes in the columns on both sides; where there is one alone, lines to lanes above and
        below share a place.
    bends : bool
        Whether a line to the next column changes its height.
    """
    from_left = [one for one in strands if one.column == number - 1]
    into = [one for one in strands if number in one.reach]
    rise = sorted((one for one in from_left if one.way == "above"), key=lambda one: -one.row)
    sink = sorted((one for one in from_left if one.way == "below"), key=lambda one: one.row)
    fall = [one for one in into if one.way == "above" and one.column < number - 1]
    fall.sort(key=lambda one: one.row)
    climb = sorted((one for one in into if one.way == "below"), key=lambda one: -one.row)
    leaving, x = _slots(rise, sink, _SIDE, shared=left == 1)
    wide = sizes.BEND if bends else 0.0
    entering, end = _slots(fall, climb, x + wide, shared=right == 1)
    return Gutter(leaving, x, wide, entering, end + _SIDE + sizes.HEAD)


def _slots(
    above: Sequence[Strand], below: Sequence[Strand], x: float, *, shared: bool
) -> tuple[dict[Strand, float], float]:
    """Places of upright lines, and where the next could stand."""
    start = 0 if shared else len(above)
    places = {one: x + i * sizes.SLOT for i, one in enumerate(above)}
    places |= {one: x + (start + i) * sizes.SLOT for i, one in enumerate(below)}
    number = max(len(above), start + len(below))
    return places, x + number * sizes.SLOT
