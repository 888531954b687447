"""Pieces of a closed surface: its side, and what is set onto the side at an end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.plane.kernel_point import kernel_point
from palpate.core.rebuild.ends.end_curve import Curve, Line, curves_of
from palpate.core.rebuild.ends.ends import End
from palpate.core.rebuild.slices.star_shaped import are_star_shaped

RIM = 720
"""Points of a rim from which its middle is taken."""


class Patch(Protocol):
    """A piece of a surface, from one ring to another."""

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3), or derivatives of them.

        Parameters
        ----------
        v : (n,) array
            From 0 at its lower ring to 1 at its upper.
        turns : (n,) array
            Counter-clockwise seen from above; a whole turn is 1.
        by : pair of int
            How often it is differentiated by v and by turns; together up to 2.
        """


@dataclass(frozen=True, slots=True, eq=False)
class EndPatch:
    """A ring's shape, scaled along a curve until it is a point or another ring."""

    side: Patch
    """Whose last ring it begins at."""
    curve: Curve
    rim: Floats
    """Middle of the side's last ring, (3,): from where it is seen whole, if it can be."""
    middle: Floats
    """Middle of the end, (3,)."""
    upper: bool
    """Whether it lies on the side or under it."""

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """See `Patch.at`."""
        way = v if self.upper else 1.0 - v
        sign = 1.0 if self.upper else (-1.0) ** by[0]
        along, share = (sign * self.curve.at(way, by[0])).T
        edge = np.full(len(turns), 1.0 if self.upper else 0.0)
        offset = self.side.at(edge, turns, (0, by[1]))
        if by[1]:
            return np.asarray(share[:, None] * offset)
        moved = along[:, None] * (self.middle - self.rim) + share[:, None] * (offset - self.rim)
        return np.asarray(moved + self.rim if by[0] == 0 else moved)

    @property
    def folded(self) -> float:
        """How much of a level end lies on itself, over the area that its ring encloses.

        More than 0 where no place sees the ring whole.
        """
        curve = self.curve
        rises = isinstance(curve, Line) and curve.begin[0] != curve.end[0]
        if not isinstance(curve, Line) or (rises and self.middle[2] != self.rim[2]):
            return 0.0
        seen = _ring(self.side, self.upper)[:, :2] - self.rim[:2]
        onwards = np.roll(seen, -1, axis=0)
        twice = seen[:, 0] * onwards[:, 1] - seen[:, 1] * onwards[:, 0]
        whole = float(twice.sum())
        return float(np.maximum(-twice, 0.0).sum()) / whole if whole > 0.0 else 1.0


def end_patches(side: Patch, end: End, *, upper: bool) -> tuple[Patch, ...]:
    """What closes a side at an end, from below upwards.

    Parameters
    ----------
    side : Patch
        The side.
    end : End
        How it ends. The gap is that of the contours; it is set onto the side's last ring,
        wherever that lies.
    upper : bool
        Whether it is the upper end.
    """
    ring = _ring(side, upper)
    centroid = area_centroid(ring)
    shift = _whole_view(ring[:, :2], centroid) - centroid
    rim = np.array([*(centroid + shift), ring[:, 2].mean()])
    gap = end.height - float(rim[2]) if end.height != end.rim else 0.0
    middle = np.array([*(end.middle + shift), rim[2] + gap]) if gap else rim
    curves = curves_of(end.profile, gap)
    found = tuple(EndPatch(side, curve, rim, middle, upper) for curve in curves)
    return found if upper else found[::-1]


def _ring(side: Patch, upper: bool) -> Floats:
    """Points (n, 3) of a side's last ring."""
    return side.at(np.full(RIM, 1.0 if upper else 0.0), np.arange(RIM) / RIM)


def _whole_view(ring: Floats, centroid: Floats) -> Floats:
    """From where a ring (n, 2) is seen whole: its centroid, if nowhere or from there, too."""
    if are_star_shaped(ring[None] - centroid)[0]:
        return centroid
    found = kernel_point(ring)
    return centroid if found is None else found
