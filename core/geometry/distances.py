"""How far two surfaces are apart, the same way everywhere: Chamfer, RMS, Hausdorff, normals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Floats
from palpate.core.geometry.meshes import areas_and_normals, triangle_corners
from palpate.core.geometry.nearest import NearestSearch, nearest_points, nearest_search

SAMPLES = 20_000  # On each surface, so that the mean is right to about one part in a hundred
SEED = 1999


class SurfaceDistances(NamedTuple):
    """How far two surfaces are apart."""

    chamfer: float  # Mean of the two one-way mean distances, m
    rms: float  # Root mean square distance over both ways, m
    p95: float  # The larger of the two 95 % quantiles, m
    hausdorff: float  # The largest distance of both ways, m
    # Mean angle between the normals at the samples and at their nearest points, degrees.
    normal_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class PreparedSurface:
    """A surface with its samples and its search tree, for any number of comparisons."""

    normals: Floats  # (m, 3): unit normal of each face
    samples: SurfaceSamples
    search: NearestSearch


def prepare_surface(vertices: ArrayLike, faces: ArrayLike) -> PreparedSurface:
    """Sample a surface and prepare it for the search.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    faces : (m, 3) array of integers
        Rows of `vertices`. Faces without area are left out.

    Raises
    ------
    ValueError
        If a vertex is not finite, a face names a vertex that is not there, or the surface has
        no area.
    """
    corners = triangle_corners(vertices, faces)
    areas, normals = areas_and_normals(corners)
    corners, normals = corners[areas > 0.0], normals[areas > 0.0]
    if not len(corners):
        raise ValueError(f"a surface must have an area, but all {len(areas)} faces have none")
    samples = sample_surface(corners, SAMPLES, np.random.default_rng(SEED))
    return PreparedSurface(normals, samples, nearest_search(corners))


def compare_surfaces(one: PreparedSurface, other: PreparedSurface) -> SurfaceDistances:
    """Distances between two surfaces, from the samples of each to the other's triangles.

    Both ways count alike: ``compare(a, b) == compare(b, a)``.
    """
    (there, there_angles), (back, back_angles) = _one_way(one, other), _one_way(other, one)
    mean_square = 0.5 * (float(np.mean(there**2)) + float(np.mean(back**2)))
    angles = 0.5 * (float(there_angles.mean()) + float(back_angles.mean()))
    return SurfaceDistances(
        chamfer=0.5 * (float(there.mean()) + float(back.mean())),
        rms=math.sqrt(mean_square),
        p95=max(float(np.quantile(there, 0.95)), float(np.quantile(back, 0.95))),
        hausdorff=max(float(there.max()), float(back.max())),
        normal_deg=math.degrees(angles),
    )


def _one_way(source: PreparedSurface, target: PreparedSurface) -> tuple[Floats, Floats]:
    """Distance (m) and angle between normals (rad), each (n,), at the source's samples."""
    nearest = nearest_points(target.search, source.samples.points)
    here, there = source.normals[source.samples.faces], target.normals[nearest.faces]
    across = np.cross(here, there)
    sine = np.sqrt(np.einsum("ij,ij->i", across, across))
    # By atan2: the arc cosine loses half the digits of small angles.
    return nearest.distances, np.arctan2(sine, np.einsum("ij,ij->i", here, there))


class SurfaceSamples(NamedTuple):
    """Points on a surface."""

    points: Floats  # (n, 3), m
    faces: NDArray[np.intp]  # (n,): the face on which each lies, ascending


def sample_surface(corners: Floats, count: int, rng: np.random.Generator) -> SurfaceSamples:
    """Points on triangles, uniform by area.

    `corners` (m, 3, 3): corners of the triangles, m. `count`: number of points. `rng`: source of
    the randomness. Raises ValueError if the triangles have no area.

    Stratified: the faces are laid end to end by area, the line is cut into `count` equal
    pieces, and each piece gets one point. Every point of the surface is as likely as any
    other, so means stay unbiased, but their scatter is that of a much larger plain sample.
    Within a face: Osada et al., *Shape distributions*, 2002, (1).
    """
    line = np.cumsum(areas_and_normals(corners)[0])
    if not line[-1] > 0.0:
        raise ValueError("a surface must have an area to be sampled, got 0")
    places = (np.arange(count) + rng.random(count)) / count * line[-1]
    # To the right of all faces that end at or before the place: faces without area get none.
    faces = np.searchsorted(line, places, side="right")
    faces = np.minimum(faces, np.searchsorted(line, line[-1]))  # rounding of the last place
    root = np.sqrt(rng.random(count))[:, None]
    share = rng.random(count)[:, None]
    a, b, c = corners[faces, 0], corners[faces, 1], corners[faces, 2]
    return SurfaceSamples(a + root * (b - a) + root * share * (c - b), faces)
