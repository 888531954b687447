"""Where an object ends that was touched: heights, edges, middles and slopes of its ends.

Of a dome, which falls away from its highest touch, the height is the top of one quadric through all
taxels with a shift of each touch. Between the last row and an end, distances from the axis are
taken over that of the row on their azimuth, so that touches on any side of an oval or a box tell of
one edge. An oblique top, or a flat one seen along an axis that is a little off, is level after
every height has been moved by a slope that changes evenly from one end to the other: z = zeta + (p
+ q zeta) . (x, y). Sides, rims and ends are fitted there and carried back. Each touch of an end
tells how that leans there; touches that are flat and lean alike make a plane.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry import area_centroid, area_centroids
from palpate.core.rebuild.contours import ContactPoints, quadric_terms
from palpate.core.rebuild.ends.closing import End, close_rows
from palpate.core.rebuild.ends.profiles import EdgeSamples
from palpate.core.rebuild.side import RadialSpline

# Of end planes and their shear.
TOGETHER = 0.02  # Of the extent: how far off their plane they, or others above it, may lie
OUTER = 0.1  # Of the extent: so far below the outermost touch others must lean alike
# Touches that tell a plane or a height alone; of fewer, each may be wrong by this angle, and
# none that is not flat may lie beside them: a dome looks flat somewhere.
FEW, UNSURE = 3, math.radians(0.25)
SHORT = 2e-3  # Of the extent: what was touched so near to a given height is of that end
SURE = 3.0  # Standard deviations by which a slope must differ from none
LEAST = 1e-4  # Of the extent: what heights must be moved by to be worth it
LEVEL = 0.15  # Slope up to which an end is nearly level: one must be, else the axis leans
STEEPEST = 1.0  # Slope beyond which nothing was understood
ContactKind = Literal["flat", "bent", "edge"]
FACING_END = (
    0.8  # Part of a normal along the axis from which on a taxel lies on an end, sloping or not
)
FEWEST_TAXELS = 24  # Taxels of a touch: fewer met but an edge
# A touch is flat if its taxels lie no farther off a plane than this share of its width; with noise,
# if a bent surface follows them no better than by the second factor, nor the best touch its plane
# by the third: else it lies across an edge.
FLAT, BENT, WORSE = 2e-4, 1.4, 2.0
ALIKE = math.radians(2.0)  # How much otherwise than the outermost touches of a plane may lean
# A flat touch that leans less is level; of those that lean more each is as high as its highest
# taxel.
CONTACT_LEVEL = math.radians(0.5)
THIN = 0.1  # Of its width: what a touch must be wide at least, the other way, to lean in some way
LEAST_STRETCH = 0.25  # How far heights may be pressed together; farther aside both ends would meet
By = tuple[int, int]  # How often a surface is differentiated, by each of its two parameters
# Of heights, edges and middles.
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
FEWEST_TOUCHES = 3  # Touches: of fewer, the highest is as good
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
    """How far level touches of an end, and others, tell that it reaches, m."""
    heights = np.full(int(contacts.touch.max()) + 1, -np.inf)
    np.maximum.at(heights, contacts.touch[beyond], way * contacts.points[beyond, 2])
    met = [one for one in end_contacts_of(contacts, way) if np.isfinite(heights[one.touch])]
    level = [way * float(one.place[2]) for one in met if one.level]
    others = [float(heights[one.touch]) for one in met if one.kind != "edge" and not one.level]
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
    """How far an end reaches, along the axis, m, by taxels `on` it (n,); None if few touched it."""
    assert contacts.normals is not None
    reach = way * contacts.points[:, 2]
    deep = DEEP * float(np.ptp(reach))
    used = on & (way * contacts.normals[:, 2] > FACING) & (reach > reach[on].max() - deep)
    touch, counts = np.unique(contacts.touch[used], return_inverse=True)
    if len(touch) < FEWEST_TOUCHES:
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
    beyond = way * (contacts.points[:, 2] - last) > 0.0
    return np.asarray((way * contacts.normals[:, 2] > UPRIGHT) & beyond)


def end_from_contacts(
    contacts: ContactPoints,
    spline: RadialSpline,
    turns: Floats,
    rim: float,
    inwards: float,
    end: float | None,
    noise: float,
) -> End:
    """How the side, a radial spline, goes on from its first or last row, at `turns` (k,).

    That lies at the height `rim`, and the side goes on `inwards`, negative downwards; the end was
    touched at the height `end`; `noise` is the deviation of a row's points; all in m.
    """
    heights = np.sort(rim + STRETCH * inwards * np.arange(ROWS) / (ROWS - 1))
    grid = spline.rings(heights, turns)
    row = grid[0 if inwards > 0.0 else -1]
    radius = float(np.sqrt(np.mean(np.sum((row - area_centroid(row)) ** 2, axis=1))))

    def closed(lean: Floats) -> End:
        beyond = None if end is None else edge_samples(contacts, spline, rim, end, radius, lean)
        found = close_rows(heights, grid, end, noise, beyond, upper=inwards < 0.0)
        return with_touched_middle(found, row, contacts)

    away = heights - heights.mean()  # By how much the rows' middles move aside with the height
    middles = area_centroids(grid)
    ahead = away @ middles / float(away @ away) * (0.0 if end is None else end - rim)
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
    `end` are heights, `radius` the row's mean one, `lean` (2,) how far aside its middle lies, m.
    """
    assert contacts.normals is not None
    sign = 1.0 if end > rim else -1.0
    depth = sign * (contacts.points[:, 2] - rim)
    way = np.clip(depth / abs(end - rim), 0.0, 1.0)
    axis = spline.axis_curve.at(contacts.points[:, 2])
    away = contacts.points[:, :2] - axis - way[:, None] * lean
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
        lean = np.linalg.solve(rows.T @ rows + PRIOR * np.eye(2), rows.T @ off + PRIOR * before)
    if not float(np.hypot(*lean)) <= max(MOST * float(radii.mean()), float(np.hypot(*before))):
        return end
    return replace(end, middle=centre + lean)


