"""Solids beside their definitions in extended precision, and slow casts to compare with."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from palpate.core import shapes
from palpate.core.arrays import Floats
from palpate.core.poses import Pose

Wide = np.longdouble
Level = Callable[[Any], Any]  # of points (..., 3) in m; positive outside, 0 on the surface
GOLDEN = Wide(0.5) * (np.sqrt(Wide(5)) - 1)
DOWN = np.array([0.0, 0.0, -1.0])
BOX_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
BOX_FACES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


@dataclass(frozen=True)
class Case:
    """A solid, made at any scale, and its definition at scale 1."""

    make: Callable[[float], Any]
    level: Level
    genus: int = 0

    @cached_property
    def solid(self) -> Any:
        return self.make(1.0)

    @cached_property
    def mesh(self) -> shapes.Mesh:
        return self.solid.mesh(4)


def superquadric(
    size: Any,
    exponents: Any,
    taper: tuple[float, float] = (0.0, 0.0),
    curvature: float = 0.0,
    azimuth: float = 0.0,
) -> Case:
    """Fung, 1999, (2.6) to (2.9); the level is the logarithm of the gauge of the base."""
    e1, e2 = exponents

    def make(scale: float) -> Any:
        base = shapes.Superquadric(scale * np.array(size), np.array(exponents))
        if taper == (0.0, 0.0) and curvature == 0.0:
            return base
        bend = shapes.Bend(curvature / scale, azimuth)
        return shapes.DeformedSuperquadric(base, np.array(taper), bend)

    def level(points: Any) -> Any:
        (x, y, z), exact = np.moveaxis(points, -1, 0), points.dtype.type
        k, cosine, sine = exact(curvature), np.cos(exact(azimuth)), np.sin(exact(azimuth))
        if k != 0:
            inwards = x * cosine + y * sine
            stretch = np.hypot(k * z, 1 - k * inwards)
            before = (2 * inwards - k * (inwards**2 + z**2)) / (1 + stretch)
            x, y = x + cosine * (before - inwards), y + sine * (before - inwards)
            z = np.arctan2(k * z, 1 - k * inwards) / k
        share = np.clip(z / size[2], -1, 1)
        with np.errstate(divide="ignore"):
            log_x = np.log(np.abs(x / (size[0] * (1 + taper[0] * share))))
            log_y = np.log(np.abs(y / (size[1] * (1 + taper[1] * share))))
            log_z = np.log(np.abs(z / size[2]))
        return log_norm(log_norm(log_x, log_y, e2), log_z, e1)

    return Case(make, level)


def log_norm(x: Any, y: Any, e: float) -> Any:
    """Logarithm of the norm of power 2 / e, from logarithms that may be -inf."""
    power = 2 / x.dtype.type(e)
    larger = np.maximum(np.maximum(x, y), x.dtype.type(-1e4))
    return larger + np.log(np.exp(power * (x - larger)) + np.exp(power * (y - larger))) / power


def hyperquadric(planes: Any, exponents: Any, *dents: tuple[float, Any, Any]) -> Case:
    """Fung, 1999, (2.28) to (2.30): the sum of all terms less 1."""

    def make(scale: float) -> shapes.Hyperquadric:
        by = np.array([1 / scale] * 3 + [1.0])
        some = tuple(shapes.Dent(depth, by * sheet, np.array(g)) for depth, sheet, g in dents)
        return shapes.Hyperquadric(by * planes, np.array(exponents, float), some)

    def powers(sheet: Any, g: Any, points: Any) -> Any:
        sheet, g = np.asarray(sheet, points.dtype), np.array(g, points.dtype)
        return (np.abs(points @ sheet[:, :3].T + sheet[:, 3]) ** g).sum(axis=-1)

    def level(points: Any) -> Any:
        bumps = [depth * np.exp(-powers(sheet, g, points)) for depth, sheet, g in dents]
        return powers(planes, exponents, points) + sum(bumps) - 1

    return Case(make, level)


def cylinder(
    section: Any, heights: Any, scales: Any, smooth: bool = False, tilt: float = 0.0
) -> Case:
    """Fung, 1999, (2.26) and (2.27); `section`: radii of a spline, or size and exponent."""
    azimuth = 2.0 if tilt else 0.0
    spline = len(section) > 2
    natural = CubicSpline(heights, scales, bc_type="natural")
    if spline:
        knots = np.linspace(0, 2 * math.pi, len(section) + 1)
        radius = CubicSpline(knots, np.append(section, section[0]), bc_type="periodic")

    def make(scale: float) -> shapes.GeneralisedCylinder:
        if spline:
            outline: Any = shapes.SplineSection(scale * np.array(section))
        else:
            outline = shapes.SuperellipseSection(scale * np.array(section[0]), section[1])
        along, sizes = scale * np.array(heights), np.array(scales)
        return shapes.GeneralisedCylinder(outline, along, sizes, smooth, tilt, azimuth)

    def level(points: Any) -> Any:
        (x, y, z), exact = np.moveaxis(points, -1, 0), points.dtype.type
        along = z / np.cos(exact(tilt))
        x = x - along * np.sin(exact(tilt)) * math.cos(azimuth)
        y = y - along * np.sin(exact(tilt)) * math.sin(azimuth)
        if spline:
            turn = np.mod(np.arctan2(y, x), 2 * math.pi)
            gauge = np.hypot(x, y) / radius(turn.astype(float))
        else:
            (a, b), e = section
            power = 2 / exact(e)
            gauge = (np.abs(x / a) ** power + np.abs(y / b) ** power) ** (1 / power)
        inside = np.clip(along.astype(float), heights[0], heights[-1])
        size = natural(inside) if smooth else np.interp(inside, heights, scales)
        end = np.maximum(heights[0] - along, along - heights[-1])
        return np.maximum(gauge - size, 30 * end)

    return Case(make, level)


def half_space(unit: Floats, offset: float) -> Case:
    return Case(lambda s: shapes.HalfSpace(3 * unit, s * offset), lambda p: p @ unit - offset)


def block(low: Any, high: Any) -> Case:
    """An upright box as a polyhedron."""
    low, high = np.array(low), np.array(high)

    def level(points: Any) -> Any:
        return np.maximum(low - points, points - high).max(axis=-1)

    corners = low + BOX_CORNERS * (high - low)
    return Case(lambda s: shapes.Polyhedron(s * corners, BOX_FACES), level)


def star_prism() -> Case:
    """A star of ten corners, carried upwards; the level is that of the edge in a point's sector."""

    def level(points: Any) -> Any:
        (x, y, z), sector = np.moveaxis(points, -1, 0), np.arctan2(points[..., 1], points[..., 0])
        sector = np.floor(np.mod(sector, 2 * math.pi) / (math.pi / 5)).astype(int) % 10
        (a, b), (c, d) = STAR[:, sector], STAR[:, sector + 1]
        side = ((x - a) * (d - b) - (y - b) * (c - a)) / np.hypot(c - a, d - b)
        return np.maximum(side, np.maximum(-z, z - 0.03))

    corners = np.concatenate([np.column_stack([*STAR[:, :10], np.full(10, z)]) for z in (0, 0.03)])
    faces = [[*range(9, -1, -1)], [*range(10, 20)]]
    faces += [[i, (i + 1) % 10, (i + 1) % 10 + 10, i + 10] for i in range(10)]
    return Case(lambda s: shapes.Polyhedron(s * corners, faces), level)


