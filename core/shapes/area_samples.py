"""Places spread evenly by area over a superquadric that may be tapered and bent.

Even in its parameters is not even on the surface. Here flat facets are drawn by their area, places
on them evenly, and these are thrown onto the surface along the radii; how much area each then
stands for is known exactly, and decides whether it is kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.gauge import gauge_of
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.taper import Taper

LEVEL = 4
"""5120 facets."""
HEADROOM = 1.25
"""By how much a place may stand for more area than any corner or middle of a facet."""
NO_TAPER: Floats = np.zeros(2)
NO_BEND = Bend(0.0)
CORNERS_AND_MIDDLES = (
    np.array([[6, 0, 0], [0, 6, 0], [0, 0, 6], [2, 2, 2], [3, 3, 0], [3, 0, 3], [0, 3, 3]]) / 6.0
)
WEIGHTS = np.array([3, 3, 3, 27, 8, 8, 8]) / 60.0
"""Of these places in an integral over the facet: exact for cubics."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The surface of a superquadric that may be tapered and bent, ready to be sampled."""

    shape: Superquadric
    taper: Floats
    """Widening of x and y at the top, (2,)."""
    bend: Bend
    corners: Floats
    """Of its facets, (m, 3, 3), before it is tapered, m."""
    flat: Floats
    """Areas of the facets, (m,), m2."""
    heights: Floats
    """Distances of their planes from the origin, (m,), m."""
    areas: Floats
    """Areas of the surface over them, (m,), m2."""
    most: float
    """Largest ratio of the surface over a place to that over its facet's average place."""

    @property
    def area(self) -> float:
        """Of the surface, m2: to five digits, near sharp edges to two."""
        return float(self.areas.sum())


def surface_of(
    shape: Superquadric,
    taper: Floats = NO_TAPER,
    bend: Bend = NO_BEND,
    level: int = LEVEL,
) -> Surface:
    """Prepare the surface of a solid for sampling.

    Parameters
    ----------
    shape : Superquadric
        What is tapered and bent.
    taper : (2,) array
        Widening of x and y at the top: see `Taper`.
    bend : Bend
        How the tapered solid is bent.
    level : int
        Of the mesh whose facets are drawn; the samples are as even with any.

    Raises
    ------
    ValueError
        If the taper collapses the solid or the bend folds it.
    """
    vertices, faces = shape.mesh(level)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.sqrt(np.einsum("mi,mi->m", normals, normals))
    heights = np.einsum("mi,mi->m", normals, corners[:, 0]) / twice
    bare = Surface(shape, taper, bend, corners, 0.5 * twice, heights, np.zeros(0), 0.0)
    places = np.einsum("kc,mci->mki", CORNERS_AND_MIDDLES, corners).reshape(-1, 3)
    bend(_taper(bare)(places))  # refuses what it would fold
    over = _over(bare, places, np.repeat(heights, len(WEIGHTS))).reshape(-1, len(WEIGHTS))
    areas = bare.flat * (over @ WEIGHTS)
    most = float((over.max(axis=1) * bare.flat / areas).max())
    return replace(bare, areas=areas, most=most)


def area_samples(surface: Surface, count: int, rng: np.random.Generator) -> Floats:
    """Places (count, 3) on a surface, m, all equally likely by area and independent.

    Parameters
    ----------
    surface : Surface
        See `surface_of`.
    count : int
        Number of places.
    rng : Generator
        Source of the randomness.
    """
    line, limit = np.cumsum(surface.areas), HEADROOM * surface.most
    kept = [np.zeros((0, 3))]
    while sum(len(part) for part in kept) < count:
        drawn = rng.random((2 * count + 16, 4))
        facets = np.searchsorted(line, drawn[:, 0] * line[-1], side="right")
        facets = np.minimum(facets, len(line) - 1)  # rounding of the last place
        root = np.sqrt(drawn[:, 1])
        shares = np.column_stack([1.0 - root, root * (1.0 - drawn[:, 2]), root * drawn[:, 2]])
        places = np.einsum("nc,nci->ni", shares, surface.corners[facets])
        over = _over(surface, places, surface.heights[facets])
        crowding = over * surface.flat[facets] / surface.areas[facets]
        kept.append(_thrown(surface, places[drawn[:, 3] * limit < crowding]))
    return np.concatenate(kept)[:count]


def _taper(surface: Surface) -> Taper:
    along_x, along_y = surface.taper.tolist()
    return Taper(along_x, along_y, float(surface.shape.size[2]))


def _over(surface: Surface, places: Floats, heights: Floats) -> Floats:
    """Area of the surface over that of the facet, at places (n, 3) of facets.

    A patch that is thrown along the radii keeps its solid angle; a map stretches its normal by
    the cofactors of its Jacobian.
    """
    size = surface.shape.size
    gauge, slope = gauge_of(places / size, surface.shape.exponents)
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


def _thrown(surface: Surface, places: Floats) -> Floats:
    """Places of facets, thrown onto the surface, tapered and bent."""
    return surface.bend(_taper(surface)(places / surface.shape.gauge(places)[:, None]))
