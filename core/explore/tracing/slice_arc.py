"""What one touch tells the tracer: the arc in which the touched surface meets the slice.

One point in each column of taxels, and column by column the band of heights that was touched
without a break beside it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats
from palpate.core.poses import split_pose
from palpate.core.touch import Jet, Pad

NEIGHBOURS = 8  # Pairs of taxels that tell the slope nearest to the slice
LEAN = 0.36  # Slope to assume where only an edge of the pad touches: 20 degrees
Indices = NDArray[np.intp]
# Two neighbouring taxels belong to one surface if they differ by less than this many pitches.
STEEP = 2.0
# First row, counted from the one before the slice, and number of rows that a polynomial goes
# through: the first window of which all rows are touched.
WINDOWS = ((-1, 4), (-2, 4), (0, 4), (-1, 3), (0, 3), (0, 2))
MOST_ROWS = 4
# Columns with more than two rows that do without those that have two: a corner of the pad in a
# hollow has few of either.
AMPLE = 6
ROUNDS = 3  # Newton steps from the straight line's crossing: the next changes less than rounding


class SliceArc(NamedTuple):
    """One touch, in the slicing frame."""

    points: Floats  # The arc, (n, 3), in the direction of travel; empty if the slice was not met
    normals: Floats  # Outward unit normals along it, (n, 3)
    # Normal curvature across the contour along it, (n,), 1/m; convex is positive; 0 where the
    # surface is not smooth.
    across: Floats
    low: Floats  # Lowest height touched below each of its points without a break, (n,), m
    high: Floats  # Highest height touched above them, (n,), m
    # Slope of the surface against the pad along the pad's y axis, where it is nearest to the slice.
    slope: float
    nearest: Floats  # The touched point nearest to the slice in height, (3,)
    pad: Floats  # Middle of the pad's face, (3,)
    above: int  # Touched taxels above the slice
    below: int  # Touched taxels below it


def arc_in_slice(
    pad: Pad,
    pose: Floats,
    surface: Floats,
    touched: Bools,
    jet: Jet | None,
    height: float,
    smooth: bool = True,
) -> SliceArc | None:
    """Arc of a touched surface at a slice height.

    `pose` (7,): pose of the pad in the slicing frame. `surface` (rows, cols): surface over the
    plane of the pad's face, m. `touched` (rows, cols) of bool: where the pad touches. `jet`: the
    surface's jet; without one the pad's own normal stands in. `height`: height of the slice, m.
    None if nothing is touched.
    """
    if not touched.any():
        return None
    position, axes = split_pose(pose)
    x, y = pad.grid()
    above = position[2] + axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * surface - height
    found = crossings(pad, above, surface, touched)
    low, high = contact_bands(above, same_surface(pad, surface, touched), found)
    local = found.places
    if len(local) and jet is not None:
        slope_x, slope_y = jet.slopes(local[:, 0], local[:, 1])
        curve = jet.second_derivatives(local[:, 0], local[:, 1])[2]
    else:
        slope_x = slope_y = curve = np.zeros(len(local))
    steepness = np.sqrt(1.0 + slope_x**2 + slope_y**2)
    outward = np.column_stack([slope_x, slope_y, -np.ones(len(local))]) / steepness[:, None]
    return SliceArc(
        points=local @ axes.T + position,
        normals=outward @ axes.T,
        across=curve / (steepness * (1.0 + slope_y**2)) * smooth,
        low=height + low,
        high=height + high,
        slope=float(np.median(slope_y)) if len(local) else _slope(pad, above, surface, touched),
        nearest=axes @ _nearest(pad, above, surface, touched) + position,
        pad=position,
        above=int((touched & (above > 0.0)).sum()),
        below=int((touched & (above < 0.0)).sum()),
    )


def crossings(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> Crossings:
    """Where the surface meets the slice, at most once in each column.

    A straight line between two rows stands off by up to an eighth of the curvature times the pitch
    squared, 4 um on a ball of 30 mm; a cubic through four rows by less than 0.1 um.
    """
    x, y = pad.grid()
    meets = (above[:-1] <= 0.0) != (above[1:] <= 0.0)
    row, col = np.nonzero(meets & same_surface(pad, surface, touched))
    rows, window = _windows(touched, row, col)
    row, col, rows, window = _curved(row, col, rows, window)
    share = above[row, col] / (above[row, col] - above[row + 1, col])
    rise, depth = (_polynomials(field, rows, col, window) for field in (above, surface))
    straight = share
    for _ in range(ROUNDS):
        value, slope = _values(rise, share)
        share = share - value / np.where(slope == 0.0, 1.0, slope)
    share = np.where((share >= 0.0) & (share <= 1.0), share, straight)
    up = y[row, col] + share * pad.pitch
    found = np.column_stack([x[row, col], up, _values(depth, share)[0]])
    order = np.lexsort((np.abs(found[:, 1]), col))
    first = np.ones(len(found), bool)
    first[1:] = np.diff(col[order]) > 0
    chosen = order[first]
    return Crossings(found[chosen], row[chosen], col[chosen])


def same_surface(pad: Pad, surface: Floats, touched: Bools) -> Bools:
    """Whether two neighbouring rows touch one surface, (rows - 1, cols)."""
    level: Bools = np.abs(surface[1:] - surface[:-1]) < STEEP * pad.pitch
    return touched[:-1] & touched[1:] & level


def _windows(touched: Bools, row: Indices, col: Indices) -> tuple[Indices, Indices]:
    """Rows (n, 4) of each crossing's polynomial, and the number of its window (n,)."""
    last = len(touched) - 1
    window = np.full(len(row), len(WINDOWS) - 1)
    for number in reversed(range(len(WINDOWS) - 1)):
        begin, count = WINDOWS[number]
        wanted = row[:, None] + begin + np.arange(count)
        inside = (wanted >= 0) & (wanted <= last)
        whole = (inside & touched[np.clip(wanted, 0, last), col[:, None]]).all(axis=1)
        window[whole] = number
    begins = np.array([begin for begin, _ in WINDOWS])[window]
    return np.clip((row + begins)[:, None] + np.arange(MOST_ROWS), 0, last), window


