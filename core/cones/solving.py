"""Axis and apex of a cone from features whose places are known: tables 1.1 and 1.2 in one fit.

Features of top and bottom determine the axis, features of the sides the apex, independently of each
other. Faces and edges of an end are square to the axis, and all features of an end lie in one such
plane: this is linear in the axis, so that the best unit vector is an eigenvector. Meridians and
side planes pass through the apex: this is linear in the apex, but for weights that fall with the
distance over which a direction is prolonged. So all combinations of the tables, and overdetermined
ones, are solved in the same way.

The sides alone never give the axis: Fearing's theorem.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, positive
from palpate.core.cones.features import ENDS, Feature
from palpate.core.geometry import axes_across

MIN_RECIPROCAL_CONDITION = 3e-8  # half of a double's digits: smaller singular values are rounding


@dataclass(frozen=True, slots=True, kw_only=True)
class SolvingSettings:
    """Standard deviations of contact features, and when an axis or apex is known."""

    angle_noise: float = math.radians(1.0)  # [rad] of a direction, in each component across it
    position_noise: float = 1e-4  # [m] of each coordinate of a touched point
    max_axis_error: float = math.radians(20.0)  # [rad] of an axis that is known
    max_apex_error: float = 0.5  # of a known apex, over its distance from the contacts
    max_steps: int = 50  # of the reweighting for the apex


DEFAULT_SOLVING = SolvingSettings()


class InsufficientFeaturesError(ValueError):
    """The features leave the axis or the apex free, or nearly free."""


class ConeOrientation(NamedTuple):
    """Direction of a cone's axis."""

    axis: Floats  # unit vector from bottom to top, towards the apex, (3,)
    covariance: Floats  # of the axis, singular along itself, (3, 3)
    # Whether the features determine which end is the top; else the axis's z component is positive.
    sense_known: bool
    squared_misfit: float  # sum of squared residuals, each over its standard deviation
    redundancy: int  # number of equations less that of unknowns

    @property
    def psi(self) -> float:
        """Angle between axis and z, 0 to pi [rad]: R = Rz(phi) Ry(psi), (1.6) corrected."""
        return math.atan2(math.hypot(self.axis[0], self.axis[1]), self.axis[2])

    @property
    def phi(self) -> float:
        """Azimuth of the axis [rad]."""
        return math.atan2(self.axis[1], self.axis[0])

    @property
    def rotation(self) -> Floats:
        """Object axes as columns (3, 3): the last is the axis, the second is level."""
        c, s = math.cos(self.phi), math.sin(self.phi)
        across = np.array([-s, c, 0.0])
        return np.column_stack([np.cross(across, self.axis), across, self.axis])

    @property
    def angle_covariance(self) -> Floats:
        """Covariance (2, 2) of phi and psi [rad^2]; infinite for phi if the axis is upright."""
        sine = math.sin(self.psi)
        if sine == 0.0:
            return np.diag([math.inf, float(np.trace(self.covariance)) / 2.0])
        by_axis = self.rotation[:, [1, 0]].T / [[sine], [1.0]]
        return np.asarray(by_axis @ self.covariance @ by_axis.T)

    @property
    def residual_sigma(self) -> float:
        """Root mean square residual in standard deviations; 0 if nothing is left over."""
        return residual_sigma(self)


class ConeOrigin(NamedTuple):
    """Apex of a cone: the v of (1.5) for B = 0."""

    point: Floats  # (3,) [m]
    covariance: Floats  # (3, 3) [m^2]
    squared_misfit: float  # sum of squared residuals, each over its standard deviation
    redundancy: int  # number of equations less that of unknowns

    @property
    def residual_sigma(self) -> float:
        """Root mean square residual in standard deviations; 0 if nothing is left over."""
        return residual_sigma(self)


def residual_sigma(*solved: ConeOrientation | ConeOrigin) -> float:
    """Root mean square residual of all, in standard deviations; 0 without redundancy.

    About 1 for features of a cone; above 3 the object is no cone, or the places are wrong.
    """
    redundancy = sum(solution.redundancy for solution in solved)
    squared = sum(solution.squared_misfit for solution in solved)
    return math.sqrt(squared / redundancy) if redundancy > 0 else 0.0


