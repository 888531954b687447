"""Felt points as equations for the squared distance from the axis, one a point.

Each point counts by its distance along its own normal: to first order that is the misfit of the
squared distance, times the radial part of the normal, over twice the distance from the axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.spine import Spine
from palpate.core.splines.basis import Basis, PeriodicBasis

LEAST_DISTANCE = 0.05
"""Least distance from the axis in a point's weight, as a share of the median."""
LEAST_FACING = 0.05
"""Least radial part of a normal: a point on a level face says nothing of the distance."""
INWARD, MOST_INWARD = -0.2, 0.03
"""Radial part of a normal below which a point looks towards the axis, and the share of such points
above which sections are not star-shaped about it."""


class SideRows(NamedTuple):
    """The points that tell of the side."""

    matrix: csr_array
    """(n, along * around): from coefficients to distances along the normals, over m."""
    target: Floats
    """(n,), m."""
    normals: Floats
    """(n, 3)."""
    touch: Ints
    """(n,)."""
    heights: Floats
    """(n,), m."""
    places: Floats
    """(n, 2): along the heights, from 0 to 1, and around in turns."""
    middle: float
    """Median distance from the axis, m."""


def looks_inward(felt: FeltPoints, spine: Spine) -> bool:
    """Whether too many points look towards the axis for one distance a turn; needs normals."""
    if felt.normals is None or not len(felt.points):
        return False
    _, _, facing = _about(felt.points, felt.normals, spine)
    return bool(np.mean(facing < INWARD) > MOST_INWARD)


def side_rows(
    felt: FeltPoints, spine: Spine, low: float, high: float, along: Basis, around: PeriodicBasis
) -> SideRows:
    """Equations of the points between two heights.

    Parameters
    ----------
    felt : FeltPoints
        With normals; those outside the heights, or on level faces, are left out.
    spine : Spine
        The axis.
    low, high : float
        Heights, m.
    along, around : Basis, PeriodicBasis
        Splines along the heights, over 0 to 1, and around.

    Raises
    ------
    ValueError
        If no point is left.
    """
    assert felt.normals is not None
    away, distance, facing = _about(felt.points, felt.normals, spine)
    height = felt.points[:, 2]
    within = (height >= low) & (height <= high) & (facing > LEAST_FACING)
    if not within.any():
        raise ValueError(f"no felt point lies on the side between {low:g} and {high:g} m")
    away, distance, facing = away[within], distance[within], facing[within]
    turns = np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi)
    middle = float(np.median(distance))
    # Next to the axis the first order is worth nothing: no point counts more than those there.
    weights = facing / (2.0 * np.maximum(distance, LEAST_DISTANCE * middle))
    height = height[within]
    local = np.clip((height - low) / (high - low), 0.0, 1.0)
    basis = tensor_rows(along.matrix(local), around.matrix(turns))
    return SideRows(
        csr_array(diags_array(weights) @ basis),
        weights * distance**2,
        felt.normals[within],
        felt.touch[within],
        height,
        np.stack([local, turns], axis=-1),
        middle,
    )


def tensor_rows(first: csr_array, second: csr_array) -> csr_array:
    """Row by row product of two sparse bases, (n, first columns * second columns)."""
    counts = np.diff(first.indptr)[0], np.diff(second.indptr)[0]
    n = first.shape[0]
    values = first.data.reshape(n, counts[0], 1) * second.data.reshape(n, 1, counts[1])
    columns = first.indices.reshape(n, counts[0], 1) * second.shape[1] + second.indices.reshape(
        n, 1, counts[1]
    )
    pointers = np.arange(0, n * counts[0] * counts[1] + 1, counts[0] * counts[1])
    shape = (n, first.shape[1] * second.shape[1])
    return csr_array((values.ravel(), columns.ravel(), pointers), shape=shape)


def _about(points: Floats, normals: Floats, spine: Spine) -> tuple[Floats, Floats, Floats]:
    """Places (n, 2) about the axis, distances from it, and the radial parts of the normals."""
    away = points[:, :2] - spine.at(points[:, 2])
    distance = np.linalg.norm(away, axis=1)
    least = np.finfo(float).eps * max(float(distance.max(initial=0.0)), np.finfo(float).tiny)
    facing = np.einsum("ni,ni->n", normals[:, :2], away) / np.maximum(distance, least)
    return away, distance, facing
