"""The rigid motion that brings points onto a surface.

Each point counts by its distance from the nearest point of the surface, which is the distance
from the tangent plane there to first order: Chen and Medioni, *Object modelling by registration
of multiple range images*, 1992, with the damped steps of Fitzgibbon, *Robust registration of 2D
and 3D point sets*, 2003. It begins where the points are, with their middle moved to the surface's,
and at each way to lay their principal axes onto the surface's.
"""

from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.geometry.distances import PreparedSurface
from palpate.core.geometry.nearest import nearest_points
from palpate.core.least_squares import ResidualFunction, Solutions, levenberg_marquardt
from palpate.core.poses import (
    pose_of,
    principal_axes,
    right_jacobians,
    rotation_angle,
    rotations_from_vectors,
)

FEWEST = 6  # Points, for six parameters
# Points with which all starts take their first steps, and with which the best are ended.
FEW, MANY = 200, 2000
FIRST_STEPS, LAST_STEPS = 12, 60
KEPT = 4  # Starts that are ended
TOLERANCE = 1e-7
ALIKE = 1.1  # Times the least residual: another motion that leaves no more is as good an answer
# Times the least residual: what leaves no more is the same to all its digits that count.
SAME = 1.001
APART = np.radians(5.0)  # Turns that differ by less are one
FLOOR = 5e-4  # Of the surface's size: residuals below this are all alike, for facets leave as much
# Of the size: nearer points lie on the surface, and only its normal says which way is off.
ON = 1e-12


class Alignment(NamedTuple):
    """A rigid motion, and how well it fits."""

    # Position, m, and quaternion x, y, z, w with w not negative, (7,): the points' frame in the
    # surface's.
    pose: Floats
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
    """The rigid motion that brings points onto a surface.

    `points` (n, 3): at least 6, spread over what they were taken from, m. `surface`: the surface,
    see `palpate.core.geometry.prepare_surface`. Raises ValueError if there are too few points, they
    are all in one place, or one is not finite.

    Of motions that fit alike, the one that turns the points least.
    """
    given = finite_array("points", points, (None, 3))
    if len(given) < FEWEST:
        raise ValueError(f"points must be at least {FEWEST}, got {len(given)}")
    middle = given.mean(axis=0)
    if not np.ptp(given, axis=0).max() > 0.0:
        raise ValueError(
            f"points must not lie all in one place, got {len(given)} at {middle.tolist()}"
        )
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
    pose = pose_of(position, rotations[won])
    pose[3:] *= np.copysign(1.0, pose[6])
    return Alignment(pose, float(rms[won]), bool(fine.converged[won]), bool((good & apart).any()))


def _least_turned(rms: Floats, rotations: Floats, size: float) -> int:
    """Of the motions that leave the same, the one that turns least."""
    least = float(rms.min())
    same = np.flatnonzero(rms <= max(SAME * least, ON * size))
    turned = [rotation_angle(np.eye(3), rotations[one]) for one in same]
    return int(same[int(np.argmin(turned))])


def _starts(points: Floats, there: Floats) -> Floats:
    """Rotations (26, 3, 3): none, twice, and those that lay principal axes onto each other."""
    units = np.array([np.eye(3)[list(order)] for order in permutations(range(3))])
    signs = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)])
    turned = (units[:, None] * signs[None, :, :, None]).reshape(-1, 3, 3)
    turned = turned[np.linalg.det(turned) > 0.0]
    starts = principal_axes(there) @ turned @ principal_axes(points).T
    return np.concatenate([np.eye(3)[None], np.eye(3)[None], starts])


def _best(scaled: _Scaled, rough: Solutions) -> list[int]:
    """The starts that came farthest, but of those that came to the same turn only one."""
    rotations = scaled.turns @ rotations_from_vectors(rough.parameters[:, :3])
    best: list[int] = []
    for one in np.argsort(rough.cost, kind="stable").tolist():
        if all(rotation_angle(rotations[one], rotations[other]) > APART for other in best):
            best.append(one)
    return best[:KEPT]


def _solve(scaled: _Scaled, most: int, starts: Floats, steps: int) -> Solutions:
    chosen = np.linspace(0, len(scaled.points) - 1, min(most, len(scaled.points)))
    points = scaled.points[chosen.round().astype(np.intp)]
    return levenberg_marquardt(
        _problem(scaled, points),
        starts,
        np.full(6, -np.inf),
        np.full(6, np.inf),
        steps=steps,
        enough=ON * np.sqrt(len(points)),
        tolerance=TOLERANCE,
    )


def _problem(scaled: _Scaled, points: Floats) -> ResidualFunction:
    """Signed distances of moved points, and how they change with turn and shift."""

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

    return problem
