"""Where the middle of an end lies: as felt, for an object may lean otherwise than its contours.

Between the last row and the end, sections are the row scaled by the end's profile about an axis
that runs straight to the end's middle. At the height of a felt point, its distance across the
section is linear in where that middle lies; the contours' own lean counts as a few points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.rebuild.ends.ends import End
from palpate.core.rebuild.felt.felt_points import FeltPoints

PRIOR = 2.0
"""As many points at the very end, felt from each side, does the lean of the contours count."""
PASSES = 4
"""Azimuths are taken about the middle, which moves."""
MOST = 1.0
"""Of the row's radius: an end whose middle seems to lie farther off was not understood."""


def with_felt_middle(end: End, row: Floats, felt: FeltPoints) -> End:
    """The end about the middle that was felt.

    Parameters
    ----------
    end : End
        The end, its middle as the contours lean.
    row : (k, 2) array
        The last row of the side, m.
    felt : FeltPoints
        With normals.
    """
    assert felt.normals is not None
    gap = end.height - end.rim
    if not abs(gap) > 0.0:
        return end
    way = (felt.points[:, 2] - end.rim) / gap
    beyond = (way > 0.0) & (way <= 1.0)
    if not beyond.any():
        return end
    points, normals, way = felt.points[beyond, :2], felt.normals[beyond, :2], way[beyond]
    centre, shares = area_centroid(row), end.profile.shares(way)
    away = row - centre
    turns, radii = np.arctan2(away[:, 1], away[:, 0]), np.hypot(*away.T)
    before = end.middle - centre
    rows = way[:, None] * normals
    lean = before
    for _ in range(PASSES):
        from_axis = points - centre - way[:, None] * lean
        length = np.maximum(np.hypot(*from_axis.T), np.finfo(float).tiny)
        at = np.arctan2(from_axis[:, 1], from_axis[:, 0])
        seen = np.interp(at, turns[np.argsort(turns)], radii[np.argsort(turns)], period=2.0 * np.pi)
        section = (shares * seen / length)[:, None] * from_axis
        off = np.einsum("nd,nd->n", normals, points - centre - section)
        system = rows.T @ rows + PRIOR * np.eye(2)
        lean = np.linalg.solve(system, rows.T @ off + PRIOR * before)
    if not float(np.hypot(*lean)) <= max(MOST * float(radii.mean()), float(np.hypot(*before))):
        return end
    return replace(end, middle=centre + lean)
