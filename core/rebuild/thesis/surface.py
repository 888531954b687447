"""The thesis's solid as a closed surface like any other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.signed_area import signed_area
from palpate.core.rebuild.surface.patches import Patch
from palpate.core.rebuild.surface.sampled_patch import sampled_patch
from palpate.core.rebuild.thesis.solid import ThesisSolid


@dataclass(frozen=True, slots=True, eq=False)
class ConePatch:
    """Straight lines from a side's last ring to a point."""

    side: Patch
    tip: Floats
    """(3,)."""
    upper: bool
    """Whether it lies on the side or under it."""

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """See `Patch.at`."""
        edge = np.full(len(turns), 1.0 if self.upper else 0.0)
        ring = self.side.at(edge, turns, (0, by[1]))
        share = (1.0 - v if self.upper else v)[:, None]
        if by[0] > 1:
            return np.zeros_like(ring)
        tip = self.tip if by[1] == 0 else np.zeros(3)
        if by[0] == 1:
            return (ring - tip) * (-1.0 if self.upper else 1.0)
        found: Floats = tip + share * (ring - tip)
        return found


def thesis_patches(solid: ThesisSolid) -> tuple[Patch, ...]:
    """Its surface, from the bottom to the top, counter-clockwise whatever the lattice does.

    Notes
    -----
    The program closes its surface by points beyond its first and last rows; these are cones.
    """
    middle = solid.surface(np.array([0.5]), np.linspace(0.0, 1.0, 65))[0, :-1]
    mirrored = signed_area(middle[:, :2]) < 0.0

    def grid(v: Floats, turns: Floats) -> Floats:
        return solid.surface(v, 1.0 - turns if mirrored else turns)

    side = sampled_patch(grid)
    if solid.cap is None:
        return (side,)
    turns = np.arange(side.control.shape[1]) / side.control.shape[1]
    tips = []
    for v, way in ((0.0, -1.0), (1.0, 1.0)):
        ring = side.at(np.full(len(turns), v), turns)
        tips.append(ring.mean(axis=0) + np.array([0.0, 0.0, way * solid.cap]))
    return ConePatch(side, tips[0], False), side, ConePatch(side, tips[1], True)