def solve_orientation(
    features: Sequence[Feature],
    angle_noise: float = DEFAULT_SOLVING.angle_noise,
    position_noise: float = DEFAULT_SOLVING.position_noise,
    settings: SolvingSettings = DEFAULT_SOLVING,
) -> ConeOrientation:
    """The axis from features of top and bottom: table 1.1, all rows that apply at once.

    `angle_noise`: standard deviation of a measured direction, in each component across it [rad].
    `position_noise`: of each coordinate of a point [m]. An edge counts as its line; the normals
    beside it determine only the sense of the axis. Raises InsufficientFeaturesError if the axis
    stays free, or its error is 20 degrees or more; ValueError if a place is not known.
    """
    _check(features, angle_noise, position_noise)
    fit = fit_axis(features, angle_noise, position_noise, settings)
    if fit.orientation is None:
        raise InsufficientFeaturesError(_free_axis_reason(features, fit))
    return fit.orientation


def _check(features: Sequence[Feature], angle_noise: float, position_noise: float) -> None:
    positive("angle_noise", angle_noise, "rad")
    positive("position_noise", position_noise, "m")
    for index, feature in enumerate(features):
        if feature.place is None:
            raise ValueError(f"feature {index} ({feature.group}) must have a place, got None")


class AxisFit(NamedTuple):
    """The axis, or what features of the ends say about it."""

    orientation: ConeOrientation | None  # None if the axis is free
    free: Floats  # unit vectors (k, 3) that span the possible axes; the axis if it is known
    error: float  # [rad] standard deviation of the axis in its least certain direction
    redundancy: int  # number of equations less that of unknowns


def fit_axis(
    features: Sequence[Feature],
    angle_noise: float,
    position_noise: float,
    settings: SolvingSettings = DEFAULT_SOLVING,
) -> AxisFit:
    """Fit the axis to features of known places."""
    rows = _axis_rows(features, angle_noise, position_noise)
    _, sizes, directions = np.linalg.svd(np.vstack([*rows, np.zeros((3, 3))]))
    min_size = max(MIN_RECIPROCAL_CONDITION * sizes[0], 1.0 / settings.max_axis_error)
    rank = min(int((sizes > min_size).sum()), 2)
    error = 1.0 / float(sizes[1]) if sizes[1] > 0.0 else math.inf
    ends = [feature for feature in features if feature.place in ENDS]
    equations = sum({"F": 3, "E": 2}.get(feature.group, 1) for feature in ends)
    n_offsets = len({feature.place for feature in ends})  # of the planes of the ends
    redundancy = equations - n_offsets - rank
    if rank < 2:
        return AxisFit(None, directions[rank:], error, redundancy)
    covariance = (directions[:2].T / sizes[:2] ** 2) @ directions[:2]
    axis, sense_known, n_opposed = _oriented(features, directions[2])
    squared = float(sizes[2]) ** 2 + n_opposed * (math.pi / angle_noise) ** 2
    orientation = ConeOrientation(axis, covariance, sense_known, squared, redundancy)
    return AxisFit(orientation, axis[None], error, redundancy)


def _axis_rows(
    features: Sequence[Feature], angle_noise: float, position_noise: float
) -> list[Floats]:
    """Rows that vanish for the axis, each over its standard deviation."""
    rows: list[Floats] = []
    for end in ENDS:
        own = [feature for feature in features if feature.place == end]
        rows += [axes_across(face.normals[0]) / angle_noise for face in own if face.group == "F"]
        rows += [edge.direction[None] / angle_noise for edge in own if edge.direction is not None]
        if len(own) > 1:  # they lie in one plane, whose offset the mean removes
            points = np.array([feature.point for feature in own])
            rows.append((points - points.mean(axis=0)) / position_noise)
    return rows


