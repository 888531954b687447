"""Cross-sections of generalised cylinders, star-shaped about 0, and their splines.

A section answers with its gauge |p| / rho(theta): below 1 inside, 1 on the outline. Along a
line at speed v, a distance r from 0, with the part c of the speed across the radius, the gauge
bends by (g + g'') c^2 / r with g = 1 / rho: bounds of g + g'' are all that casting needs.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.shapes.superquadrics import (
    LARGEST_EXPONENT,
    LEAST_EXPONENT,
    SMALLEST,
    p_norm_along,
)

LEAST_RADII, MOST_RADII = 3, 64
LEAST_RADIUS = 1e-9  # m
SPLITS = 64  # Parts of each piece of the outline over which its bend is bounded


class SectionBounds(NamedTuple):
    """Bounds of a section."""

    radius: tuple[float, float]  # Least and largest distance of the outline from 0, m
    hollow: float  # How negative g + g'' gets, 0 if the section is convex, 1/m
    bulge: float  # Largest g + g'', perhaps infinite, 1/m
    steepest: float  # Largest slope of the gauge, 1/m


class Section(Protocol):
    """A cross-section."""

    @property
    def traits(self) -> SectionBounds:
        """Its bounds."""

    def gauge_along(self, x: Floats, y: Floats, dx: Floats, dy: Floats) -> tuple[Floats, Floats]:
        """Gauge at places, and its derivative along directions, (n,) each."""

    def outline(self, count: int) -> Floats:
        """Points (count, 2) around it, counter-clockwise, m."""


class SplineSection:
    """The closed cubic spline through radii at even azimuths, the first at 0.

    `radii` (n,): 3 to 64 distances from the axis, m. Raises ValueError if there are too few or too
    many, or the outline would reach the axis.
    """

    def __init__(self, radii: Floats):
        radii = finite_array("radii", radii, (None,))
        if not LEAST_RADII <= len(radii) <= MOST_RADII:
            raise ValueError(f"radii must be {LEAST_RADII} to {MOST_RADII}, got {len(radii)}")
        if not (radii >= LEAST_RADIUS).all():
            raise ValueError(
                f"radii must be positive, {LEAST_RADIUS:g} m or more, got {radii.tolist()} m"
            )
        knots = np.linspace(0.0, 2 * math.pi, len(radii) + 1)
        self._rho = periodic_spline(knots, radii)
        least = self._rho.value_range()[0]
        if not least > 0.0:
            raise ValueError(
                f"radii change so much that the curve through them reaches the axis: {least:.4g} m "
                f"is its least radius; give more of them, or more even ones than {radii.tolist()} m"
            )
        self.traits = _spline_traits(self._rho)

    def gauge_along(self, x: Floats, y: Floats, dx: Floats, dy: Floats) -> tuple[Floats, Floats]:
        """See `Section.gauge_along`."""
        distance = np.hypot(x, y)
        rho, slope = self._radius(np.arctan2(y, x))
        inverse = 1.0 / (distance + SMALLEST)
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
    """The cubic spline through values (n,) at evenly spaced knots (n + 1,), the last the first."""
    count, width = len(values), float(knots[1] - knots[0])
    matrix = 4 * np.eye(count)
    every = np.arange(count)
    np.add.at(matrix, (every, (every + 1) % count), 1.0)
    np.add.at(matrix, (every, every - 1), 1.0)
    second = np.roll(values, -1) - 2 * values + np.roll(values, 1)
    turn = np.asarray(6 * second / width**2, np.float64)
    bends = np.asarray(np.linalg.solve(matrix, turn), np.float64)
    return _from_bends(
        knots, np.concatenate([values, values[:1]]), np.concatenate([bends, bends[:1]])
    )


def _spline_traits(rho: PiecewiseCubic) -> SectionBounds:
    """By interval arithmetic over small parts of the outline.

    With g = 1 / rho: g + g'' = (rho^2 + 2 rho'^2 - rho rho'') / rho^3.
    """
    share = np.linspace(0.0, 1.0, SPLITS + 1)
    width = np.diff(rho.knots)
    places = rho.knots[:-1, None] + share * width[:, None]
    piece = np.repeat(np.arange(len(width), dtype=np.int32)[:, None], SPLITS + 1, axis=1)
    value, slope, bend = rho.at(places, piece)
    step = width[:, None] / SPLITS
    bends = _ends(bend, 0.0 * step)  # straight in each part
    most_bend = np.abs(bends).max(axis=0)
    slopes = _ends(slope, np.abs(np.diff(bend, axis=1)) * step / 8)
    values = _ends(value, most_bend * step**2 / 8)
    least_slope = np.where(slopes[0] * slopes[1] <= 0.0, 0.0, np.abs(slopes).min(axis=0))
    most_slope = np.abs(slopes).max(axis=0)
    products = values[:, None] * bends[None]  # radius times bend: its corners
    low = values[0] ** 2 + 2 * least_slope**2 - products.max(axis=(0, 1))
    high = values[1] ** 2 + 2 * most_slope**2 - products.min(axis=(0, 1))
    hollow, bulge = (-low / values[0] ** 3).max(), (high / values[0] ** 3).max()
    steepest = (np.hypot(1.0, most_slope / values[0]) / values[0]).max()
    return SectionBounds(rho.value_range(), max(float(hollow), 0.0), float(bulge), float(steepest))


def _ends(at: Floats, more: Floats) -> Floats:
    """Range over each part, from its ends and how far it can leave the chord, (2, ...)."""
    first, last = at[:, :-1], at[:, 1:]
    return np.stack([np.minimum(first, last) - more, np.maximum(first, last) + more])


class SuperellipseSection:
    """A superellipse about 0.

    `size` (2,): semi-axes along x and y, m. `exponent`: 0.02 nearly a rectangle, 1 an ellipse, 2 a
    rhombus. Raises ValueError if a semi-axis is not positive or the exponent is out of its range.
    """

    def __init__(self, size: Floats, exponent: float):
        size = finite_array("size", size, (2,))
        if not (size >= LEAST_RADIUS).all():
            raise ValueError(
                f"size must be positive, {LEAST_RADIUS:g} m or more, got {size.tolist()} m"
            )
        if not LEAST_EXPONENT <= exponent <= LARGEST_EXPONENT:
            raise ValueError(
                f"exponent must lie between {LEAST_EXPONENT} and {LARGEST_EXPONENT}, got {exponent}"
            )
        self._size, self._power = size, 2.0 / exponent
        diagonal, rounded = float(np.hypot(*size)), exponent <= 1.0
        least = float(size.min()) if rounded else float(size.prod()) / diagonal
        most = diagonal if rounded else float(size.max())
        # A norm of power p >= 2 bends by (p - 1) |v|^2 / |x| at most: see Superquadric.smoothness.
        bulge = (self._power - 1.0) * most / least**2 if rounded else math.inf
        self.traits = SectionBounds((least, most), 0.0, bulge, 1.0 / least)

    def gauge_along(self, x: Floats, y: Floats, dx: Floats, dy: Floats) -> tuple[Floats, Floats]:
        """See `Section.gauge_along`."""
        a, b = self._size.tolist()
        outwards_x, outwards_y = np.copysign(1.0, x) * (dx / a), np.copysign(1.0, y) * (dy / b)
        return p_norm_along(np.abs(x) / a, np.abs(y) / b, outwards_x, outwards_y, self._power)

    def outline(self, count: int) -> Floats:
        """See `Section.outline`; a corner is met if `count` is a multiple of 8."""
        angle = np.arange(count) * (2 * math.pi / count)
        rays = np.column_stack([np.cos(angle), np.sin(angle)])
        size, none = np.abs(rays), np.zeros(count)
        gauge = p_norm_along(size[:, 0], size[:, 1], none, none, self._power)[0]
        return rays * self._size / gauge[:, None]


class PiecewiseCubic(NamedTuple):
    """A function of one number in pieces a + b u + c u^2 + d u^3, u from the piece's begin."""

    knots: Floats  # (n + 1,), increasing
    coefficients: Floats  # (4, n)

    def piece(self, places: Floats) -> Ints:
        """Piece in which each place lies, or which is nearest to it."""
        found = np.searchsorted(self.knots, places, side="right") - 1
        return np.clip(found, 0, len(self.knots) - 2).astype(np.int32)

    def at(self, places: Floats, piece: Ints) -> tuple[Floats, Floats, Floats]:
        """Value and the first two derivatives of given pieces, carried on beyond their ends."""
        u = places - self.knots[piece]
        a, b, c, d = self.coefficients[:, piece]
        return a + u * (b + u * (c + u * d)), b + u * (2 * c + u * 3 * d), 2 * c + 6 * d * u

    def extremes(self) -> tuple[Floats, Floats]:
        """Places inside the pieces at which the function has an extreme, and its values there."""
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


def straight_pieces(knots: Floats, values: Floats) -> PiecewiseCubic:
    """Straight lines through values (n,) at increasing knots (n,)."""
    slopes = np.diff(values) / np.diff(knots)
    none = np.zeros_like(slopes)
    return PiecewiseCubic(knots, np.stack([values[:-1], slopes, none, none]))


def natural_spline(knots: Floats, values: Floats) -> PiecewiseCubic:
    """The cubic spline through values (n,) that does not bend at its ends."""
    width = np.diff(knots)
    matrix = np.eye(len(knots))
    inner = np.arange(1, len(knots) - 1)
    matrix[inner, inner - 1], matrix[inner, inner + 1] = width[:-1], width[1:]
    matrix[inner, inner] = 2 * (width[:-1] + width[1:])
    turn = np.zeros(len(knots))
    turn[1:-1] = 6 * np.diff(np.diff(values) / width)
    return _from_bends(knots, values, np.asarray(np.linalg.solve(matrix, turn), np.float64))


def _from_bends(knots: Floats, values: Floats, bends: Floats) -> PiecewiseCubic:
    """Pieces from the values and the second derivatives at the knots."""
    width = np.diff(knots)
    slope = np.diff(values) / width - width * (2 * bends[:-1] + bends[1:]) / 6
    return PiecewiseCubic(
        knots, np.stack([values[:-1], slope, bends[:-1] / 2, np.diff(bends) / (6 * width)])
    )
