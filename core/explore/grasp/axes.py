"""Slicing axes from normals alone: of revolution, of straight sides, of a touched end face.

Every normal of a surface of revolution meets its axis; those of a screw surface have one pitch.
Both are linear in the axis's Pluecker coordinates, so that neither the profile nor where along it
the contacts lie matters: Pottmann and Randrup, *Rotational and helical surface approximation for
reverse engineering*, 1998. Most normals of a box or a column are square to its axis; those of its
two ends are not, and are left out. A single touch of an end does not show whether it met a face:
where the surface is level, slices are best level; where all sides run straight along its normal, it
is the face that closes them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, scaled_mad

N_PARAMETERS = 5  # of a screw: four of its axis, and a pitch
MIN_CONTACTS = N_PARAMETERS + 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtrusionSettings:
    """Which normals belong to the straight sides of an object, and when these have an axis."""

    # [rad] largest deviation of the sides' normals from square to the axis, in each iteration.
    side_angles: tuple[float, ...] = tuple(math.radians(a) for a in (20.0, 10.0, 5.0, 2.5, 1.5))
    min_contacts: int = 10  # of the sides
    min_share: float = 0.4  # of the contacts in the first angle that stay; a ball keeps fewer
    # Mean square of the sides' unit normals in the weaker direction across the axis. With less, all
    # point in nearly one direction, and the axis may turn about it.
    min_spread: float = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class EndAxisSettings:
    """When the normal of a touched end is a better slicing axis."""

    min_change: float = math.radians(1.0)  # [rad] of the axis; smaller changes are not made
    max_level: float = math.radians(3.0)  # [rad] of an end's normal to the vertical, of a level end
    max_side_angle: float = math.radians(3.0)  # [rad] of the sides' own axis from the end's normal


@dataclass(frozen=True, slots=True, kw_only=True)
class RevolutionSettings:
    """How an axis of revolution is fitted to normals, some of which do not belong to it."""

    n_iterations: int = 25  # of iterative reweighting
    n_fixed: int = 6  # first iterations, in which the axis keeps its direction
    outlier: float = 3.0  # [standard deviations] beyond which a normal has no weight, as at edges
    max_miss: float = 0.015  # [size of the contacts] from a normal to the axis that it belongs to
    min_scale: float = 5e-4  # [size of the contacts] least standard deviation of that distance
    ridge: float = 1e-6  # of the mean square, added to it: a cylinder's moment is not unique


def end_face_axis(
    axis: Floats,
    face: Floats,
    normals: Floats,
    settings: EndAxisSettings = EndAxisSettings(),
    sides: ExtrusionSettings = ExtrusionSettings(),
) -> Floats | None:
    """The slicing axis (3,) that the touch of an end suggests; None to keep the present one.

    `axis` (3,): the present slicing axis, a unit vector that points to the end. `face` (3,):
    outward unit normal where the end was touched. `normals` (n, 3): outward unit normals of all
    contacts. `settings`, `sides`: when the end decides, and which normals are the sides'.
    """
    vertical = np.array([0.0, 0.0, 1.0])
    if _angle(face, axis) < settings.min_change:
        return None
    if _angle(face, vertical) < settings.max_level:
        return None if np.array_equal(axis, vertical) else vertical
    straight = extrusion_axis(normals, face, sides)
    if straight is None or _angle(straight, face) > settings.max_side_angle:
        return None
    return face


def _angle(a: Floats, b: Floats) -> float:
    """Angle between unit vectors [rad]."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def extrusion_axis(
    normals: Floats, axis: Floats, settings: ExtrusionSettings = ExtrusionSettings()
) -> Floats | None:
    """The axis (3,) to which the sides' normals are square; None if they have none.

    `normals` (n, 3): of the contacts. `axis` (3,): about where it lies. Both are unit vectors.
    """
    sideways = int((np.abs(normals @ axis) < math.sin(settings.side_angles[0])).sum())
    for angle in settings.side_angles:
        sides = normals[np.abs(normals @ axis) < math.sin(angle)]
        if len(sides) < max(settings.min_contacts, settings.min_share * sideways):
            return None
        spread, directions = np.linalg.eigh(sides.T @ sides / len(sides))
        square = directions[:, 0]
        axis = square if square @ axis > 0.0 else -square
    return np.asarray(axis) if spread[1] >= settings.min_spread else None


