"""Which places the features of a cone may have: tables 1.3 and 1.4, decided by measured geometry.

Every assignment of places is tried. Its equations are those of `solving`, whose residuals must be
within the noise. The conditions that the tables state in words are inequalities: a meridian slopes,
the contacts lie below the apex, a top face faces along the axis, and a cone is convex. Where the
equations leave axis or apex free, an assignment is possible if some axis fulfils all conditions.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, positive
from palpate.core.cones import solving, tables
from palpate.core.cones.features import ENDS, PLACES, Feature

OUTWARD = "a top face faces along the axis, and a bottom face against it"
BETWEEN_ENDS = "every contact lies between the planes of the ends, the top above the bottom"
RIM_NORMAL = "one of the faces beside an edge of an end is that end"
RIM_SUPPORTS = "the body lies on one side of the plane through the apex and an edge of an end"
CONVEX = "no contact lies outside a touched face"
SECTION_HOLDS_AXIS = "a side face looks away from the axis and upwards"
FITS = "the equations of these places hold within the noise"


@dataclass(frozen=True, slots=True, kw_only=True)
class InterpretationSettings:
    """How many assignments are tried, and which axes where the equations leave a choice."""

    max_features: int = 6  # with three places each: 729 assignments
    n_circle: int = 720  # axes in a plane
    n_sphere: int = 4096  # axes in all directions
    solver: solving.SolvingSettings = solving.DEFAULT_SOLVING


class Interpretation(NamedTuple):
    """One assignment of places to features, with its cone."""

    features: tuple[Feature, ...]  # in the same order, with their places
    row: tables.TableRow | None  # of table 1.3 or 1.4; None if they do not list this combination
    orientation: solving.ConeOrientation | None  # None if these places leave the axis free
    origin: solving.ConeOrigin | None  # None if these places leave the apex free
    redundancy: int  # number of equations less that of unknowns
    residual_sigma: float  # [standard deviations] larger one of axis and apex; 0 if not redundant
    violations: tuple[str, ...]  # constraints that fail; empty if the assignment is possible

    @property
    def name(self) -> str:
        """The features with their places, in their order."""
        return " ".join(feature.name for feature in self.features)

    @property
    def is_possible(self) -> bool:
        """Whether no constraint is violated."""
        return not self.violations


def interpretations(
    features: Sequence[Feature],
    *,
    angle_noise: float = solving.DEFAULT_SOLVING.angle_noise,
    position_noise: float = solving.DEFAULT_SOLVING.position_noise,
    tolerance: float = 3.0,
    section_holds_axis: bool = False,
    settings: InterpretationSettings = InterpretationSettings(),
) -> tuple[Interpretation, ...]:
    """All assignments of places: first the possible ones, by their residual, then all others.

    `features`: 1 to 6; a place that is known is kept. `angle_noise`: standard deviation of a
    measured direction in each component across it [rad]; `position_noise`: of a coordinate [m].
    `tolerance`: largest residual of an equation, and least margin of an inequality [standard
    deviations]. `section_holds_axis`: whether the axis is known to run through the section. Besides
    the combinations of the tables those are tried in which an edge bounds a touched end. Raises
    ValueError if there are no features, or more than 6.
    """
    if not 1 <= len(features) <= settings.max_features:
        raise ValueError(f"features must be 1 to {settings.max_features}, got {len(features)}")
    noise = _Noise(
        positive("angle_noise", angle_noise, "rad"),
        positive("position_noise", position_noise, "m"),
        positive("tolerance", tolerance, "standard deviations"),
    )
    choices = [PLACES[f.group] if f.place is None else (f.place,) for f in features]
    assignments = []
    for places in itertools.product(*choices):
        placed = [replace(f, place=place) for f, place in zip(features, places, strict=True)]
        assignments.append(_interpretation(placed, noise, section_holds_axis, settings))
    return tuple(sorted(assignments, key=lambda item: (not item.is_possible, item.residual_sigma)))


class _Noise(NamedTuple):
    """Standard deviations, and the tolerance in their unit."""

    angle: float  # [rad]
    position: float  # [m]
    tolerance: float  # [standard deviations]

    def heights(self, offsets: Floats, axis_error: float) -> Floats:
        """Largest error of the height between two points [m], `offsets` (..., 3) apart [m]."""
        distances = np.linalg.norm(offsets, axis=-1)
        square = 2.0 * self.position**2 + (axis_error * distances) ** 2
        return np.asarray(self.tolerance * np.sqrt(square))


def _interpretation(
    placed: list[Feature], noise: _Noise, holds_axis: bool, settings: InterpretationSettings
) -> Interpretation:
    axis = solving.fit_axis(placed, noise.angle, noise.position, settings.solver)
    apex = solving.fit_apex(placed, noise.angle, noise.position, settings.solver)
    sides = solving.ConeOrigin(apex.point, np.zeros((3, 3)), apex.squared_misfit, apex.redundancy)
    solved = [solution for solution in (axis.orientation, sides) if solution is not None]
    worst = max(solving.residual_sigma(solution) for solution in solved)
    violations = [] if worst <= noise.tolerance else [FITS]
    if not _is_convex(placed, noise):
        violations.append(CONVEX)
    axes = _axes(placed, axis, settings)
    verdicts = _verdicts(placed, noise, axes, axis, apex, holds_axis)
    failed = ~np.array([*verdicts.values()])
    best = int(failed.sum(axis=0).argmin())
    violations += [name for name, fails in zip(verdicts, failed[:, best], strict=True) if fails]
    return Interpretation(
        features=tuple(placed),
        row=tables.row_of(feature.name for feature in placed),
        orientation=axis.orientation and axis.orientation._replace(axis=axes[best]),
        origin=apex.origin,
        redundancy=axis.redundancy + apex.redundancy,
        residual_sigma=worst,
        violations=tuple(violations),
    )


def _is_convex(placed: list[Feature], noise: _Noise) -> bool:
    """Whether all contacts lie behind all touched faces, whatever their places."""
    points = np.array([feature.point for feature in placed])
    return not any(
        ((points - face.point) @ normal > noise.heights(points - face.point, noise.angle)).any()
        for face in placed
        for normal in face.normals
    )


def _axes(placed: list[Feature], fit: solving.AxisFit, settings: InterpretationSettings) -> Floats:
    """Unit vectors (c, 3): the axis in both senses; if it is not known, all that are possible."""
    if fit.orientation is not None:
        return np.stack([fit.orientation.axis, -fit.orientation.axis])
    tops = [f.normals for f in placed if f.place == "T" and len(f.normals)]
    bottoms = [-f.normals for f in placed if f.place == "B" and len(f.normals)]
    if tops or bottoms:  # one of the faces beside an edge of an end is that end
        return np.vstack([*tops, *bottoms])
    if len(fit.free) == 2:
        turns = np.arange(settings.n_circle) * (2.0 * np.pi / settings.n_circle)
        return np.column_stack([np.cos(turns), np.sin(turns)]) @ fit.free
    place = np.arange(settings.n_sphere) + 0.5  # on a spiral, by the golden angle
    height = 1.0 - 2.0 * place / settings.n_sphere
    turns = place * np.pi * (3.0 - math.sqrt(5.0))
    level = np.sqrt(1.0 - height**2)
    return np.column_stack([level * np.cos(turns), level * np.sin(turns), height])


def _verdicts(
    placed: list[Feature], noise: _Noise, axes: Floats,
    axis: solving.AxisFit, apex: solving.ApexFit, holds_axis: bool,
) -> dict[str, Bools]:  # fmt: skip
    """Whether each constraint holds, for each of the axes (c,)."""
    error = min(axis.error, noise.angle) if axis.orientation is None else axis.error
    clear = math.sin(min(noise.tolerance * math.hypot(error, noise.angle), 0.5 * math.pi))
    lines = _stack(f.direction for f in placed if f.place == "M")
    sides = _stack(f.normals[0] for f in placed if f.group == "F" and f.place == "S")
    sines = np.linalg.norm(np.cross(axes[:, None], sides), axis=2)
    verdicts = {
        tables.MERIDIAN_SLOPES: (np.abs(axes @ lines.T) > clear).all(axis=1),
        tables.FACES_NOT_PARALLEL: (sines > clear).all(axis=1),
        **_end_verdicts(placed, noise, axes, error, math.cos(math.asin(clear))),
        **_apex_verdicts(placed, noise, axes, apex, error),
    }
    if holds_axis:
        tangents = _stack(f.normals[0] for f in placed if f.group == "P" and len(f.normals))
        outward = np.vstack([sides, tangents])
        verdicts[SECTION_HOLDS_AXIS] = (axes @ outward.T > -clear).all(axis=1)
    return verdicts


def _stack(vectors: Iterable[Floats | None]) -> Floats:
    """Vectors (k, 3); none are (0, 3)."""
    return np.array([v for v in vectors if v is not None], np.float64).reshape(-1, 3)


def _end_verdicts(
    placed: list[Feature], noise: _Noise, axes: Floats, error: float, cosine: float
) -> dict[str, Bools]:
    """Whether the ends face along the axis, with all contacts between them."""
    points = np.array([feature.point for feature in placed])
    outward, between, rims = np.ones((3, len(axes)), bool)
    for end in placed:
        if end.place in ENDS:
            room = noise.heights(points - end.point, error)
            is_elsewhere = np.array([feature.place != end.place for feature in placed])
            is_below = np.array([end.place == "T" and feature.place == "B" for feature in placed])
            above = ENDS[end.place] * (axes @ (points - end.point).T)
            limits = np.where(is_below & _is_decisive(room, points - end.point), -room, room)
            between &= (above[:, is_elsewhere] < limits[is_elsewhere]).all(axis=1)
            facing = ENDS[end.place] * axes @ end.normals.T
            if end.group == "F":
                outward &= facing[:, 0] > 0.0
            elif len(end.normals):
                rims &= facing.max(axis=1) >= cosine
    return {OUTWARD: outward, BETWEEN_ENDS: between, RIM_NORMAL: rims}


def _is_decisive(room: Floats, offsets: Floats) -> Bools:
    """Whether the error of a height is less than half of the distance."""
    return np.asarray(room < 0.5 * np.linalg.norm(offsets, axis=-1))


def _apex_verdicts(
    placed: list[Feature], noise: _Noise, axes: Floats, apex: solving.ApexFit, error: float
) -> dict[str, Bools]:
    """Whether contacts are below the apex, it is off the ends' planes, and edges bound the body.

    An apex that is free along a direction that is not level may be at any height.
    """
    offsets = apex.point - np.array([feature.point for feature in placed])
    heights = axes @ offsets.T
    if apex.origin is None:
        rises = np.linalg.norm(axes @ apex.free.T, axis=1) > noise.angle * noise.tolerance
        room = noise.heights(offsets, noise.angle)
        return {tables.BELOW_APEX: rises | (heights > -room).all(axis=1)}
    variances = np.einsum("ci,ij,cj->c", axes, apex.origin.covariance, axes)
    room = np.hypot(noise.heights(offsets, error), noise.tolerance * np.sqrt(variances)[:, None])
    is_end = np.array([feature.place in ENDS for feature in placed])
    is_off = (np.abs(heights) > room) | ~_is_decisive(room, offsets)
    return {
        tables.BELOW_APEX: (heights > -room).all(axis=1),
        tables.APEX_OFF_ENDS: is_off[:, is_end].all(axis=1),
        RIM_SUPPORTS: np.full(len(axes), _rims_support(placed, noise, apex.origin)),
    }


def _rims_support(placed: list[Feature], noise: _Noise, origin: solving.ConeOrigin) -> bool:
    """Whether all contacts are on one side of the planes through the apex and edges of ends."""
    points = np.array([feature.point for feature in placed])
    apex_error = math.sqrt(float(np.trace(origin.covariance)))
    for edge in placed:
        if edge.place in ENDS and edge.direction is not None:
            up = origin.point - edge.point
            normal, length = np.cross(edge.direction, up), float(np.linalg.norm(up))
            size = float(np.linalg.norm(normal))
            if size == 0.0:
                return False
            offsets = points - edge.point
            lever = np.linalg.norm(offsets, axis=1) * length / size
            tilt = math.hypot(noise.angle, apex_error / length)
            room = np.hypot(noise.heights(offsets, 0.0), noise.tolerance * tilt * lever)
            distances = offsets @ normal / size
            if (distances > room).any() and (distances < -room).any():
                return False
    return True
