"""The side of an object, as it is rebuilt from the contours of an exploration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.explore.planners.choice import END_SHARE
from palpate.core.frames import inverse, split_pose, transform
from palpate.core.measure.distance import prepare
from palpate.core.measure.nearest import nearest_points
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.messages.types import Contour, ShapeModel, Truth

USABLE = ("closed", "occluded")
LEAST_POINTS = 8
WORST = 100.0
"""Error where nothing can be rebuilt, %."""


class Side(NamedTuple):
    """Of a true surface, between 3 and 97 % of its height."""

    points: Floats
    """Spread evenly by area, (n, 3), m."""
    height: float
    """Of the object, m."""

    def percent(self, vertices: Floats, faces: Ints) -> float:
        """Root mean square distance of the side from a mesh, % of the height."""
        found = nearest_points(prepare(vertices, faces).search, self.points).distances
        return float(100.0 * np.sqrt((found**2).mean()) / self.height)


def side_of(truth: Truth) -> Side:
    """The side of a true surface that stands upright."""
    points = prepare(truth.vertices, truth.faces).samples.points
    low = float(truth.vertices[:, 2].min())
    share = (points[:, 2] - low) / truth.height
    return Side(points[(share >= END_SHARE) & (share <= 1.0 - END_SHARE)], truth.height)


def of_contours(side: Side, contours: Sequence[Contour], *, slopes: bool) -> float:
    """Error of the side that is rebuilt from contours alone, %.

    Parameters
    ----------
    side : Side
        The true one.
    contours : sequence of Contour
        Those without use are left out.
    slopes : bool
        With their normals; else from positions alone.
    """
    usable = [one for one in contours if one.status in USABLE and len(one.points) >= LEAST_POINTS]
    if len(usable) < 2:
        return WORST
    into = inverse(usable[0].frame)
    _, axes = split_pose(into)
    points = [transform(into, one.points) for one in usable]
    normals = [one.normals @ axes.T for one in usable] if slopes else None
    try:
        mesh = reconstruct(points, normals, method="skin").mesh()
    except ValueError:  # these contours make no solid
        return WORST
    there = Side(transform(into, side.points), side.height)
    return there.percent(mesh.vertices, mesh.faces)


def of_model(side: Side, model: ShapeModel) -> float:
    """Error of the side of a model that was rebuilt from everything that was felt, %."""
    return side.percent(model.vertices, model.faces) if len(model.faces) else WORST
