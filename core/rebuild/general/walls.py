"""Thickness of an object's walls, from points that were touched on both sides of them.

Two sheets of a surface that pass through one cell of a spline bend each other, and may tear. Then
cells are made no larger than the walls. The thickness of a wall is the distance from a point,
inwards along its normal, to points of opposite normals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.core.geometry import point_tree
from palpate.core.rebuild.contours import ContactPoints


@dataclass(frozen=True, slots=True, kw_only=True)
class WallSettings:
    """Which points lie on opposite sides of a wall, and how large cells are for it."""

    spacing: float = 1.5e-3  # [m] edge of cubes, of each of which one point is used; larger, faster
    max_opposite_cosine: float = -0.8  # between the normals of two sides
    max_offset_ratio: float = 0.6  # of a pair across its normal, over the thickness
    min_share: float = 0.25  # least fraction of all points that lie on walls
    thin_share: float = 0.02  # fraction of all points that may lie on thinner walls
    cell_ratio: float = 1.0  # edge of a cell over the thickness of the wall; larger is coarser
    size_ratio: float = 1.25  # of one cell size to the next: so that a few touches do not change it


def wall_thickness(
    contacts: ContactPoints, most: float, settings: WallSettings = WallSettings()
) -> float | None:
    """Thickness of the thinnest walls [m], a low quantile; None where few points lie on walls.

    `most` [m] is the largest thickness of a wall. Few points on walls do not count: untouched gaps
    span many small cells, so that small cells help only where both sides are well covered.
    """
    assert contacts.normals is not None
    cubes = np.floor(contacts.points / settings.spacing)
    first_in = np.unique(cubes, axis=0, return_index=True)[1]
    points, normals = contacts.points[first_in], contacts.normals[first_in]
    pairs = point_tree(points).query_pairs(most, output_type="ndarray")
    first, second = pairs.T
    facing = np.einsum("ni,ni->n", normals[first], normals[second]) < settings.max_opposite_cosine
    first, second = first[facing], second[facing]
    between = points[second] - points[first]
    inwards = normals[second] - normals[first]  # from the first side to the second
    inwards /= np.linalg.norm(inwards, axis=1, keepdims=True)
    thickness = np.einsum("ni,ni->n", between, inwards)
    aside = np.linalg.norm(between - thickness[:, None] * inwards, axis=1)
    good = (thickness > 0.0) & (aside < settings.max_offset_ratio * thickness)
    nearest = np.full(len(points), np.inf)
    for side in (first[good], second[good]):
        np.minimum.at(nearest, side, thickness[good])
    if np.isfinite(nearest).mean() < settings.min_share:
        return None
    return float(np.quantile(nearest, settings.thin_share, method="lower"))


def wall_cell(
    contacts: ContactPoints, cell: float, settings: WallSettings = WallSettings()
) -> float:
    """Edge of cells [m] that resolve the walls touched on both sides, at most `cell`."""
    thickness = wall_thickness(contacts, 2.0 * cell, settings)
    wanted = cell if thickness is None else settings.cell_ratio * thickness
    if wanted >= cell:
        return cell
    steps = math.ceil(math.log(cell / wanted, settings.size_ratio) - 1e-9)
    return float(cell / settings.size_ratio**steps)
