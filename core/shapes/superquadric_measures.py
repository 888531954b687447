"""Volume and moments of a superquadric in closed form, its area, and samples uniform by area.

Uniform parameters are not uniform on the surface. Here flat facets are drawn by their area, places
on them uniformly, and these are projected onto the surface along the radii; the ratio of areas is
known exactly, and gives the probability of keeping a sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.shapes.global_deformations import Bend, Taper
from palpate.core.shapes.superquadrics import Superquadric, gauge_and_gradient
from palpate.reprs import readable

NO_TAPER: Floats = np.zeros(2)
NO_BEND = Bend(0.0)
QUADRATURE_NODES = (  # corners and middles of a triangle and its sides, barycentric
    np.array([[6, 0, 0], [0, 6, 0], [0, 0, 6], [2, 2, 2], [3, 3, 0], [3, 0, 3], [0, 3, 3]]) / 6.0
)
QUADRATURE_WEIGHTS = np.array([3, 3, 3, 27, 8, 8, 8]) / 60.0  # exact for cubics


@readable
class MassMoments(NamedTuple):
    """Moments of a solid of density 1."""

    volume: float  # [m3]
    centroid: Floats  # (3,) [m]
    second: Floats  # integral of the coordinates' products about the frame's origin, (3, 3) [m5]

    def inertia(self) -> Floats:
        """Inertia (3, 3) [m5] about the frame's origin; times the density it is in kg m2."""
        return np.asarray(np.trace(self.second) * np.eye(3) - self.second)


def superquadric_volume(size: ArrayLike, exponents: ArrayLike) -> float:
    """Volume [m3] of a superquadric: 2 a1 a2 a3 e1 e2 B(e1/2 + 1, e1) B(e2/2, e2/2).

    `size` (3,): semi-axes, positive [m]. `exponents` (2,): positive; also below and above the range
    of a `Superquadric`. Raises ValueError if a semi-axis or an exponent is not positive.
    """
    semi_axes = finite_array("size", size, (3,))
    pair = finite_array("exponents", exponents, (2,))
    if not (semi_axes > 0.0).all():
        raise ValueError(f"size must be positive, got {semi_axes.tolist()} m")
    if not (pair > 0.0).all():
        raise ValueError(f"exponents must be positive, got {pair.tolist()}")
    e1, e2 = pair.tolist()
    return float(np.prod(semi_axes) * 4.0 * _ratio(0.5 * e2, 0.5 * e2) * _heights(e1, 1.0, 1)[0])


def superquadric_moments(shape: Superquadric, taper: ArrayLike = (0.0, 0.0)) -> MassMoments:
    """Volume, centroid and second moments of a superquadric that may be tapered.

    `shape`: the untapered solid. `taper` (2,): widening of x and y at the top: see `Taper`. Raises
    ValueError if a widening is not between -1 and 1. A section at the fraction h of the half height
    is widened by 1 + K h, so that each moment is a polynomial in the widenings. Its coefficients
    are integrals over h of a power of h times the section's area, or times its square for the
    moments across. A bend does not change the volume.
    """
    kx, ky = finite_array("taper", taper, (2,)).tolist()
    a, b, c = shape.size.tolist()
    Taper(kx, ky, c)  # raises ValueError if a section collapses
    e1, e2 = shape.exponents.tolist()
    area, across = 4.0 * _ratio(0.5 * e2, 0.5 * e2), 4.0 / 3.0 * _ratio(1.5 * e2, 0.5 * e2)
    wide, deep = np.array([1.0, kx]), np.array([1.0, ky])
    widening = np.convolve(wide, deep)
    heights, squares = a * b * c * area * _heights(e1, 1.0, 5), _heights(e1, 2.0, 5)
    content = float(widening @ heights[:3])
    over_x = np.convolve(np.convolve(wide, wide), widening) @ squares
    over_y = np.convolve(np.convolve(deep, deep), widening) @ squares
    return MassMoments(
        content,
        np.array([0.0, 0.0, c * float(widening @ heights[1:4]) / content]),
        np.diag(
            [
                a**3 * b * c * across * float(over_x),
                a * b**3 * c * across * float(over_y),
                c * c * float(widening @ heights[2:5]),
            ]
        ),
    )


def _heights(e1: float, power: float, count: int) -> Floats:
    """Integrals over h from -1 to 1 of h^k (1 - |h|^(2/e1))^(e1 power), k below count."""
    integrals = np.zeros(count)
    for k in range(0, count, 2):
        integrals[k] = 2.0 / (k + 1.0) * _ratio(0.5 * e1 * (k + 1.0), power * e1)
    return integrals


def _ratio(x: float, y: float) -> float:
    """Gamma(1 + x) Gamma(1 + y) / Gamma(1 + x + y): 1 where both vanish, and no digits lost."""
    from scipy.special import gammaln

    return float(np.exp(gammaln(1.0 + x) + gammaln(1.0 + y) - gammaln(1.0 + x + y)))