class EndPlane(NamedTuple):
    """A plane over the slicing frame, z = height + slopes . (x, y)."""

    height: float  # At the origin, m
    slopes: Floats  # (2,)
    error: float  # Standard deviation of a slope

    def at(self, places: Floats) -> Floats:
        """Heights (n,) over places (n, 2), m."""
        return self.height + places @ self.slopes


def shear_between(
    contacts: ContactPoints, middle: Floats, ends: tuple[float | None, float | None]
) -> Shear | None:
    """The shear of the space between the ends; None where both are level, or not planes.

    By all taxels, with normals, and the object's middle (2,), seen from the slicing frame. An end
    where no taxel was is level at its height in `ends`, m; one that nobody knows is like the other.
    """
    extent = float(np.ptp(contacts.points[:, 2]))
    low, high = end_plane(contacts, -1.0), end_plane(contacts, 1.0)
    away = contacts.points[:, :2] - middle
    reach = float(np.linalg.norm(away, axis=1).max())
    slopes = [(float(np.linalg.norm(one.slopes)), one.error) for one in (low, high) if one]
    if not any(slope > SURE * error and slope * reach > LEAST * extent for slope, error in slopes):
        return None
    below = low or _like(high, contacts, -1.0, ends[0], middle)
    above = high or _like(low, contacts, 1.0, ends[1], middle)
    bottom, top = (float(plane.at(middle[None])[0]) for plane in (below, above))
    if not top > bottom:
        return None
    change = (above.slopes - below.slopes) / (top - bottom)
    shear = Shear(middle, below.slopes - bottom * change, change)
    steep = sorted(float(np.linalg.norm(plane.slopes)) for plane in (below, above))
    sound = bool(shear.reaches(contacts.points).all()) and steep[0] < LEVEL and steep[1] < STEEPEST
    return shear if sound else None


def end_plane(contacts: ContactPoints, way: float) -> EndPlane | None:
    """The plane of an end, way 1 or -1; None if it was not touched as one."""
    end_contacts = end_contacts_of(contacts, way)
    flat = [one for one in end_contacts if one.kind == "flat"]
    if not flat:
        return None
    extent = float(np.ptp(contacts.points[:, 2]))
    first = max(flat, key=lambda contact: way * float(contact.place[2]))
    outer = OUTER * extent
    near = [one for one in end_contacts if way * float(first.place[2] - one.place[2]) <= outer]
    alike = [one for one in flat if first.leans_as(one) and first.misses(one) <= TOGETHER * extent]
    others = [one for one in near if one.kind == "flat" and not first.leans_as(one)]
    beside = [one for one in near if one.kind != "flat" and first.misses(one) <= TOGETHER * extent]
    if len(others) >= len(alike) or (beside and len(alike) < FEW):
        return None
    slopes = np.stack([one.slopes for one in alike])
    mean = slopes.mean(axis=0)
    height = float(np.mean([one.place[2] - one.place[:2] @ mean for one in alike]))
    scatter = np.sqrt(np.mean((slopes - mean) ** 2)) if len(alike) >= FEW else math.tan(UNSURE)
    plane = EndPlane(height, mean, float(scatter / np.sqrt(len(alike))))
    beyond = float((way * (contacts.points[:, 2] - plane.at(contacts.points[:, :2]))).max())
    return plane if beyond < TOGETHER * extent else None


