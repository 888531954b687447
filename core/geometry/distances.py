"""How far two surfaces are apart, and the rigid motion that brings points onto one.

In an alignment each point counts by its distance from the nearest point of the surface, which is
the distance from the tangent plane there to first order: Chen and Medioni, *Object modelling by
registration of multiple range images*, 1992, with the damped steps of Fitzgibbon, *Robust
registration of 2D and 3D point sets*, 2003. It begins where the points are, with their middle moved
to the surface's, and at each way to lay their principal axes onto the surface's.
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

SAMPLES = 20_000  # On each surface, so that the mean is right to about one part in a hundred
SEED = 1999
FEWEST = 6  # Points, for six parameters
FEW, MANY = 200, 2000  # Points of the first steps of all starts, and of the last of the best
FIRST_STEPS, LAST_STEPS = 12, 60
KEPT = 4  # Starts that are ended
TOLERANCE = 1e-7
ALIKE = 1.1  # Times the least residual: another motion that leaves no more is as good an answer
SAME = 1.001  # Times the least residual: what leaves no more is the same but for rounding
APART = np.radians(5.0)  # Turns that differ by less are one
FLOOR = 5e-4  # Of the surface's size: residuals below this are all alike, for facets leave as much
ON = 1e-12  # Of the size: nearer points lie on the surface; its normal says which way is off


class SurfaceDistances(NamedTuple):
    """How far two surfaces are apart."""

    chamfer: float  # Mean of the two one-way mean distances, m
    rms: float  # Root mean square distance over both ways, m
    p95: float  # The larger of the two 95 % quantiles, m
    hausdorff: float  # The largest distance of both ways, m
    normal_deg: float  # Mean angle between normals at samples and at their nearest points
    rms_above: float  # Root mean square distance of samples above a height alone, m


@readable
@dataclass(frozen=True, slots=True, eq=False)
class PreparedSurface:
    """A surface with its samples and its search tree, for any number of comparisons."""

    normals: Floats  # (m, 3): unit normal of each face
    samples: SurfaceSamples
    search: NearestSearch

    def thinned(self, every: int) -> PreparedSurface:
        """With the first of every so many samples alone, which are spread as evenly."""
        points, faces = self.samples
        samples = SurfaceSamples(points[::every], faces[::every])
        return PreparedSurface(self.normals, samples, self.search)


def prepare_surface(
    vertices: ArrayLike, faces: ArrayLike, samples: int = SAMPLES
) -> PreparedSurface:
    """Sample a surface and prepare it for the search.

    `vertices` (n, 3), m. `faces` (m, 3): rows of those; ones without area are left out. Of fewer
    `samples` distances scatter more, as their sampling floor tells. Raises ValueError if a vertex
    is not finite, a face names none that is there, or the surface has no area.
    """
    corners = triangle_corners(vertices, faces)
    areas, normals = areas_and_normals(corners)
    corners, normals = corners[areas > 0.0], normals[areas > 0.0]
    if not len(corners):
        raise ValueError(f"a surface must have an area, but all {len(areas)} faces have none")
    places = sample_surface(corners, samples, np.random.default_rng(SEED))
    return PreparedSurface(normals, places, nearest_search(corners))


def compare_surfaces(
    one: PreparedSurface, other: PreparedSurface, height: float = -math.inf
) -> SurfaceDistances:
    """Distances from the samples of each of two surfaces to the other; both count alike.

    `height`: `rms_above` tells of the samples above it, along z, whose nearest points lie above it
    as well [m]; 0 if there are none.
    """
    (there, there_angles, up), (back, back_angles, down) = (
        _one_way(*pair, height) for pair in ((one, other), (other, one))
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
    """Distance [m], angle between normals [rad] and whether both ends lie above a height [m].

    Each (n,), at the source's samples.
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

    points: Floats  # (n, 3), m
    faces: NDArray[np.intp]  # (n,): the face on which each lies, ascending


def sample_surface(corners: Floats, count: int, rng: np.random.Generator) -> SurfaceSamples:
    """Points on triangles, uniform by area.

    Stratified: the faces are laid end to end by area, the line is cut into `count` equal pieces,
    and each gets one point: means stay unbiased, but scatter as those of a larger plain sample.
    Within a face: Osada et al., *Shape distributions*, 2002, (1). Raises ValueError without area.
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


class Alignment(NamedTuple):
    """A rigid motion, and how well it fits."""

    pose: Floats  # Of the points' frame in the surface's, (7,), w not negative
    rms: float  # Root mean square distance of the moved points from the surface, m
    converged: bool  # No small step lowers it
    # A motion turned by more than 5 degrees leaves no more than 1.1 times as much: the surface
    # looks alike from several sides.
    ambiguous: bool


class _Scaled(NamedTuple):
    """Points and surface, each about its own middle, over the surface's size."""

    points: Floats
    surface: PreparedSurface
    middle: Floats
    size: float
    turns: Floats  # Rotations (b, 3, 3) at which the starts begin


