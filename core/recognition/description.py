"""Measures of a closed surface that do not depend on its pose, on four levels.

The levels are those of the database of Allen, *Integrating vision and touch for object recognition
tasks*, 1988 (Fung, 1999, 1.4.2): the whole object; its components, that is the nearest superquadric
and the voids in the hull; its surfaces, plane faces and round sides; and patches, here the sections
across its axis. Allen's patches bound a few touched places; our surface is closed, and sections say
more of it. A mirror image has the same description.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats
from palpate.core.geometry import areas_and_normals, sample_surface, triangle_corners
from palpate.core.rebuild.recovery import recover
from palpate.core.recognition.faces import DEFAULT_FACES, FaceSettings, PlaneFaces, plane_faces
from palpate.core.recognition.voids import (
    DEFAULT_VOIDS,
    Voids,
    VoidSettings,
    convex_hull,
    find_voids,
)

N_SECTIONS = 7  # across the axis: `FEATURES` has names for them
MIN_POSITIVE = 1e-12  # of a number whose logarithm is taken, or by which is divided


@dataclass(frozen=True, slots=True, kw_only=True)
class DescriptionSettings:
    """How finely a surface is measured. Stored scatter is valid for the same settings only."""

    # Quantiles of the widths over all directions: small, median and largest.
    width_quantiles: tuple[float, float, float] = (0.1, 0.5, 1.0)
    n_directions: int = 300  # in which widths are measured
    n_samples: int = 4000  # of the surface, for the plane faces
    n_fitted: int = 80  # samples to which the superquadric is fitted
    faces: FaceSettings = DEFAULT_FACES
    voids: VoidSettings = DEFAULT_VOIDS


class Whole(NamedTuple):
    """The object level."""

    volume: float  # [m3]
    area: float  # [m2]
    gyration: Floats  # radii of gyration along the principal axes, descending, (3,) [m]
    widths: Floats  # quantiles of the width between parallel planes, (3,) [m]
    skew: float  # of the volume along the axis of the sections, not negative [1]
    facing: Floats  # mean squares of the normals along their principal axes, descending, (3,)


class FittedShape(NamedTuple):
    """The superquadric nearest to the object."""

    size: Floats  # semi-axes, descending, (3,) [m]
    exponents: Floats  # e1 and e2, (2,)
    taper: float  # the larger of both, not negative
    bend: float  # [rad] turn of the bent axis from end to end
    residual: float  # [m] root mean square distance of the surface


class Sections(NamedTuple):
    """The patch level: sections across the axis, at even shares of the length."""

    areas: Floats  # (k,) [m2]
    moments: Floats  # second moments of area, the larger first, (k, 2) [m4]
    compactness: Floats  # area squared over 2 pi times the polar moment: 1 for a disc, (k,)


@dataclass(frozen=True, slots=True, eq=False)
class Description:
    """Measures of a closed surface that do not depend on its pose."""

    whole: Whole  # the object
    fitted: FittedShape  # its components: the nearest superquadric
    voids: Voids  # and the voids in its hull
    faces: PlaneFaces  # its surfaces
    sections: Sections  # its patches


def describe(
    vertices: ArrayLike, faces: ArrayLike, settings: DescriptionSettings = DescriptionSettings()
) -> Description:
    """The description of a closed surface; the same for the same arrays.

    `vertices` (n, 3) [m]. `faces` (m, 3): rows of those, counter-clockwise seen from outside. The
    axis of the sections is the principal axis whose moment differs most from the other two: of a
    solid of revolution, its axis. Raises ValueError unless the surface is closed, with a volume.
    """
    corners = triangle_corners(vertices, faces)
    places, rows = np.asarray(vertices, np.float64), np.asarray(faces, np.int32)
    hull = convex_hull(places)
    voids = find_voids(places, rows, hull, settings.voids)
    volume, middle, axes, squares = _moments(corners)
    local = (corners - middle) @ axes
    logs = np.log(squares)
    odd = int(np.argmax(np.abs(3.0 * logs - logs.sum())))
    sections, skew = _sections(local[:, :, [(odd + 1) % 3, (odd + 2) % 3, odd]], volume)
    areas, normals = areas_and_normals(corners)
    shares = areas / areas.sum()
    whole = Whole(
        volume=volume,
        area=float(areas.sum()),
        gyration=np.sqrt(squares),
        widths=_widths(hull[0], settings),
        skew=skew,
        facing=np.linalg.eigvalsh((normals * shares[:, None]).T @ normals)[::-1],
    )
    points, numbers = sample_surface(local, settings.n_samples, np.random.default_rng(1999))[:2]
    planes = plane_faces(points, (normals @ axes)[numbers], whole.area, settings.faces)
    return Description(whole, _fitted(points, settings.n_fitted), voids, planes, sections)


def _widths(points: Floats, settings: DescriptionSettings) -> Floats:
    """Quantiles (3,) of the width of points (n, 3) over all directions [m]."""
    along = _even_directions(settings.n_directions) @ points.T
    return np.asarray(np.quantile(np.ptp(along, axis=1), settings.width_quantiles))


def _moments(corners: Floats) -> tuple[float, Floats, Floats, Floats]:
    """Volume, centroid (3,), principal axes (3, 3) and variances along them (3,), descending."""
    origin = corners.mean(axis=(0, 1))
    near = corners - origin
    a, b, c = near.transpose(1, 0, 2)
    sixth = np.einsum("ni,ni->n", a, np.cross(b, c)) / 6.0
    volume = float(sixth.sum())
    sums = near.sum(axis=1)
    middle = (sixth @ sums) / (4.0 * volume)
    second = np.einsum("n,nki,nkj->ij", sixth, near, near) + (sums * sixth[:, None]).T @ sums
    variances, axes = np.linalg.eigh(second / (20.0 * volume) - np.outer(middle, middle))
    axes = axes[:, ::-1] * [1.0, 1.0, np.linalg.det(axes[:, ::-1])]
    return volume, origin + middle, axes, variances[::-1]


def _fitted(points: Floats, count: int) -> FittedShape:
    rows = np.linspace(0, len(points) - 1, count).astype(int)
    fit = recover(points[rows], taper=True, bend=True)
    angle = 2.0 * fit.bend.curvature * float(fit.size[2])
    taper = float(np.abs(fit.taper).max())
    return FittedShape(np.sort(fit.size)[::-1], fit.exponents, taper, angle, fit.rms)


def _even_directions(count: int) -> Floats:
    """Unit vectors (count, 3), nearly evenly spread: a spiral of equal heights (Fibonacci)."""
    number = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * number / count, math.pi * (1.0 + math.sqrt(5.0)) * number
    across = np.sqrt(1.0 - height * height)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), height])


def _sections(corners: Floats, volume: float) -> tuple[Sections, float]:
    """Sections across z of triangles (m, 3, 3) about the centroid, and the skew along it."""
    low, high = float(corners[:, :, 2].min()), float(corners[:, :, 2].max())
    heights = low + (high - low) * (np.arange(N_SECTIONS) + 0.5) / N_SECTIONS
    measures = np.array([_section(corners, height) for height in heights])
    variance, third = _axial_moments(corners, volume)
    measures = measures[::-1] if third < 0.0 else measures
    areas, moments = measures[:, 0], measures[:, 1:]
    compactness = areas**2 / np.maximum(2.0 * math.pi * moments.sum(axis=1), MIN_POSITIVE**2)
    return Sections(areas, moments, compactness), abs(third) / variance**1.5


def _section(corners: Floats, height: float) -> tuple[float, float, float]:
    """Area [m2] and principal second moments of area [m4], the larger first, at a height.

    Each triangle that crosses the plane gives a segment with the solid on its left; area and
    moments are sums over the segments, in any order (Green).
    """
    above = corners[:, :, 2] > height
    crossed = corners[above.any(axis=1) & ~above.all(axis=1)]
    up = crossed[:, :, 2] > height
    next_up = np.roll(up, -1, axis=1)
    starts, ends = (_crossing(crossed, edge, height) for edge in (up & ~next_up, ~up & next_up))
    twice = starts[:, 0] * ends[:, 1] - starts[:, 1] * ends[:, 0]
    area = 0.5 * float(twice.sum())
    if not area > 0.0:
        return 0.0, 0.0, 0.0
    sums = starts + ends
    middle = twice @ sums / (6.0 * area)
    square = sum((xy * twice[:, None]).T @ xy for xy in (starts, ends, sums)) / 24.0
    small, large = np.linalg.eigvalsh(square - area * np.outer(middle, middle)).tolist()
    return area, max(large, 0.0), max(small, 0.0)


def _crossing(corners: Floats, edge: np.ndarray, height: float) -> Floats:
    """Where the marked edge of each triangle meets a height, (n, 2)."""
    row, first = np.arange(len(corners)), edge.argmax(axis=1)
    here, there = corners[row, first], corners[row, (first + 1) % 3]
    share = (height - here[:, 2]) / (there[:, 2] - here[:, 2])
    return np.asarray((here + share[:, None] * (there - here))[:, :2])


def _axial_moments(corners: Floats, volume: float) -> tuple[float, float]:
    """Mean square [m2] and mean cube [m3] of z over the solid, by sums over its tetrahedra."""
    a, b, c = corners.transpose(1, 0, 2)
    sixth = np.einsum("ni,ni->n", a, np.cross(b, c)) / 6.0
    x, y, z = a[:, 2], b[:, 2], c[:, 2]
    square = x * x + y * y + z * z + x * y + y * z + z * x
    cube = x**3 + y**3 + z**3 + (x + y) * (y + z) * (z + x) - x * y * z
    return float(sixth @ square) / (10.0 * volume), float(sixth @ cube) / (20.0 * volume)


class ShapeFeature(NamedTuple):
    """A number of a description that is compared."""

    name: str
    kind: str  # log volume, log area, log length, angle, count, or share
    of: Callable[[Description], float]


def feature_vector(description: Description) -> Floats:
    """The numbers of a description that are compared, in the order of `FEATURES`.

    Sizes are logarithms: equal ratios count equally in small and large objects.
    """
    return np.array([feature.of(description) for feature in FEATURES])


def _face_share(d: Description, number: int) -> float:
    areas = d.faces.areas * d.faces.certainty
    return float(areas[number]) / d.whole.area if number < len(areas) else 0.0


def _facing_share(d: Description, power: int) -> float:
    """Mean power of the cosine between plane faces, weighted by their shares of the area."""
    shares = d.faces.areas * d.faces.certainty / d.whole.area
    return float(shares @ (d.faces.normals @ d.faces.normals.T) ** power @ shares)


def _log(value: float) -> float:
    return math.log(max(value, MIN_POSITIVE))


def _fit_weight(d: Description, max_residual: float = 6e-3) -> float:
    """Weight of the nearest superquadric's shape: 1 if it fits, 0 if many fit equally badly.

    `max_residual`: fraction of the size, beyond which the shape of the best fit is random.
    """
    ratio = d.fitted.residual / (max_residual * float(d.whole.widths[-1]))
    return 1.0 / (1.0 + ratio**4)


def _fit_distance(d: Description, tolerance: float = 1e-3) -> float:
    """Residual of the nearest superquadric [m], plus `tolerance` of the size.

    So all fits that are better than the tolerance are alike.
    """
    return d.fitted.residual + tolerance * float(d.whole.widths[2])


def _exponent_roundness(d: Description, number: int) -> float:
    """Of both exponents, the least first: 1 for an exponent of 1, and 0 for 0 or 2.

    With 0 and 2 the body is nearly the same, turned by 45 degrees, and which of them fits best is
    random.
    """
    roundness = np.sort(d.fitted.exponents * (2.0 - d.fitted.exponents))
    return _fit_weight(d) * float(roundness[number])


def _section_features(i: int) -> list[ShapeFeature]:
    def roundness(d: Description) -> float:
        large, small = d.sections.moments[i].tolist()
        return math.sqrt(small / large) if large > 0.0 else 1.0

    where = f"of the section at {100 * (2 * i + 1) // (2 * N_SECTIONS)} % of the axis"
    return [
        ShapeFeature(f"area {where}", "log area", lambda d: _log(float(d.sections.areas[i]))),
        ShapeFeature(f"compactness {where}", "share", lambda d: float(d.sections.compactness[i])),
        ShapeFeature(f"roundness {where}", "share", roundness),
    ]


FEATURES: tuple[ShapeFeature, ...] = (
    ShapeFeature("volume", "log volume", lambda d: _log(d.whole.volume)),
    ShapeFeature("area", "log area", lambda d: _log(d.whole.area)),
    ShapeFeature("largest radius of gyration", "log length", lambda d: _log(d.whole.gyration[0])),
    ShapeFeature("middle radius of gyration", "log length", lambda d: _log(d.whole.gyration[1])),
    ShapeFeature("least radius of gyration", "log length", lambda d: _log(d.whole.gyration[2])),
    ShapeFeature("small width", "log length", lambda d: _log(d.whole.widths[0])),
    ShapeFeature("median width", "log length", lambda d: _log(d.whole.widths[1])),
    ShapeFeature("largest width", "log length", lambda d: _log(d.whole.widths[2])),
    ShapeFeature("skew along the axis", "share", lambda d: d.whole.skew),
    ShapeFeature("area that faces most alike", "share", lambda d: float(d.whole.facing[0])),
    ShapeFeature("area that faces least alike", "share", lambda d: float(d.whole.facing[2])),
    ShapeFeature("distance from a superquadric", "log length", lambda d: _log(_fit_distance(d))),
    ShapeFeature("roundness of an exponent", "share", lambda d: _exponent_roundness(d, 0)),
    ShapeFeature("roundness of the other exponent", "share", lambda d: _exponent_roundness(d, 1)),
    ShapeFeature("taper", "share", lambda d: _fit_weight(d) * d.fitted.taper),
    ShapeFeature("bend", "angle", lambda d: _fit_weight(d) * d.fitted.bend),
    ShapeFeature("holes", "count", lambda d: float(d.voids.holes)),
    ShapeFeature("empty share of the hull", "share", lambda d: d.voids.share),
    ShapeFeature("pockets", "count", lambda d: d.voids.certain),
    ShapeFeature("largest pocket", "share",
                 lambda d: float(d.voids.pockets.max(initial=0.0)) / d.whole.volume),
    ShapeFeature("plane faces", "count", lambda d: float(d.faces.certainty.sum())),
    ShapeFeature("plane share of the area", "share",
                 lambda d: 1.0 - d.faces.round_area / d.whole.area),
    ShapeFeature("largest face", "share", lambda d: _face_share(d, 0)),
    ShapeFeature("second face", "share", lambda d: _face_share(d, 1)),
    ShapeFeature("third face", "share", lambda d: _face_share(d, 2)),
    ShapeFeature("imbalance of the faces", "share", lambda d: _facing_share(d, 1)),
    ShapeFeature("parallelism of the faces", "share", lambda d: _facing_share(d, 2)),
    *(feature for i in range(N_SECTIONS) for feature in _section_features(i)),
)  # fmt: skip
