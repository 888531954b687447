"""Superquadric, cast exactly; its gauge, inside-outside function, and points by two angles.

The inside-outside function F of (2.6) is turned into the gauge N = F^(1/2), which is a norm for
exponents up to 2: N is then convex along every ray, Newton's method from outside is monotone and
cannot miss, and N' >= 0 outside proves that a ray meets nothing. The gauge is a norm of a norm,
each computed from the ratio of its smaller to its larger argument, so that no power overflows and
no digits are lost. Of points by two angles, the trigonometric ones are dense where the surface is
curved; the regular ones are almost even.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.shapes import ray_casting
from palpate.core.shapes.protocol import ImplicitShape, Mesh
from palpate.core.shapes.tessellations import icosphere

MIN_EXPONENT, MAX_EXPONENT = 0.02, 2.0  # above 2 the solid is pinched, its gauge not a norm
RANGE_TOLERANCE = 1e-13  # fraction of the smallest semi-axis: some hundred rounding errors
TINY = 1e-300  # replaces 0 in a logarithm or a divisor
# Distance from a coordinate plane over the gauge, at which second derivatives of exponents above 1
# are evaluated at least: nearer they are unbounded.
MIN_RATIO = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Superquadric(ImplicitShape):
    """Superquadric about the origin, upright.

    `size` (3,): semi-axes [m]. `exponents` (2,): e1 along z and e2 across, from 0.02 (nearly a box)
    over 1 (ellipsoid) to 2 (octahedron). Raises ValueError if a semi-axis is not positive or an
    exponent is out of its range. Fung, 1999, (2.1) and (2.6), with powers of absolute values,
    scaled by the largest coordinate to avoid overflow. The text's F is the gauge squared.
    """

    size: Floats
    exponents: Floats

    def __post_init__(self) -> None:
        size = finite_array("size", self.size, (3,))
        exponents = finite_array("exponents", self.exponents, (2,))
        if not (size > 0).all():
            raise ValueError(f"size must be positive, got {size.tolist()} m")
        if not ((exponents >= MIN_EXPONENT) & (exponents <= MAX_EXPONENT)).all():
            raise ValueError(
                f"exponents must lie between {MIN_EXPONENT} and {MAX_EXPONENT}, "
                f"got {exponents.tolist()}"
            )
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "exponents", exponents)

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, (2, 3) [m]."""
        return np.stack([-self.size, self.size])

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """The gauge less 1, and its slope: see `ImplicitShape.inside_out`."""
        size = self.size[:, None]
        value, slope = self.gauge_along(points.T / size, directions.T / size)
        return value - 1.0, slope

    def gauge(self, points: Floats) -> Floats:
        """Gauge of points (n, 3): below 1 inside, 1 on the surface, above 1 outside."""
        return self.gauge_along(points.T / self.size[:, None], np.zeros((3, 1)))[0]

    def normals(self, points: Floats) -> Floats:
        """Outward unit normals (n, 3) of the scaled surfaces through points (n, 3).

        Across a crease, which exponents above 1 have in the coordinate planes, it is the mean of
        the two sides; at the centre, which has none, it is upwards.
        """
        slope = gauge_and_gradient(points / self.size, self.exponents)[1] / self.size
        slope[~slope.any(axis=1), 2] = 1.0
        return np.asarray(slope / np.sqrt(np.einsum("ni,ni->n", slope, slope))[:, None])

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        towards = direction / self.size
        places = np.ascontiguousarray(origins.T / self.size[:, None])
        starts, ends = ray_casting.clip_to_box(places, towards, np.ones(3))
        ends, along = np.minimum(ends, reach), towards[:, None]
        speed = float(np.abs(towards).sum())  # no norm of it is larger

        def roots(met: Ints) -> Floats:
            near = places[:, met]

            def gauge(travelled: Floats, which: ray_casting.RaySelection) -> tuple[Floats, Floats]:
                value, slope = self.gauge_along(near[:, which] + along * travelled, along)
                return value - 1.0, slope

            return ray_casting.first_roots(
                gauge,
                starts[met],
                ends[met],
                tolerance=RANGE_TOLERANCE * float(self.size.min()),
                rise=self.smoothness() * speed**2,
            )

        return ray_casting.ranges_of(starts, ends, roots)

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Spans of parallel rays inside, (n, 1, 2): see `CsgSolid.spans`."""
        return ray_casting.convex_spans(self, origins, direction)

    def mesh(self, level: int) -> Mesh:
        """Icosphere projected along its radii: see `Shape.mesh`."""
        directions, faces = icosphere(level)
        scaled = directions * self.size
        return Mesh(scaled / self.gauge(scaled)[:, None], faces)

    def smoothness(self) -> float:
        """Bound c: outside, the gauge's second derivative is at most c times speed squared.

        Infinite for exponents above 1: the gauge then has creases in the axes' planes. A norm
        composed of powers p, q >= 2 is smooth with the constant max(p, q) - 1: Ball, Carlen and
        Lieb, *Sharp uniform convexity and smoothness inequalities*, 1994.
        """
        return np.inf if self.exponents.max() > 1.0 else 2.0 / float(self.exponents.min()) - 1.0

    def gauge_along(self, scaled: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """Gauge and its derivative along directions, in coordinates divided by the semi-axes.

        `scaled` (3, n): points, by coordinate, 1. `direction` (3, n) or (3, 1), scaled likewise.
        Returns `gauge`, `slope` (n,): in a crease one of those between its two sides.
        """
        p, q = 2.0 / float(self.exponents[1]), 2.0 / float(self.exponents[0])
        x, y, z = np.abs(scaled)
        dx, dy, dz = np.copysign(1.0, scaled) * direction
        across, across_slope = p_norm_along(x, y, dx, dy, p)
        return p_norm_along(across, z, across_slope, dz, q)


def p_norm_along(x: Floats, y: Floats, dx: Floats, dy: Floats, p: float) -> tuple[Floats, Floats]:
    """The p-norm l (1 + (s/l)^p)^(1/p) of x and y, not negative, s the smaller, and its slope."""
    first = x >= y
    larger = np.maximum(x, y)
    ratio = np.minimum(x, y) / (larger + TINY)
    weight = ratio ** (p - 1.0)
    total = 1.0 + weight * ratio
    stretch = total ** (1.0 / p)
    slope = (np.where(first, dx, dy) + weight * np.where(first, dy, dx)) * (stretch / total)
    return larger * stretch, slope


class PNorm(NamedTuple):
    """(x^p + y^p)^(1/p) with p = 2/e, of non-negative numbers, and its slopes."""

    value: Floats
    by_x: Floats
    by_y: Floats
    by_exponent: Floats
    share_x: Floats  # x over the norm
    share_y: Floats  # y over the norm


class PNormCurvature(NamedTuple):
    """Slope of a norm along a direction, and the slope's derivatives."""

    slope: Floats
    by_x: Floats
    by_y: Floats
    by_exponent: Floats