def _oriented(features: Sequence[Feature], axis: Floats) -> tuple[Floats, bool, int]:
    """The axis from bottom to top, whether its sense is known, and number of opposed end faces."""
    votes = []
    for feature in features:
        if feature.place in ENDS and len(feature.normals):
            along = feature.normals @ axis  # one of the normals is that of the end
            votes.append(ENDS[feature.place] * float(along[np.argmax(np.abs(along))]))
    for end, sign in ENDS.items():
        on_end = [float(feature.point @ axis) for feature in features if feature.place == end]
        off_end = [float(feature.point @ axis) for feature in features if feature.place != end]
        if on_end and off_end and not votes:
            votes.append(sign * float(np.mean(on_end) - np.mean(off_end)))
    total = sum(votes)
    oriented = -axis if (total or float(axis[2])) < 0.0 else axis
    faces = [feature for feature in features if feature.group == "F" and feature.place in ENDS]
    n_opposed = sum(ENDS[face.place] * float(face.normals[0] @ oriented) < 0.0 for face in faces)
    return oriented, total != 0.0, n_opposed


def _free_axis_reason(features: Sequence[Feature], fit: AxisFit) -> str:
    ends = [feature for feature in features if feature.place in ENDS]
    if not ends:
        return (
            "the axis is free: nothing of top or bottom was touched: the same sides cut square to "
            "any other direction are again a cone"
        )
    names = " ".join(feature.name for feature in ends)
    edges = [feature for feature in ends if feature.group == "E"]
    if len(ends) == 1:
        why = "one edge or vertex of an end leaves the axis free to turn about it"
    elif len(edges) == len(ends) and len({edge.place for edge in edges}) == 2:
        why = "the edges of top and bottom are parallel"
    elif len(edges) == len(ends):
        why = "the edges lie on one line"
    elif edges and all(feature.place == edges[0].place for feature in ends):
        why = "the vertices lie on the line of the edge"
    elif len(ends) == 2:
        why = "two vertices, or an edge and a vertex of the other end, leave it free to turn"
    else:
        why = "the touched features of the ends lie along one direction"
    known = fit.error <= math.pi
    spread = f" (known to {math.degrees(fit.error):.3g} degrees)" if known else ""
    return f"the axis is free: {why}: {names}{spread}"


def solve_origin(
    features: Sequence[Feature],
    angle_noise: float = DEFAULT_SOLVING.angle_noise,
    position_noise: float = DEFAULT_SOLVING.position_noise,
    settings: SolvingSettings = DEFAULT_SOLVING,
) -> ConeOrigin:
    """The apex from meridians and side faces: table 1.2, all rows that apply at once.

    The arguments are those of `solve_orientation`. Raises InsufficientFeaturesError if the apex
    stays free, or its error is over half of its distance from the contacts; ValueError if a place
    is not known.
    """
    _check(features, angle_noise, position_noise)
    fit = fit_apex(features, angle_noise, position_noise, settings)
    if fit.origin is None:
        raise InsufficientFeaturesError(_free_apex_reason(features, fit, settings))
    return fit.origin


class ApexFit(NamedTuple):
    """The apex, or what features of the sides say about it."""

    origin: ConeOrigin | None  # None if the apex is free
    point: Floats  # the apex, or its possible place nearest to the contacts, (3,) [m]
    free: Floats  # unit vectors (k, 3) that span its other possible places
    error: float  # [m] its standard deviation in the least certain direction
    squared_misfit: float  # of `point`, see `ConeOrigin`
    redundancy: int  # number of equations less that of unknowns