@dataclass(frozen=True, slots=True, eq=False)
class SampledSurface:
    """The surface of a superquadric that may be tapered and bent, prepared for sampling."""

    shape: Superquadric
    taper: Floats  # widening of x and y at the top, (2,)
    bend: Bend
    corners: Floats  # of the facets, (m, 3, 3) [m], before the taper
    flat: Floats  # areas of the facets, (m,) [m2]
    heights: Floats  # distances of their planes from the origin, (m,) [m]
    areas: Floats  # areas of the surface over them, (m,) [m2]
    most: float  # largest ratio of the surface over a place to the mean over its facet

    @property
    def area(self) -> float:
        """Area of the surface [m2]: to five digits, near sharp edges to two."""
        return float(self.areas.sum())


def sampled_surface(
    shape: Superquadric, taper: Floats = NO_TAPER, bend: Bend = NO_BEND, level: int = 4
) -> SampledSurface:
    """Prepare the surface of a solid for sampling.

    `shape`: the undeformed solid. `taper` (2,): widening of x and y at the top: see `Taper`.
    `bend`: of the tapered solid. `level`: of the mesh whose facets are drawn, which does not affect
    the distribution. Raises ValueError if the taper collapses the solid or the bend folds it.
    """
    vertices, faces = shape.mesh(level)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.sqrt(np.einsum("mi,mi->m", normals, normals))
    heights = np.einsum("mi,mi->m", normals, corners[:, 0]) / twice
    bare = SampledSurface(shape, taper, bend, corners, 0.5 * twice, heights, np.zeros(0), 0.0)
    places = np.einsum("kc,mci->mki", QUADRATURE_NODES, corners).reshape(-1, 3)
    bend(_taper(bare)(places))  # raises ValueError if it folds the solid
    ratio = _area_ratio(bare, places, np.repeat(heights, len(QUADRATURE_WEIGHTS))).reshape(
        -1, len(QUADRATURE_WEIGHTS)
    )
    areas = bare.flat * (ratio @ QUADRATURE_WEIGHTS)
    most = float((ratio.max(axis=1) * bare.flat / areas).max())
    return replace(bare, areas=areas, most=most)


def area_samples(
    surface: SampledSurface, count: int, rng: np.random.Generator, headroom: float = 1.25
) -> Floats:
    """Places (count, 3) [m] on a surface, uniform by area and independent.

    `surface`: see `sampled_surface`. `rng`: source of the randomness. `headroom`: assumed
    largest density, over the largest one at the quadrature nodes.
    """
    line, limit = np.cumsum(surface.areas), headroom * surface.most
    kept = [np.zeros((0, 3))]
    while sum(len(part) for part in kept) < count:
        drawn = rng.random((2 * count + 16, 4))
        facets = np.searchsorted(line, drawn[:, 0] * line[-1], side="right")
        facets = np.minimum(facets, len(line) - 1)  # rounding of the last place
        root = np.sqrt(drawn[:, 1])
        shares = np.column_stack([1.0 - root, root * (1.0 - drawn[:, 2]), root * drawn[:, 2]])
        places = np.einsum("nc,nci->ni", shares, surface.corners[facets])
        ratio = _area_ratio(surface, places, surface.heights[facets])
        crowding = ratio * surface.flat[facets] / surface.areas[facets]
        places = places[drawn[:, 3] * limit < crowding]
        projected = places / surface.shape.gauge(places)[:, None]
        kept.append(surface.bend(_taper(surface)(projected)))
    return np.concatenate(kept)[:count]


def _area_ratio(surface: SampledSurface, places: Floats, heights: Floats) -> Floats:
    """Area of the surface over that of the facet, at places (n, 3) of facets.

    Projection along radii keeps the solid angle; normals stretch by the Jacobian's cofactors.
    """
    size = surface.shape.size
    gauge, slope = gauge_and_gradient(places / size, surface.shape.exponents)
    normal = slope / size * (heights / gauge**3)[:, None]
    places = places / gauge[:, None]
    wide, deep = (1.0 + np.outer(surface.taper, places[:, 2] / size[2])).reshape(2, -1)
    lean = places[:, :2] * surface.taper / size[2]
    x, y = normal[:, 0] * deep, normal[:, 1] * wide
    z = normal[:, 2] * wide * deep - lean[:, 0] * x - lean[:, 1] * y
    tapered = places[:, :2] * np.column_stack([wide, deep])
    stretch = 1.0 - surface.bend.curvature * (tapered @ surface.bend.towards)
    across = np.sqrt(x * x + y * y) * stretch
    return np.asarray(np.sqrt(across * across + z * z))


def _taper(surface: SampledSurface) -> Taper:
    along_x, along_y = surface.taper.tolist()
    return Taper(along_x, along_y, float(surface.shape.size[2]))