def p_norm(x: Floats, y: Floats, e: Floats) -> PNorm:
    """The norm of exponent `e`, up to 2; all arguments have a common shape or broadcast to it."""
    p = 2.0 / e
    larger = np.maximum(np.maximum(x, y), TINY)
    ratio = np.minimum(x, y) / larger
    part = ratio**p
    total = 1.0 + part
    value = larger * total ** (1.0 / p)
    log_part = p * np.log(np.maximum(ratio, TINY))
    entropy = np.log1p(part) - part / total * log_part  # half of it, times the norm, is by_exponent
    share_x, share_y = x / value, y / value
    return PNorm(
        value, share_x ** (p - 1.0), share_y ** (p - 1.0), 0.5 * value * entropy, share_x, share_y
    )


def p_norm_curvature(at: PNorm, along_x: Floats, along_y: Floats, e: Floats) -> PNormCurvature:
    """Second derivatives of a norm, one of them along a direction."""
    p = 2.0 / e
    x, y = at.share_x, at.share_y
    slope = at.by_x * along_x + at.by_y * along_y
    sharpness = (np.maximum(x, MIN_RATIO) * np.maximum(y, MIN_RATIO)) ** (p - 2.0)
    turn = (p - 1.0) / at.value * sharpness * (y * along_x - x * along_y)
    half = 0.5 * p * p
    by_exponent = -(p - 1.0) * at.by_exponent / at.value * slope
    for share, part in ((x, at.by_x * along_x), (y, at.by_y * along_y)):
        by_exponent = by_exponent - half * part * np.log(np.maximum(share, MIN_RATIO**4))
    return PNormCurvature(slope, turn * y, -turn * x, by_exponent)


def gauge_and_gradient(scaled: Floats, exponents: Floats) -> tuple[Floats, Floats]:
    """Gauge (n,) and its gradient (n, 3), at points (n, 3) divided by the semi-axes.

    Across a crease, which exponents above 1 have in the coordinate planes, the gradient is the mean
    of its two sides; at the centre it is 0.
    """
    _, whole, slopes = _nested_norms(scaled, exponents)
    return whole.value, np.sign(scaled) * slopes


def _nested_norms(scaled: Floats, exponents: Floats) -> tuple[PNorm, PNorm, Floats]:
    x, y, z = np.abs(scaled).T
    across = p_norm(x, y, np.asarray(exponents[1]))
    whole = p_norm(across.value, z, np.asarray(exponents[0]))
    slopes = (whole.by_x * across.by_x, whole.by_x * across.by_y, whole.by_y)
    return across, whole, np.stack(slopes, axis=-1)


