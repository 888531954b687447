"""Distances between two surfaces, and the rigid alignment of points to a surface.

An alignment minimises each point's distance from the nearest point of the surface, which is the
distance from the tangent plane there to first order: Chen and Medioni, *Object modelling by
registration of multiple range images*, 1992, with the damped steps of Fitzgibbon, *Robust
registration of 2D and 3D point sets*, 2003. It starts from the points' own pose, from the pose with
their mean moved to the surface's, and from all alignments of their principal axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry.meshes import areas_and_normals, triangle_corners
from palpate.core.geometry.nearest import NearestSearch, nearest_points, nearest_search
from palpate.core.least_squares import Solutions, levenberg_marquardt
from palpate.core.poses import (
    Pose,
    principal_axes,
    right_jacobians,
    rotation_angle,
    rotations_from_vectors,
)
from palpate.reprs import readable

MIN_POINTS = 6  # of an alignment, which has six parameters


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplingSettings:
    """Random samples on a surface; 20,000 give the mean distance to about 1 %."""

    n_samples: int = 20_000
    seed: int = 1999


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignmentSettings:
    """Search for the rigid motion of an alignment: all starts roughly, the best of them finely."""

    n_rough_points: int = 200
    n_fine_points: int = 2000
    rough_steps: int = 12
    fine_steps: int = 60
    n_refined: int = 4  # best starts, which are solved finely
    tolerance: float = 1e-7  # of the least-squares iteration
    min_turn: float = math.radians(5.0)  # [rad] between distinct motions
    # A distinct motion with a residual below either of these two makes the result ambiguous.
    max_ambiguous_ratio: float = 1.1  # over the least residual
    residual_floor: float = 5e-4  # fraction of the surface's size; facets alone cause as much
    # Of motions with equal residuals the least turned is taken.
    max_equal_ratio: float = 1.001  # over the least residual
    on_surface: float = 1e-12  # fraction of the size; nearer points have the surface's normal


DEFAULT_SAMPLING = SamplingSettings()


class SurfaceDistances(NamedTuple):
    """Distances between two surfaces."""

    chamfer: float  # [m] mean of the two one-way mean distances
    rms: float  # [m] root mean square distance in both directions
    p95: float  # [m] the larger of the two 95 % quantiles
    hausdorff: float  # [m] the largest distance in both directions
    normal_deg: float  # [deg] mean angle between normals at samples and at their nearest points
    rms_above: float  # [m] root mean square distance of samples above a height


@readable
@dataclass(frozen=True, slots=True, eq=False)
class PreparedSurface:
    """A surface with its samples and its search tree, for any number of comparisons."""

    normals: Floats  # (m, 3): unit normal of each face
    samples: SurfaceSamples
    search: NearestSearch

    def thinned(self, factor: int) -> PreparedSurface:
        """The surface with one of `factor` samples, which are as evenly distributed."""
        points, faces = self.samples
        samples = SurfaceSamples(points[::factor], faces[::factor])
        return PreparedSurface(self.normals, samples, self.search)


def prepare_surface(
    vertices: ArrayLike,
    faces: ArrayLike,
    samples: int = DEFAULT_SAMPLING.n_samples,
    seed: int = DEFAULT_SAMPLING.seed,
) -> PreparedSurface:
    """Sample a surface and prepare it for the search.

    `vertices` (n, 3) [m]. `faces` (m, 3): indices of vertices; faces without area are left out.
    With fewer `samples` distances scatter more, as their sampling floor shows. Raises ValueError if
    a vertex is not finite, an index is out of range, or the surface has no area.
    """
    corners = triangle_corners(vertices, faces)
    areas, normals = areas_and_normals(corners)
    corners, normals = corners[areas > 0.0], normals[areas > 0.0]
    if not len(corners):
        raise ValueError(f"a surface must have an area, but all {len(areas)} faces have none")
    places = sample_surface(corners, samples, np.random.default_rng(seed))
    return PreparedSurface(normals, places, nearest_search(corners))


def compare_surfaces(
    first: PreparedSurface, second: PreparedSurface, height: float = -math.inf
) -> SurfaceDistances:
    """Distances from the samples of each of two surfaces to the other, with equal weights.

    `height`: `rms_above` is of the samples above it [m], along z, whose nearest points are above it
    too; 0 if there are none.
    """
    (there, there_angles, up), (back, back_angles, down) = (
        _one_way(*pair, height) for pair in ((first, second), (second, first))
    )
    mean_square = 0.5 * (float(np.mean(there**2)) + float(np.mean(back**2)))
    above = there[up], back[down]
    angles = 0.5 * (float(there_angles.mean()) + float(back_angles.mean()))
    return SurfaceDistances(
        chamfer=0.5 * (float(there.mean()) + float(back.mean())),
        rms=math.sqrt(mean_square),
        p95=max(float(np.quantile(there, 0.95)), float(np.quantile(back, 0.95))),
        hausdorff=max(float(there.max()), float(back.max())),
        normal_deg=math.degrees(angles),
        rms_above=math.sqrt(sum(0.5 * float(np.mean(part**2)) for part in above if len(part))),
    )


def _one_way(
    source: PreparedSurface, target: PreparedSurface, height: float
) -> tuple[Floats, Floats, Bools]:
    """Distances [m], angles between normals [rad] and whether both ends are above a height [m].

    (n,) each, at the source's samples.
    """
    nearest = nearest_points(target.search, source.samples.points)
    here, there = source.normals[source.samples.faces], target.normals[nearest.faces]
    across = np.cross(here, there)
    sine = np.sqrt(np.einsum("ij,ij->i", across, across))
    # By atan2: the arc cosine loses half the digits of small angles.
    angles = np.arctan2(sine, np.einsum("ij,ij->i", here, there))
    above = np.minimum(source.samples.points[:, 2], nearest.points[:, 2]) > height
    return nearest.distances, angles, above


class SurfaceSamples(NamedTuple):
    """Points on a surface."""

    points: Floats  # (n, 3) [m]
    faces: NDArray[np.intp]  # (n,): face of each, ascending


def sample_surface(corners: Floats, count: int, rng: np.random.Generator) -> SurfaceSamples:
    """Points on triangles, uniform by area.

    Stratified: the cumulative area of the faces is cut into `count` equal intervals with one point
    each: means stay unbiased, and scatter as those of a larger simple sample. Within a face: Osada
    et al., *Shape distributions*, 2002, (1). Raises ValueError without area.
    """
    line = np.cumsum(areas_and_normals(corners)[0])
    if not line[-1] > 0.0:
        raise ValueError("a surface must have an area to be sampled, got 0")
    places = (np.arange(count) + rng.random(count)) / count * line[-1]
    # side="right": faces without area get no point.
    faces = np.searchsorted(line, places, side="right")
    faces = np.minimum(faces, np.searchsorted(line, line[-1]))  # rounding of the last place
    root = np.sqrt(rng.random(count))[:, None]
    share = rng.random(count)[:, None]
    a, b, c = corners[faces, 0], corners[faces, 1], corners[faces, 2]
    return SurfaceSamples(a + root * (b - a) + root * share * (c - b), faces)


class Alignment(NamedTuple):
    """A rigid motion and its residual."""

    pose: Floats  # of the points' frame in the surface's, (7,), w not negative
    rms: float  # [m] root mean square distance of the moved points from the surface
    converged: bool
    # Whether a motion turned by more than 5 degrees has at most 1.1 times this residual, because
    # the surface is symmetric.
    ambiguous: bool


class _Scaled(NamedTuple):
    """Points and surface, each about its own mean, over the surface's size."""

    points: Floats
    surface: PreparedSurface
    middle: Floats
    size: float
    turns: Floats  # initial rotations (b, 3, 3)


