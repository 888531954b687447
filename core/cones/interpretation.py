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
from palpate.core.cones import solving, tables
from palpate.core.cones.features import ENDS, PLACES, Feature

TOLERANCE = 3.0  # Standard deviations
MOST_FEATURES = 6  # Three places each: 729 assignments
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
    row: tables.TableRow | None  # Of table 1.3 or 1.4; None if they do not list this combination
    orientation: solving.ConeOrientation | None  # None if these places leave the axis free
    origin: solving.ConeOrigin | None  # None if these places leave the apex free
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
    angle_noise: float = solving.ANGLE_NOISE,
    position_noise: float = solving.POSITION_NOISE,
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
    axis = solving.fit_axis(placed, noise.angle, noise.position)
    apex = solving.fit_apex(placed, noise.angle, noise.position)
    sides = solving.ConeOrigin(apex.point, np.zeros((3, 3)), apex.squared_misfit, apex.redundancy)
    solved = [one for one in (axis.orientation, sides) if one is not None]
    worst = max(solving.residual_sigma(one) for one in solved)
    refusals = [] if worst <= noise.tolerance else [FITS]
    points = np.array([one.point for one in placed])
    if any(  # A cone lies behind all its faces, wherever on it these are
        ((points - one.point) @ normal > noise.heights(points - one.point, noise.angle)).any()
        for one in placed
        for normal in one.normals
    ):
        refusals.append(CONVEX)
    axes = _axes(placed, axis)
    verdicts = _verdicts(placed, noise, axes, axis, apex, holds_axis)
    failed = ~np.array([*verdicts.values()])
    best = int(failed.sum(axis=0).argmin())
    refusals += [name for name, fails in zip(verdicts, failed[:, best], strict=True) if fails]
    orientation = axis.orientation and axis.orientation._replace(axis=axes[best])
    row = tables.row_of(one.name for one in placed)
    over = axis.redundancy + apex.redundancy
    told = orientation, apex.origin, over, worst, tuple(refusals)
    return Interpretation(tuple(placed), row, *told)


def _axes(placed: list[Feature], fit: solving.AxisFit) -> Floats:
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
    placed: list[Feature], noise: _Noise, axes: Floats,
    axis: solving.AxisFit, apex: solving.ApexFit, holds_axis: bool,
) -> dict[str, Bools]:  # fmt: skip
    """Which constraints hold for which axes (c,)."""
    error = min(axis.error, noise.angle) if axis.orientation is None else axis.error
    clear = math.sin(min(noise.tolerance * math.hypot(error, noise.angle), 0.5 * math.pi))
    lines = _stack(one.direction for one in placed if one.place == "M")
    sides = _stack(one.normals[0] for one in placed if one.group == "F" and one.place == "S")
    apart = np.linalg.norm(np.cross(axes[:, None], sides), axis=2)
    verdicts = {
        tables.MERIDIAN_SLOPES: (np.abs(axes @ lines.T) > clear).all(axis=1),
        tables.FACES_NOT_PARALLEL: (apart > clear).all(axis=1),
        **_ends_hold(placed, noise, axes, error, math.cos(math.asin(clear))),
        **_apex_holds(placed, noise, axes, apex, error),
    }
    if holds_axis:
        tangents = _stack(one.normals[0] for one in placed if one.group == "P" and len(one.normals))
        outward = np.vstack([sides, tangents])
        verdicts[SECTION_HOLDS_AXIS] = (axes @ outward.T > -clear).all(axis=1)
    return verdicts


def _stack(vectors: Iterable[Floats | None]) -> Floats:
    """Vectors (k, 3); none are (0, 3)."""
    return np.array([one for one in vectors if one is not None], np.float64).reshape(-1, 3)


def _ends_hold(
    placed: list[Feature], noise: _Noise, axes: Floats, error: float, cosine: float
) -> dict[str, Bools]:
    """Whether the ends face along the axis, with all contacts between them."""
    points = np.array([one.point for one in placed])
    outward, between, rims = np.ones((3, len(axes)), bool)
    for mine in placed:
        if mine.place in ENDS:
            room = noise.heights(points - mine.point, error)
            others = np.array([one.place != mine.place for one in placed])
            strictly = np.array([mine.place == "T" and one.place == "B" for one in placed])
            above = ENDS[mine.place] * (axes @ (points - mine.point).T)
            limits = np.where(strictly & _decides(room, points - mine.point), -room, room)
            between &= (above[:, others] < limits[others]).all(axis=1)
            facing = ENDS[mine.place] * axes @ mine.normals.T
            if mine.group == "F":
                outward &= facing[:, 0] > 0.0
            elif len(mine.normals):
                rims &= facing.max(axis=1) >= cosine
    return {OUTWARD: outward, BETWEEN_ENDS: between, RIM_NORMAL: rims}


def _decides(room: Floats, apart: Floats) -> Bools:
    """Whether a height is known well enough, to half of the distance, to be told from 0."""
    return np.asarray(room < 0.5 * np.linalg.norm(apart, axis=-1))


def _apex_holds(
    placed: list[Feature], noise: _Noise, axes: Floats, apex: solving.ApexFit, error: float
) -> dict[str, Bools]:
    """Whether contacts lie below the apex, it outside the ends' planes, and the body on one side.

    Where the apex is free along a direction that is not level it may lie as high as need be.
    """
    apart = apex.point - np.array([one.point for one in placed])
    heights = axes @ apart.T
    if apex.origin is None:
        rises = np.linalg.norm(axes @ apex.free.T, axis=1) > noise.angle * noise.tolerance
        room = noise.heights(apart, noise.angle)
        return {tables.BELOW_APEX: rises | (heights > -room).all(axis=1)}
    own = np.einsum("ci,ij,cj->c", axes, apex.origin.covariance, axes)
    room = np.hypot(noise.heights(apart, error), noise.tolerance * np.sqrt(own)[:, None])
    ends = np.array([one.place in ENDS for one in placed])
    off = (np.abs(heights) > room) | ~_decides(room, apart)
    return {
        tables.BELOW_APEX: (heights > -room).all(axis=1),
        tables.APEX_OFF_ENDS: off[:, ends].all(axis=1),
        RIM_SUPPORTS: np.full(len(axes), _rims_support(placed, noise, apex.origin)),
    }


def _rims_support(placed: list[Feature], noise: _Noise, origin: solving.ConeOrigin) -> bool:
    points = np.array([one.point for one in placed])
    own = math.sqrt(float(np.trace(origin.covariance)))
    for one in placed:
        if one.place in ENDS and one.direction is not None:
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
