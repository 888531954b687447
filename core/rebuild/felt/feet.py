"""Touches that face an end of an object, and how each of them leans and bends.

What a touch says of its own slope does not depend on the error of its place.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.felt_points import FeltPoints

Kind = Literal["flat", "bent", "edge"]

FACING = 0.8
"""Part of a normal along the axis from which on a taxel lies on an end, slanted or not."""
FEWEST = 24
"""Taxels of a touch: fewer felt but an edge."""
FLAT, BENT, WORSE = 2e-4, 1.4, 2.0
"""A touch is flat if its taxels lie no farther off a plane than this share of its width; with
noise, if a bent surface follows them no better than by the second factor, nor the best touch its
plane by the third: else it lies across an edge."""
ALIKE = math.radians(2.0)
"""By how much touches of one plane may lean otherwise than the outermost of them."""
LEVEL = math.radians(0.5)
"""A flat touch that leans less is level; of those that lean more each is as high as its highest
taxel."""
THIN = 0.1
"""Of its width: what a touch must be wide at least, the other way, to lean in some way."""


class Foot(NamedTuple):
    """A touch of an end."""

    touch: int
    """Its number."""
    place: Floats
    """Mean of its taxels, (3,), m."""
    slopes: Floats
    """(2,)."""
    off: float
    """How far its taxels lie off a plane, root mean square, m."""
    width: float
    """Of its taxels, root mean square from their middle, m."""
    kind: Kind
    """flat: they lie in a plane; bent: a smooth surface follows them better; edge: neither, or
    they lie in a line."""

    def misses(self, other: Foot) -> float:
        """How far another touch lies off its plane, along the axis, m."""
        height = self.place[2] + (other.place - self.place)[:2] @ self.slopes
        return abs(float(other.place[2] - height))

    @property
    def level(self) -> bool:
        """Whether all its taxels tell one height."""
        return self.kind == "flat" and float(np.linalg.norm(self.slopes)) < math.tan(LEVEL)

    def leans_as(self, other: Foot) -> bool:
        """Whether another touch leans like it."""
        return float(np.linalg.norm(other.slopes - self.slopes)) < math.tan(ALIKE)


def feet_of(felt: FeltPoints, way: float) -> list[Foot]:
    """The touches that face an end, way 1 or -1, with enough taxels to say how it leans there."""
    assert felt.normals is not None
    facing = way * felt.normals[:, 2] > FACING
    counts = np.bincount(felt.touch[facing], minlength=1)
    numbers = np.flatnonzero(counts >= FEWEST)
    feet = [_foot(int(each), felt.points[facing & (felt.touch == each)]) for each in numbers]
    best = min((one.off for one in feet), default=0.0)
    least = [FLAT * one.width for one in feet]
    return [
        one._replace(kind="edge") if one.kind == "flat" and one.off > WORSE * best + small else one
        for one, small in zip(feet, least, strict=True)
    ]


def _foot(touch: int, points: Floats) -> Foot:
    """A touch by its taxels (n, 3) that face an end."""
    place = points.mean(axis=0)
    away, z = (points - place)[:, :2], points[:, 2] - place[2]
    width = float(np.sqrt(np.mean((away**2).sum(axis=1))))
    # In its own width, so that the unit of length does not matter.
    x, y = away.T / (width or 1.0)
    rows = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
    plane, bent = (np.linalg.lstsq(rows[:, :count], z, rcond=None)[0] for count in (3, 6))
    off = float(np.sqrt(np.mean((z - rows[:, :3] @ plane) ** 2)))
    left = float(np.sqrt(np.mean((z - rows @ bent) ** 2)))
    narrow = float(np.linalg.eigvalsh(np.cov(x, y))[0]) < THIN**2
    is_bent = off > BENT * left + FLAT * width
    kind: Kind = "edge" if narrow else "bent" if is_bent else "flat"
    return Foot(touch, place, plane[1:] / (width or 1.0), off, width, kind)
