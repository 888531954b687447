"""Axis and apex of a cone from features whose places are known: tables 1.1 and 1.2 in one fit.

What was touched of top and bottom gives the axis, what was touched of the sides the apex; neither
says anything of the other. A face is square to the axis, an edge of an end too, and what was
touched of one end lies in one such plane: linear in the axis, so that the best unit vector is an
eigenvector. Meridians and side planes pass through the apex: linear in it, but for weights that
fall with the distance over which a direction is prolonged. Every combination of the tables is a
case of this, and so is what is overdetermined.

The sides alone never give the axis: Fearing's theorem.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, positive
from palpate.core.cones.features import ENDS, Feature
from palpate.core.geometry import axes_across

ANGLE_NOISE = math.radians(1.0)  # Of both components of a measured direction across itself
POSITION_NOISE = 1e-4  # Of each coordinate of a touched point, m
# Share of the largest singular value: an equation below is rounding, half of a double's digits
RECIPROCAL = 3e-8
MOST_APEX_ERROR = 0.5  # Beyond which an apex is not known, of its distance from the contacts


class InsufficientFeaturesError(ValueError):
    """Features that leave the axis or the apex free, or nearly so."""


class ConeOrientation(NamedTuple):
    """Direction of a cone's axis."""

    axis: Floats  # Unit vector from bottom to top, which is where the apex is, (3,)
    covariance: Floats  # Of the axis, singular along itself, (3, 3)
    # Whether the features say which end of the axis is the top; else its z component is positive
    sense_known: bool
    squared_misfit: float  # Sum of squared residuals, each over its standard deviation
    redundancy: int  # Equations left over

    @property
    def psi(self) -> float:
        """Angle between axis and z, from 0 to pi, rad: R = Rz(phi) Ry(psi), (1.6) corrected."""
        return math.atan2(math.hypot(self.axis[0], self.axis[1]), self.axis[2])

    @property
    def phi(self) -> float:
        """Azimuth of the axis, rad."""
        return math.atan2(self.axis[1], self.axis[0])

    @property
    def rotation(self) -> Floats:
        """Object axes as columns (3, 3): the last is the axis, the second is level."""
        c, s = math.cos(self.phi), math.sin(self.phi)
        across = np.array([-s, c, 0.0])
        return np.column_stack([np.cross(across, self.axis), across, self.axis])

    @property
    def angle_covariance(self) -> Floats:
        """Covariance (2, 2) of phi and psi, rad^2; phi's is infinite where the axis is upright."""
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

    point: Floats  # Where, (3,), m
    covariance: Floats  # (3, 3), m^2
    squared_misfit: float  # Sum of squared residuals, each over its standard deviation
    redundancy: int  # Equations left over

    @property
    def residual_sigma(self) -> float:
        """Root mean square residual in standard deviations; 0 if nothing is left over."""
        return residual_sigma(self)


def residual_sigma(*solved: ConeOrientation | ConeOrigin) -> float:
    """Root mean square residual of all, in standard deviations; 0 if nothing is left over.

    About 1 if the features are those of a cone; above 3 it is none, or their places are others.
    """
    redundancy = sum(one.redundancy for one in solved)
    squared = sum(one.squared_misfit for one in solved)
    return math.sqrt(squared / redundancy) if redundancy > 0 else 0.0


def solve_orientation(
    features: Sequence[Feature],
    angle_noise: float = ANGLE_NOISE,
    position_noise: float = POSITION_NOISE,
) -> ConeOrientation:
    """The axis from what was touched of top and bottom: table 1.1, all rows that apply at once.

    `angle_noise`: standard deviation of a measured direction, in each component across it, rad.
    `position_noise`: of each coordinate of a point, m. An edge counts as its line: the normals
    beside it tell the sense of the axis only. Raises InsufficientFeaturesError if the axis stays
    free, or is known to no better than 20 degrees; ValueError if a place is not known.
    """
    _check(features, angle_noise, position_noise)
    fit = fit_axis(features, angle_noise, position_noise)
    if fit.orientation is None:
        raise InsufficientFeaturesError(_why_the_axis_is_free(features, fit))
    return fit.orientation


def _check(features: Sequence[Feature], angle_noise: float, position_noise: float) -> None:
    positive("angle_noise", angle_noise, "rad")
    positive("position_noise", position_noise, "m")
    for index, one in enumerate(features):
        if one.place is None:
            raise ValueError(f"feature {index} ({one.group}) must have a place, got None")


