"""How far two surfaces are apart, the same way everywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats
from palpate.core.measure.nearest import NearestSearch, nearest_points, search_of
from palpate.core.measure.sampling import Samples, sample_surface
from palpate.core.measure.triangles import areas_and_normals, corners_of

SAMPLES = 20_000
"""On each surface, so that the mean is right to about one part in a hundred."""
SEED = 1999


class Distances(NamedTuple):
    """How far two surfaces are apart."""

    chamfer: float
    """Mean of the two one-way mean distances, m."""
    rms: float
    """Root mean square distance over both ways, m."""
    p95: float
    """The larger of the two 95 % quantiles, m."""
    hausdorff: float
    """The largest distance of both ways, m."""
    normal_deg: float
    """Mean angle between the normals at the samples and at their nearest points, degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A surface with its samples and its search tree, for any number of comparisons."""

    normals: Floats
    """(m, 3): unit normal of each face."""
    samples: Samples
    search: NearestSearch


def prepare(vertices: ArrayLike, faces: ArrayLike) -> Prepared:
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
    corners = corners_of(vertices, faces)
    areas, normals = areas_and_normals(corners)
    corners, normals = corners[areas > 0.0], normals[areas > 0.0]
    if not len(corners):
        raise ValueError(f"a surface must have an area, but all {len(areas)} faces have none")
    samples = sample_surface(corners, SAMPLES, np.random.default_rng(SEED))
    return Prepared(normals, samples, search_of(corners))


def compare(one: Prepared, other: Prepared) -> Distances:
    """Distances between two surfaces, from the samples of each to the other's triangles.

    Both ways count alike: ``compare(a, b) == compare(b, a)``.
    """
    (there, there_angles), (back, back_angles) = _one_way(one, other), _one_way(other, one)
    mean_square = 0.5 * (float(np.mean(there**2)) + float(np.mean(back**2)))
    angles = 0.5 * (float(there_angles.mean()) + float(back_angles.mean()))
    return Distances(
        chamfer=0.5 * (float(there.mean()) + float(back.mean())),
        rms=math.sqrt(mean_square),
        p95=max(float(np.quantile(there, 0.95)), float(np.quantile(back, 0.95))),
        hausdorff=max(float(there.max()), float(back.max())),
        normal_deg=math.degrees(angles),
    )


def _one_way(source: Prepared, target: Prepared) -> tuple[Floats, Floats]:
    """Distance (m) and angle between normals (rad), each (n,), at the source's samples."""
    nearest = nearest_points(target.search, source.samples.points)
    here, there = source.normals[source.samples.faces], target.normals[nearest.faces]
    across = np.cross(here, there)
    sine = np.sqrt(np.einsum("ij,ij->i", across, across))
    # By atan2: the arc cosine loses half the digits of small angles.
    return nearest.distances, np.arctan2(sine, np.einsum("ij,ij->i", here, there))
