"""Where a lattice turns space inside out."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.splines.determinant import Pieces, determinant_pieces, halve
from palpate.core.splines.lattice import Lattice

SAMPLES = 25
"""Along each axis, in the middle of equal steps, if no points are given."""
ROUNDS = 4
"""How often undecided pieces are halved."""
MOST_NUMBERS = 1 << 22
"""Coefficients of the pieces of one layer that are halved: more would take too much room."""

Verdict = Literal["sound", "folded", "undecided"]


class FoldReport(NamedTuple):
    """What is known of a lattice's folds. Changes of volume are 1 where nothing is deformed."""

    verdict: Verdict
    """``sound`` and ``folded`` are certain but for rounding, for the whole lattice."""
    share: float
    """Share of the samples at which space is turned inside out or squeezed flat."""
    least: float
    """Least change of volume that was met."""
    where: Floats
    """Parameters (3,) at which it was."""


def fold_report(lattice: Lattice, points: Floats | None = None) -> FoldReport:
    """Look for folds, and prove that there are none if that can be done.

    Parameters
    ----------
    lattice : Lattice
        Any.
    points : (n, 3) array, optional
        Where the share is taken, m; evenly over the lattice if left out.

    Raises
    ------
    ValueError
        If points lie outside the lattice.

    Notes
    -----
    The determinant's coefficients over Bernstein polynomials enclose it (Gain and Dodgson,
    *Preventing self-intersection under free-form deformation*, 2001, bound it more loosely);
    pieces for which they have both signs are halved, and given up as undecided in the end.
    What is judged is the deformed volume: an undeformed one is taken to be sound.
    """
    if points is None:
        steps = (np.arange(SAMPLES) + 0.5) / SAMPLES
        change = lattice.change_on_grid(steps, steps, steps)
        grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
        change, places = change.ravel(), grid.reshape(-1, 3)
    else:
        change, places = lattice.jacobian_determinant(points), lattice.local(points)
    least, where = np.inf, np.full(3, 0.5)
    if len(change):
        least, where = float(change.min()), places[change.argmin()]
    verdict, corner = _judge(lattice)
    there = float(lattice.change_on_grid(*corner[:, None])[0, 0, 0])
    if there < least:  # seen by none of the samples
        least, where = there, corner
    share = float((change <= 0.0).mean()) if len(change) else 0.0
    return FoldReport(verdict, share, least, where)


def _judge(lattice: Lattice) -> tuple[Verdict, Floats]:
    """The verdict, and the corner (3,) of a piece at which the determinant is least."""
    undecided, deepest, where = False, np.inf, np.full(3, 0.5)
    for pieces in determinant_pieces(lattice.relative):
        for number in range(ROUNDS + 1):
            corner, place = _least_corner(pieces)
            if corner < deepest:
                deepest, where = corner, place
            if corner < -pieces.rounding:
                return "folded", where
            pieces = _keep(pieces, _may_fold(pieces))
            if not len(pieces.low):
                break
            # Halving makes no coefficient larger: what rounding hides stays hidden.
            hidden = np.abs(pieces.coefficients).max() <= pieces.rounding
            if hidden or number == ROUNDS or pieces.coefficients.size > MOST_NUMBERS:
                undecided = True
                break
            pieces = halve(pieces)
    return ("undecided" if undecided else "sound"), where


def _least_corner(pieces: Pieces) -> tuple[float, Floats]:
    """Corner coefficients are values: the least of them, and where."""
    ends = np.ix_(range(len(pieces.low)), [0, -1], [0, -1], [0, -1])
    corners = pieces.coefficients[ends]
    piece, *corner = np.unravel_index(corners.argmin(), corners.shape)
    return float(corners.min()), pieces.low[piece] + np.array(corner) * pieces.width[piece]


def _may_fold(pieces: Pieces) -> Bools:
    least: Floats = pieces.coefficients.min(axis=(1, 2, 3))
    fold: Bools = least <= pieces.rounding
    return fold


def _keep(pieces: Pieces, which: Bools) -> Pieces:
    return pieces._replace(
        low=pieces.low[which],
        width=pieces.width[which],
        coefficients=pieces.coefficients[which],
    )