def _like(
    other: EndPlane | None, contacts: ContactPoints, way: float, given: float | None, middle: Floats
) -> EndPlane:
    """What stands for an end that is no plane: level if only given, else as the other one."""
    assert other is not None
    if given is not None and only_given(contacts, way, given):
        return EndPlane(given, np.zeros(2), 0.0)
    farthest = way * float((way * contacts.points[:, 2]).max())
    return EndPlane(farthest - float(middle @ other.slopes), other.slopes, other.error)


def only_given(contacts: ContactPoints, way: float, given: float | None) -> bool:
    """Whether an end is known by a given height alone, as by a platform: no taxel there faces."""
    if given is None:
        return False
    assert contacts.normals is not None
    heights = way * contacts.points[:, 2]
    there = heights > way * given - SHORT * float(np.ptp(heights))
    return not bool((way * contacts.normals[there, 2] > FACING_END).any())


class EndContact(NamedTuple):
    """A touch of an end."""

    touch: int  # Its number
    place: Floats  # Mean of its taxels, (3,), m
    slopes: Floats  # (2,)
    off: float  # How far its taxels lie off a plane, root mean square, m
    width: float  # Of its taxels, root mean square from their middle, m
    # flat: they lie in a plane; bent: a smooth surface follows them better; edge: neither, or they
    # lie in a line.
    kind: ContactKind

    def misses(self, other: EndContact) -> float:
        """How far another touch lies off its plane, along the axis, m."""
        height = self.place[2] + (other.place - self.place)[:2] @ self.slopes
        return abs(float(other.place[2] - height))

    @property
    def level(self) -> bool:
        """Whether all its taxels tell one height."""
        return self.kind == "flat" and float(np.linalg.norm(self.slopes)) < math.tan(CONTACT_LEVEL)

    def leans_as(self, other: EndContact) -> bool:
        """Whether another touch leans like it."""
        return float(np.linalg.norm(other.slopes - self.slopes)) < math.tan(ALIKE)


def end_contacts_of(contacts: ContactPoints, way: float) -> list[EndContact]:
    """The touches that face an end, way 1 or -1, with enough taxels to tell how it leans there."""
    assert contacts.normals is not None
    facing = np.flatnonzero(way * contacts.normals[:, 2] > FACING_END)
    counts = np.bincount(contacts.touch[facing], minlength=1)
    met = np.flatnonzero(counts >= FEWEST_TAXELS)
    if not len(met):
        return []
    facing = facing[counts[contacts.touch[facing]] >= FEWEST_TAXELS]
    facing = facing[np.argsort(contacts.touch[facing], kind="stable")]
    found = _end_contacts(
        met.astype(np.int32), counts[met].astype(np.int32), contacts.points[facing]
    )
    best = min(one.off for one in found)
    uneven = [one.kind == "flat" and one.off > WORSE * best + FLAT * one.width for one in found]
    pairs = zip(found, uneven, strict=True)
    return [one._replace(kind="edge") if worse else one for one, worse in pairs]


