"""Where an object ends that was touched.

Heights, edges and middles of its ends from contact points.

Of a dome, which falls away from its highest touch, the height is the top of one quadric through
all taxels with a shift of each touch. Between the last row and an end, distances from the axis
are taken over that of the row on their azimuth, so that touches on any side of an oval or a box
tell of one edge. Where the end's middle lies is linear in distances across the section; the
contours' own lean counts as a few points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.geometry import area_centroid
from palpate.core.rebuild.contours import ContactPoints, quadric_terms
from palpate.core.rebuild.ends.closing import End, close_ends
from palpate.core.rebuild.ends.profiles import EdgeSamples
from palpate.core.rebuild.ends.shear import end_contacts_of
from palpate.core.rebuild.radial import RadialSpline

FEW = 3  # Level touches that tell the height of an end by themselves
UPRIGHT = 0.9  # Part of a normal along the axis from which on a taxel lies on an end
# Standard deviations by which a touch of one height may lie below the mean of higher ones; and of
# level touches, which scatter, but do not fall away.
NOISES, LEVEL_NOISES = 3.0, 4.0
ROWS = 14  # Rows from which an end is told
STRETCH = 0.15  # Share of the side over which they lie
# Of the last row's radius: an end whose middle lies farther aside of where the rows lead is seen
# about its own axis.
LEANS = 0.15
FACING = 0.995  # Part of a normal along the axis from which on a taxel belongs to the dome
DEEP = 0.01  # Of the extent: how far below the farthest taxel it still does
FEWEST = 3  # Touches: of fewer, the highest is as good
SURER = 0.1  # Taxels err so much less than the poses; the quadric may be as wrong
PRIOR = 2.0  # As many points at the very end, from each side, does the contours' lean count
PASSES = 4  # Azimuths are taken about the middle, which moves
MOST = 1.0  # Of the row's radius: an end whose middle seems to lie farther off was not understood
BINS = 12  # Heights between the last row and the end at which points are averaged
LEAST_FACING = 0.2  # Radial part of a normal: a point on a level face tells nothing of the radius
SECTORS, FEWEST_SECTORS = 12, 4  # Of a turn, and those with points: one alone may be a feature
REACH = 0.6  # Of the way to the end: nearer touches tell the same of all ends, which begin alike
# Of the way to the end: what was touched farther lies on it. A row of taxels over a sharp edge has
# normals between both sides, and would pass for a rounding.
NEARLY = 0.95
WALL = 0.4  # Mean radial part of the normals: where they lean over the end, nothing is an edge
TURNS = 192  # At which the last row is taken


def touched_end(
    contacts: ContactPoints, last: float, way: float, pose: float | None, given: float | None
) -> float | None:
    """Height of an end, m, from the taxels that touched it; as given, if none did.

    Each touch errs by its pose, and the farthest of many by the luckiest one's: so those that may
    be one height are averaged, from the highest on. What does not lie beyond the `last` contour
    tells nothing of the end. `way` is 1 for the upper end and -1 for the lower one; `pose` the
    standard deviation of a touch's height, m, None without noise to be seen; `given` the height at
    which the end was touched by whatever means, m.
    """
    beyond = on_end(contacts, last, way)
    if not beyond.any():
        return given
    within = NOISES * (pose or 0.0)
    level, others = _touched_heights(contacts, beyond, way)
    told = _one_height(np.concatenate([level, others]), within)
    # Level touches decide if nothing that was touched reaches over them.
    is_level = len(level) >= FEW and told <= float(level.max()) + within
    found = told
    if is_level:
        found = _one_height(level, LEVEL_NOISES * (pose or 0.0))
    elif pose is not None:
        dome = dome_height(contacts, beyond, way)
        found = told if dome is None else dome
    farthest = float((way * contacts.points[beyond, 2]).max())
    if given is None or way * given <= farthest:
        return way * found
    # Without noise the farthest is the truest; with it, the mean of what may be one height.
    is_one = pose is not None and way * given - found <= within
    return way * (found if is_one else max(found, way * given))


def _touched_heights(contacts: ContactPoints, beyond: Bools, way: float) -> tuple[Floats, Floats]:
    """How far touches of an end tell that it reaches, m: level ones, and others.

    A level touch tells it by all its taxels, another by the farthest; one across an edge tells
    nothing, nor do a few taxels beside whole touches.
    """
    heights = np.full(int(contacts.touch.max()) + 1, -np.inf)
    np.maximum.at(heights, contacts.touch[beyond], way * contacts.points[beyond, 2])
    end_contacts = [
        one for one in end_contacts_of(contacts, way) if np.isfinite(heights[one.touch])
    ]
    level = [way * float(one.place[2]) for one in end_contacts if one.level]
    others = [
        float(heights[one.touch]) for one in end_contacts if one.kind != "edge" and not one.level
    ]
    if not level and not others:
        return np.zeros(0), heights[np.isfinite(heights)]
    return np.array(level), np.array(others)


def _one_height(heights: Floats, within: float) -> float:
    """Mean of the highest and of those that each lie within so much of the mean of higher ones."""
    falling = np.sort(heights)[::-1]
    means = np.cumsum(falling) / np.arange(1, len(falling) + 1)
    beyond = np.flatnonzero(falling[1:] < means[:-1] - within)
    return float(means[beyond[0] if len(beyond) else -1])


def dome_height(contacts: ContactPoints, on: Bools, way: float) -> float | None:
    """How far an end reaches, along the axis in its own direction, m; None if few touched it.

    `contacts` have normals, `on` (n,) tells which of them lie on the end, `way` is as of
    `touched_end`.
    """
    assert contacts.normals is not None
    reach = way * contacts.points[:, 2]
    deep = DEEP * float(np.ptp(reach))
    used = on & (way * contacts.normals[:, 2] > FACING) & (reach > reach[on].max() - deep)
    touch, counts = np.unique(contacts.touch[used], return_inverse=True)
    if len(touch) < FEWEST:
        return None
    places = contacts.points[used, :2]
    middle = places.mean(axis=0)
    scale = max(float(np.abs(places - middle).max()), np.finfo(float).tiny)
    quadric = quadric_terms(*((places - middle) / scale).T)
    shifts = np.eye(len(touch))
    rows = np.block([[quadric, shifts[counts]], [np.zeros((len(touch), 6)), SURER * shifts]])
    right = np.concatenate([reach[used], np.zeros(len(touch))])
    found = np.linalg.lstsq(rows, right, rcond=None)[0]
    return float((quadric @ found[:6]).max())


def on_end(contacts: ContactPoints, last: float, way: float) -> Bools:
    """Which taxels (n,) lie on an end, way 1 or -1, beyond the last contour at a height, m."""
    if contacts.normals is None:
        return np.zeros(len(contacts.points), np.bool_)
    found: Bools = (way * contacts.normals[:, 2] > UPRIGHT) & (
        way * (contacts.points[:, 2] - last) > 0.0
    )
    return found


def end_from_contacts(
    contacts: ContactPoints,
    spline: RadialSpline,
    turns: Floats,
    rim: float,
    inwards: float,
    end: float | None,
    noise: float,
) -> End:
    """How the side, a radial spline, goes on from its first or last row.

    The row has `turns` (k,) and the height `rim`, from which the side goes on `inwards`, negative
    downwards; the end was touched at the height `end`; `noise` is the standard deviation of a point
    of a row; all in m.
    """
    heights = np.sort(rim + STRETCH * inwards * np.arange(ROWS) / (ROWS - 1))
    grid = spline.rings(heights, turns)
    row = grid[0 if inwards > 0.0 else -1]
    radius = float(np.sqrt(np.mean(np.sum((row - area_centroid(row)) ** 2, axis=1))))

    def closed(lean: Floats) -> End:
        beyond = None if end is None else edge_samples(contacts, spline, rim, end, radius, lean)
        if inwards > 0.0:
            below = beyond, None
            ends = close_ends(heights, grid, bottom=end, noise=noise, dense=True, beyond=below)
            return with_touched_middle(ends[0], row, contacts)
        above = None, beyond
        ends = close_ends(heights, grid, top=end, noise=noise, dense=True, beyond=above)
        return with_touched_middle(ends[1], row, contacts)

    ahead = _lean(heights, grid) * (0.0 if end is None else end - rim)
    first = closed(ahead)
    lean = first.middle - area_centroid(row)
    if end is None or float(np.hypot(*(lean - ahead))) < LEANS * radius:
        return first
    return closed(lean)


def edge_samples(
    contacts: ContactPoints,
    spline: RadialSpline,
    rim: float,
    end: float,
    radius: float,
    lean: Floats,
) -> EdgeSamples | None:
    """Mean radii between the last row and the end; None where too little was touched.

    From contacts as measured, for shifts that fit the smooth side would hide the edge. `rim` and
    `end` are the heights of the side's last row and of the end, `radius` is that row's mean one,
    and `lean` (2,) how far aside of its middle the end's middle lies, m.
    """
    assert contacts.normals is not None
    sign = 1.0 if end > rim else -1.0
    depth = sign * (contacts.points[:, 2] - rim)
    way = np.clip(depth / abs(end - rim), 0.0, 1.0)
    away = (
        contacts.points[:, :2] - spline.axis_curve.at(contacts.points[:, 2]) - way[:, None] * lean
    )
    distance = np.maximum(np.linalg.norm(away, axis=1), np.finfo(float).tiny)
    facing = np.einsum("ni,ni->n", contacts.normals[:, :2], away) / distance
    told = (depth > 0.0) & (depth < NEARLY * abs(end - rim)) & (facing > LEAST_FACING)
    turns = np.mod(np.arctan2(away[told, 1], away[told, 0]) / (2.0 * np.pi), 1.0)
    at = np.arange(TURNS) / TURNS
    row = np.sqrt(spline.squared(np.array([rim]), at)[0])
    share = distance[told] / np.interp(turns, at, row, period=1.0)
    bins = np.minimum((depth[told] / abs(end - rim) * BINS).astype(int), BINS - 1)
    seen = np.zeros((BINS, SECTORS), np.bool_)
    seen[bins, (turns * SECTORS).astype(int)] = True
    enough = seen.sum(axis=1) >= FEWEST_SECTORS
    if not enough[int(REACH * BINS) :].any():
        return None

    def mean(values: Floats) -> Floats:
        sums = np.bincount(bins, values * facing[told], BINS)[enough]
        return np.asarray(sums / np.bincount(bins, facing[told], BINS)[enough])

    counts = np.bincount(bins, minlength=BINS)[enough]
    weights = np.bincount(bins, facing[told], BINS)[enough] / counts
    if weights.mean() < WALL:
        return None
    return EdgeSamples(sign * rim + mean(depth[told]), radius * mean(share), weights)


def with_touched_middle(end: End, row: Floats, contacts: ContactPoints) -> End:
    """The end about the middle that was touched, beside a last row (k, 2), m."""
    assert contacts.normals is not None
    gap = end.height - end.rim
    if not abs(gap) > 0.0:
        return end
    way = (contacts.points[:, 2] - end.rim) / gap
    beyond = (way > 0.0) & (way <= 1.0)
    if not beyond.any():
        return end
    points, normals, way = contacts.points[beyond, :2], contacts.normals[beyond, :2], way[beyond]
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


def _lean(heights: Floats, grid: Floats) -> Floats:
    """By how much the middles of rows (m, k, 2) move aside along the height, (2,)."""
    away = heights - heights.mean()
    middles = np.array([area_centroid(ring) for ring in grid])
    return np.asarray(away @ middles / float(away @ away))