class RevolutionAxis(NamedTuple):
    """An axis that normals meet."""

    axis: Floats  # (3,) unit vector; its sign means nothing
    point: Floats  # (3,) [m] on the axis, nearest to the middle of the contacts
    error: float  # [rad] standard deviation of the axis's angle; at most pi
    rms: float  # [size of the contacts] spread of the distances of normals from the axis
    share: float  # of the contacts whose normals meet it within `RevolutionSettings.max_miss`
    # [size of the contacts per rad] by which normals leave an axis that turns about the point; 0
    # for a ball.
    lift: float


def revolution_axis(
    points: Floats,
    normals: Floats,
    axes: Floats,
    settings: RevolutionSettings = RevolutionSettings(),
) -> RevolutionAxis:
    """The axis that most normals meet best.

    `points`, `normals` (n, 3): at least 6 contacts [m], and unit vectors. `axes` (k, 3): where the
    search starts, besides three axes that the normals suggest. Raises ValueError if there are fewer
    contacts.
    """
    if len(points) < MIN_CONTACTS:
        raise ValueError(f"points must be at least {MIN_CONTACTS}, got {len(points)}")
    middle = points.mean(axis=0)
    centred = points - middle
    size = math.sqrt(float((centred**2).sum(axis=1).mean())) or 1.0
    lines = np.hstack([np.cross(centred / size, normals), normals])
    starts = [*_axes(lines, np.ones(len(lines)), settings.ridge)[1].T, *axes]
    fits = (_fit_weights(lines, start, settings) for start in starts)
    weights, scale, _ = min(fits, key=lambda fit: fit[2])
    spread, directions, slides = _axes(lines, weights, settings.ridge)
    axis = directions[:, 0]
    moment = -slides @ axis
    missed = lines @ np.concatenate([axis, moment])
    total = float(weights.sum())
    variance = scale**2 * total / max(total - N_PARAMETERS, 1.0)
    lift = max(float(spread[1] - max(spread[0], 0.0)), 0.0)
    error = math.sqrt(variance / total / lift) if lift > 0.0 else math.pi
    return RevolutionAxis(
        axis,
        middle + size * np.cross(axis, moment),
        min(error, math.pi),
        scale,
        float((np.abs(missed) < settings.max_miss).mean()),
        math.sqrt(lift),
    )


def _fit_weights(
    lines: Floats, axis: Floats, settings: RevolutionSettings
) -> tuple[Floats, float, float]:
    """Weights (n,) of the normals in a fit from a start `axis` (3,), their spread, and its cost."""
    weights, scale, missed = np.ones(len(lines)), math.inf, np.zeros(len(lines))
    for iteration in range(settings.n_iterations):
        _, directions, slides = _axes(lines, weights, settings.ridge)
        if iteration >= settings.n_fixed:
            axis = directions[:, 0]
        missed = lines @ np.concatenate([axis, -slides @ axis])
        scale = max(scaled_mad(missed), settings.min_scale)
        off = np.minimum(np.abs(missed) / (settings.outlier * scale), 1.0)
        weights = (1.0 - off * off) ** 2
    # The spread is no cost: half of the contacts may agree on an axis that the others contradict.
    cost = float(np.minimum(np.abs(missed) / settings.max_miss, 1.0).mean())
    return weights, scale, cost


def _axes(lines: Floats, weights: Floats, ridge: float) -> tuple[Floats, Floats, Floats]:
    """Mean square misses (3,) ascending, their axes as columns, and `slides` (3, 3).

    The best moment of an axis a is -slides @ a; with it the misses depend on a alone.
    """
    square = (lines * weights[:, None]).T @ lines / float(weights.sum())
    mixed, own = square[3:, :3], square[3:, 3:] + ridge * np.trace(square) / 6.0 * np.eye(3)
    slides = np.linalg.solve(own, mixed)
    spread, axes = np.linalg.eigh(square[:3, :3] - mixed.T @ slides)
    return spread, axes, slides