def _end_contacts(touches: Ints, counts: Ints, points: Floats) -> list[EndContact]:
    """Touches by their taxels (n, 3) that face an end, so many of each, in the touches' order."""
    row = np.repeat(np.arange(len(counts)), counts)
    column = np.arange(len(points)) - np.repeat(np.cumsum(counts) - counts, counts)
    begins = np.cumsum(counts) - counts
    places = np.add.reduceat(points, begins) / counts[:, None]
    away = points - places[row]
    squares = np.add.reduceat(np.square(away[:, :2]).sum(axis=1), begins) / counts
    widths = np.sqrt(squares)
    scale = np.where(widths > 0.0, widths, 1.0)  # In its own width: the unit does not matter
    local = away[:, :2] / scale[row, None]
    # One more column: its factor's last ones are what a plane, and a quadric, leave of the heights.
    equations = np.zeros((len(counts), int(counts.max()), 7))
    equations[row, column] = np.column_stack([quadric_terms(*local.T), away[:, 2]])
    factor = np.asarray(np.linalg.qr(equations, mode="r"), np.float64)
    offs = np.linalg.norm(factor[:, 3:, 6], axis=1) / np.sqrt(counts)
    left = np.abs(factor[:, 6, 6]) / np.sqrt(counts)
    planes = np.einsum("tij,tj->ti", np.linalg.pinv(factor[:, :3, :3]), factor[:, :3, 6])
    slopes = planes[:, 1:] / scale[:, None]
    moments = np.add.reduceat(local[:, :, None] * local[:, None], begins)
    narrow = np.linalg.eigvalsh(moments / (counts - 1)[:, None, None])[:, 0] < THIN**2
    is_bent = offs > BENT * left + FLAT * widths
    kinds: list[ContactKind] = ["flat", "bent", "edge"]
    kind = np.where(narrow, 2, is_bent.astype(int))
    return [
        EndContact(
            int(touches[i]), places[i], slopes[i], float(offs[i]), float(widths[i]), kinds[kind[i]]
        )
        for i in range(len(touches))
    ]


class Shear(NamedTuple):
    """By how much heights are moved; places are seen from the slicing frame, m."""

    middle: Floats  # Where nothing is moved, (2,)
    slopes: Floats  # At the height 0 of the levelled space, (2,)
    change: Floats  # By which they change with each m of it, (2,)

    def levelled(self, points: Floats) -> Floats:
        """Points (n, 3) in the levelled space."""
        away = points[:, :2] - self.middle
        heights = (points[:, 2] - away @ self.slopes) / (1.0 + away @ self.change)
        return np.column_stack([points[:, :2], heights])

    def reaches(self, points: Floats) -> Bools:
        """Which points (n, 3) it carries: those before the line in which both ends would meet."""
        return 1.0 + (points[:, :2] - self.middle) @ self.change > LEAST_STRETCH

    def sheared(self, points: Floats) -> Floats:
        """Points (n, 3) of the levelled space where they are."""
        away = points[:, :2] - self.middle
        moved = np.einsum("ni,ni->n", self._at(points[:, 2]), away)
        return np.column_stack([points[:, :2], points[:, 2] + moved])

    def levelled_contacts(self, contacts: ContactPoints) -> ContactPoints:
        """Contact points in the levelled space, normals square to what is the surface there."""
        points = self.levelled(contacts.points)
        if contacts.normals is None:
            return contacts._replace(points=points)
        upward = contacts.normals[:, 2:]
        level = contacts.normals[:, :2] + upward * self._at(points[:, 2])
        stretch = 1.0 + (points[:, :2] - self.middle) @ self.change
        normals = np.column_stack([level, upward[:, 0] * stretch])
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        return contacts._replace(points=points, normals=normals)

    def steepness(self, height: float) -> float:
        """How steep a plane is that is level at a height of the levelled space, m."""
        return float(np.linalg.norm(self._at(np.array([height]))))

    def carried(self, at: Callable[[By], Floats], by: By) -> Floats:
        """Where points `at((0, 0))` (n, 3) of the levelled space are, or derivatives, to 2."""
        points = at((0, 0))
        if by == (0, 0):
            return self.sheared(points)
        found = at(by).copy()
        stretch = 1.0 + (points[:, :2] - self.middle) @ self.change
        along = np.einsum("ni,ni->n", self._at(points[:, 2]), found[:, :2])
        found[:, 2] = found[:, 2] * stretch + along
        if sum(by) == 2:
            halves = ((1, 0), (0, 1)) if by == (1, 1) else ((by[0] // 2, by[1] // 2),) * 2
            one, other = (at(each) for each in halves)
            found[:, 2] += one[:, 2] * (other[:, :2] @ self.change)
            found[:, 2] += other[:, 2] * (one[:, :2] @ self.change)
        return found

    def _at(self, heights: Floats) -> Floats:
        """Slopes (n, 2) at heights (n,) of the levelled space."""
        return self.slopes + heights[:, None] * self.change


def levelled(shear: Shear | None, contacts: ContactPoints) -> ContactPoints:
    """Contact points in the levelled space; as they are if there is no shear."""
    return contacts if shear is None else shear.levelled_contacts(contacts)