def _curved(
    row: Indices, col: Indices, rows: Indices, window: Indices
) -> tuple[Indices, Indices, Indices, Indices]:
    """The crossings without those that only a straight line goes through, if enough remain."""
    kept = window < len(WINDOWS) - 1
    if kept.sum() < AMPLE:
        return row, col, rows, window
    return row[kept], col[kept], rows[kept], window[kept]


def _polynomials(field: Floats, rows: Indices, col: Indices, window: Indices) -> Floats:
    """Coefficients (n, 4) along the rows, 0 at the row before the slice."""
    coefficients: Floats = np.einsum("nij,nj->ni", _OF_WINDOW[window], field[rows, col[:, None]])
    return coefficients


def _values(polynomials: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Values and slopes (n,) of polynomials (n, 4) at places (n,)."""
    a, b, c, d = polynomials.T
    return a + share * (b + share * (c + share * d)), b + share * (2.0 * c + share * 3.0 * d)


def contact_bands(above: Floats, one_surface: Bools, met: Crossings) -> tuple[Floats, Floats]:
    """Lowest and highest height touched without a break from where columns meet the slice.

    Only touched taxels count: of a domed pad's face the edge often hangs free.

    Returns `low`, `high` (n,): heights over the slice, m: 0 or less, 0 or more.
    """
    breaks = np.cumsum(~one_surface, axis=0)
    stretch = np.vstack([np.zeros_like(breaks[:1]), breaks])[:, met.columns]
    unbroken = stretch == stretch[met.rows, np.arange(len(met.rows))]
    heights = np.where(unbroken, above[:, met.columns], 0.0)
    return heights.min(axis=0), heights.max(axis=0)


def _slope(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> float:
    """Slope along y at the touched rows nearest to the slice, which was not met."""
    both = touched[:-1] & touched[1:]
    if both.sum() < 2:
        mean_y = float(pad.grid()[1][touched].mean())
        return -math.copysign(LEAN, mean_y)
    away = np.abs(above[1:] + above[:-1])[both]
    rise = (surface[1:] - surface[:-1])[both] / pad.pitch
    return float(np.median(rise[np.argsort(away, kind="stable")[:NEIGHBOURS]]))


def _nearest(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> Floats:
    """The surface's point (3,) nearest to the slice in height, pad frame, m."""
    x, y = pad.grid()
    nearest = np.where(touched, np.abs(above), np.inf).argmin()
    row, col = np.unravel_index(int(nearest), surface.shape)
    return np.array([x[row, col], y[row, col], surface[row, col]])


def deepest_point(pad: Pad, surface: Floats, touched: Bools) -> Floats:
    """The surface's point (3,) under the most compressed taxel, pad frame, m."""
    x, y = pad.grid()
    pressed = np.where(touched, -(surface + pad.sag()), -np.inf)
    row, col = np.unravel_index(int(pressed.argmax()), surface.shape)
    return np.array([x[row, col], y[row, col], surface[row, col]])


class Crossings(NamedTuple):
    """Where columns meet the slice, in their order."""

    places: Floats  # Pad frame, (n, 3), m
    rows: Indices  # The row before each, (n,)
    columns: Indices  # Its column, (n,)


def _coefficients(first: int, count: int) -> Floats:
    """What gives a polynomial's coefficients from its values on the rows, (4, 4)."""
    nodes = first + np.arange(count)
    matrix = np.zeros((MOST_ROWS, MOST_ROWS))
    matrix[:count, :count] = np.linalg.inv(np.vander(nodes, increasing=True).astype(float))
    return matrix


_OF_WINDOW = np.stack([_coefficients(*window) for window in WINDOWS])
