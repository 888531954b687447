"""Generalised cylinder: a section that is scaled as it moves along a straight axis.

The solid is where the section's gauge G(x, y) is at most the scale r(z). An oblique axis is a
shear, which keeps rays straight: they are cast at the upright solid. Along a ray G bends
downwards only if the section is not convex, and r is a cubic between two knots: both are
bounded, so that rays are cast exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh
from palpate.core.shapes.ray_casting import (
    Minorant,
    MinorantFunction,
    clip_to_box,
    guaranteed_first_roots,
)
from palpate.core.shapes.sections import PiecewiseCubic, Section, natural_spline, straight_pieces
from palpate.core.shapes.superquadrics import SMALLEST

# Beyond it the section's plane nearly holds the axis, and the solid is flat.
MOST_TILT = math.radians(75.0)
MOST_HEIGHTS = 64
LEAST_STEP = 1e-9  # Between two heights, m
BOUNDS_LEVEL = 6
RANGE_TOLERANCE = 1e-13  # Of the solid's height or least radius
LEAST_AROUND = 8
SIDE_RINGS, CAP_RINGS = 3 / 8, 1 / 8  # For each point of a ring; those of one plane end


class GeneralisedCylinder:
    """A straight homogeneous generalised cylinder, closed by plane ends.

    `section`: what is swept. `heights` (n,): places along the axis, increasing, 2 to 64, m.
    `scales` (n,): scale of the section there, positive; at the ends it may be 0 (an apex), 1.
    `smooth`: whether the scale is the natural cubic spline through these, not straight lines.
    `tilt` and `tilt_direction`: angle between the axis and z, less than 75 degrees, and the axis's
    azimuth, rad. Raises ValueError if heights do not increase, or the scale is not positive between
    the ends.

    Fung, 1999, (2.26) and (2.27); with two straight heights the linear cylinder (1.4).
    """

    def __init__(
        self,
        section: Section,
        heights: Floats,
        scales: Floats,
        smooth: bool = False,
        tilt: float = 0.0,
        tilt_direction: float = 0.0,
    ):
        self._section, self._scale = section, _checked_scale(heights, scales, smooth)
        if not abs(tilt) <= MOST_TILT:
            raise ValueError(f"tilt must be at most 75 degrees, got {math.degrees(tilt):g}")
        if not math.isfinite(tilt_direction):
            raise ValueError(f"tilt_direction must be finite, got {tilt_direction}")
        x, y = math.cos(tilt_direction), math.sin(tilt_direction)
        sine, cosine = math.sin(tilt), math.cos(tilt)
        self._shear = np.array([[1.0, 0.0, sine * x], [0.0, 1.0, sine * y], [0.0, 0.0, cosine]])
        self._upright = np.linalg.inv(self._shear)
        low, high = float(self._scale.knots[0]), float(self._scale.knots[-1])
        widest = section.traits.radius[1] * self._scale.value_range()[1]
        self._middle = np.array([0.0, 0.0, 0.5 * (low + high)])
        self._half = np.array([widest, widest, 0.5 * (high - low)])
        slimmest = section.traits.radius[0] * self._scale.value_range()[1]
        self._tolerance = RANGE_TOLERANCE * min(slimmest, (high - low) * cosine)

    @property
    def convex(self) -> bool:
        """Whether the solid is known to be convex."""
        scale = self._scale
        ends = [scale.at(place, np.arange(len(scale.knots) - 1, dtype=np.int32))
                for place in (scale.knots[:-1], scale.knots[1:])]  # fmt: skip
        bent = max(float(bend.max()) for _, _, bend in ends)
        kinks = ends[0][1][1:] - ends[1][1][:-1]
        # Of a cubic spline, rounding makes kinks.
        room = 1e-12 * max(float(np.abs(slope).max()) for _, slope, _ in ends)
        return self._section.traits.hollow == 0.0 and bent <= 0.0 and bool((kinks <= room).all())

    def bounds(self) -> Floats:
        """Smallest and largest coordinates of a fine tessellation, (2, 3), m."""
        vertices = self.mesh(BOUNDS_LEVEL).vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])

    def enclosure(self) -> Floats:
        """An upright box about the solid: see `ImplicitShape.enclosure`."""
        ends = np.outer(self._scale.knots[[0, -1]], self._shear[:, 2])
        wide = np.array([self._half[0], self._half[1], 0.0])
        return np.stack([ends.min(axis=0) - wide, ends.max(axis=0) + wide])

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """The largest of G - r and the distances beyond the ends over the widest radius."""
        x, y, z = self._upright @ points.T
        dx, dy, dz = self._upright @ directions.T
        gauge, gauge_slope = self._section.gauge_along(x, y, dx, dy)
        beyond = z - self._middle[2]
        level = np.clip(z, *self._scale.knots[[0, -1]])
        scale, scale_slope, _ = self._scale.at(level, self._scale.piece(level))
        scale_slope = np.where(level == z, scale_slope, 0.0)
        end = (np.abs(beyond) - self._half[2]) / self._half[0]
        end_slope = np.sign(beyond) * dz / self._half[0]
        side, side_slope = gauge - scale, gauge_slope - scale_slope * dz
        return np.maximum(side, end), np.where(side >= end, side_slope, end_slope)

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        places, towards, starts, ends = self._through(origins, direction)
        ends = np.minimum(ends, reach)
        ranges = np.full(len(origins), MISS)
        met = np.flatnonzero(starts <= ends)
        if len(met):
            outside = self._below(places[:, met], towards)
            found = guaranteed_first_roots(outside, starts[met], ends[met], self._tolerance)
            ranges[met] = np.where(found == 0.0, INSIDE, found)
        return ranges

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays are inside: see `spans`."""
        from palpate.core.shapes.ray_casting import convex_spans, marched_spans

        if self.convex:
            return convex_spans(self, origins, direction)
        places, towards, starts, ends = self._through(origins, direction)
        outside, inside = self._below(places, towards), self._above(places, towards)
        return marched_spans(outside, inside, starts, ends, self._tolerance)

    def mesh(self, level: int) -> Mesh:
        """Rings along the axis, one in each kink and rim: see `Shape.mesh`."""
        return profile_mesh(self._section.outline, self._scale, self._shear, level)

    def _through(self, origins: Floats, direction: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Upright rays, and the part of each between the ends."""
        places, towards = self._upright @ origins.T, self._upright @ direction
        starts, ends = clip_to_box(places - self._middle[:, None], towards, self._half)
        return places, towards, starts, ends

    def _below(self, places: Floats, towards: Floats) -> MinorantFunction:
        """Bounds from below of G - r along rays."""
        hollow = self._section.traits.hollow
        across, speed = _across(places, towards), float(np.hypot(*towards[:2]))

        def floor(travelled: Floats, lengths: Floats, which: Ints) -> Minorant:
            x, y, z = places[:, which] + towards[:, None] * travelled
            scale, slope, bends, lengths = self._scale_along(z, float(towards[2]), lengths)
            gauge, gauge_slope = self._section.gauge_along(x, y, *towards[:2, None])
            dip: Floats = np.maximum(bends[1], 0.0)
            if hollow > 0.0:
                near = _nearest(x, y, towards, speed, lengths)
                with np.errstate(over="ignore"):  # in the axis nothing can be told
                    dip = dip + hollow * (across[which] / near) ** 2 / near
            return Minorant(gauge - scale, gauge_slope - slope, dip, lengths, np.zeros_like(scale))

        return floor

    def _above(self, places: Floats, towards: Floats) -> MinorantFunction:
        """Bounds from below of r - G along rays."""
        traits, speed = self._section.traits, float(np.hypot(*towards[:2]))

        def floor(travelled: Floats, lengths: Floats, which: Ints) -> Minorant:
            x, y, z = places[:, which] + towards[:, None] * travelled
            scale, slope, bends, lengths = self._scale_along(z, float(towards[2]), lengths)
            gauge, gauge_slope = self._section.gauge_along(x, y, *towards[:2, None])
            dip: Floats = np.maximum(-bends[0], 0.0)
            if traits.hollow == 0.0:  # a convex gauge lies below its chord
                after = self._section.gauge_along(
                    x + towards[0] * lengths, y + towards[1] * lengths, *towards[:2, None]
                )[0]
                rise = np.minimum((after - gauge) / (lengths + SMALLEST), traits.steepest * speed)
                return Minorant(scale - gauge, slope - rise, dip, lengths, np.zeros_like(scale))
            near = _nearest(x, y, towards, speed, lengths)
            with np.errstate(over="ignore", invalid="ignore"):
                bulge = np.nan_to_num(traits.bulge * (speed * speed / near), posinf=np.inf)
                # Near the axis the gauge is a cone: there its steepest slope says more.
                tangent = gauge_slope + 0.5 * bulge * lengths <= traits.steepest * speed
            rise = np.where(tangent, gauge_slope, traits.steepest * speed)
            dip = dip + np.where(tangent, bulge, 0.0)
            return Minorant(scale - gauge, slope - rise, dip, lengths, np.zeros_like(scale))

        return floor

    def _scale_along(
        self, z: Floats, rate: float, lengths: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Scale, its slope, the range of its bend (2, n), and how far one cubic holds."""
        knots = self._scale.knots
        # A ray that has come to a knot, but for rounding, is in the piece behind it.
        piece = self._scale.piece(z + rate * self._tolerance)
        scale, slope, bend = self._scale.at(z, piece)
        ahead = knots[piece + 1] if rate > 0.0 else knots[piece]
        last = len(knots) - 2 if rate > 0.0 else 0
        with np.errstate(divide="ignore", invalid="ignore"):
            way = np.where((piece == last) | (rate == 0.0), np.inf, (ahead - z) / rate)
        lengths = np.minimum(lengths, way)
        after = self._scale.at(z + rate * lengths, piece)[2]
        bends = np.sort(np.stack([bend, after]), axis=0) * rate**2
        return scale, slope * rate, bends, lengths


def _checked_scale(heights: Floats, scales: Floats, smooth: bool) -> PiecewiseCubic:
    heights = finite_array("heights", heights, (None,))
    scales = finite_array("scales", scales, (len(heights),))
    if not 2 <= len(heights) <= MOST_HEIGHTS:
        raise ValueError(f"heights must be 2 to {MOST_HEIGHTS}, got {len(heights)}")
    if not (np.diff(heights) >= LEAST_STEP).all():
        raise ValueError(
            f"heights must increase, by {LEAST_STEP:g} m or more, got {heights.tolist()} m"
        )
    if not ((scales[1:-1] > 0.0).all() and min(scales[0], scales[-1]) >= 0.0 < scales.max()):
        raise ValueError(f"scales must be positive, but for 0 at an end, got {scales.tolist()}")
    curve = natural_spline(heights, scales) if smooth else straight_pieces(heights, scales)
    places, values = curve.extremes()
    if len(values) and not values.min() > 0.0:
        raise ValueError(
            f"scales lead the smooth curve through them down to {values.min():.4g} at the height "
            f"{places[values.argmin()]:.4g} m; give more of them, or leave smooth out"
        )
    return curve


def profile_mesh(
    outline: Callable[[int], Floats], scale: PiecewiseCubic, shear: Floats, level: int
) -> Mesh:
    """A swept section, closed by plane ends.

    `outline`: gives that many points (n, 2) around the section, m. `scale`: scale of the section
    along the axis; 0 at an end is an apex, else the end is a plane. `shear` (3, 3): from the
    upright solid to the wanted one. `level`: each has four times the faces of the one before:
    80,000 for level 6.
    """
    around = max(2 ** (level + 2), LEAST_AROUND)
    size, height = _profile(scale, int(SIDE_RINGS * around), int(CAP_RINGS * around))
    figure = outline(around)
    inner = np.concatenate(
        [size[1:-1, None, None] * figure,
         np.broadcast_to(height[1:-1, None, None], (len(size) - 2, around, 1))], axis=2
    )  # fmt: skip
    poles = np.array([[0.0, 0.0, height[0]], [0.0, 0.0, height[-1]]])
    vertices = np.concatenate([inner.reshape(-1, 3), poles])
    return Mesh(vertices @ shear.T, _faces(len(size) - 2, around))


def _profile(scale: PiecewiseCubic, rings: int, on_cap: int) -> tuple[Floats, Floats]:
    """Sizes and heights of rings from the lower pole to the upper one, a ring at each knot."""
    knots = scale.knots
    # As many parts of each piece as it is long, and at least one.
    parts = np.maximum(np.rint(rings * np.diff(knots) / np.ptp(knots)), 1).astype(int)
    piece = np.repeat(np.arange(len(parts), dtype=np.int32), parts)
    within = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    height = knots[piece] + np.diff(knots)[piece] * within / parts[piece]
    size = scale.at(height, piece)[0]
    end = scale.at(knots[-1:], scale.piece(knots[-1:]))[0]
    size, height = np.append(size, end), np.append(height, knots[-1])
    share = np.arange(on_cap) / on_cap
    low = share * size[0] if size[0] > 0.0 else np.zeros(0)
    high = share[::-1] * size[-1] if size[-1] > 0.0 else np.zeros(0)
    return (
        np.concatenate([low, size, high]),
        np.concatenate([np.full(len(low), knots[0]), height, np.full(len(high), knots[-1])]),
    )


def _faces(rings: int, around: int) -> Ints:
    """Triangles of rings, then two poles; counter-clockwise seen from outside."""
    here = np.arange(around)
    after = (here + 1) % around
    low, high = rings * around, rings * around + 1
    first = (rings - 1) * around
    begin = (np.arange(rings - 1) * around)[:, None]
    a, b = (begin + here).ravel(), (begin + after).ravel()
    faces = [
        np.column_stack([np.full(around, low), after, here]),
        np.column_stack([a, b, b + around]),
        np.column_stack([a, b + around, a + around]),
        np.column_stack([first + here, first + after, np.full(around, high)]),
    ]
    return np.concatenate(faces).astype(np.int32)


def _across(places: Floats, towards: Floats) -> Floats:
    """How fast rays go around the axis: distance times speed across the radius, (n,)."""
    return np.asarray(places[0] * towards[1] - places[1] * towards[0])


def _nearest(x: Floats, y: Floats, towards: Floats, speed: float, lengths: Floats) -> Floats:
    """Distance from the axis at which rays pass it within the lengths, not 0."""
    dx, dy, _ = towards
    way = np.clip(-(x * dx + y * dy) / (speed * speed + SMALLEST), 0.0, lengths)
    return np.asarray(np.hypot(x + dx * way, y + dy * way)) + SMALLEST
