"""Which places the features of a cone may have: tables 1.3 and 1.4, decided by measured geometry.

Every assignment of places is tried. Its equations are those of `solving`; what is left over of them
must vanish within the noise. What the tables say in words are inequalities: a meridian slopes, the
contacts lie below the apex, a top face faces along the axis, and a cone is convex. Where the
equations leave axis or apex free, an assignment stands if some axis fulfils them all.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, positive
from palpate.core.cones.features import PLACES, Feature
from palpate.core.cones.solving import (
    ANGLE_NOISE,
    POSITION_NOISE,
    ApexFit,
    AxisFit,
    ConeOrientation,
    ConeOrigin,
    fit_apex,
    fit_axis,
    residual_sigma,
)
from palpate.core.cones.tables import (
    APEX_OFF_ENDS,
    BELOW_APEX,
    FACES_NOT_PARALLEL,
    MERIDIAN_SLOPES,
    TableRow,
    row_of,
)

TOLERANCE = 3.0  # Standard deviations
MOST_FEATURES = 6  # Three places each: 729 assignments
# Of the distance between two points: a difference of heights that is known worse is no ground to
# refuse what needs one
UNDECIDED = 0.5
ON_CIRCLE, ON_SPHERE = 720, 4096  # Axes that are tried where the equations leave a choice
OUTWARD = "a top face faces along the axis, and a bottom face against it"
BETWEEN_ENDS = "every contact lies between the planes of the ends, the top above the bottom"
RIM_NORMAL = "one of the faces beside an edge of an end is that end"
RIM_SUPPORTS = "the body lies on one side of the plane through the apex and an edge of an end"
CONVEX = "no contact lies outside a touched face"
SECTION_HOLDS_AXIS = "a side face looks away from the axis and upwards"
FITS = "the equations of these places hold within the noise"


class Interpretation(NamedTuple):
    """One assignment of places to features, and what becomes of it."""

    features: tuple[Feature, ...]  # As given, with their places
    row: TableRow | None  # Of table 1.3 or 1.4; None if they do not list this combination
    orientation: ConeOrientation | None  # None if these places leave the axis free
    origin: ConeOrigin | None  # None if these places leave the apex free
    redundancy: int  # Equations left over
    # The larger of axis and apex, in standard deviations; 0 if no equation is left over
    residual_sigma: float
    refusals: tuple[str, ...]  # Constraints that fail; empty if the assignment stands

    @property
    def name(self) -> str:
        """The features with their places, in the order given."""
        return " ".join(one.name for one in self.features)

    @property
    def stands(self) -> bool:
        """Whether no constraint refuses it."""
        return not self.refusals


def interpretations(
    features: Sequence[Feature],
    *,
    angle_noise: float = ANGLE_NOISE,
    position_noise: float = POSITION_NOISE,
    tolerance: float = TOLERANCE,
    section_holds_axis: bool = False,
) -> tuple[Interpretation, ...]:
    """All assignments of places: first those that stand, by their residual, then those refused.

    `features`: 1 to 6; those that have a place keep it. `angle_noise`: standard deviation of a
    measured direction in each component across it, rad; `position_noise`: of a coordinate, m.
    `tolerance`: how many standard deviations an equation may be off, and an inequality must be
    clear. `section_holds_axis`: whether the axis is known to run through the section. Besides the
    combinations of the tables those are tried in which an edge bounds a touched end. Raises
    ValueError if there are no features, or more than 6.
    """
    if not 1 <= len(features) <= MOST_FEATURES:
        raise ValueError(f"features must be 1 to {MOST_FEATURES}, got {len(features)}")
    noise = _Noise(
        positive("angle_noise", angle_noise, "rad"),
        positive("position_noise", position_noise, "m"),
        positive("tolerance", tolerance, "standard deviations"),
    )
    choices = [PLACES[one.group] if one.place is None else (one.place,) for one in features]
    found = []
    for places in itertools.product(*choices):
        placed = [replace(one, place=place) for one, place in zip(features, places, strict=True)]
        found.append(_interpretation(placed, noise, section_holds_axis))
    return tuple(sorted(found, key=lambda one: (len(one.refusals) > 0, one.residual_sigma)))


class _Noise(NamedTuple):
    """Standard deviations, and how many of them count."""

    angle: float
    position: float
    tolerance: float

    def heights(self, apart: Floats, axis_error: float) -> Floats:
        """What a difference of two points' heights may be off, m; `apart` (..., 3), m."""
        distances = np.linalg.norm(apart, axis=-1)
        square = 2.0 * self.position**2 + (axis_error * distances) ** 2
        return np.asarray(self.tolerance * np.sqrt(square))