class AxisFit(NamedTuple):
    """What features of the ends say about the axis, be it enough or not."""

    orientation: ConeOrientation | None  # None if the axis is free
    free: Floats  # Unit vectors (k, 3) that span where the axis may point; itself if it is known
    error: float  # Standard deviation of the axis in its least certain direction, rad
    redundancy: int  # Equations left over


def fit_axis(features: Sequence[Feature], angle_noise: float, position_noise: float) -> AxisFit:
    """Fit the axis to features of known places."""
    rows: list[Floats] = []
    for end in ENDS:
        mine = [one for one in features if one.place == end]
        rows += [axes_across(one.normals[0]) / angle_noise for one in mine if one.group == "F"]
        rows += [one.direction[None] / angle_noise for one in mine if one.direction is not None]
        if len(mine) > 1:  # They lie in one plane; the mean takes its offset out
            points = np.array([one.point for one in mine])
            rows.append((points - points.mean(axis=0)) / position_noise)
    _, sizes, directions = np.linalg.svd(np.vstack([*rows, np.zeros((3, 3))]))
    known = max(RECIPROCAL * sizes[0], 1.0 / math.radians(20.0))  # Off by more it is not known
    rank = min(int((sizes > known).sum()), 2)
    error = 1.0 / float(sizes[1]) if sizes[1] > 0.0 else math.inf
    ends = [one for one in features if one.place in ENDS]
    equations = sum({"F": 3, "E": 2}.get(one.group, 1) for one in ends)
    offsets = len({one.place for one in ends})  # A point of each end goes into its offset
    redundancy = equations - offsets - rank
    if rank < 2:
        return AxisFit(None, directions[rank:], error, redundancy)
    covariance = (directions[:2].T / sizes[:2] ** 2) @ directions[:2]
    axis, known_sense, opposed = _with_sense(features, directions[2])
    squared = float(sizes[2]) ** 2 + opposed * (math.pi / angle_noise) ** 2
    found = ConeOrientation(axis, covariance, known_sense, squared, redundancy)
    return AxisFit(found, axis[None], error, redundancy)


def _with_sense(features: Sequence[Feature], axis: Floats) -> tuple[Floats, bool, int]:
    """The axis from bottom to top, whether that is known, and faces whose normals contradict it."""
    votes = []
    for one in features:
        if one.place in ENDS and len(one.normals):
            along = one.normals @ axis  # One of the normals is that of the end
            votes.append(ENDS[one.place] * float(along[np.argmax(np.abs(along))]))
    for end, sign in ENDS.items():
        mine = [float(one.point @ axis) for one in features if one.place == end]
        others = [float(one.point @ axis) for one in features if one.place != end]
        if mine and others and not votes:
            votes.append(sign * float(np.mean(mine) - np.mean(others)))
    total = sum(votes)
    turned = -axis if (total or float(axis[2])) < 0.0 else axis
    faces = [one for one in features if one.group == "F" and one.place in ENDS]
    opposed = sum(ENDS[one.place] * float(one.normals[0] @ turned) < 0.0 for one in faces)
    return turned, total != 0.0, opposed


def _why_the_axis_is_free(features: Sequence[Feature], fit: AxisFit) -> str:
    ends = [one for one in features if one.place in ENDS]
    if not ends:
        return (
            "the axis is free: nothing of top or bottom was touched: the same sides cut square to "
            "any other direction are again a cone"
        )
    names = " ".join(one.name for one in ends)
    edges = [one for one in ends if one.group == "E"]
    if len(ends) == 1:
        why = "one edge or vertex of an end leaves the axis free to turn about it"
    elif len(edges) == len(ends) and len({one.place for one in edges}) == 2:
        why = "the edges of top and bottom are parallel"
    elif len(edges) == len(ends):
        why = "the edges lie on one line"
    elif edges and all(one.place == edges[0].place for one in ends):
        why = "the vertices lie on the line of the edge"
    elif len(ends) == 2:
        why = "two vertices, or an edge and a vertex of the other end, leave it free to turn"
    else:
        why = "what was touched of the ends lies along one direction"
    known = fit.error <= math.pi
    spread = f" (known to {math.degrees(fit.error):.3g} degrees)" if known else ""
    return f"the axis is free: {why}: {names}{spread}"


def solve_origin(
    features: Sequence[Feature],
    angle_noise: float = ANGLE_NOISE,
    position_noise: float = POSITION_NOISE,
) -> ConeOrigin:
    """The apex from meridians and side faces: table 1.2, all rows that apply at once.

    Arguments as of `solve_orientation`. Raises InsufficientFeaturesError if the apex stays free, or
    is less sure than half of its distance from the contacts; ValueError if a place is not known.
    """
    _check(features, angle_noise, position_noise)
    fit = fit_apex(features, angle_noise, position_noise)
    if fit.origin is None:
        raise InsufficientFeaturesError(_why_the_apex_is_free(features, fit))
    return fit.origin


