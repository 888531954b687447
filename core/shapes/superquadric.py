"""Superquadric: the thesis's basic solid, cast exactly.

The inside-outside function F of (2.6) is turned into the gauge N = F^(1/2), which is a norm
for exponents up to 2: N is then convex along every ray, Newton's method from outside is
monotone and cannot miss, and N' >= 0 outside proves that a ray meets nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.shapes.icosphere import icosphere
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh

LEAST_EXPONENT, LARGEST_EXPONENT = 0.02, 2.0
TINY = 1e-300
NEWTON_TOLERANCE = 1e-12
"""Of the gauge, which is 1 on the surface: below 1e-12 of the object's size."""
MOST_ITERATIONS = 60


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

    def gauge(self, points: Floats) -> Floats:
        """Gauge of points (n, 3): below 1 inside, 1 on the surface, above 1 outside."""
        return self._gauge_along(points, np.zeros(3))[0]

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        ranges = np.full(len(origins), MISS)
        gauge, slope = self._gauge_along(origins, direction)
        ranges[gauge <= 1.0] = INSIDE
        active = np.flatnonzero((gauge > 1.0) & (slope < 0.0))
        travelled = np.zeros(len(active))
        gauge, slope = gauge[active], slope[active]
        for _ in range(MOST_ITERATIONS):
            with np.errstate(over="ignore"):  # nearly parallel to a face: infinitely far
                travelled = travelled - (gauge - 1.0) / slope
            going = travelled <= reach  # a Newton point never lies past the surface
            active, travelled = active[going], travelled[going]
            if not len(active):
                break
            gauge, slope = self._gauge_along(
                origins[active] + travelled[:, None] * direction, direction
            )
            arrived = gauge - 1.0 <= NEWTON_TOLERANCE
            ranges[active[arrived]] = travelled[arrived]
            going = ~arrived & (slope < 0.0)
            active, travelled = active[going], travelled[going]
            gauge, slope = gauge[going], slope[going]
        ranges[active] = travelled
        return ranges

    def mesh(self, level: int) -> Mesh:
        """Icosphere projected along its radii: see `Shape.mesh`."""
        directions, faces = icosphere(level)
        scaled = directions * self.size
        return Mesh(scaled / self.gauge(scaled)[:, None], faces)

    def _gauge_along(self, points: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """Gauge at points (n, 3) and its derivative along one direction (3,)."""
        p, q = 2.0 / self.exponents[1], 2.0 / self.exponents[0]
        scaled = points / self.size
        x, y, z = np.abs(scaled).T
        # Across: the p-norm of x and y, by ratios to the larger.
        larger = np.maximum(x, y) + TINY
        x_power, y_power = (x / larger) ** (p - 1), (y / larger) ** (p - 1)
        total = x_power * (x / larger) + y_power * (y / larger)
        total = np.where(total > 0.0, total, 1.0)  # on the z axis
        across = larger * total ** (1 / p)
        # Along: the q-norm of that and z.
        largest = np.maximum(across, z) + TINY
        r_power, z_power = (across / largest) ** (q - 1), (z / largest) ** (q - 1)
        whole = r_power * (across / largest) + z_power * (z / largest)
        whole = np.where(whole > 0.0, whole, 1.0)  # at the centre
        gauge = largest * whole ** (1 / q)
        step = np.sign(scaled) * (direction / self.size)
        across_slope = total ** (1 / p - 1) * (x_power * step[:, 0] + y_power * step[:, 1])
        slope = whole ** (1 / q - 1) * (r_power * across_slope + z_power * step[:, 2])
        return gauge, slope
