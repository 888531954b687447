"""Generalised cylinder: a section that is scaled as it moves along a straight axis.

Inside, the section's gauge G(x, y) = |p| / rho(theta) is at most the scale r(z). An oblique axis is
a shear, which keeps rays straight: they are cast at the upright solid. Along a line at speed v, at
a distance d from the axis, with the speed c across the radius, G bends by (g + g'') c^2 / d with g
= 1 / rho, downwards only if the section is not convex; r is a cubic between two knots. Both are
bounded, so that rays are cast exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.shapes.protocol import ImplicitShape, Mesh
from palpate.core.shapes.ray_casting import (
    Minorant,
    MinorantFunction,
    clip_to_box,
    convex_spans,
    guaranteed_first_roots,
    marched_spans,
    ranges_of,
)
from palpate.core.shapes.superquadrics import (
    MAX_EXPONENT,
    MIN_EXPONENT,
    TINY,
    p_norm_along,
)

MAX_TILT = math.radians(75.0)  # near 90 degrees the section's plane contains the axis
MAX_HEIGHTS = 64
MIN_LENGTH = 1e-9  # [m] of a radius, and between two heights
RANGE_TOLERANCE = 1e-13  # fraction of the solid's height or least radius
MIN_RADII, MAX_RADII = 3, 64


class GeneralisedCylinder(ImplicitShape):
    """A straight homogeneous generalised cylinder, closed by plane ends.

    `section`: cross-section. `heights` (n,): places along the axis, increasing, 2 to 64 [m].
    `scales` (n,): of the section there, positive; at the ends possibly 0 (an apex). `smooth`:
    whether the scale is a natural cubic spline, not straight lines. `tilt` and `tilt_direction`:
    angle between the axis and z, at most 75 degrees, and the axis's azimuth [rad]. Raises
    ValueError if heights do not increase, or the scale is not positive between the ends.

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
        if not abs(tilt) <= MAX_TILT:
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
        # Rounding causes kinks of a cubic spline.
        limit = 1e-12 * max(float(np.abs(slope).max()) for _, slope, _ in ends)
        return self._section.traits.hollow == 0.0 and bent <= 0.0 and bool((kinks <= limit).all())

    def enclosure(self) -> Floats:
        """An upright box around the solid: see `ImplicitShape.enclosure`."""
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

        def roots(met: Ints) -> Floats:
            outside = self._outside_bound(places[:, met], towards)
            return guaranteed_first_roots(outside, starts[met], ends[met], self._tolerance)

        return ranges_of(starts, ends, roots)

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Spans of parallel rays inside: see `CsgSolid.spans`."""
        if self.convex:
            return convex_spans(self, origins, direction)
        places, towards, starts, ends = self._through(origins, direction)
        outside, inside = self._outside_bound(places, towards), self._inside_bound(places, towards)
        return marched_spans(outside, inside, starts, ends, self._tolerance)

    def mesh(self, level: int) -> Mesh:
        """Rings along the axis, one in each kink and rim: see `Shape.mesh`."""
        return profile_mesh(self._section.outline, self._scale, self._shear, level)

    def _through(self, origins: Floats, direction: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        places, towards = self._upright @ origins.T, self._upright @ direction
        starts, ends = clip_to_box(places - self._middle[:, None], towards, self._half)
        return places, towards, starts, ends

    def _outside_bound(self, places: Floats, towards: Floats) -> MinorantFunction:
        hollow = self._section.traits.hollow
        # Angular momentum of rays about the axis: distance times speed across the radius.
        across = places[0] * towards[1] - places[1] * towards[0]
        speed = float(np.hypot(*towards[:2]))

        def floor(travelled: Floats, lengths: Floats, which: Ints) -> Minorant:
            x, y, z = places[:, which] + towards[:, None] * travelled
            scale, slope, bends, lengths = self._scale_along(z, float(towards[2]), lengths)
            gauge, gauge_slope = self._section.gauge_along(x, y, *towards[:2, None])
            dip: Floats = np.maximum(bends[1], 0.0)
            if hollow > 0.0:
                near = _nearest(x, y, towards, speed, lengths)
                with np.errstate(over="ignore"):  # on the axis there is no bound
                    dip = dip + hollow * (across[which] / near) ** 2 / near
            return Minorant(gauge - scale, gauge_slope - slope, dip, lengths, np.zeros_like(scale))

        return floor

    def _inside_bound(self, places: Floats, towards: Floats) -> MinorantFunction:
        traits, speed = self._section.traits, float(np.hypot(*towards[:2]))

        def floor(travelled: Floats, lengths: Floats, which: Ints) -> Minorant:
            x, y, z = places[:, which] + towards[:, None] * travelled
            scale, slope, bends, lengths = self._scale_along(z, float(towards[2]), lengths)
            gauge, gauge_slope = self._section.gauge_along(x, y, *towards[:2, None])
            dip: Floats = np.maximum(-bends[0], 0.0)
            if traits.hollow == 0.0:  # a convex gauge lies below its chord
                there = x + towards[0] * lengths, y + towards[1] * lengths
                after = self._section.gauge_along(*there, *towards[:2, None])[0]
                rise = np.minimum((after - gauge) / (lengths + TINY), traits.steepest * speed)
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
        """Scale, its slope, the range of its bend (2, n), and the length of one cubic."""
        knots = self._scale.knots
        # A ray at a knot, up to rounding, is in the next piece.
        piece = self._scale.piece(z + rate * self._tolerance)
        scale, slope, bend = self._scale.at(z, piece)
        ahead = knots[piece + 1] if rate > 0.0 else knots[piece]
        last = len(knots) - 2 if rate > 0.0 else 0
        with np.errstate(divide="ignore", invalid="ignore"):
            remaining = np.where((piece == last) | (rate == 0.0), np.inf, (ahead - z) / rate)
        lengths = np.minimum(lengths, remaining)
        after = self._scale.at(z + rate * lengths, piece)[2]
        bends = np.sort(np.stack([bend, after]), axis=0) * rate**2
        return scale, slope * rate, bends, lengths


def _checked_scale(heights: Floats, scales: Floats, smooth: bool) -> PiecewiseCubic:
    heights = finite_array("heights", heights, (None,))
    scales = finite_array("scales", scales, (len(heights),))
    if not 2 <= len(heights) <= MAX_HEIGHTS:
        raise ValueError(f"heights must be 2 to {MAX_HEIGHTS}, got {len(heights)}")
    if not (np.diff(heights) >= MIN_LENGTH).all():
        raise ValueError(
            f"heights must increase, by {MIN_LENGTH:g} m or more, got {heights.tolist()} m"
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


def natural_spline(knots: Floats, values: Floats) -> PiecewiseCubic:
    """The natural cubic spline through values (n,)."""
    width = np.diff(knots)
    matrix = np.eye(len(knots))
    inner = np.arange(1, len(knots) - 1)
    matrix[inner, inner - 1], matrix[inner, inner + 1] = width[:-1], width[1:]
    matrix[inner, inner] = 2 * (width[:-1] + width[1:])
    turn = np.zeros(len(knots))
    turn[1:-1] = 6 * np.diff(np.diff(values) / width)
    return _from_bends(knots, values, np.asarray(np.linalg.solve(matrix, turn), np.float64))


def straight_pieces(knots: Floats, values: Floats) -> PiecewiseCubic:
    """Straight lines through values (n,) at increasing knots (n,)."""
    slopes = np.diff(values) / np.diff(knots)
    none = np.zeros_like(slopes)
    return PiecewiseCubic(knots, np.stack([values[:-1], slopes, none, none]))


def profile_mesh(
    outline: Callable[[int], Floats],
    scale: PiecewiseCubic,
    shear: Floats,
    level: int,
    *,
    side_rings: float = 3 / 8,
    cap_rings: float = 1 / 8,
) -> Mesh:
    """A swept outline, closed by plane ends or, where the scale is 0, an apex; then sheared.

    `side_rings`, `cap_rings`: rings of the side, and of an end, over the points of a ring.
    """
    around = max(2 ** (level + 2), 8)
    size, height = _profile(scale, int(side_rings * around), int(cap_rings * around))
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
    # The parts of each piece are proportional to its length, at least one.
    parts = np.maximum(np.rint(rings * np.diff(knots) / np.ptp(knots)), 1).astype(int)
    piece = np.repeat(np.arange(len(parts), dtype=np.int32), parts)
    part = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    height = knots[piece] + np.diff(knots)[piece] * part / parts[piece]
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


def _nearest(x: Floats, y: Floats, towards: Floats, speed: float, lengths: Floats) -> Floats:
    """Least distance of rays from the axis over the lengths, not 0."""
    dx, dy, _ = towards
    place = np.clip(-(x * dx + y * dy) / (speed * speed + TINY), 0.0, lengths)
    return np.asarray(np.hypot(x + dx * place, y + dy * place)) + TINY


class SectionBounds(NamedTuple):
    """Bounds of a section."""

    radius: tuple[float, float]  # [m] least and largest distance of the outline from 0
    hollow: float  # [1/m] largest -(g + g''), 0 if the section is convex
    bulge: float  # [1/m] largest g + g'', possibly infinite
    steepest: float  # [1/m] largest slope of the gauge


class Section(Protocol):
    """A cross-section."""

    @property
    def traits(self) -> SectionBounds:
        """Bounds of the section."""

    def gauge_along(self, x: Floats, y: Floats, dx: Floats, dy: Floats) -> tuple[Floats, Floats]:
        """Gauge at places, and its derivative along directions, (n,) each."""

    def outline(self, count: int) -> Floats:
        """Points (count, 2) [m] around it, counter-clockwise."""


class SplineSection:
    """The closed cubic spline through radii at even azimuths, the first at 0.

    `radii` (n,): 3 to 64 distances from the axis [m]. Raises ValueError if there are too few or too
    many, or the outline would reach the axis.
    """

    def __init__(self, radii: Floats):
        radii = finite_array("radii", radii, (None,))
        if not MIN_RADII <= len(radii) <= MAX_RADII:
            raise ValueError(f"radii must be {MIN_RADII} to {MAX_RADII}, got {len(radii)}")
        if not (radii >= MIN_LENGTH).all():
            raise ValueError(
                f"radii must be positive, {MIN_LENGTH:g} m or more, got {radii.tolist()} m"
            )
        self._rho = periodic_spline(np.linspace(0.0, 2 * math.pi, len(radii) + 1), radii)
        inner = self._rho.value_range()[0]
        if not inner > 0.0:
            raise ValueError(
                f"radii change so much that the curve through them reaches the axis: {inner:.4g} m "
                f"is its least radius; give more of them, or more even ones than {radii.tolist()} m"
            )
        self.traits = _spline_traits(self._rho)

    def gauge_along(self, x: Floats, y: Floats, dx: Floats, dy: Floats) -> tuple[Floats, Floats]:
        """See `Section.gauge_along`."""
        distance = np.hypot(x, y)
        rho, slope = self._radius(np.arctan2(y, x))
        inverse = 1.0 / (distance + TINY)
        outwards, across = (x * dx + y * dy) * inverse, (x * dy - y * dx) * inverse
        return distance / rho, (outwards - slope / rho * across) / rho

    def outline(self, count: int) -> Floats:
        """See `Section.outline`."""
        azimuth = np.linspace(0.0, 2 * math.pi, count, endpoint=False)
        rho = self._radius(azimuth)[0]
        return np.column_stack([rho * np.cos(azimuth), rho * np.sin(azimuth)])

    def _radius(self, azimuth: Floats) -> tuple[Floats, Floats]:
        azimuth = np.mod(azimuth, 2 * math.pi)
        return self._rho.at(azimuth, self._rho.piece(azimuth))[:2]


def periodic_spline(knots: Floats, values: Floats) -> PiecewiseCubic:
    """The periodic cubic spline through values (n,) at evenly spaced knots (n + 1,)."""
    count, width = len(values), float(knots[1] - knots[0])
    matrix = 4 * np.eye(count)
    rows = np.arange(count)
    np.add.at(matrix, (rows, (rows + 1) % count), 1.0)
    np.add.at(matrix, (rows, rows - 1), 1.0)
    second = np.roll(values, -1) - 2 * values + np.roll(values, 1)
    turn = np.asarray(6 * second / width**2, np.float64)
    bends = np.asarray(np.linalg.solve(matrix, turn), np.float64)
    wound = np.concatenate([values, values[:1]])
    return _from_bends(knots, wound, np.concatenate([bends, bends[:1]]))


def _from_bends(knots: Floats, values: Floats, bends: Floats) -> PiecewiseCubic:
    width = np.diff(knots)
    slope = np.diff(values) / width - width * (2 * bends[:-1] + bends[1:]) / 6
    third = np.diff(bends) / (6 * width)
    return PiecewiseCubic(knots, np.stack([values[:-1], slope, bends[:-1] / 2, third]))


def _spline_traits(rho: PiecewiseCubic, n_parts: int = 64) -> SectionBounds:
    """Bounds by intervals, `n_parts` of each piece.

    With g = 1 / rho, g + g'' = (rho^2 + 2 rho'^2 - rho rho'') / rho^3.
    """
    share = np.linspace(0.0, 1.0, n_parts + 1)
    width = np.diff(rho.knots)
    places = rho.knots[:-1, None] + share * width[:, None]
    piece = np.repeat(np.arange(len(width), dtype=np.int32)[:, None], n_parts + 1, axis=1)
    value, slope, bend = rho.at(places, piece)
    step = width[:, None] / n_parts
    bends = _part_ranges(bend, 0.0 * step)  # linear in each part
    most_bend = np.abs(bends).max(axis=0)
    slopes = _part_ranges(slope, np.abs(np.diff(bend, axis=1)) * step / 8)
    values = _part_ranges(value, most_bend * step**2 / 8)
    least_slope = np.where(slopes[0] * slopes[1] <= 0.0, 0.0, np.abs(slopes).min(axis=0))
    most_slope = np.abs(slopes).max(axis=0)
    products = values[:, None] * bends[None]  # radius times bend, at its corners
    low = values[0] ** 2 + 2 * least_slope**2 - products.max(axis=(0, 1))
    high = values[1] ** 2 + 2 * most_slope**2 - products.min(axis=(0, 1))
    hollow, bulge = (-low / values[0] ** 3).max(), (high / values[0] ** 3).max()
    steepest = (np.hypot(1.0, most_slope / values[0]) / values[0]).max()
    return SectionBounds(rho.value_range(), max(float(hollow), 0.0), float(bulge), float(steepest))


def _part_ranges(at: Floats, off_chord: Floats) -> Floats:
    """Bounds in each part, (2, ...), from values at its ends and the distance off the chord."""
    first, last = at[:, :-1], at[:, 1:]
    return np.stack([np.minimum(first, last) - off_chord, np.maximum(first, last) + off_chord])


class SuperellipseSection:
    """A superellipse about 0.

    `size` (2,): semi-axes along x and y [m]. `exponent`: 0.02 nearly a rectangle, 1 an ellipse, 2 a
    rhombus. Raises ValueError if a semi-axis is not positive or the exponent is out of its range.
    """

    def __init__(self, size: Floats, exponent: float):
        size = finite_array("size", size, (2,))
        if not (size >= MIN_LENGTH).all():
            raise ValueError(
                f"size must be positive, {MIN_LENGTH:g} m or more, got {size.tolist()} m"
            )
        if not MIN_EXPONENT <= exponent <= MAX_EXPONENT:
            raise ValueError(
                f"exponent must lie between {MIN_EXPONENT} and {MAX_EXPONENT}, got {exponent}"
            )
        self._size, self._power = size, 2.0 / exponent
        diagonal, rounded = float(np.hypot(*size)), exponent <= 1.0
        inner = float(size.min()) if rounded else float(size.prod()) / diagonal
        outer = diagonal if rounded else float(size.max())
        # A norm of power p >= 2 bends by (p - 1) |v|^2 / |x| at most: see Superquadric.smoothness.
        bulge = (self._power - 1.0) * outer / inner**2 if rounded else math.inf
        self.traits = SectionBounds((inner, outer), 0.0, bulge, 1.0 / inner)

    def gauge_along(self, x: Floats, y: Floats, dx: Floats, dy: Floats) -> tuple[Floats, Floats]:
        """See `Section.gauge_along`."""
        a, b = self._size.tolist()
        outwards_x, outwards_y = np.copysign(1.0, x) * (dx / a), np.copysign(1.0, y) * (dy / b)
        return p_norm_along(np.abs(x) / a, np.abs(y) / b, outwards_x, outwards_y, self._power)

    def outline(self, count: int) -> Floats:
        """See `Section.outline`; corners are vertices if `count` is a multiple of 8."""
        angle = np.arange(count) * (2 * math.pi / count)
        rays = np.column_stack([np.cos(angle), np.sin(angle)])
        size, none = np.abs(rays), np.zeros(count)
        gauge = p_norm_along(size[:, 0], size[:, 1], none, none, self._power)[0]
        return rays * self._size / gauge[:, None]


class PiecewiseCubic(NamedTuple):
    """A function in pieces a + b u + c u^2 + d u^3, with u from the piece's begin."""

    knots: Floats  # (n + 1,), increasing
    coefficients: Floats  # (4, n)

    def piece(self, places: Floats) -> Ints:
        """Piece of each place, or the nearest piece."""
        pieces = np.searchsorted(self.knots, places, side="right") - 1
        return np.clip(pieces, 0, len(self.knots) - 2).astype(np.int32)

    def at(self, places: Floats, piece: Ints) -> tuple[Floats, Floats, Floats]:
        """Value and the first two derivatives of pieces, also beyond their ends."""
        u = places - self.knots[piece]
        a, b, c, d = self.coefficients[:, piece]
        return a + u * (b + u * (c + u * d)), b + u * (2 * c + u * 3 * d), 2 * c + 6 * d * u

    def extremes(self) -> tuple[Floats, Floats]:
        """Places of extremes inside the pieces, and the values there."""
        _, b, c, d = self.coefficients
        root = np.sqrt(np.maximum(c * c - 3 * b * d, 0.0))
        turned = -(c + np.copysign(root, c))  # the larger root first, without cancellation
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.stack([turned / (3 * d), b / turned])
        width = np.diff(self.knots)
        piece = np.nonzero((u > 0.0) & (u < width))
        places = self.knots[piece[1]] + u[piece]
        return places, self.at(places, piece[1].astype(np.int32))[0]

    def value_range(self) -> tuple[float, float]:
        """Least and largest value from the first knot to the last."""
        ends = self.at(self.knots, self.piece(self.knots))[0]
        values = np.concatenate([ends, self.extremes()[1]])
        return float(values.min()), float(values.max())
