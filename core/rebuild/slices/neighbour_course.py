"""How far points of closed curves are off the course of their neighbours, and what curves share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from palpate.core.arrays import Floats
from palpate.core.rebuild.slices.curve_places import chord_places

REACH = 3
"""Neighbours on either side that tell of a point."""
SAMPLES = 128
"""Places around at which curves are compared."""
NEAREST = 4
"""Curves beside one that tell what is the object's."""
WINDOW = 1.5
"""Steps on either side within which a curve may have the same corner."""
PAIRS = ((2, 4), (1, 5), (0, 6), (2, 1), (4, 5))
"""Neighbours through which lines foretell the point between or beyond them: of seven in a row."""


CUBIC = (1, 2, 4, 5)
"""Neighbours that a cubic passes."""


class Course(NamedTuple):
    """Points and what their neighbours foretell of them."""

    off: Floats
    """(N, 2): how far each is off, along and across, by the median of several guesses."""
    bend: Floats
    """(N, 2): how far each is off the cubic through two neighbours on either side."""
    frame: Floats
    """(N, 2, 2): unit vectors along and across."""
    points: Floats
    """(N, 2)."""

    def foretold(self, bend: Floats) -> Floats:
        """Where they should be if they ought to be off the cubic by as much, (N, 2)."""
        moved: Floats = self.points + np.einsum("ni,nij->nj", bend - self.bend, self.frame)
        return moved


class Shared(NamedTuple):
    """What the curves beside each are off the course of their own, by the place around."""

    places: Floats
    """(M, S): turns that correspond, rising, over less than one turn."""
    off: Floats
    """(M, S, 2): along and across, in the size of the curve itself."""
    bend: Floats
    """(M, S, 2): the same from the cubic."""
    most: Floats
    """(M, S): how far they are off nearby, at most."""

    def at(self, owner: NDArray[np.intp], turns: Floats) -> Around:
        """Where the curves `owner` (N,) have the turns (N,)."""
        column = np.empty(len(turns), np.intp)
        samples = self.places.shape[1]
        for row, places in enumerate(self.places):
            mine = owner == row
            ahead = np.mod(turns[mine] - places[0], 1.0)
            rising = np.append(places - places[0], 1.0)
            share = np.interp(ahead, rising, np.arange(samples + 1))
            column[mine] = np.rint(share).astype(np.intp) % samples
        return Around(self.off[owner, column], self.bend[owner, column], self.most[owner, column])


class Around(NamedTuple):
    """The same for single points."""

    off: Floats
    """(N, 2)."""
    bend: Floats
    """(N, 2)."""
    most: Floats
    """(N,)."""


def off_course(beside: Floats, ahead: Floats) -> Course:
    """How far points are off.

    The neighbours foretell a point five times, and the median counts: one wrong neighbour
    spoils two of the five at most.

    Parameters
    ----------
    beside : (N, 7, 2) array
        Each point in the middle of its neighbours.
    ahead : (N, 7) array
        How far ahead of it, in turns, they are: rising, 0 in the middle.
    """
    point = beside[:, REACH]
    beside = beside - point[:, None]
    along = beside[:, REACH + 2] - beside[:, REACH - 2]
    length = np.hypot(along[:, 0], along[:, 1])
    along = along / np.where(length > 0.0, length, 1.0)[:, None]
    frame = np.stack([along, np.stack([along[:, 1], -along[:, 0]], axis=1)], axis=1)
    in_frame = np.einsum("nij,nkj->ink", frame, beside)
    one, other = np.array(PAIRS).T
    share = ahead[:, one] / (ahead[:, one] - ahead[:, other])
    off = [
        -_middle_of_five(own[:, one] + share * (own[:, other] - own[:, one])) for own in in_frame
    ]
    cubic = np.einsum("nk,nkd->nd", _cubic_weights(ahead[:, CUBIC]), beside[:, CUBIC])
    bend = -np.einsum("nij,nj->ni", frame, cubic)
    return Course(np.stack(off, axis=1), bend, frame, point)


def _middle_of_five(values: Floats) -> Floats:
    """Medians (N,) of rows (N, 5): three of the five are no more than it, and three no less."""
    a, b, c, d, e = values.T
    low, high = np.minimum(a, b), np.maximum(a, b)
    low, high = np.maximum(low, np.minimum(c, d)), np.minimum(high, np.maximum(c, d))
    # Of four values the two in the middle are left; the fifth is between them, or not.
    middle: Floats = np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), e))
    return middle


def _cubic_weights(ahead: Floats) -> Floats:
    """Lagrange's weights (N, 4) at 0 of values at four other places (N, 4)."""
    between = ahead[:, None, :] - ahead[:, :, None]
    np.einsum("nkk->nk", between)[:] = 1.0
    others = np.where(np.eye(4, dtype=bool), 1.0, ahead[:, None, :])
    weights: Floats = (others / between).prod(axis=2)
    return weights


def shared_course(fine: Floats, places: Floats, steps: Floats, sizes: Floats) -> Shared:
    """What the curves beside each are off, at the distance of their own points.

    Parameters
    ----------
    fine : (M, n, 2) array
        Curves at even steps of their turn.
    places : (M, K) array
        Turns of them that correspond, rising, over less than one turn.
    steps : (M,) array
        Turns between their points.
    sizes : (M,) array
        How large they are.
    """
    count = len(fine)
    around = np.linspace(0.0, places.shape[1], SAMPLES, endpoint=False)
    wound = np.column_stack([places, places[:, :1] + 1.0])
    turns = np.stack([np.interp(around, np.arange(wound.shape[1]), row) for row in wound])
    ahead = steps[:, None, None] * np.arange(-REACH, REACH + 1)
    taps = (turns[..., None] + ahead).reshape(count, -1)
    beside = chord_places(fine, taps).reshape(-1, 2 * REACH + 1, 2)
    even = np.broadcast_to(np.arange(-REACH, REACH + 1.0), beside.shape[:2])
    found = off_course(beside, even)
    off, bend = (
        part.reshape(count, SAMPLES, 2) / sizes[:, None, None] for part in (found.off, found.bend)
    )
    far = np.hypot(off[..., 0], off[..., 1])
    window = int(np.ceil(WINDOW * SAMPLES * float(np.median(steps))))
    most = maximum_filter1d(far, 2 * window + 1, axis=1, mode="wrap")
    near = _nearest(count)
    if not near.shape[1]:
        return Shared(turns, 0.0 * off, 0.0 * off, 0.0 * far)
    common, bent = (np.median(part[near], axis=1) * sizes[:, None, None] for part in (off, bend))
    return Shared(turns, common, bent, np.median(most[near], axis=1) * sizes[:, None])


def _nearest(count: int) -> NDArray[np.intp]:
    """The curves next to each one, (count, at most 4)."""
    every = np.arange(count)
    away = np.abs(every[:, None] - every).astype(np.float64)
    np.fill_diagonal(away, np.inf)
    nearest: NDArray[np.intp] = np.argsort(away, axis=1, kind="stable")[
        :, : min(NEAREST, count - 1)
    ]
    return nearest