def _interpretation(placed: list[Feature], noise: _Noise, holds_axis: bool) -> Interpretation:
    axis = fit_axis(placed, noise.angle, noise.position)
    apex = fit_apex(placed, noise.angle, noise.position)
    sides = ConeOrigin(apex.point, np.zeros((3, 3)), apex.squared_misfit, apex.redundancy)
    worst = max(residual_sigma(one) for one in (axis.orientation, sides) if one is not None)
    refusals = [] if worst <= noise.tolerance else [FITS]
    refusals += [] if _is_convex(placed, noise) else [CONVEX]
    axes = _axes(placed, axis)
    verdicts = _verdicts(placed, noise, axes, axis, apex, holds_axis)
    failed = np.array([~one for one in verdicts.values()])
    best = int(failed.sum(axis=0).argmin())
    refusals += [name for name, fails in zip(verdicts, failed[:, best], strict=True) if fails]
    orientation = axis.orientation
    if orientation is not None:
        orientation = orientation._replace(axis=axes[best])
    row = row_of(one.name for one in placed)
    return Interpretation(
        tuple(placed),
        row,
        orientation,
        apex.origin,
        axis.redundancy + apex.redundancy,
        worst,
        tuple(refusals),
    )


def _is_convex(placed: list[Feature], noise: _Noise) -> bool:
    """Whether all contacts lie behind all faces, wherever on the cone these are."""
    points = np.array([one.point for one in placed])
    return not any(
        ((points - one.point) @ normal > noise.heights(points - one.point, noise.angle)).any()
        for one in placed
        for normal in one.normals
    )


def _axes(placed: list[Feature], fit: AxisFit) -> Floats:
    """Unit vectors (c, 3): the axis either way; if more of it is not known, all that may be it."""
    if fit.orientation is not None:
        return np.stack([fit.orientation.axis, -fit.orientation.axis])
    tops = [one.normals for one in placed if one.place == "T" and len(one.normals)]
    bottoms = [-one.normals for one in placed if one.place == "B" and len(one.normals)]
    if tops or bottoms:  # One of the faces beside an edge of an end is that end
        return np.vstack([*tops, *bottoms])
    if len(fit.free) == 2:
        turns = np.arange(ON_CIRCLE) * (2.0 * np.pi / ON_CIRCLE)
        return np.column_stack([np.cos(turns), np.sin(turns)]) @ fit.free
    place = np.arange(ON_SPHERE) + 0.5  # Along a spiral, by the golden angle
    height, turns = 1.0 - 2.0 * place / ON_SPHERE, place * np.pi * (3.0 - math.sqrt(5.0))
    level = np.sqrt(1.0 - height**2)
    return np.column_stack([level * np.cos(turns), level * np.sin(turns), height])


def _verdicts(
    placed: list[Feature],
    noise: _Noise,
    axes: Floats,
    axis: AxisFit,
    apex: ApexFit,
    holds_axis: bool,
) -> dict[str, Bools]:
    """Which constraints hold for which axes (c,)."""
    error = min(axis.error, noise.angle) if axis.orientation is None else axis.error
    clear = math.sin(min(noise.tolerance * math.hypot(error, noise.angle), 0.5 * math.pi))
    lines = _stack(one.direction for one in placed if one.place == "M")
    sides = _stack(one.normals[0] for one in placed if one.group == "F" and one.place == "S")
    tangents = _stack(one.normals[0] for one in placed if one.group == "P" and len(one.normals))
    outward = np.vstack([sides, tangents])
    verdicts = {
        MERIDIAN_SLOPES: (np.abs(axes @ lines.T) > clear).all(axis=1),
        FACES_NOT_PARALLEL: (np.linalg.norm(np.cross(axes[:, None], sides), axis=2) > clear).all(
            axis=1
        ),
        OUTWARD: _faces_outward(placed, axes),
        BETWEEN_ENDS: _between_ends(placed, noise, axes, error),
        RIM_NORMAL: _rim_normals(placed, axes, math.cos(min(math.asin(clear), 0.5 * math.pi))),
        **_below_apex(placed, noise, axes, apex, error),
    }
    if apex.origin is not None:
        supported = _rims_support(placed, noise, apex.origin)
        verdicts[RIM_SUPPORTS] = np.full(len(axes), supported)
    if holds_axis:
        verdicts[SECTION_HOLDS_AXIS] = (axes @ outward.T > -clear).all(axis=1)
    return verdicts


