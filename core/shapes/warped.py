"""A superquadric that is tapered, then bent: cast exactly, without a mesh."""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.bent_box import through_bent_box
from palpate.core.shapes.first_root import Which, first_roots
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh
from palpate.core.shapes.straighten import Curve, Straightening
from palpate.core.shapes.superquadric import RANGE_TOLERANCE, TINY, Superquadric
from palpate.core.shapes.taper import Taper

LARGEST_SHARE = 0.98
"""Of the bend that would squeeze the inner side to nothing, or close the axis to a ring."""
BOUNDS_LEVEL = 6
"""82k faces."""
NO_BEND = Bend(0.0)


class WarpedSuperquadric:
    """A superquadric about the origin, tapered along z, then bent.

    Parameters
    ----------
    base : Superquadric
        What is tapered and bent.
    taper : (2,) array
        Widening of x and y at the top, as a share: see `Taper`.
    bend : Bend
        How the tapered solid is bent.

    Raises
    ------
    ValueError
        If a taper collapses the solid, or the bend folds it or closes it to a ring.
    """

    def __init__(self, base: Superquadric, taper: Floats, bend: Bend = NO_BEND):
        self._base, self._bend = base, bend
        self._taper = Taper(float(taper[0]), float(taper[1]), float(base.size[2]))
        most = most_bend(base, taper, bend.direction)
        if not abs(bend.curvature) <= most:
            raise ValueError(
                f"bend must lie between {-most:.4g} and {most:.4g} 1/m, or this solid folds, "
                f"got {bend.curvature:g}"
            )
        self._half = _half_box(base, taper, bend.direction)
        self._straightening = Straightening(base.size, taper, bend)
        cosine, sine = bend.towards
        self._axes = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    def bounds(self) -> Floats:
        """Smallest and largest coordinates of a fine tessellation, (2, 3), m."""
        vertices = self.mesh(BOUNDS_LEVEL).vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])

    def enclosure(self) -> Floats:
        """An upright box about the solid: see `ImplicitShape.enclosure`."""
        inwards, _, height = self._half.tolist()
        # A bend moves sideways most at the ends; up most there, or where it turns level.
        turned = 0.5 * math.pi / max(abs(self._bend.curvature), TINY)
        edge, rise = np.array([-inwards, inwards] * 3), [0.0, min(height, turned), height]
        corners = np.column_stack([edge, 0.0 * edge, np.repeat(rise, 2)])
        bent = Bend(self._bend.curvature)(corners)
        moved = np.outer(bent[:, 0] - edge, self._bend.towards)
        width, depth = self._base.size[:2] * (1.0 + np.abs(self._straightening.taper))
        top = float(bent[:, 2].max())
        return np.array(
            [
                [-width + moved[:, 0].min(), -depth + moved[:, 1].min(), -top],
                [width + moved[:, 0].max(), depth + moved[:, 1].max(), top],
            ]
        )

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """The gauge less 1, times the section's width: see `ImplicitShape.inside_out`."""
        return self._height(self._axes.T @ points.T, self._axes.T @ directions.T)

    def gauge(self, points: Floats) -> Floats:
        """The base's gauge of points (n, 3), straightened: below 1 inside, above 1 outside."""
        return self._base.gauge(self._taper.inverse(self._bend.inverse(points)))

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        places, towards = self._axes.T @ origins.T, self._axes.T @ direction
        curvature = self._bend.curvature
        starts, ends, gaps = through_bent_box(places, towards, self._half, curvature)
        ends = np.minimum(ends, reach)
        ranges = np.full(len(origins), MISS)
        met = np.flatnonzero(starts <= ends)
        if not len(met):
            return ranges
        places, along = places[:, met], towards[:, None]

        def height(travelled: Floats, which: Which) -> tuple[Floats, Floats]:
            return self._height(places[:, which] + along * travelled, towards)

        dip, rise = self._dip_and_rise(towards)
        found = first_roots(
            height,
            starts[met],
            ends[met],
            tolerance=RANGE_TOLERANCE * float(self._base.size.min()),
            dip=dip,
            rise=rise,
            gaps=tuple((begin[met], end[met]) for begin, end in gaps),
        )
        ranges[met] = np.where(found == 0.0, INSIDE, found)
        return ranges

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays are inside: see `spans`."""
        from palpate.core.shapes.spans import marched_spans
        from palpate.core.shapes.warped_spans import inside_below, outside_below

        places, towards = self._axes.T @ origins.T, self._axes.T @ direction
        starts, ends, gaps = through_bent_box(places, towards, self._half, self._bend.curvature)
        along = towards[:, None]

        def curve(travelled: Floats, which: Ints) -> Curve:
            return self._straightening.along(places[:, which] + along * travelled, towards)

        dip = self._dip_and_rise(towards)[0]
        return marched_spans(
            outside_below(curve, self._base.gauge_along, dip, gaps),
            inside_below(curve, self._base.gauge_along, dip),
            starts,
            ends,
            RANGE_TOLERANCE * float(self._base.size.min()),
        )

    def mesh(self, level: int) -> Mesh:
        """The base's tessellation, tapered and bent: see `Shape.mesh`."""
        vertices, faces = self._base.mesh(level)
        return Mesh(self._bend(self._taper(vertices)), faces)

    def _height(self, places: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """A function that is 0 on the surface and its slope along rays: `Straightening`."""
        place, slope, width, width_slope = self._straightening.along(places, direction)
        gauge, gauge_slope = self._base.gauge_along(place, slope)
        return gauge - width, gauge_slope - width_slope

    def _dip_and_rise(self, direction: Floats) -> tuple[float, float]:
        """How much that function bends down, and up, at most where it is positive, 1/m2."""
        place, width, least_width = self._straightening.bound(direction, self._half)
        most = np.array(place)[:, 1:]  # slope and curve of each coordinate
        speed, down = self._base.gauge_along(most, np.zeros((3, 1)))[0].tolist()
        dip = down + width.curve
        return dip, self._base.smoothness() * speed**2 / least_width + dip


def most_bend(base: Superquadric, taper: Floats, direction: float) -> float:
    """Largest curvature to which a tapered superquadric is bent, 1/m.

    Parameters
    ----------
    base : Superquadric
        What is tapered and bent.
    taper : (2,) array
        Widening of x and y at the top.
    direction : float
        Azimuth of the bend, rad.
    """
    inwards, _, height = _half_box(base, taper, direction).tolist()
    return LARGEST_SHARE * float(min(1.0 / inwards, math.pi / height))


def _half_box(base: Superquadric, taper: Floats, direction: float) -> Floats:
    """Half edges of a box about the tapered solid, turned to the direction of the bend.

    How far a section reaches in a direction is the dual of the norm of which it is the ball.
    """
    width, depth = (base.size[:2] * (1.0 + np.abs(taper))).tolist()
    cosine, sine = math.cos(direction), math.sin(direction)
    e2 = float(base.exponents[1])
    inwards = _dual_norm(width * cosine, depth * sine, e2)
    return np.array([inwards, _dual_norm(width * sine, depth * cosine, e2), base.size[2]])


def _dual_norm(x: float, y: float, e2: float) -> float:
    small, large = sorted((abs(x), abs(y)))
    if e2 == 2.0:
        return large
    power = 2.0 / (2.0 - e2)
    result: float = large * (1.0 + (small / large) ** power) ** (1.0 / power)
    return result