class InsideOutside(NamedTuple):
    """log F and its derivatives."""

    value: Floats  # (n,): negative inside, 0 on the surface, positive outside; -1381 at the centre
    # By the logarithms of the coordinates, (n, 3): between 0 and 2, with the sum 2, but 0 at the
    # centre. By the logarithms of the semi-axes it is the negative.
    by_log: Floats
    by_place: Floats  # by the scaled coordinates, (n, 3)
    by_exponents: Floats  # by e1 and e2, (n, 2)


def inside_outside(scaled: ArrayLike, exponents: ArrayLike) -> InsideOutside:
    """Logarithm of the inside-outside function.

    `scaled` (n, 3): points in the solid's own frame, divided by its semi-axes, 1. `exponents` (2,):
    e1 and e2, above 0 and up to 2. Raises ValueError if points are not finite, or an exponent is
    out of its range.

    Fung, 1999, (2.6), with powers of absolute values. F is the square of the gauge; the distance
    along a radius is that from the centre times 1 - 1 / sqrt(F). With exponents above 1 there are
    creases in the coordinate planes. On a crease the derivative by the place is the mean of its two
    sides; it never exceeds twice the reciprocal of the gauge. At the centre all derivatives are 0.
    """
    points = finite_array("scaled", scaled, (None, 3))
    pair = finite_array("exponents", exponents, (2,))
    if not ((pair > 0.0) & (pair <= MAX_EXPONENT)).all():
        raise ValueError(f"exponents must be above 0 and up to 2, got {pair.tolist()}")
    across, whole, slopes = _nested_norms(points, pair)
    outer, outer_z = _shares(whole)
    inner, inner_y = _shares(across)
    shares = np.stack([outer * inner, outer * inner_y, outer_z], axis=-1)
    by_e2 = outer * across.by_exponent / across.value
    by_e1 = whole.by_exponent / whole.value
    off_centre = (np.abs(points).max(axis=1) > TINY)[:, None]
    return InsideOutside(
        2.0 * np.log(whole.value),
        np.where(off_centre, 2.0 * shares, 0.0),
        np.where(off_centre, 2.0 * np.sign(points) * slopes / whole.value[:, None], 0.0),
        np.where(off_centre, 2.0 * np.stack([by_e1, by_e2], axis=-1), 0.0),
    )


def _shares(at: PNorm) -> tuple[Floats, Floats]:
    return at.by_x * at.share_x, at.by_y * at.share_y


class SurfacePoints(NamedTuple):
    """Points of a surface."""

    points: Floats  # (n, 3) [m]
    normals: Floats  # (n, 3): outward unit normals


def trigonometric_points(shape: Superquadric, eta: ArrayLike, omega: ArrayLike) -> SurfacePoints:
    """Points of (2.1), with powers that keep the sign.

    `eta` and `omega` (n,): angles [rad]. Raises ValueError if the angles are not finite, or their
    numbers differ. Normals by Barr, *Superquadrics and angle-preserving transformations*, 1981: the
    same angles with exponents 2 - e over the semi-axes. They are finite everywhere, poles and seam
    too.
    """
    cos_eta, sin_eta, cos_omega, sin_omega = _cosines(eta, omega)

    def surface(e1: float, e2: float) -> Floats:
        across = _power(cos_eta, e1)
        x, y = across * _power(cos_omega, e2), across * _power(sin_omega, e2)
        return np.column_stack([x, y, _power(sin_eta, e1)])

    e1, e2 = shape.exponents.tolist()
    normals = _units(surface(2.0 - e1, 2.0 - e2) / shape.size)
    return SurfacePoints(shape.size * surface(e1, e2), normals)


def _power(value: Floats, exponent: float) -> Floats:
    return np.sign(value) * np.abs(value) ** exponent


def regular_points(shape: Superquadric, eta: ArrayLike, omega: ArrayLike) -> SurfacePoints:
    """Points of (2.4) and (2.5), on the radii of the scaled solid.

    As `trigonometric_points`; normals across a crease are the mean of its two sides.
    """
    cos_eta, sin_eta, cos_omega, sin_omega = _cosines(eta, omega)
    radii = np.column_stack([cos_eta * cos_omega, cos_eta * sin_omega, sin_eta])
    gauge, slope = gauge_and_gradient(radii, shape.exponents)
    return SurfacePoints(shape.size * radii / gauge[:, None], _units(slope / shape.size))


def _cosines(eta: ArrayLike, omega: ArrayLike) -> tuple[Floats, Floats, Floats, Floats]:
    first = finite_array("eta", eta, (None,))
    second = finite_array("omega", omega, (len(first),))
    return _exact(np.cos(first)), np.sin(first), _exact(np.cos(second)), _exact(np.sin(second))


def _exact(value: Floats) -> Floats:
    """Values with rounding errors of pi set to 0: their small powers would be far from 0."""
    return np.where(np.abs(value) < 4.0 * np.finfo(float).eps, 0.0, value)


def _units(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.sqrt(np.einsum("ni,ni->n", vectors, vectors))[:, None])
