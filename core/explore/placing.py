"""Pose of an object after it was turned over, from a few contacts and the known solid.

The hand sets the object down on another side. The hand errs, the turn about the vertical is
unknown, and the object may roll onto a side that was not requested. So each side on which the solid
can rest is tried, at even azimuths. From each start, contacts are registered to the surface, by
their distances from its tangent planes and by the differences of normals (Chen and Medioni, *Object
modelling by registration of multiple range images*, 1992; normals as by Serafin and Grisetti,
*NICP*, 2015). Each residual is divided by its standard deviation, so that unknown places have a
small weight. The lowest corner of the hull touches the platform: this gives the height where only
upright sides were touched. Other poses that fit as well as the best one are returned too: then the
object looks alike in them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import RestingSolid, point_tree, rotation_between
from palpate.core.least_squares import Solutions, cauchy_loss, levenberg_marquardt
from palpate.core.poses import (
    Pose,
    cross_matrices,
    right_jacobians,
    rotation_angle,
    rotations_from_vectors,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacingSettings:
    """How the pose of an object that was turned over is looked for."""

    n_azimuths: int = 36  # starts of each side, turned about the vertical
    max_rests: int = 24  # sides that are tried, nearest to the requested one first
    rest_spacing: float = math.radians(12.0)  # [rad] between sides; of nearer ones, one is tried
    coarse_steps: int = 12  # Levenberg-Marquardt steps from every start
    n_best: int = 12  # distinct poses that are refined
    fine_steps: int = 25  # Levenberg-Marquardt steps of each refined pose
    tolerance: float = 1.0e-4  # root of the predicted relative decrease of the cost that ends a fit
    normal_error: float = 0.25  # [1] smallest standard deviation of a normal's components
    # [m] around a place. The largest angle between its normal and others there is added to the
    # normal's error: a contact at an edge has the normal of neither face.
    edge_reach: float = 2.0e-3
    n_neighbours: int = 16  # nearest places that are compared for that angle
    least_error: float = 0.2e-3  # [m] smallest error of a place: places lie about so far apart
    # [standard deviations] added to the height of a corner of the hull before corners are compared:
    # the object stands on the corner that is lowest then.
    corner_sigmas: float = 2.0
    outlier: float = 3.0  # [standard deviations] scale of the Cauchy loss of a residual
    same_angle: float = math.radians(8.0)  # [rad] between poses, below which they are the same
    # Costs are negative logarithms of likelihoods: half the sum of squared residuals.
    rocked_angle: float = math.radians(10.0)  # [rad] of lean from the request: beyond it, it rocked
    rocked_cost: float = 4.0  # added then: an object rocks in a few of a hundred turns
    rocked_growth: float = 3.0  # [1/rad] added per angle beyond that: an object seldom rolls far
    same_cost: float = 4.0  # above the cost of the best pose, up to which a pose fits as well
    max_cost: float = 2.0  # per contact, of the best pose; beyond it the pose is unknown
    min_contacts: int = 8  # with fewer the pose is unknown


class KnownSurface(NamedTuple):
    """Places of a solid in its own frame, and their errors."""

    points: Floats  # (n, 3) [m]
    normals: Floats  # (n, 3) outward
    errors: Floats  # (n,) [m] standard deviations


class Placement(NamedTuple):
    """How an object lies."""

    pose: Pose  # of its own frame in the world
    cost: float  # per contact; 0.5 to 1 where contacts fit
    error: float  # [m] standard deviation of the pose, as rms shift along the contacts' normals
    alternatives: tuple[Pose, ...]  # other poses that fit as well


def place_object(
    surface: KnownSurface,
    resting: RestingSolid,
    points: Floats,
    normals: Floats,
    asked: Floats | None,
    platform: float,
    settings: PlacingSettings = PlacingSettings(),
) -> Placement | None:
    """How the object lies, or None where the contacts fit in no pose.

    `resting`: the solid's hull, in its own frame. `points`, `normals` (n, 3): contacts in the world
    [m]. `asked` (3, 3): the requested rotation; None if there was no request. `platform`: height on
    which the object lies [m].
    """
    if len(points) < settings.min_contacts:
        return None
    starts = _starts(resting, points, asked, platform, settings)
    problem = _Registration(surface, resting.hull, points, normals, platform, settings)
    rough = problem.solve(starts, settings.coarse_steps)
    poses = list(map(problem.pose, starts, rough.parameters))
    best = _unlike(poses, rough.cost, settings.same_angle)[: settings.n_best]
    starts = [poses[number] for number in best]
    fine = problem.solve(starts, settings.fine_steps)
    poses = list(map(problem.pose, starts, fine.parameters))
    costs = fine.cost.copy()
    if asked is not None:
        upright = np.array([pose.axes[2] @ asked[2] for pose in poses])
        excess = np.arccos(np.clip(upright, -1.0, 1.0)) - settings.rocked_angle
        rocked = settings.rocked_cost + settings.rocked_growth * excess
        costs += np.where(excess > 0.0, rocked, 0.0)
    first, *other_poses = _unlike(poses, costs, settings.same_angle)
    if not fine.cost[first] <= settings.max_cost * len(points):
        return None
    alike = [at for at in other_poses if costs[at] <= costs[first] + settings.same_cost]
    error = problem.error(starts[first], fine.parameters[first])
    alternatives = tuple(poses[number] for number in alike)
    return Placement(poses[first], float(fine.cost[first]) / len(points), error, alternatives)


def _unlike(poses: list[Pose], costs: Floats, same_angle: float) -> list[int]:
    """Numbers of distinct poses, cheapest first: `same_angle` or more apart."""
    kept: list[int] = []
    for number in np.argsort(costs, kind="stable").tolist():
        turns = (rotation_angle(poses[number].axes, poses[better].axes) for better in kept)
        if all(turn > same_angle for turn in turns):
            kept.append(number)
    return kept


def _starts(
    resting: RestingSolid,
    points: Floats,
    asked: Floats | None,
    platform: float,
    settings: PlacingSettings,
) -> list[Pose]:
    """Poses of the object on each of its sides, at even azimuths, centred on the contacts."""
    sides, first = [rest.down for rest in resting.rests], list[Floats]()
    if asked is not None:
        first = [-asked[2]]  # downwards in the object's frame
        sides.sort(key=lambda side: -float(side @ first[0]))
    rests: list[Floats] = []
    for side in sides:
        if all(rest @ side < math.cos(settings.rest_spacing) for rest in rests):
            rests.append(side)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    poses = []
    for down in [*first, *rests[: settings.max_rests]]:
        level = rotation_between(down, np.array([0.0, 0.0, -1.0]))
        for azimuth in 2.0 * math.pi * np.arange(settings.n_azimuths) / settings.n_azimuths:
            axes = rotations_from_vectors(np.array([[0.0, 0.0, azimuth]]))[0] @ level
            corners = resting.hull @ axes.T
            low, high = corners.min(axis=0), corners.max(axis=0)
            place = middle - 0.5 * (low + high)
            poses.append(Pose(np.array([*place[:2], platform - low[2]]), axes))
    return poses


class _Registration:
    """Least squares problem: the motions of start poses that bring contacts onto a surface."""

    def __init__(
        self,
        surface: KnownSurface,
        hull: Floats,  # (h, 3) [m]
        points: Floats,
        normals: Floats,
        platform: float,
        settings: PlacingSettings,
    ):
        self.surface, self.points, self.normals, self.settings = surface, points, normals, settings
        self.hull, self.platform = hull, platform
        self.middle = points.mean(axis=0)
        self.tree = point_tree(surface.points)
        self.errors = np.maximum(surface.errors, settings.least_error)
        near = self.tree.query(
            surface.points, settings.n_neighbours, distance_upper_bound=settings.edge_reach
        )[1]
        beside = np.concatenate([surface.normals, np.zeros((1, 3))])[near]
        cosines = np.einsum("nki,ni->nk", beside, surface.normals)
        cosines[near == len(surface.points)] = 1.0
        turned = np.arccos(np.clip(cosines.min(axis=1), -1.0, 1.0))
        self.normal_errors = np.hypot(turned, settings.normal_error)
        self.hull_errors = self.errors[self.tree.query(hull)[1]]

    def solve(self, starts: list[Pose], steps: int) -> Solutions:
        """Solutions (b, 6): a turn and a shift of the contacts about their middle, per start."""
        turns = np.stack([start.axes.T for start in starts])
        shifts = np.stack([start.to_local(self.middle[None])[0] for start in starts])
        return levenberg_marquardt(
            lambda parameters, rows: self._residuals(turns[rows], shifts[rows], parameters),
            np.zeros((len(starts), 6)),
            np.full(6, -np.inf),
            np.full(6, np.inf),
            loss=cauchy_loss(self.settings.outlier),
            steps=steps,
            tolerance=self.settings.tolerance,
        )

    def pose(self, start: Pose, parameters: Floats) -> Pose:
        """The object's pose after the motion `parameters` (6,) of a start."""
        turn = start.axes.T @ rotations_from_vectors(parameters[None, :3])[0]
        shift = start.to_local(self.middle[None])[0] + parameters[3:]
        return Pose(self.middle - turn.T @ shift, np.ascontiguousarray(turn.T))

    def error(self, start: Pose, parameters: Floats) -> float:
        """Rms standard deviation of the pose along the normals at the contacts [m]."""
        turns, shifts = start.axes.T[None], start.to_local(self.middle[None])
        _, jacobian = self._residuals(turns, shifts, parameters[None])
        covariance = np.linalg.pinv(jacobian[0].T @ jacobian[0])
        along = jacobian[0][: len(self.points)]
        variances = np.einsum("ni,ij,nj->n", along, covariance, along)
        moved = self._moved(turns, shifts, parameters[None])[0]
        errors = self.errors[self.tree.query(moved)[1]]
        return float(np.sqrt(np.mean(variances * errors**2)))

    def _moved(self, turns: Floats, shifts: Floats, parameters: Floats) -> Floats:
        """Contacts (b, n, 3) in the object's frame [m]."""
        rotations = turns @ rotations_from_vectors(parameters[:, :3])
        offsets = shifts[:, None] + parameters[:, None, 3:]
        return np.asarray((self.points - self.middle) @ rotations.transpose(0, 2, 1) + offsets)

    def _residuals(
        self, turns: Floats, shifts: Floats, parameters: Floats
    ) -> tuple[Floats, Floats]:
        """Residuals (b, 4 n + 1) and Jacobian: of tangent planes, normals, and the platform."""
        rotations = turns @ rotations_from_vectors(parameters[:, :3])
        moved = self._moved(turns, shifts, parameters)
        nearest = np.reshape(self.tree.query(moved.reshape(-1, 3))[1], moved.shape[:2])
        expected, errors = self.surface.normals[nearest], self.errors[nearest]
        offsets = np.einsum("bni,bni->bn", moved - self.surface.points[nearest], expected) / errors
        turned = self.normals @ rotations.transpose(0, 2, 1)
        normal_errors = self.normal_errors[nearest][..., None]
        turn_offsets = (turned - expected) / normal_errors
        right = right_jacobians(parameters[:, :3])
        along = expected / errors[..., None]
        local = np.cross(self.points - self.middle, along @ rotations)
        by_place = np.concatenate([local @ right, along], axis=2)
        by_normal = -rotations[:, None] @ cross_matrices(self.normals) @ right[:, None]
        by_normal = np.concatenate([by_normal, np.zeros_like(by_normal)], axis=3)
        by_normal = (by_normal / normal_errors[..., None]).reshape(len(turns), -1, 6)
        height, by_height = self._heights(rotations, shifts + parameters[:, 3:], right)
        residuals = np.concatenate([offsets, turn_offsets.reshape(len(turns), -1), height], axis=1)
        return residuals, np.concatenate([by_place, by_normal, by_height], axis=1)

    def _heights(self, rotations: Floats, shifts: Floats, right: Floats) -> tuple[Floats, Floats]:
        """Height (b, 1) of the hull's lowest corner over the platform, and derivatives (b, 1, 6).

        Both are divided by that corner's standard deviation. Uncertain corners, as of an untouched
        ripple, are not taken for the lowest: see `corner_sigmas`.
        """
        ups = rotations[:, :, 2]  # the vertical in the object's frame
        margins = self.settings.corner_sigmas * self.hull_errors
        lowest = (self.hull @ ups.T + margins[:, None]).argmin(axis=0)
        away = self.hull[lowest] - shifts
        errors = self.hull_errors[lowest, None]
        height = np.einsum("bi,bi->b", away, ups) + self.middle[2] - self.platform
        world = np.einsum("bij,bi->bj", rotations, away)
        level = np.column_stack([-world[:, 1], world[:, 0], np.zeros(len(world))])
        growth = np.concatenate([np.einsum("bi,bij->bj", level, right), -ups], axis=1)
        return height[:, None] / errors, (growth / errors)[:, None]
