"""A closed surface given by a rule, exact at every place, in no resolution.

It runs from a pole at v = 0 to a pole at v = 1, through the lower end, the side and the upper
end; around it runs the turn. The pieces meet at seams, where it may have an edge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.frames import split_pose, transform
from palpate.core.plane.signed_area import signed_area
from palpate.core.rebuild.ends.ends import End
from palpate.core.rebuild.slant import Slant
from palpate.core.rebuild.surface.patches import Patch, end_patches
from palpate.core.rebuild.surface.surface_forms import Curvatures, curvatures_of, unit_normals

POLE = 1e-5
"""Of the way from pole to pole: within this of a pole, normals and curvatures are told as they
are at this distance, where the tangents do not vanish."""
OPEN = 1e-6
"""Of the size: a ring at a pole that is wider than this leaves a hole."""
LENGTH_ROWS, LENGTH_TURNS = 17, 24
"""Grid on which a piece's length is taken."""
LEAST_PIECE = 0.02
"""Least share of v that a piece gets."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Pieces from pole to pole; `close_surface` makes one."""

    pieces: tuple[Patch, ...]
    """From the bottom to the top."""
    seams: Floats
    """v at which they begin and end, (pieces + 1,), from 0 to 1."""
    middle: Floats
    """About the middle of its box, (3,)."""
    size: float
    """Diagonal of its box, about."""
    frame: Floats | None = None
    """Pose (7,) of the frame in which the pieces are; None if they are where the surface is."""
    slant: Slant | None = None
    """How the pieces are slanted before."""

    def at(self, v: ArrayLike, turns: ArrayLike, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (..., 3), or derivatives of them.

        Parameters
        ----------
        v : array
            From 0, the lower pole, to 1, the upper. At a seam the upper piece answers.
        turns : array
            Around it; a whole turn is 1. It is broadcast with `v`.
        by : pair of int
            How often it is differentiated by v and by turns; together up to 2.

        Raises
        ------
        ValueError
            If a place is not finite or v lies outside 0 to 1, or more derivatives are wanted.
        """
        v, turns = np.broadcast_arrays(np.asarray(v, float), np.asarray(turns, float))
        shape = v.shape
        v = finite_array("v", v.ravel(), (None,))
        turns = finite_array("turns", turns.ravel(), (None,))
        if len(v) and not (v.min() >= 0.0 and v.max() <= 1.0):
            raise ValueError(f"v must lie between 0 and 1, got {v.min():g} to {v.max():g}")
        if min(by) < 0 or sum(by) > 2:
            raise ValueError(f"by must be 0 or more and together at most 2, got {by}")
        points = np.empty((len(v), 3))
        owner = self.piece_of(v)
        for piece in np.unique(owner):
            rows = owner == piece
            points[rows] = self.piece_at(int(piece), v[rows], turns[rows], by)
        return points.reshape(*shape, 3)

    def piece_of(self, v: Floats) -> Ints:
        """The piece (n,) at each v (n,); the upper one at a seam."""
        found = np.searchsorted(self.seams, v, side="right") - 1
        return np.clip(found, 0, len(self.pieces) - 1).astype(np.int32)

    def piece_at(
        self, piece: int, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)
    ) -> Floats:
        """Points (n, 3) of one piece, at v (n,) between its seams, or derivatives of them."""
        low, high = self.seams[piece], self.seams[piece + 1]
        local = np.clip((v - low) / (high - low), 0.0, 1.0)
        found = self._slanted(self.pieces[piece], local, turns, by)
        if self.frame is not None:
            position, axes = split_pose(self.frame)
            found = found @ axes.T
            found = found + position if by == (0, 0) else found
        return found / (high - low) ** by[0] if by[0] else found

    def _slanted(self, piece: Patch, v: Floats, turns: Floats, by: tuple[int, int]) -> Floats:
        if self.slant is None:
            return piece.at(v, turns, by)
        return self.slant.carried(lambda order: piece.at(v, turns, order), by)

    def normals(self, v: ArrayLike, turns: ArrayLike) -> Floats:
        """Outward unit normals (..., 3); arguments and errors as for `at`.

        Where it has an edge, those of the piece that answers; at a tip, the limit along the
        turn.
        """
        inside = self._off_poles(v)
        by_v, by_t = self.at(inside, turns, (1, 0)), self.at(inside, turns, (0, 1))
        normals = unit_normals(by_v.reshape(-1, 3), by_t.reshape(-1, 3))
        return normals.reshape(by_v.shape)

    def curvatures(self, v: ArrayLike, turns: ArrayLike) -> Curvatures:
        """Principal curvatures at places (n,); arguments and errors as for `at`."""
        inside = self._off_poles(v)
        orders = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        return curvatures_of(*(self.at(inside, turns, by).reshape(-1, 3) for by in orders))

    def _off_poles(self, v: ArrayLike) -> Floats:
        v = np.asarray(v, float)
        if v.size and not (v.min() >= 0.0 and v.max() <= 1.0):
            raise ValueError(f"v must lie between 0 and 1, got {v.min():g} to {v.max():g}")
        inside: Floats = np.clip(v, POLE, 1.0 - POLE)
        return inside


def close_surface(side: Patch, bottom: End | None = None, top: End | None = None) -> Surface:
    """A side with its ends.

    Parameters
    ----------
    side : Patch
        From its lowest ring to its highest, counter-clockwise seen from above.
    bottom, top : End, optional
        What is set onto it; none where the side itself closes in a point.

    Raises
    ------
    ValueError
        If the side runs clockwise, or does not close where no end is set onto it.
    """
    below = end_patches(side, bottom, upper=False) if bottom is not None else ()
    above = end_patches(side, top, upper=True) if top is not None else ()
    _check_way(_grid(side, np.linspace(0.0, 1.0, LENGTH_ROWS), _turns()))
    return closed_surface((*below, side, *above))


def closed_surface(pieces: tuple[Patch, ...]) -> Surface:
    """Pieces, from the lowest to the highest, that make a closed surface.

    Raises
    ------
    ValueError
        If it does not close in a point at both ends.
    """
    turns = _turns()
    v = np.linspace(0.0, 1.0, LENGTH_ROWS)
    grid = np.stack([_grid(piece, v, turns) for piece in pieces])
    points = grid.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.linalg.norm(high - low))
    for name, ring in (("bottom", grid[0, 0]), ("top", grid[-1, -1])):
        width = float(np.ptp(ring, axis=0).max())
        if width > OPEN * size:
            raise ValueError(
                f"{name} must be given, for the side does not close there: "
                f"its last ring is {width:g} wide"
            )
    steps = np.linalg.norm(np.diff(grid, axis=1), axis=-1).mean(axis=2).sum(axis=1)
    shares = np.maximum(steps / steps.sum(), LEAST_PIECE)
    seams = np.concatenate([[0.0], np.cumsum(shares) / shares.sum()])
    seams[-1] = 1.0
    return Surface(pieces, seams, 0.5 * (low + high), size)


def placed(surface: Surface, frame: Floats | None, slant: Slant | None = None) -> Surface:
    """A surface that is where its pieces are, slanted and carried along by a frame's pose (7,)."""
    if frame is None and slant is None:
        return surface
    middle = surface.middle[None] if slant is None else slant.slanted(surface.middle[None])
    if frame is not None:
        middle = transform(frame, middle)
    return replace(surface, middle=middle[0], frame=frame, slant=slant)


def _turns() -> Floats:
    turns: Floats = np.arange(LENGTH_TURNS) / LENGTH_TURNS
    return turns


def _grid(piece: Patch, v: Floats, turns: Floats) -> Floats:
    rows, columns = np.repeat(v, len(turns)), np.tile(turns, len(v))
    return piece.at(rows, columns).reshape(len(v), len(turns), 3)


def _check_way(rings: Floats) -> None:
    area = signed_area(rings[len(rings) // 2, :, :2])
    if not area > 0.0:
        raise ValueError(f"side must run counter-clockwise, got a ring of signed area {area:g}")