def moved(case: Case, shift: Any) -> Case:
    position = np.array(shift)
    return Case(
        lambda s: shapes.PosedSolid(case.make(s), Pose(s * position, np.eye(3))),
        lambda points: case.level(points - np.array(shift)),
    )


def ball(x: float = 0.0, y: float = 0.0, z: float = 0.0, radius: float = 0.03) -> Case:
    return moved(superquadric([radius] * 3, (1.0, 1.0)), (x, y, z))


def combined(kind: Any, choose: Any, cases: tuple[Case, ...]) -> Case:
    return Case(
        lambda s: kind(tuple(case.make(s) for case in cases)),
        lambda points: choose.reduce([case.level(points) for case in cases]),
    )


def intersection(*cases: Case) -> Case:
    return combined(shapes.Intersection, np.maximum, cases)


def complement(case: Case) -> Case:
    return Case(lambda s: shapes.complement_of(case.make(s)), lambda points: -case.level(points))


def without(first: Case, *rest: Case) -> Case:
    return Case(
        lambda s: shapes.difference(first.make(s), *(case.make(s) for case in rest)),
        intersection(first, *(complement(case) for case in rest)).level,
    )


def boolean(tree: Case, **words: int) -> Case:
    return Case(lambda s: shapes.BooleanShape(tree.make(s)), tree.level, **words)