def fit_apex(
    features: Sequence[Feature],
    angle_noise: float,
    position_noise: float,
    settings: SolvingSettings = DEFAULT_SOLVING,
) -> ApexFit:
    """Fit the apex to features of known places, by reweighted least squares."""
    sides = [feature for feature in features if feature.place in ("M", "S")]
    if not sides:
        return ApexFit(None, np.zeros(3), np.eye(3), math.inf, 0.0, 0)
    middle = np.mean([feature.point for feature in sides], axis=0)
    # Unit vectors (k, 3) of each feature that are square to the line from its point to the apex.
    normals = [
        feature.normals if feature.direction is None else axes_across(feature.direction)
        for feature in sides
    ]
    rows, counts = np.vstack(normals), [len(part) for part in normals]
    points = np.repeat([feature.point - middle for feature in sides], counts, axis=0)
    offsets = np.einsum("ij,ij->i", rows, points)
    apex = np.zeros(3)
    for _ in range(settings.max_steps):
        before = apex
        squares = ((apex - points) ** 2).sum(axis=1)
        weights = 1.0 / np.sqrt(position_noise**2 + angle_noise**2 * squares)
        weighted = np.vstack([rows * weights[:, None], np.zeros((3, 3))])
        _, sizes, directions = np.linalg.svd(weighted, full_matrices=False)
        known = sizes > MIN_RECIPROCAL_CONDITION * sizes[0]
        inverse = directions[known].T / sizes[known] ** 2 @ directions[known]
        apex = inverse @ (rows.T @ (weights**2 * offsets))
        distance = math.sqrt(float(((apex - points) ** 2).sum(axis=1).mean()))
        if np.linalg.norm(apex - before) <= 1e-14 * distance:
            break
    errors = np.where(known, 1.0 / np.where(known, sizes, 1.0), math.inf)
    squared = float((weights**2 * (rows @ apex - offsets) ** 2).sum())
    certain = errors <= settings.max_apex_error * distance if known.all() else known
    redundancy = len(rows) - int(certain.sum())
    place, error = apex + middle, float(errors.max())
    origin = ConeOrigin(place, inverse, squared, redundancy) if certain.all() else None
    return ApexFit(origin, place, directions[~certain], error, squared, redundancy)


def _free_apex_reason(features: Sequence[Feature], fit: ApexFit, settings: SolvingSettings) -> str:
    sides = [feature for feature in features if feature.place in ("M", "S")]
    names = " ".join(feature.name for feature in sides)
    meridians = [feature for feature in sides if feature.place == "M"]
    if not sides:
        return "the apex is free: nothing of the sides was touched"
    if len(meridians) == len(sides) == 1:
        why = "it may be anywhere on one meridian"
    elif not meridians and len(sides) < 3:
        why = "it may be anywhere on a plane, or where two meet"
    elif not meridians:
        why = "the faces are coplanar, or meet in one line"
    elif len(meridians) < len(sides):
        why = "the meridians lie in the planes of the faces"
    else:
        directions = np.array([line.direction for line in meridians])
        apart = np.array([line.point for line in meridians]) - meridians[0].point
        across = np.linalg.norm(np.cross(apart, directions[0]), axis=1).max()
        collinear = across <= settings.max_apex_error * np.linalg.norm(apart, axis=1).max()
        why = "the meridians are collinear" if collinear else "the meridians are parallel"
    spread = "" if math.isinf(fit.error) else f" (known to {fit.error * 1e3:.3g} mm)"
    return f"the apex is free: {why}: {names}{spread}"


class ScaledRadius(NamedTuple):
    """Distance of a cone's side from its axis, at unit distance below the apex: |A| lambda."""

    azimuth: float  # [rad] about the axis, from the x axis of `ConeOrientation.rotation`
    radius: float  # |A| lambda(azimuth); only their product is determined
    half_angle: float  # [rad] between meridian and axis: arc tangent of the radius


def scaled_radii(
    features: Sequence[Feature], orientation: ConeOrientation, origin: ConeOrigin
) -> tuple[ScaledRadius, ...]:
    """The scale factor A of (1.4) times the section, by meridian: edges, parabolic points."""
    radii = []
    for feature in features:
        if feature.place == "M":
            x, y, z = (feature.point - origin.point) @ orientation.rotation
            half_angle = math.atan2(math.hypot(x, y), -z)
            radii.append(ScaledRadius(math.atan2(y, x), math.tan(half_angle), half_angle))
    return tuple(radii)