def align(
    points: ArrayLike, surface: PreparedSurface, settings: AlignmentSettings = AlignmentSettings()
) -> Alignment:
    """The rigid motion of points onto a surface; of equal fits the one with the least turn.

    `points` (n, 3): at least 6, spread over the object [m]. Raises ValueError if there are too few
    points, all in one place, or one is not finite.
    """
    places = finite_array("points", points, (None, 3))
    if len(places) < MIN_POINTS:
        raise ValueError(f"points must be at least {MIN_POINTS}, got {len(places)}")
    middle = places.mean(axis=0)
    if not np.ptp(places, axis=0).max() > 0.0:
        place = middle.tolist()
        raise ValueError(f"points must not lie all in one place, got {len(places)} at {place}")
    samples = surface.samples.points
    centre = samples.mean(axis=0)
    size = float(np.ptp(samples, axis=0).max())
    turns = _starts(places - middle, samples - centre)
    scaled = _Scaled((places - middle) / size, surface, centre, size, turns)
    begin = np.zeros((len(turns), 6))
    begin[0, 3:] = (middle - centre) / size
    rough = _solve(scaled, settings.n_rough_points, begin, settings.rough_steps, settings)
    best = _best(scaled, rough, settings)
    scaled = scaled._replace(turns=turns[best])
    starts, n_points = rough.parameters[best], settings.n_fine_points
    fine = _solve(scaled, n_points, starts, settings.fine_steps, settings)
    rotations = scaled.turns @ rotations_from_vectors(fine.parameters[:, :3])
    rms = size * np.sqrt(2.0 * fine.cost / min(n_points, len(places)))
    chosen = _least_turned(rms, rotations, size, settings)
    position = centre + size * fine.parameters[chosen, 3:] - rotations[chosen] @ middle
    angles = np.array([rotation_angle(rotations[chosen], other) for other in rotations])
    limit = settings.max_ambiguous_ratio * float(rms[chosen])
    rivals = (rms <= max(limit, settings.residual_floor * size)) & (angles > settings.min_turn)
    pose = Pose(position, rotations[chosen]).array
    pose[3:] *= np.copysign(1.0, pose[6])
    return Alignment(pose, float(rms[chosen]), bool(fine.converged[chosen]), bool(rivals.any()))


