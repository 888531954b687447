"""Coons patches: a surface from its boundary curves, and closed surfaces from traced contours.

Two lofts between opposite curves, less the surface that both have in common: Coons, *Surfaces for
computer-aided design of space forms*, 1967; Farin, *Curves and surfaces for CAGD*, 5th ed., 2002,
chapter 22. The Coons patch of Fung, 1999, (1.3), is only the last of the three parts, with C(0, 1)
in place of C(1, 0). Curves are rows of points at parameters, and a patch interpolates all of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.geometry import area_centroid, azimuth_match, signed_area


class Slopes(NamedTuple):
    """Derivatives of a patch across its four curves [m]."""

    low: Floats  # by v at v = 0, (n, 3)
    high: Floats  # by v at v = 1, (n, 3)
    left: Floats  # by u at u = 0, (m, 3)
    right: Floats  # by u at u = 1, (m, 3)
    twists: Floats = np.zeros((2, 2, 3))  # by both at the corners, v before u


def coons_patch(low: ArrayLike, high: ArrayLike, left: ArrayLike, right: ArrayLike) -> Floats:
    """The bilinearly blended patch, (m, n, 3) [m].

    `low` and `high` (n, 3): the curves v = 0 and v = 1 at even u; `left` and `right` (m, 3): the
    curves u = 0 and u = 1 at even v [m]. Raises ValueError if curves are not finite, have fewer
    than 2 points, or do not meet at a corner.
    """
    rows, columns = _checked(low, high, left, right)
    v, u = (np.linspace(0.0, 1.0, len(curves[0])) for curves in (columns, rows))
    along, across = np.stack([1.0 - v, v], axis=1), np.stack([1.0 - u, u], axis=1)
    return _boolean_sum(along, rows, across, columns, rows[:, [0, -1]])


def hermite_patch(
    low: ArrayLike, high: ArrayLike, left: ArrayLike, right: ArrayLike, slopes: Slopes
) -> Floats:
    """The bicubically blended patch, (m, n, 3) [m], with slopes across its curves.

    Curves are as of `coons_patch`. Patches join smoothly where they have curve and slopes across it
    in common; the slopes at corners must be the curves' own there, and twists theirs. Raises
    ValueError as `coons_patch`, or if slopes are not as many as their curve's points.
    """
    rows, columns = _checked(low, high, left, right)
    across_rows = [finite_array("slopes", slope, (len(rows[0]), 3)) for slope in slopes[:2]]
    across_columns = [finite_array("slopes", slope, (len(columns[0]), 3)) for slope in slopes[2:4]]
    rows, columns = np.stack([*rows, *across_rows]), np.stack([*columns, *across_columns])
    v, u = np.linspace(0.0, 1.0, columns.shape[1]), np.linspace(0.0, 1.0, rows.shape[1])
    values = rows[:, [0, -1]]
    rates = np.concatenate([columns[2:, [0, -1]].swapaxes(0, 1), slopes.twists])
    corners = np.concatenate([values, rates], axis=1)
    return _boolean_sum(_hermite(v), rows, _hermite(u), columns, corners)


def _checked(
    low: ArrayLike, high: ArrayLike, left: ArrayLike, right: ArrayLike, max_gap: float = 1e-9
) -> tuple[Floats, Floats]:
    """Curves (2, n, 3) along u and (2, m, 3) along v that meet at all corners.

    `max_gap`: at the corners, fraction of the curves' size.
    """
    sides = {"low": low, "high": high, "left": left, "right": right}
    curves = {name: finite_array(name, curve, (None, 3)) for name, curve in sides.items()}
    for name, other in (("low", "high"), ("left", "right")):
        counts = len(curves[name]), len(curves[other])
        if counts[0] != counts[1] or counts[0] < 2:
            raise ValueError(f"{name} and {other} must have as many points, 2 at least: {counts}")
    size = float(np.ptp(np.vstack([*curves.values()]), axis=0).max())
    for name, other, end, start in (
        ("low", "left", 0, 0), ("low", "right", -1, 0),
        ("high", "left", 0, -1), ("high", "right", -1, -1),
    ):  # fmt: skip
        gap = float(np.linalg.norm(curves[name][end] - curves[other][start]))
        if gap > max_gap * size:
            raise ValueError(f"{name} and {other} must meet at a corner, but are {gap:g} m apart")
    return np.stack([curves["low"], curves["high"]]), np.stack([curves["left"], curves["right"]])


def _boolean_sum(
    along: Floats, rows: Floats, across: Floats, columns: Floats, corners: Floats
) -> Floats:
    """Loft of rows (k, n, 3) by weights (m, k), and of columns, less that of corners (k, k, 3)."""
    by_rows = np.einsum("mk,knc->mnc", along, rows)
    by_columns = np.einsum("nk,kmc->mnc", across, columns)
    return np.asarray(by_rows + by_columns - np.einsum("mk,nl,klc->mnc", along, across, corners))


def _hermite(t: Floats) -> Floats:
    """Cubics (k, 4) that have one each of value at 0, at 1, slope at 0, at 1."""
    square, cube = t * t, t * t * t
    start, leave = 2.0 * cube - 3.0 * square + 1.0, cube - 2.0 * square + t
    return np.stack([start, 1.0 - start, leave, cube - square], axis=1)


def coons_surface(
    contours: list[Floats], meridians: int, *, rows: int = 8, columns: int = 4
) -> Floats:
    """Points (r, c, 3) [m] of a smooth surface through closed contours: each row is a ring.

    `contours`: at least 3, each (n_i, 3) in order around the z axis, upwards [m], from any first
    point in either direction. `meridians`: number of azimuths at which curves join them. `rows` and
    `columns`: of points of each patch between neighbours. Rings run counter-clockwise seen from
    above, as `palpate.core.geometry.close_rings` takes them. A meridian's tangents are those of the
    parabola through three neighbours over their chords (Overhauser, 1968); patches on both sides of
    a contour share them. So the error between contours falls with the third power of their
    distance, and where they are evenly spaced with the fourth. Raises ValueError if there are too
    few contours or meridians, or a contour is not finite or encloses nothing.
    """
    if len(contours) < 3 or meridians < 3:
        got = f"got {len(contours)} and {meridians}"
        raise ValueError(f"a surface needs 3 contours and 3 meridians at least, {got}")
    count = meridians * columns
    rings = np.stack([_resampled(contour, i, count) for i, contour in enumerate(contours)])
    chords = np.linalg.norm(np.diff(rings, axis=0), axis=2)
    tangents = _tangents(rings, chords)
    contour_tangents = 0.5 * columns * (np.roll(rings, -1, axis=1) - np.roll(rings, 1, axis=1))
    bands = []
    for i in range(len(rings) - 1):
        two = slice(i, i + 2)
        rises = tangents[two] * chords[i, :, None]
        patches = [
            _patch(rings[two], rises, contour_tangents[two], columns, rows, first)
            for first in range(0, count, columns)
        ]
        bands.append(np.concatenate([patch[:-1, :-1] for patch in patches], axis=1))
    return np.concatenate([*bands, rings[-1:]])


def _resampled(contour: Floats, number: int, count: int) -> Floats:
    """A contour at even azimuths about its centroid, (count, 3), by a cubic through its points."""
    from scipy.interpolate import CubicSpline

    points = finite_array(f"contours[{number}]", contour, (None, 3))
    if len(points) < 3 or signed_area(points[:, :2]) == 0.0:
        raise ValueError(f"contours[{number}] must enclose an area, got {len(points)} points")
    if signed_area(points[:, :2]) < 0.0:
        points = points[::-1]
    closed = np.concatenate([points, points[:1]])
    steps = np.linalg.norm(np.diff(closed[:, :2], axis=0), axis=1)
    kept = np.concatenate([steps > 0.0, [True]])
    closed, lengths = closed[kept], np.concatenate([[0.0], np.cumsum(steps[steps > 0.0])])
    curve = CubicSpline(lengths / lengths[-1], closed, bc_type="periodic")
    azimuths = 2.0 * np.pi * np.arange(count) / count
    return np.asarray(curve(azimuth_match(closed[:-1, :2], area_centroid(points), azimuths).turns))


def _tangents(rings: Floats, chords: Floats) -> Floats:
    """Tangents (k, n, 3) by chord length, of parabolas through three rings (k, n, 3)."""
    rates = np.diff(rings, axis=0) / chords[..., None]
    before, after = chords[:-1, :, None], chords[1:, :, None]
    inner = (after * rates[:-1] + before * rates[1:]) / (before + after)
    return np.concatenate([2.0 * rates[:1] - inner[:1], inner, 2.0 * rates[-1:] - inner[-1:]])


def _patch(
    rings: Floats, rises: Floats, contour_tangents: Floats, columns: int, rows: int, first: int
) -> Floats:
    """One patch (rows + 1, columns + 1, 3) between two contours and two meridians."""
    here = np.arange(first, first + columns + 1) % rings.shape[1]
    ends = here[[0, -1]]
    v = _hermite(np.linspace(0.0, 1.0, rows + 1))
    sides = np.einsum("mk,kjc->jmc", v, np.concatenate([rings[:, ends], rises[:, ends]]))
    twists = 0.5 * columns * (np.roll(rises, -1, axis=1) - np.roll(rises, 1, axis=1))[:, ends]
    # Derivatives across the meridians: those of contours and tangents along the contours.
    away = np.einsum("mk,kjc->jmc", v, np.concatenate([contour_tangents[:, ends], twists]))
    slopes = Slopes(rises[0, here], rises[1, here], away[0], away[1], twists)
    return hermite_patch(rings[0, here], rings[1, here], sides[0], sides[1], slopes)