def first_entries(level: Level, origins: Floats, directions: Floats, reach: float) -> Any:
    """Where rays (n, 3) first enter, and their least levels up to there.

    By samples in double precision, minima between them, and bisection in extended precision.
    Ranges are inf where there is no entry, -inf for a start inside.
    """
    start, along, samples = origins.astype(Wide), directions.astype(Wide), 200

    def depth(ray: Any, travelled: Any) -> Any:
        return level(start[ray] + travelled[:, None] * along[ray])

    travelled = np.linspace(0.0, reach, samples)
    seen = level(origins[:, None] + travelled[:, None] * directions[:, None])
    first = np.where((seen <= 0).any(axis=1), (seen <= 0).argmax(axis=1), samples)
    crossing = (first > 0) & (first < samples)
    low, high = np.zeros(len(origins), Wide), np.full(len(origins), np.nan, Wide)
    low[crossing], high[crossing] = travelled[first[crossing] - 1], travelled[first[crossing]]
    least = seen.min(axis=1).astype(Wide)
    # Dips between samples, the latest first, so that the earliest is kept.
    dips = (seen[:, 1:-1] <= seen[:, :-2]) & (seen[:, 1:-1] <= seen[:, 2:])
    ray, place = np.nonzero(dips & (np.arange(1, samples - 1) < first[:, None]))
    left, right = travelled[place], travelled[place + 2]
    for _ in range(55):
        third, fourth = right - GOLDEN * (right - left), left + GOLDEN * (right - left)
        nearer = depth(ray, third) <= depth(ray, fourth)
        left, right = np.where(nearer, left, third), np.where(nearer, fourth, right)
    bottom = (left + right) / 2
    depths = depth(ray, bottom)
    np.minimum.at(least, ray, depths)
    for i in np.flatnonzero(depths <= 0)[::-1]:
        low[ray[i]], high[ray[i]] = travelled[place[i]], bottom[i]
    met = np.flatnonzero(np.isfinite(high))
    near, far = low[met], high[met]
    for _ in range(60):
        middle = (near + far) / 2
        inside = depth(met, middle) <= 0
        near, far = np.where(inside, near, middle), np.where(inside, middle, far)
    ranges = np.full(len(origins), np.inf, Wide)
    ranges[met] = far
    ranges[seen[:, 0] <= 0] = -np.inf
    return ranges, least


def check_casts(
    case: Case, bundles: Iterable[tuple[Floats, Floats]], reach: float, tolerance: float = 1e-12
) -> list[Floats]:
    """Ranges of casts from origins (n, 3) in directions (3,), checked against the definition."""
    rays = [(origins, np.broadcast_to(along, origins.shape)) for origins, along in bundles]
    casts = [case.solid.cast(origins, along[0], reach) for origins, along in rays]
    origins, directions = (np.concatenate(parts) for parts in zip(*rays, strict=True))
    result = np.concatenate(casts)
    wanted, least = first_entries(case.level, origins, directions, reach)
    clear = np.abs(least) > 1e-12  # else rounding decides whether a ray grazes
    inside = wanted == -np.inf
    assert np.array_equal((result == -np.inf)[clear], inside[clear])
    # No entry is passed, and none is early but at a dip too thin for the samples.
    assert (result <= wanted + tolerance)[clear].all()
    early = np.flatnonzero(clear & ~inside & (result < wanted - tolerance))
    places = origins + np.where(np.isfinite(result), result, 0.0)[:, None] * directions
    assert np.abs(case.level(places[early].astype(Wide)).astype(float)).max(initial=0.0) < 1e-10
    return casts