def align(points: ArrayLike, surface: PreparedSurface) -> Alignment:
    """The rigid motion that brings points onto a surface; of those that fit alike the least turned.

    `points` (n, 3): at least 6, spread over what they were taken from, m. Raises ValueError if
    there are too few points, all in one place, or one is not finite.
    """
    given = finite_array("points", points, (None, 3))
    if len(given) < FEWEST:
        raise ValueError(f"points must be at least {FEWEST}, got {len(given)}")
    middle = given.mean(axis=0)
    if not np.ptp(given, axis=0).max() > 0.0:
        place = middle.tolist()
        raise ValueError(f"points must not lie all in one place, got {len(given)} at {place}")
    there = surface.samples.points
    centre = there.mean(axis=0)
    size = float(np.ptp(there, axis=0).max())
    turns = _starts(given - middle, there - centre)
    scaled = _Scaled((given - middle) / size, surface, centre, size, turns)
    begin = np.zeros((len(turns), 6))
    begin[0, 3:] = (middle - centre) / size
    rough = _solve(scaled, FEW, begin, FIRST_STEPS)
    best = _best(scaled, rough)
    scaled = scaled._replace(turns=turns[best])
    fine = _solve(scaled, MANY, rough.parameters[best], LAST_STEPS)
    rotations = scaled.turns @ rotations_from_vectors(fine.parameters[:, :3])
    rms = size * np.sqrt(2.0 * fine.cost / min(MANY, len(given)))
    won = _least_turned(rms, rotations, size)
    position = centre + size * fine.parameters[won, 3:] - rotations[won] @ middle
    apart = np.array([rotation_angle(rotations[won], one) for one in rotations]) > APART
    good = rms <= max(ALIKE * float(rms[won]), FLOOR * size)
    pose = Pose(position, rotations[won]).array
    pose[3:] *= np.copysign(1.0, pose[6])
    return Alignment(pose, float(rms[won]), bool(fine.converged[won]), bool((good & apart).any()))


def _starts(points: Floats, there: Floats) -> Floats:
    """Rotations (26, 3, 3): none, twice, and those that lay principal axes onto each other."""
    units = np.array([np.eye(3)[list(order)] for order in permutations(range(3))])
    signs = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)])
    turned = (units[:, None] * signs[None, :, :, None]).reshape(-1, 3, 3)
    turned = turned[np.linalg.det(turned) > 0.0]
    starts = principal_axes(there) @ turned @ principal_axes(points).T
    return np.concatenate([np.eye(3)[None], np.eye(3)[None], starts])


def _solve(scaled: _Scaled, most: int, starts: Floats, steps: int) -> Solutions:
    """From some starts, by the points' signed distances and how they change with turn and shift."""
    chosen = np.linspace(0, len(scaled.points) - 1, min(most, len(scaled.points)))
    points = scaled.points[chosen.round().astype(np.intp)]

    def problem(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
        turns = scaled.turns[rows] @ rotations_from_vectors(parameters[:, :3])
        moved = points @ turns.transpose(0, 2, 1) + parameters[:, None, 3:]
        queries = scaled.middle + scaled.size * moved.reshape(-1, 3)
        nearest = nearest_points(scaled.surface.search, queries)
        off = (queries - nearest.points) / scaled.size
        normals = scaled.surface.normals[nearest.faces]
        distance = nearest.distances / scaled.size
        away = np.where((distance > ON)[:, None], off / np.maximum(distance, ON)[:, None], normals)
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
        min_residual=ON * np.sqrt(len(points)),
        tolerance=TOLERANCE,
    )


def _best(scaled: _Scaled, rough: Solutions) -> list[int]:
    """The starts that came farthest, but of those that came to the same turn only one."""
    rotations = scaled.turns @ rotations_from_vectors(rough.parameters[:, :3])
    best: list[int] = []
    for one in np.argsort(rough.cost, kind="stable").tolist():
        if all(rotation_angle(rotations[one], rotations[other]) > APART for other in best):
            best.append(one)
    return best[:KEPT]


def _least_turned(rms: Floats, rotations: Floats, size: float) -> int:
    same = np.flatnonzero(rms <= max(SAME * float(rms.min()), ON * size))
    return int(same[np.argmin([rotation_angle(np.eye(3), rotations[one]) for one in same])])
