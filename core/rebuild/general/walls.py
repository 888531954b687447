"""How thin an object's walls are, from points that were touched on both sides of them.

Two sheets of a surface that pass through one cell of a spline bend each other, and may tear. Then
cells are made no larger than the walls. A wall is as thick as it is far from one point,
inwards along its normal, to points that face the other way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.core.geometry import point_tree
from palpate.core.rebuild.contours import ContactPoints


@dataclass(frozen=True, slots=True, kw_only=True)
class WallSettings:
    """Which points lie on both sides of a wall, and how small cells are for it."""

    spacing: float = 1.5e-3  # [m] of points of which pairs are sought, about
    opposite: float = -0.8  # cosine between the normals of two sides, at most
    aside: float = 0.6  # offset of the other side's point from the normal, of the thickness
    min_share: float = 0.25  # of all points, that must lie on walls touched from both sides
    thinnest: float = 0.02  # of all points, may lie on thinner walls than cells are made for
    cells: float = 1.0  # edge of a cell, of the thickness
    ratio: float = 1.25  # between one size of cells and the next: few touches do not change it


WALLS = WallSettings()


def wall_thickness(
    contacts: ContactPoints, most: float, settings: WallSettings = WALLS
) -> float | None:
    """Thickness than which few walls are thinner [m]; None where few points lie on walls at all.

    `most` [m]: what is thicker is no wall. Before much of both sides was touched, small cells tell
    less than large ones: what touches leave open goes through many of them.
    """
    assert contacts.normals is not None
    cubes = np.floor(contacts.points / settings.spacing)
    first_in = np.unique(cubes, axis=0, return_index=True)[1]
    points, normals = contacts.points[first_in], contacts.normals[first_in]
    pairs = point_tree(points).query_pairs(most, output_type="ndarray")
    first, second = pairs.T
    facing = np.einsum("ni,ni->n", normals[first], normals[second]) < settings.opposite
    first, second = first[facing], second[facing]
    between = points[second] - points[first]
    inwards = normals[second] - normals[first]  # from the first side to the second
    inwards /= np.linalg.norm(inwards, axis=1, keepdims=True)
    thickness = np.einsum("ni,ni->n", between, inwards)
    aside = np.linalg.norm(between - thickness[:, None] * inwards, axis=1)
    good = (thickness > 0.0) & (aside < settings.aside * thickness)
    nearest = np.full(len(points), np.inf)
    for side in (first[good], second[good]):
        np.minimum.at(nearest, side, thickness[good])
    if np.isfinite(nearest).mean() < settings.min_share:
        return None
    return float(np.quantile(nearest, settings.thinnest, method="lower"))


def wall_cell(contacts: ContactPoints, cell: float, settings: WallSettings = WALLS) -> float:
    """Edge of cells for the walls that were touched on both sides, at most `cell` [m]."""
    thickness = wall_thickness(contacts, 2.0 * cell, settings)
    if thickness is None or settings.cells * thickness >= cell:
        return cell
    steps = math.ceil(math.log(cell / (settings.cells * thickness), settings.ratio) - 1e-9)
    return float(cell / settings.ratio**steps)