class ApexFit(NamedTuple):
    """What features of the sides say about the apex, be it enough or not."""

    origin: ConeOrigin | None  # None if the apex is free
    point: Floats  # The apex, or the place nearest to the contacts where it may be, (3,), m
    free: Floats  # Unit vectors (k, 3) along which it may lie elsewhere
    error: float  # Its standard deviation in the least certain direction, m
    squared_misfit: float  # As `ConeOrigin` has it, for `point`
    redundancy: int  # Equations left over


def fit_apex(features: Sequence[Feature], angle_noise: float, position_noise: float) -> ApexFit:
    """Fit the apex to features of known places, by reweighted least squares."""
    sides = [one for one in features if one.place in ("M", "S")]
    if not sides:
        return ApexFit(None, np.zeros(3), np.eye(3), math.inf, 0.0, 0)
    middle = np.mean([one.point for one in sides], axis=0)
    # Unit vectors (k, 3) of each square to which the apex lies from its point
    lines = [one.normals if one.direction is None else axes_across(one.direction) for one in sides]
    rows = np.vstack(lines)
    through = np.repeat([one.point - middle for one in sides], [len(one) for one in lines], axis=0)
    offsets = np.einsum("ij,ij->i", rows, through)
    apex = np.zeros(3)
    for _ in range(50):  # Weights change little, so that a few are enough
        before = apex
        away = ((apex - through) ** 2).sum(axis=1)
        weights = 1.0 / np.sqrt(position_noise**2 + angle_noise**2 * away)
        weighted = np.vstack([rows * weights[:, None], np.zeros((3, 3))])
        _, sizes, directions = np.linalg.svd(weighted, full_matrices=False)
        known = sizes > RECIPROCAL * sizes[0]
        inverse = directions[known].T / sizes[known] ** 2 @ directions[known]
        apex = inverse @ (rows.T @ (weights**2 * offsets))
        reach = math.sqrt(float(((apex - through) ** 2).sum(axis=1).mean()))
        if np.linalg.norm(apex - before) <= 1e-14 * reach:
            break
    errors = np.where(known, 1.0 / np.where(known, sizes, 1.0), math.inf)
    squared = float((weights**2 * (rows @ apex - offsets) ** 2).sum())
    certain = errors <= MOST_APEX_ERROR * reach if known.all() else known
    redundancy = len(rows) - int(certain.sum())
    place, error = apex + middle, float(errors.max())
    origin = ConeOrigin(place, inverse, squared, redundancy) if certain.all() else None
    return ApexFit(origin, place, directions[~certain], error, squared, redundancy)


def _why_the_apex_is_free(features: Sequence[Feature], fit: ApexFit) -> str:
    sides = [one for one in features if one.place in ("M", "S")]
    names = " ".join(one.name for one in sides)
    meridians = [one for one in sides if one.place == "M"]
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
        directions = np.array([one.direction for one in meridians])
        apart = np.array([one.point for one in meridians]) - meridians[0].point
        beside = np.linalg.norm(np.cross(apart, directions[0]), axis=1).max()
        collinear = beside <= MOST_APEX_ERROR * np.linalg.norm(apart, axis=1).max()
        why = "the meridians are collinear" if collinear else "the meridians are parallel"
    spread = "" if math.isinf(fit.error) else f" (known to {fit.error * 1e3:.3g} mm)"
    return f"the apex is free: {why}: {names}{spread}"


class ScaledRadius(NamedTuple):
    """How far a cone's side is from its axis, at unit distance below the apex: |A| lambda."""

    azimuth: float  # About the axis, from the x axis of `ConeOrientation.rotation`, rad
    radius: float  # |A| lambda(azimuth); A and lambda cannot be told apart
    half_angle: float  # Between meridian and axis: its arc tangent, rad


def scaled_radii(
    features: Sequence[Feature], orientation: ConeOrientation, origin: ConeOrigin
) -> tuple[ScaledRadius, ...]:
    """The scale factor A of (1.4) times the section, by meridian: edges, parabolic points."""
    found = []
    for one in features:
        if one.place == "M":
            x, y, z = (one.point - origin.point) @ orientation.rotation
            half_angle = math.atan2(math.hypot(x, y), -z)
            found.append(ScaledRadius(math.atan2(y, x), math.tan(half_angle), half_angle))
    return tuple(found)
