"""Straight homogeneous generalised cones through touched points, axis and all.

A point at height s along the axis and azimuth theta about it has the radius f(s) g(theta): Fung,
1999, (1.4) with B = 0 absorbed, and 2.5.1. Three kinds are fitted: a surface of revolution, g = 1
and f a spline; a *linear* cone or cylinder, f straight and g free; and both free. Axis, f and g are
found together by Gauss-Newton steps of damped least squares over orthogonal factors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.geometry import close_rings
from palpate.core.poses import axes_along
from palpate.core.shapes import Mesh
from palpate.core.splines import clamped_basis

ConeKind = Literal["revolution", "linear", "free"]
Longs = NDArray[np.integer]
KNOT = 5.0e-3  # Between two knots of the profile, m
FEWEST_KNOTS, MOST_KNOTS = 4, 80
HARMONICS = 8  # Of a free section
STEPS, MOST_DAMPING = 30, 1e6
SETTLED, GAIN = 1e-10, 1e-4  # Of the points' extent, and of the residual: less gain ends it
LEAN = slice(2, 4)  # Where the axis's direction is among the parameters
EVERY = 40  # Points of a touch that count: more tell the same
SMOOTH = 1e-4  # Weight of second differences of what is free, over that of all points
DAMPING = (1e-3, 10.0)  # First of it, over the mean square of a column, and by how much it changes
STEEP = 5.0  # Slope of the profile beyond which its distance is not told by the radius
ROUND_ABOUT, ALONG, ROUND = 144, 120, 24  # Points of a mesh: around, along, and of a round end


class ConeFit(NamedTuple):
    """A generalised cone, its axis, and how well it fits."""

    kind: ConeKind
    point: Floats  # On the axis, (3,), m; heights count from here
    axis: Floats  # Unit vector, (3,)
    low: float  # Heights between which it was touched, m
    high: float
    profile: Floats  # Coefficients of the radius along the axis, m
    section: Floats  # Of cos and sin of 1, 2, ... times the azimuth, from `across` on: (2 h,)
    across: Floats  # Two unit vectors, (3, 2): azimuth 0 and a quarter turn
    rms: float  # Of the points' distances, m
    worst: float  # Distance of the touch that is farthest off, its points' root mean square, m
    axis_error: float  # Standard deviation of the axis's angle, rad

    def radius(self, heights: Floats, azimuths: Floats) -> Floats:
        """The radius (n,) at heights and azimuths, (n,) each, m; straight on beyond the ends."""
        return np.asarray(_profile(self, heights)[0] @ self.profile * _waves(self, azimuths))


def fit_cone(
    touches: Sequence[Floats],
    kind: ConeKind,
    point: Floats,
    axis: Floats,
    sigma: float,
    harmonics: int = HARMONICS,
    *,
    held: bool = False,
) -> ConeFit:
    """The cone through touches, (n, 3) points each, m, from an axis that is near its own.

    `point`, `axis` (3,): on the axis, m, and a unit vector along it. `sigma`: standard deviation of
    a touch across the surface, m, from which the axis's error follows. `harmonics`: of a section
    that is not round. `held`: its direction. Raises ValueError of fewer than 4 touches.
    """
    if len(touches) < 4:
        raise ValueError(f"a cone needs 4 touches, got {len(touches)}")
    some = [one[:: max(len(one) // EVERY, 1)] for one in touches]
    points, numbers = np.concatenate(some), np.repeat(np.arange(len(some)), list(map(len, some)))
    cone = _begun(points, kind, point, axis, 0 if kind == "revolution" else 2 * harmonics)
    damping, extent = DAMPING[0], float(np.ptp(points, axis=0).max())
    misses = _misses(cone, points)
    for _ in range(STEPS):
        columns = _columns(cone, points)
        columns[:, LEAN] *= not held
        step = _solved(columns, misses, cone, damping)
        moved = _moved(cone, step, points)
        after = _misses(moved, points)
        if after @ after < misses @ misses:
            before, rms = (math.sqrt(one @ one / len(one)) for one in (misses, after))
            cone, misses, damping = moved, after, damping / DAMPING[1]
            if before - rms < max(SETTLED * extent, GAIN * rms):
                break
        elif damping > MOST_DAMPING:
            break
        else:
            damping *= DAMPING[1]
    return _reported(cone, points, numbers, misses, sigma)


def _begun(points: Floats, kind: ConeKind, point: Floats, axis: Floats, waves: int) -> ConeFit:
    heights = (points - point) @ axis
    low, high = float(heights.min()), float(heights.max())
    count = 2
    if kind != "linear":
        count = min(max(round((high - low) / KNOT), FEWEST_KNOTS), MOST_KNOTS)
    frame = axes_along(axis)
    start = ConeFit(
        kind, point, axis, low, high, np.zeros(count), np.zeros(waves), frame[:, :2], 0.0, 0.0, 0.0
    )
    radii = np.linalg.norm(np.cross(points - point, axis), axis=1)
    rows = _profile(start, heights)[0]
    rough = SMOOTH * math.sqrt(len(rows)) * _roughness(start)[:, 4 : 4 + count]
    rows = np.vstack([rows, rough, SMOOTH**2 * np.eye(count)])
    wanted = np.concatenate([radii, np.zeros(len(rows) - len(radii))])
    return start._replace(profile=least_squares(rows, wanted))


def _polar(cone: ConeFit, points: Floats) -> tuple[Floats, Floats, Floats]:
    """Heights, azimuths and radii (n,) of points."""
    off = points - cone.point
    x, y = (off @ cone.across).T
    return off @ cone.axis, np.arctan2(y, x), np.hypot(x, y)


def _profile(cone: ConeFit, heights: Floats) -> tuple[Floats, Floats]:
    """What each coefficient of the profile gives at heights, (n, k), and its slope, 1/m."""
    length = max(cone.high - cone.low, 1e-9)
    x = (heights - cone.low) / length
    inside = np.clip(x, 0.0, 1.0)
    if len(cone.profile) == 2:
        ones = np.ones_like(x)
        return np.column_stack([1.0 - x, x]), np.column_stack([-ones, ones]) / length
    local = clamped_basis(len(cone.profile)).nonzero(inside, 1)
    rows, slopes = np.zeros((2, len(x), len(cone.profile)))
    np.put_along_axis(rows, local.columns(), local.values[0], axis=1)
    np.put_along_axis(slopes, local.columns(), local.values[1], axis=1)
    rows += (x - inside)[:, None] * slopes
    return rows, slopes / length


def _waves(cone: ConeFit, azimuths: Floats) -> Floats:
    """The section (n,), relative to its mean."""
    turns, _ = _harmonics(cone, azimuths)
    return np.asarray(1.0 + turns @ cone.section)


def _harmonics(cone: ConeFit, azimuths: Floats) -> tuple[Floats, Floats]:
    """Cosines and sines (n, 2 h) of the section, and their slopes."""
    orders = np.arange(1, len(cone.section) // 2 + 1)
    angles = np.outer(azimuths, orders)
    cosine, sine = np.cos(angles), np.sin(angles)
    return np.hstack([cosine, sine]), np.hstack([-orders * sine, orders * cosine])


def _misses(cone: ConeFit, points: Floats) -> Floats:
    """Distances (n,) of points, to first order, m; positive outside."""
    heights, azimuths, radii = _polar(cone, points)
    return np.asarray((radii - cone.radius(heights, azimuths)) / _stretch(cone, heights, azimuths))


def _stretch(cone: ConeFit, heights: Floats, azimuths: Floats) -> Floats:
    """How many times longer than the distance the way along the radius is, (n,)."""
    _, slopes = _profile(cone, heights)
    turns, turning = _harmonics(cone, azimuths)
    waves = 1.0 + turns @ cone.section
    steep = np.clip(slopes @ cone.profile * waves, -STEEP, STEEP)
    around = turning @ cone.section / np.maximum(waves, 0.1)
    return np.asarray(np.sqrt(1.0 + steep**2 + around**2))


def _columns(cone: ConeFit, points: Floats) -> Floats:
    """How distances change with place and lean of the axis, profile and section, (n, 4 + k)."""
    heights, azimuths, radii = _polar(cone, points)
    rows, slopes = _profile(cone, heights)
    turns, turning = _harmonics(cone, azimuths)
    base, waves = rows @ cone.profile, 1.0 + turns @ cone.section
    slope = slopes @ cone.profile * waves
    outward = np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    onward = np.column_stack([-np.sin(azimuths), np.cos(azimuths)])
    # The azimuth of a point goes back as the axis comes nearer to it from the side.
    swing = (base * (turning @ cone.section) / np.maximum(radii, 1e-6))[:, None] * onward
    place = -outward + swing
    lean = heights[:, None] * place - (slope * radii)[:, None] * outward
    columns = np.hstack([place, lean, -rows * waves[:, None], -base[:, None] * turns])
    return np.asarray(columns / _stretch(cone, heights, azimuths)[:, None])


def _roughness(cone: ConeFit) -> Floats:
    """Rows that are to vanish: second differences of a free profile, high waves of a section."""
    profile, section = len(cone.profile), len(cone.section)
    bends = np.diff(np.eye(profile), n=2, axis=0) if profile > 2 else np.zeros((0, profile))
    orders = np.tile(np.arange(1, section // 2 + 1), 2)
    waves = np.diag(orders**2 * float(np.mean(cone.profile) if profile else 1.0))
    rows = np.zeros((len(bends) + section, 4 + profile + section))
    rows[: len(bends), 4 : 4 + profile] = bends
    rows[len(bends) :, 4 + profile :] = waves
    return rows


def _solved(columns: Floats, misses: Floats, cone: ConeFit, damping: float) -> Floats:
    """The damped step (4 + k,) that takes the misses away."""
    rough = SMOOTH * math.sqrt(len(misses)) * _roughness(cone)
    held = rough @ np.concatenate([np.zeros(4), cone.profile, cone.section])
    sizes = np.sqrt(np.mean(columns**2, axis=0)) + 1e-12
    damped = np.diag(math.sqrt(damping * len(misses)) * sizes)
    rows = np.vstack([columns, rough, damped])
    wanted = np.concatenate([-misses, -held, np.zeros(len(damped))])
    return np.asarray(least_squares(rows / sizes, wanted) / sizes)


def least_squares(rows: Floats, wanted: Floats) -> Floats:
    """The solution (k,) of full rank, by orthogonal factors."""
    factor = np.asarray(np.linalg.qr(np.column_stack([rows, wanted]), mode="r"))
    count = rows.shape[1]
    return np.asarray(np.linalg.solve(factor[:count, :count], factor[:count, count]))


def _moved(cone: ConeFit, step: Floats, points: Floats) -> ConeFit:
    """The cone after a step, and where on the moved axis its touched part now lies."""
    axis = cone.axis + cone.across @ step[LEAN]
    axis /= np.linalg.norm(axis)
    first = cone.across[:, 0] - (cone.across[:, 0] @ axis) * axis
    first /= np.linalg.norm(first)
    profile = len(cone.profile)
    return cone._replace(
        point=cone.point + cone.across @ step[:2],
        axis=axis,
        across=np.column_stack([first, np.cross(axis, first)]),
        profile=cone.profile + step[4 : 4 + profile],
        section=cone.section + step[4 + profile :],
    )


def _reported(
    cone: ConeFit, points: Floats, numbers: Longs, misses: Floats, sigma: float
) -> ConeFit:
    """The cone with its residuals, and the error of its axis."""
    columns = _columns(cone, points)
    counts = np.bincount(numbers)
    # The points of a touch share its error: they count as one.
    weighed = columns / (sigma * np.sqrt(counts[numbers]))[:, None]
    rough = SMOOTH * math.sqrt(len(counts)) / sigma * _roughness(cone)
    sizes = np.sqrt(np.mean(weighed**2, axis=0)) + 1e-12
    inverse = np.linalg.pinv(np.vstack([weighed, rough]) / sizes)
    spread = np.sqrt((inverse**2).sum(axis=1)) / sizes
    by_touch = np.sqrt(np.bincount(numbers, misses**2) / counts)
    return cone._replace(
        rms=float(np.sqrt(np.mean(misses**2))),
        worst=float(by_touch.max()),
        axis_error=float(np.hypot(*spread[LEAN])),
    )


def side_points(cone: ConeFit, points: Floats, near: float, rim: float) -> Floats:
    """Those of points (n, 3) that are not on the rim of an end: far off, m, and near to one, m."""
    heights, _, _ = _polar(cone, points)
    at_end = np.minimum(heights - cone.low, cone.high - heights) < rim
    return points[~(at_end & (np.abs(_misses(cone, points)) > near))]


def widest_gap(cone: ConeFit, touches: Sequence[Floats]) -> float:
    """The widest turn about the axis that nothing has touched, rad."""
    azimuths = np.sort(_polar(cone, np.concatenate(touches))[1])
    return float(np.diff(np.append(azimuths, azimuths[0] + 2.0 * math.pi)).max())


class RoundEnd(NamedTuple):
    """An end that closes smoothly: its squared radius is a polynomial of the way from its pole."""

    pole: float  # Height, m
    edge: float  # Height at which it meets the profile, m
    powers: Floats  # Factors of the first, second and third power of the way, m, 1 and 1/m
    rms: float  # Of the points' distances, m

    def radius(self, heights: Floats) -> Floats:
        """The radius (n,) between the edge and the pole, m."""
        way = np.abs(self.pole - heights)
        return np.sqrt(np.maximum(way[:, None] ** np.arange(1, 4) @ self.powers, 0.0))


def fit_round_end(cone: ConeFit, points: Floats, pole: float, edge: float) -> RoundEnd:
    """A smooth end through points (n, 3), m, between its pole and where the profile is left.

    On a surface of revolution; of another section its mean radius.
    """
    heights, azimuths, radii = _polar(cone, points)
    radii = radii / _waves(cone, azimuths)
    between = np.linspace(edge, edge + 0.1 * (edge - pole), 10)
    heights = np.concatenate([heights, np.repeat(between, max(len(points) // 20, 1))])
    inner = cone.radius(between, np.zeros(10)) / _waves(cone, np.zeros(10))
    radii = np.concatenate([radii, np.repeat(inner, max(len(points) // 20, 1))])
    way = np.abs(pole - heights)
    rows = way[:, None] ** np.arange(1, 4)
    # The squared radius of a place is off by as much as the place, times its slope.
    weights = 1.0 / np.maximum(2.0 * radii + np.abs(pole - edge), 1e-6)
    powers = np.linalg.lstsq(rows * weights[:, None], radii**2 * weights, rcond=None)[0]
    off = (radii**2 - rows @ powers) * weights
    return RoundEnd(pole, edge, powers, float(np.sqrt(np.mean(off**2))))


def cone_mesh(cone: ConeFit, low: float | RoundEnd, high: float | RoundEnd) -> Mesh:
    """Its closed surface between two ends: plane at a height, m, or round."""
    ends = [one.edge if isinstance(one, RoundEnd) else one for one in (low, high)]
    heights = np.linspace(ends[0], ends[1], ALONG)
    azimuths = 2.0 * math.pi * np.arange(ROUND_ABOUT) / ROUND_ABOUT
    waves = _waves(cone, azimuths)
    means = cone.radius(heights, np.zeros(ALONG)) / _waves(cone, np.zeros(ALONG))
    poles = [ends[0], ends[1]]
    for number, one in enumerate((low, high)):
        if not isinstance(one, RoundEnd):
            continue
        # Closer and closer to the pole, where the surface turns into it.
        share = 1.0 - np.arange(1, ROUND) ** 2 / ROUND**2
        over = one.pole + share[:: 1 - 2 * (number == 0)] * (one.edge - one.pole)
        added = (over, heights) if number == 0 else (heights, over)
        radii = (one.radius(over), means) if number == 0 else (means, one.radius(over))
        heights, means, poles[number] = np.concatenate(added), np.concatenate(radii), one.pole
    ways = np.cos(azimuths)[:, None] * cone.across[:, 0]
    ways = ways + np.sin(azimuths)[:, None] * cone.across[:, 1]
    rings = (cone.point + heights[:, None] * cone.axis)[:, None] + (
        np.outer(np.maximum(means, 1e-6), waves)[:, :, None] * ways
    )
    bottom, top = (cone.point + one * cone.axis for one in poles)
    return Mesh(*close_rings(bottom, rings, top))