def _stack(vectors: Iterable[Floats | None]) -> Floats:
    """Vectors (k, 3); none are (0, 3)."""
    return np.array([one for one in vectors if one is not None], np.float64).reshape(-1, 3)


def _faces_outward(placed: list[Feature], axes: Floats) -> Bools:
    tops = _stack(one.normals[0] for one in placed if one.group == "F" and one.place == "T")
    bottoms = _stack(one.normals[0] for one in placed if one.group == "F" and one.place == "B")
    return np.asarray((axes @ np.vstack([tops, -bottoms]).T > 0.0).all(axis=1))


def _between_ends(placed: list[Feature], noise: _Noise, axes: Floats, error: float) -> Bools:
    points = np.array([one.point for one in placed])
    holds = np.ones(len(axes), bool)
    for end, sign in (("T", 1.0), ("B", -1.0)):
        for mine in (one for one in placed if one.place == end):
            room = noise.heights(points - mine.point, error)
            others = np.array([one.place != end for one in placed])
            strictly = np.array([end == "T" and one.place == "B" for one in placed])
            above = sign * (axes @ (points - mine.point).T)
            limits = np.where(strictly & _decides(room, points - mine.point), -room, room)
            holds &= (above[:, others] < limits[others]).all(axis=1)
    return holds


def _rim_normals(placed: list[Feature], axes: Floats, cosine: float) -> Bools:
    holds = np.ones(len(axes), bool)
    for one in placed:
        if one.place in ("T", "B") and one.group in "EV" and len(one.normals):
            sign = 1.0 if one.place == "T" else -1.0
            holds &= (sign * axes @ one.normals.T).max(axis=1) >= cosine
    return holds


def _decides(room: Floats, apart: Floats) -> Bools:
    """Whether a height is known well enough to be told from 0."""
    return np.asarray(room < UNDECIDED * np.linalg.norm(apart, axis=-1))


def _below_apex(
    placed: list[Feature], noise: _Noise, axes: Floats, apex: ApexFit, error: float
) -> dict[str, Bools]:
    """Whether contacts lie below the apex, and it outside the ends' planes.

    Where the apex is free along a direction that is not level it may lie as high as need be.
    """
    apart = apex.point - np.array([one.point for one in placed])
    if apex.origin is None:
        rises = np.linalg.norm(axes @ apex.free.T, axis=1) > noise.angle * noise.tolerance
        room = noise.heights(apart, noise.angle)
        return {BELOW_APEX: rises | (axes @ apart.T > -room).all(axis=1)}
    own = np.einsum("ci,ij,cj->c", axes, apex.origin.covariance, axes)
    room = np.hypot(noise.heights(apart, error), noise.tolerance * np.sqrt(own)[:, None])
    heights = axes @ apart.T
    ends = np.array([one.place in ("T", "B") for one in placed])
    off = (np.abs(heights) > room) | ~_decides(room, apart)
    return {
        BELOW_APEX: (heights > -room).all(axis=1),
        APEX_OFF_ENDS: off[:, ends].all(axis=1),
    }


def _rims_support(placed: list[Feature], noise: _Noise, origin: ConeOrigin) -> bool:
    points = np.array([one.point for one in placed])
    own = math.sqrt(float(np.trace(origin.covariance)))
    for one in placed:
        if one.place in ("T", "B") and one.direction is not None:
            up = origin.point - one.point
            normal = np.cross(one.direction, up)
            size = float(np.linalg.norm(normal))
            if size == 0.0:
                return False
            apart = points - one.point
            lever = np.linalg.norm(apart, axis=1) * float(np.linalg.norm(up)) / size
            turned = math.hypot(noise.angle, own / float(np.linalg.norm(up)))
            room = np.hypot(noise.heights(apart, 0.0), noise.tolerance * turned * lever)
            beside = apart @ normal / size
            if (beside > room).any() and (beside < -room).any():
                return False
    return True