LONG = [0.01, 0.012, 0.06], (0.5, 0.8)
NEARLY_A_RING = 51.0  # curvature at which the ends of a bar of 0.12 m nearly meet [1/m]
SIZE = [0.04, 0.03, 0.05]
AXES = np.column_stack([np.diag(1 / np.array(SIZE)), np.zeros(3)])
SLANTED = np.array([[20, 20, 20, 0.1], [20, -20, 20, 0], [20, 20, -20, -0.1], [-20, 20, 20, 0.2]])
BOTH = np.concatenate([AXES, SLANTED * [1, 1, 1, 0.05]])
FORMS = np.array([[60.0, 0.0, 0.0, -2.4], [0.0, 50.0, 0.0, 0.0], [0.0, 0.0, 40.0, 0.3]])
RADII = [0.03, 0.022, 0.031, 0.025, 0.028]
HEIGHTS, SCALES = [0.0, 0.03, 0.05, 0.09], [1.0, 1.3, 0.5, 0.7]
TURNS = np.arange(11) * math.pi / 5
STAR = np.where(np.arange(11) % 2, 0.016, 0.04) * np.array([np.cos(TURNS), np.sin(TURNS)])
CUSHION = hyperquadric(AXES, [4, 4, 4], (1.0, FORMS, [2, 2, 2]))
DRILL = cylinder([0.015, 0.01, 0.015, 0.01], [-0.1, 0.0, 0.1], [1.0, 0.5, 1.0])
FACES = [half_space(-n, 0.0) for n in np.eye(3)]
FACES += [half_space(n, s) for n, s in zip(np.eye(3), (0.05, 0.04, 0.03), strict=True)]

OUTER = complement(ball(-0.02)), complement(ball(0.02))

SOLIDS = {
    "rounded": superquadric([0.03, 0.02, 0.04], (0.4, 0.7)),
    "box": superquadric([0.03, 0.02, 0.04], (0.02, 0.05)),
    "octahedron": superquadric([0.01, 0.02, 0.03], (2.0, 2.0)),
    "pillow": superquadric(SIZE, (0.3, 1.7)),
    "tapered": superquadric(*LONG, (0.5, -0.4)),
    "tapered and bent": superquadric(*LONG, (0.3, 0.3), -20.0, 2.0),
    "unevenly tapered, bent": superquadric([0.03, 0.02, 0.05], (0.7, 0.9), (0.5, 0.2), 8.0, 0.4),
    "nearly a ring": superquadric(*LONG, (0.0, 0.0), NEARLY_A_RING),
    "hyperquadric": hyperquadric(AXES, [8.0, 3.0, 30.0]),
    "cut box": hyperquadric(BOTH, [12, 2, 5, 1, 4, 9, 60]),
    "star": hyperquadric(AXES, [0.5, 0.6, 0.8]),
    "swollen": hyperquadric(AXES, [4, 3, 6], (-0.8, FORMS, [2, 3, 2]), (0.3, FORMS, [2, 2, 2])),
    "sharply dented": hyperquadric(AXES, [4, 0.8, 2], (0.9, FORMS, [1, 0.6, 1.5])),
    "vase": cylinder(RADII, HEIGHTS, SCALES, smooth=True),
    "superellipse": cylinder(([0.03, 0.02], 0.4), HEIGHTS, SCALES, tilt=-0.3),
    "spindle": cylinder(([0.0325, 0.0164], 2.0), [-0.02, 0.0, 0.01, 0.035], [0, 0.3, 0.6, 1.03]),
    "dome": cylinder(([0.03, 0.03], 1.0), HEIGHTS, [1.0, 0.95, 0.85, 0.0]),
    "bite": boolean(without(ball(), ball(0.02, 0.01))),
    "half-spaces": boolean(intersection(*FACES)),
    "De Morgan": boolean(complement(combined(shapes.Union, np.minimum, OUTER))),
    "dented and drilled": boolean(without(CUSHION, DRILL), genus=1),
    "bitten star": boolean(without(star_prism(), ball(0.03, 0.0, 0.035, radius=0.012))),
    "brick": block([-0.03, -0.02, 0.0], [0.03, 0.02, 0.05]),
    "star prism": star_prism(),
}  # fmt: skip
