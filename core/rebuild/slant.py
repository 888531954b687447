"""Space as it would be if both ends of an object were level: how slanted ends are rebuilt.

An oblique top, or a flat one seen along an axis that is a little off, is level after every height
has been moved by a slope that changes evenly from the one end to the other: z = zeta + (p + q
zeta) . (x, y). Sides, rims and ends are fitted there and carried back.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.felt.felt_points import FeltPoints

LEAST_STRETCH = 0.25
"""How far heights may be pressed together; farther aside both ends would meet."""
By = tuple[int, int]
"""How often a surface is differentiated, by each of its two parameters."""


class Slant(NamedTuple):
    """By how much heights are moved; places are seen from the slicing frame, m."""

    middle: Floats
    """Where nothing is moved, (2,)."""
    slopes: Floats
    """At the height 0 of the straight space, (2,)."""
    change: Floats
    """By which they change with each m of it, (2,)."""

    def straightened(self, points: Floats) -> Floats:
        """Points (n, 3) in the straight space."""
        away = points[:, :2] - self.middle
        heights = (points[:, 2] - away @ self.slopes) / (1.0 + away @ self.change)
        return np.column_stack([points[:, :2], heights])

    def reaches(self, points: Floats) -> Bools:
        """Which points (n, 3) it carries: those before the line in which both ends would meet."""
        before: Bools = 1.0 + (points[:, :2] - self.middle) @ self.change > LEAST_STRETCH
        return before

    def slanted(self, points: Floats) -> Floats:
        """Points (n, 3) of the straight space where they are."""
        away = points[:, :2] - self.middle
        moved = np.einsum("ni,ni->n", self._at(points[:, 2]), away)
        return np.column_stack([points[:, :2], points[:, 2] + moved])

    def straightened_felt(self, felt: FeltPoints) -> FeltPoints:
        """Felt points in the straight space, their normals square to what is the surface there."""
        points = self.straightened(felt.points)
        if felt.normals is None:
            return felt._replace(points=points)
        upward = felt.normals[:, 2:]
        level = felt.normals[:, :2] + upward * self._at(points[:, 2])
        stretch = 1.0 + (points[:, :2] - self.middle) @ self.change
        normals = np.column_stack([level, upward[:, 0] * stretch])
        return felt._replace(
            points=points, normals=normals / np.linalg.norm(normals, axis=1, keepdims=True)
        )

    def steepness(self, height: float) -> float:
        """How steep a plane is that is level at a height of the straight space, m."""
        return float(np.linalg.norm(self._at(np.array([height]))))

    def carried(self, at: Callable[[By], Floats], by: By) -> Floats:
        """Points (n, 3) of a surface of the straight space, or derivatives, where they are.

        Parameters
        ----------
        at : callable
            The same of the straight space, for any derivatives.
        by : pair of int
            Together up to 2.
        """
        points = at((0, 0))
        if by == (0, 0):
            return self.slanted(points)
        found = at(by).copy()
        stretch = 1.0 + (points[:, :2] - self.middle) @ self.change
        along = np.einsum("ni,ni->n", self._at(points[:, 2]), found[:, :2])
        found[:, 2] = found[:, 2] * stretch + along
        if sum(by) == 2:
            one, other = (at(each) for each in _halves(by))
            found[:, 2] += one[:, 2] * (other[:, :2] @ self.change)
            found[:, 2] += other[:, 2] * (one[:, :2] @ self.change)
        return found

    def _at(self, heights: Floats) -> Floats:
        """Slopes (n, 2) at heights (n,) of the straight space."""
        slopes: Floats = self.slopes + heights[:, None] * self.change
        return slopes


def _halves(by: By) -> tuple[By, By]:
    """A second derivative as two first ones, one after the other."""
    if by == (1, 1):
        return (1, 0), (0, 1)
    first = (1, 0) if by[0] else (0, 1)
    return first, first


def straight(slant: Slant | None, felt: FeltPoints) -> FeltPoints:
    """Felt points in the straight space; as they are if there is no slant."""
    return felt if slant is None else slant.straightened_felt(felt)
