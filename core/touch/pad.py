"""The fingertip's pad, and the guarded move that presses it against an object.

The pad's own frame: x along the columns, y along the rows, z into the object; the middle of
the undeformed face is the origin. The transducers lie one thickness behind the face and
follow its dome, so that every taxel is equally thick.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose
from palpate.core.shapes.protocol import Shape

Outcome = Literal["hit", "miss", "inside", "bottomed"]


Yielding = Literal["springs", "membrane", "half_space"]
"""What the face does beside a contact: nothing, or it slopes back like a membrane on springs,
or like the surface of a deep elastic body."""


class Face(NamedTuple):
    """How the pad's face yields beside a contact."""

    kind: Yielding
    """In which way."""
    decay: float = 0.0
    """Length in which a membrane falls to 1/e, m; 0 for the others."""


SPRINGS = Face("springs")
"""Each taxel is a spring of its own (Winkler)."""


@dataclass(frozen=True, slots=True)
class Pad:
    """Array and pad."""

    rows: int
    """Rows of taxels."""
    cols: int
    """Columns of taxels."""
    pitch: float
    """Distance between neighbouring taxels, m."""
    thickness: float
    """Thickness over the transducers, m."""
    dome: float
    """Curvature of the face at its middle, 1/m; 0 for a flat pad."""
    saturation: float
    """Largest compression, as a share of the thickness."""
    face: Face = SPRINGS
    """How the face yields beside a contact, as a data sheet has it."""

    def grid(self) -> tuple[Floats, Floats]:
        """Coordinates x and y of the taxels, (rows, cols) each, m; read-only."""
        return _grid(self.rows, self.cols, self.pitch)

    def sag(self) -> Floats:
        """How far the domed face falls back behind its middle, (rows, cols), m; read-only."""
        return _sag(self.rows, self.cols, self.pitch, self.dome)

    def transducers(self) -> Floats:
        """Where the transducers are in the pad's frame, (rows * cols, 3), m; read-only."""
        return _transducers(self)


@cache
def _grid(rows: int, cols: int, pitch: float) -> tuple[Floats, Floats]:
    x = (np.arange(cols) - (cols - 1) / 2) * pitch
    y = (np.arange(rows) - (rows - 1) / 2) * pitch
    grid = np.meshgrid(x, y)
    for axis in grid:
        axis.setflags(write=False)
    return grid[0], grid[1]


@cache
def _sag(rows: int, cols: int, pitch: float, dome: float) -> Floats:
    x, y = _grid(rows, cols, pitch)
    sag: Floats = 0.5 * dome * (x * x + y * y)
    sag.setflags(write=False)
    return sag


@cache
def _transducers(pad: Pad) -> Floats:
    x, y = pad.grid()
    places = np.column_stack([x.ravel(), y.ravel(), -(pad.thickness + pad.sag()).ravel()])
    places.setflags(write=False)
    return places


class Press(NamedTuple):
    """How a guarded move ended."""

    outcome: Outcome
    """As in a tactile frame."""
    pose: Floats
    """Pose of the pad at its end, (7,)."""
    compression: Floats
    """Compression of the pad, (rows, cols), m."""
    advance: float
    """Way travelled, m."""
    indentation: Floats
    """How far the rigid surface would enter the undeformed pad, (rows, cols), m: negative
    over a gap, -inf where there is nothing."""


def press(shape: Shape, pad: Pad, start: Floats, reach: float, depth: float) -> Press:
    """Move a pad along its normal until its deepest compression is `depth`.

    A pad that saturates before bottoms out there, and goes no farther.

    One cast serves the whole move: the surface's distance from every taxel is known at once.

    Parameters
    ----------
    shape : Shape
        What may be met.
    pad : Pad
        What meets it.
    start : (7,) array
        Pose from which it moves.
    reach : float
        Longest way to first contact, m.
    depth : float
        Compression at which it stops, m.

    Notes
    -----
    Each taxel is a spring of its own (Winkler); inside the contact the pad takes the
    surface's shape, which is exact under any elastic model.
    """
    position, axes = split_pose(start)
    ranges = shape.cast(
        pad.transducers() @ axes.T + position, axes[:, 2], pad.thickness + reach + depth
    )
    gaps = ranges.reshape(pad.rows, pad.cols) - pad.thickness
    nearest = float(gaps.min())
    if nearest < 0.0:
        return _inside(pad, start)
    limit = pad.saturation * pad.thickness
    advance = nearest + min(depth, limit) if nearest <= reach else reach
    indentation = advance - gaps
    end = start.copy()
    end[:3] = position + advance * axes[:, 2]
    outcome: Outcome = "miss" if nearest > reach else "hit" if depth <= limit else "bottomed"
    return Press(outcome, end, np.maximum(indentation, 0.0), advance, indentation)


def _inside(pad: Pad, start: Floats) -> Press:
    """The pad began inside the object: nothing was felt that means anything."""
    size = (pad.rows, pad.cols)
    return Press("inside", start, np.zeros(size), 0.0, np.full(size, -np.inf))