def _starts(points: Floats, there: Floats) -> Floats:
    """Rotations (26, 3, 3): the identity, twice, and those between principal axes."""
    units = np.array([np.eye(3)[list(order)] for order in permutations(range(3))])
    signs = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)])
    turned = (units[:, None] * signs[None, :, :, None]).reshape(-1, 3, 3)
    turned = turned[np.linalg.det(turned) > 0.0]
    starts = principal_axes(there) @ turned @ principal_axes(points).T
    return np.concatenate([np.eye(3)[None], np.eye(3)[None], starts])


def _solve(
    scaled: _Scaled, max_points: int, starts: Floats, steps: int, settings: AlignmentSettings
) -> Solutions:
    """Least squares of some points' signed distances from the surface, from several starts."""
    chosen = np.linspace(0, len(scaled.points) - 1, min(max_points, len(scaled.points)))
    points, on_surface = scaled.points[chosen.round().astype(np.intp)], settings.on_surface

    def problem(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
        turns = scaled.turns[rows] @ rotations_from_vectors(parameters[:, :3])
        moved = points @ turns.transpose(0, 2, 1) + parameters[:, None, 3:]
        queries = scaled.middle + scaled.size * moved.reshape(-1, 3)
        nearest = nearest_points(scaled.surface.search, queries)
        offset = (queries - nearest.points) / scaled.size
        normals = scaled.surface.normals[nearest.faces]
        distance = nearest.distances / scaled.size
        units = offset / np.maximum(distance, on_surface)[:, None]
        away = np.where((distance > on_surface)[:, None], units, normals)
        side = np.where(np.einsum("ni,ni->n", away, normals) < 0.0, -1.0, 1.0)
        towards = (side[:, None] * away).reshape(moved.shape)
        local = np.cross(points, towards @ turns)
        jacobian = np.concatenate([local @ right_jacobians(parameters[:, :3]), towards], axis=2)
        return (side * distance).reshape(moved.shape[:2]), jacobian

    return levenberg_marquardt(
        problem,
        starts,
        np.full(6, -np.inf),
        np.full(6, np.inf),
        steps=steps,
        min_residual=on_surface * np.sqrt(len(points)),
        tolerance=settings.tolerance,
    )


def _best(scaled: _Scaled, rough: Solutions, settings: AlignmentSettings) -> list[int]:
    """Indices of the starts with the least costs, without those that end at an equal turn."""
    rotations = scaled.turns @ rotations_from_vectors(rough.parameters[:, :3])
    best: list[int] = []
    for index in np.argsort(rough.cost, kind="stable").tolist():
        angles = (rotation_angle(rotations[index], rotations[other]) for other in best)
        if all(angle > settings.min_turn for angle in angles):
            best.append(index)
    return best[: settings.n_refined]


def _least_turned(rms: Floats, rotations: Floats, size: float, settings: AlignmentSettings) -> int:
    limit = max(settings.max_equal_ratio * float(rms.min()), settings.on_surface * size)
    equal = np.flatnonzero(rms <= limit)
    return int(equal[np.argmin([rotation_angle(np.eye(3), turn) for turn in rotations[equal]])])
