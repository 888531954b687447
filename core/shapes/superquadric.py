"""Superquadric: the thesis's basic solid, cast exactly.

The inside-outside function F of (2.6) is turned into the gauge N = F^(1/2), which is a norm
for exponents up to 2: N is then convex along every ray, Newton's method from outside is
monotone and cannot miss, and N' >= 0 outside proves that a ray meets nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.shapes.clip import through_box
from palpate.core.shapes.first_root import Which, first_roots
from palpate.core.shapes.gauge import gauge_of
from palpate.core.shapes.icosphere import icosphere
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh

LEAST_EXPONENT, LARGEST_EXPONENT = 0.02, 2.0
"""Above the largest the solid is pinched, and the gauge no norm."""
TINY = 1e-300
RANGE_TOLERANCE = 1e-13
"""Of the smallest semi-axis: some hundred roundings."""


@dataclass(frozen=True, slots=True, eq=False)
class Superquadric:
    """Superquadric about the origin, upright.

    Parameters
    ----------
    size : (3,) array
        Semi-axes, m.
    exponents : (2,) array
        e1 along z and e2 across, from 0.02 (nearly a box) over 1 (ellipsoid) to 2 (octahedron).

    Raises
    ------
    ValueError
        If a semi-axis is not positive or an exponent is out of its range.

    Notes
    -----
    Fung, 1999, (2.1) and (2.6), with powers of absolute values and scaled by the largest
    coordinate, so that no exponent can overflow. The text's F is the gauge squared.
    """

    size: Floats
    exponents: Floats

    def __post_init__(self) -> None:
        size = finite_array("size", self.size, (3,))
        exponents = finite_array("exponents", self.exponents, (2,))
        if not (size > 0).all():
            raise ValueError(f"size must be positive, got {size.tolist()} m")
        if not ((exponents >= LEAST_EXPONENT) & (exponents <= LARGEST_EXPONENT)).all():
            raise ValueError(
                f"exponents must lie between {LEAST_EXPONENT} and {LARGEST_EXPONENT}, "
                f"got {exponents.tolist()}"
            )
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "exponents", exponents)

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, (2, 3), m."""
        return np.stack([-self.size, self.size])

    def enclosure(self) -> Floats:
        """The bounds: see `ImplicitShape.enclosure`."""
        return self.bounds()

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """The gauge less 1, and its slope: see `ImplicitShape.inside_out`."""
        value, slope = self.gauge_along(
            points.T / self.size[:, None], directions.T / self.size[:, None]
        )
        return value - 1.0, slope

    def gauge(self, points: Floats) -> Floats:
        """Gauge of points (n, 3): below 1 inside, 1 on the surface, above 1 outside."""
        return self.gauge_along(points.T / self.size[:, None], np.zeros((3, 1)))[0]

    def normals(self, points: Floats) -> Floats:
        """Outward unit normals (n, 3) of the scaled surfaces through points (n, 3).

        Across a crease, which exponents above 1 have in the coordinate planes, it is the mean of
        the two sides; at the centre, which has none, it is upwards.
        """
        slope = gauge_of(points / self.size, self.exponents)[1] / self.size
        slope[~slope.any(axis=1), 2] = 1.0
        return np.asarray(slope / np.sqrt(np.einsum("ni,ni->n", slope, slope))[:, None])

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        towards = direction / self.size
        places = np.ascontiguousarray(origins.T / self.size[:, None])
        starts, ends = through_box(places, towards, np.ones(3))
        ranges = np.full(len(origins), MISS)
        met = np.flatnonzero(starts <= np.minimum(ends, reach))
        if not len(met):
            return ranges
        places, along = places[:, met], towards[:, None]

        def gauge(travelled: Floats, which: Which) -> tuple[Floats, Floats]:
            value, slope = self.gauge_along(places[:, which] + along * travelled, along)
            return value - 1.0, slope

        speed = float(np.abs(towards).sum())  # no norm of it is larger
        found = first_roots(
            gauge,
            starts[met],
            np.minimum(ends[met], reach),
            tolerance=RANGE_TOLERANCE * float(self.size.min()),
            rise=self.smoothness() * speed**2,
        )
        ranges[met] = np.where(found == 0.0, INSIDE, found)
        return ranges

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays are inside, (n, 1, 2): see `spans`."""
        from palpate.core.shapes.spans import convex_spans

        return convex_spans(self, origins, direction)

    def mesh(self, level: int) -> Mesh:
        """Icosphere projected along its radii: see `Shape.mesh`."""
        directions, faces = icosphere(level)
        scaled = directions * self.size
        return Mesh(scaled / self.gauge(scaled)[:, None], faces)

    def smoothness(self) -> float:
        """A number c: outside, the gauge's second derivative is at most c times speed squared.

        Infinite for exponents above 1: the gauge then has creases in the axes' planes.

        Notes
        -----
        A norm composed of powers p, q >= 2 is smooth with the constant max(p, q) - 1: Ball,
        Carlen and Lieb, *Sharp uniform convexity and smoothness inequalities*, 1994.
        """
        if self.exponents.max() > 1.0:
            return np.inf
        return 2.0 / float(self.exponents.min()) - 1.0

    def gauge_along(self, scaled: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """Gauge and its derivative along directions, in coordinates divided by the semi-axes.

        Parameters
        ----------
        scaled : (3, n) array
            Points, by coordinate, 1.
        direction : (3, n) or (3, 1) array
            Directions, scaled likewise.

        Returns
        -------
        gauge, slope : (n,) arrays
            A slope where the gauge has a crease is one of those between its two sides.
        """
        p, q = 2.0 / float(self.exponents[1]), 2.0 / float(self.exponents[0])
        x, y, z = np.abs(scaled)
        dx, dy, dz = np.copysign(1.0, scaled) * direction
        across, across_slope = norm_along(x, y, dx, dy, p)
        return norm_along(across, z, across_slope, dz, q)


def norm_along(x: Floats, y: Floats, dx: Floats, dy: Floats, p: float) -> tuple[Floats, Floats]:
    """The p-norm of x and y, not negative, and its slope: by the ratio, so that nothing overflows.

    With s the smaller and l the larger: l (1 + (s/l)^p)^(1/p).
    """
    first = x >= y
    larger = np.maximum(x, y)
    ratio = np.minimum(x, y) / (larger + TINY)
    weight = ratio ** (p - 1.0)
    total = 1.0 + weight * ratio
    stretch = total ** (1.0 / p)
    slope = (np.where(first, dx, dy) + weight * np.where(first, dy, dx)) * (stretch / total)
    return larger * stretch, slope
