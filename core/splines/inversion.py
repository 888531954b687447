"""Point inversion: the parameters of a spline volume at points of space.

Closed form where the control points are an affine image of the Greville abscissae, three inversions
of one variable where they lie on parallel planes, else small least-squares problems.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.least_squares import levenberg_marquardt
from palpate.core.splines.bases import Basis
from palpate.core.splines.spline_volumes import (
    Parallelepiped,
    SplineVolume,
    control_extent,
    mean_determinant,
    rescaled_volume,
)

EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True, slots=True, kw_only=True)
class InversionSettings:
    """Iteration of the point inversion by least squares."""

    max_steps: int = 40  # from one start
    n_samples: int = 13  # along each axis, of the grid of new starts where the first failed
    n_starts: int = 6  # samples nearest to the point, from which it starts anew
    min_residual: float = 1e-12  # fraction of the volume's size; smaller ones end the iteration
    max_residual: float = 1e-9  # fraction of the volume's size, of a solution


def invert_points(
    volume: SplineVolume, points: Floats, settings: InversionSettings = InversionSettings()
) -> Inversion:
    """Parameters of points in a volume.

    `volume`: polynomial or rational, undeformed or deformed, folded or not. `points` (n, 3) [m].
    Closed form where the control points are an affine image of the Greville abscissae; three
    inversions of one variable where they lie on parallel planes; else least squares in three
    variables. Raises ValueError if points are not finite (n, 3).
    """
    points = finite_array("points", points, (None, 3))
    frame = affine_image(volume)
    if frame is not None:
        return _closed_form(volume, frame, points, settings)
    regular = regular_planes(volume)
    if regular is not None:
        return _axis_by_axis(volume, *regular, points, settings)
    return invert_general(volume, points, settings)


def affine_image(volume: SplineVolume) -> Parallelepiped | None:
    """The parallelepiped of which a volume is an affine, undeformed lattice; else None."""
    if _has_unequal_weights(volume):
        return None
    places = [basis.greville() for basis in volume.bases]
    control, corner, ends = _corners(volume)
    edges = (ends - corner) / np.array([[place[-1] - place[0]] for place in places])
    frame = _parallelepiped(corner - np.array([place[0] for place in places]) @ edges, edges)
    if frame is None:
        return None
    error = float(np.abs(frame.greville_control(volume.bases) - control).max())
    return frame if error <= _rounding(control) else None


def _closed_form(
    volume: SplineVolume, frame: Parallelepiped, points: Floats, settings: InversionSettings
) -> Inversion:
    parameters = frame.local(points)
    if parameters.min(initial=0.0) < 0.0 or parameters.max(initial=0.0) > 1.0:
        parameters = np.clip(parameters, 0.0, 1.0)
    offset = frame.points(parameters) - points
    residual = np.sqrt(np.einsum("ni,ni->n", offset, offset))
    steps = np.zeros(len(points), np.int32)
    return _with_outside(volume, points, parameters, residual, steps, settings)


def regular_planes(
    volume: SplineVolume,
) -> tuple[Parallelepiped, tuple[Floats, Floats, Floats]] | None:
    """The parallel planes on which a volume's control points lie, or None if they do not.

    Returns the frame from one corner to the three next to it, and the planes' places along its
    edges, from 0 to 1. Each parameter depends on one coordinate alone, because the bases sum to 1
    along the others.
    """
    if _has_unequal_weights(volume):
        return None
    control, corner, ends = _corners(volume)
    frame = _parallelepiped(corner, ends - corner)
    if frame is None:
        return None
    local = frame.local(control.reshape(-1, 3)).reshape(control.shape)
    planes = local[:, 0, 0, 0], local[0, :, 0, 1], local[0, 0, :, 2]
    again = frame.points(np.stack(np.meshgrid(*planes, indexing="ij"), axis=-1))
    error = float(np.abs(again - control).max())
    rising = all((np.diff(plane) > 0.0).all() for plane in planes)
    return (frame, planes) if rising and error <= _rounding(control) else None


def _corners(volume: SplineVolume) -> tuple[Floats, Floats, Floats]:
    """Control points, their first, and the last (3, 3) along each axis from there."""
    control = volume.control
    ends = np.stack([control[-1, 0, 0], control[0, -1, 0], control[0, 0, -1]])
    return control, control[0, 0, 0], ends


def _has_unequal_weights(volume: SplineVolume) -> bool:
    return volume.weights is not None and bool(np.ptp(volume.weights) > 0.0)


def _parallelepiped(corner: Floats, edges: Floats) -> Parallelepiped | None:
    try:
        return Parallelepiped(corner, edges)
    except ValueError:  # flat: no parallelepiped
        return None


def _rounding(control: Floats) -> float:
    return 16 * EPSILON * float(np.abs(control).max())


def _axis_by_axis(
    volume: SplineVolume,
    frame: Parallelepiped,
    planes: tuple[Floats, Floats, Floats],
    points: Floats,
    settings: InversionSettings,
) -> Inversion:
    axes = zip(volume.bases, planes, frame.local(points).T, strict=True)
    roots = [invert_monotone(*axis) for axis in axes]
    offset = np.stack([root.residual for root in roots], axis=1) @ frame.edges
    parameters = np.stack([root.parameters for root in roots], axis=1)
    steps = np.max([root.steps for root in roots], axis=0)
    residual = np.linalg.norm(offset, axis=1)
    return _with_outside(volume, points, parameters, residual, steps, settings)


def invert_monotone(
    basis: Basis, coefficients: Floats, values: Floats, max_steps: int = 60
) -> MonotoneRoots:
    """Parameters at which a spline with increasing coefficients takes values (n,), or its ends.

    It increases too, so that its values at the knots bracket the root. There it is one polynomial,
    whose root Newton's method finds, with bisection where a step would leave the bracket. A root
    stays where it is: an end of the bracket is on it, and bisection would move away again. Raises
    ValueError if coefficients do not increase, or a value is NaN.
    """
    coefficients = finite_array("coefficients", coefficients, (basis.count,))
    values = np.asarray(values, np.float64)
    if np.isnan(values).any():
        raise ValueError(f"values must be numbers, got {np.count_nonzero(np.isnan(values))} nan")
    if not (np.diff(coefficients) > 0.0).all():
        raise ValueError("coefficients must increase")
    breaks = basis.breaks()
    taylor = _taylor(basis, coefficients, breaks)
    heights = taylor[0]
    span = np.clip(np.searchsorted(heights, values, side="right") - 1, 0, len(breaks) - 2)
    width = np.diff(breaks)[span]
    pieces = taylor[:, span] * width ** np.arange(len(taylor))[:, None]
    rise = heights[span + 1] - heights[span]
    tolerance = 4 * EPSILON * float(heights[-1] - heights[0])
    place = np.clip((values - heights[span]) / rise, 0.0, 1.0)
    low, high = np.zeros(len(values)), np.ones(len(values))
    steps = np.zeros(len(values), np.int32)
    for _ in range(max_steps):
        value, slope = _horner(pieces, place)
        error = value - values
        active = np.abs(error) > tolerance
        low, high = np.where(error < 0.0, place, low), np.where(error > 0.0, place, high)
        active &= high > low
        if not active.any():
            break
        with np.errstate(divide="ignore", invalid="ignore"):  # then bisection
            following = place - error / slope
        inside = (following > low) & (following < high)
        # The root may lie beyond the piece's end, by rounding or because the value does.
        at_end = ((place == 0.0) & (error > 0.0)) | ((place == 1.0) & (error < 0.0))
        bisected = np.where(at_end, place, 0.5 * (low + high))
        following = np.where(inside, following, bisected)
        active &= following != place
        place = np.where(active, following, place)
        steps += active
        if not active.any():
            break
    residual = np.abs(_horner(pieces, place)[0] - values)
    return MonotoneRoots(breaks[span] + width * place, residual, steps)


def _taylor(basis: Basis, coefficients: Floats, breaks: Floats) -> Floats:
    """Derivatives over factorials at the breaks, (degree + 1, len(breaks))."""
    local = basis.nonzero(breaks, basis.degree)
    values = np.einsum("dnk,nk->dn", local.values, coefficients[local.columns()])
    factorials = np.concatenate([[1.0], np.cumprod(np.arange(1.0, basis.degree + 1))])
    return np.asarray(values / factorials[:, None])


def _horner(pieces: Floats, place: Floats) -> tuple[Floats, Floats]:
    value, slope = pieces[-1].copy(), np.zeros_like(place)
    for power in pieces[-2::-1]:
        slope = slope * place + value
        value = value * place + power
    return value, slope


def _with_outside(
    volume: SplineVolume,
    points: Floats,
    parameters: Floats,
    residual: Floats,
    steps: Ints,
    settings: InversionSettings,
) -> Inversion:
    """Inversion with points outside solved in general: clipping may not give their nearest."""
    converged = residual <= residual_tolerance(volume, settings)
    folded = np.zeros(len(points), bool)  # such volumes cannot fold
    outside = np.flatnonzero(~converged)
    if len(outside):
        nearest = invert_general(volume, points[outside], settings)
        parameters[outside], residual[outside] = nearest.parameters, nearest.residual
        converged[outside], steps[outside] = nearest.converged, nearest.steps
    return Inversion(parameters, residual, converged, folded, steps)


def invert_general(
    volume: SplineVolume, points: Floats, settings: InversionSettings = InversionSettings()
) -> Inversion:
    """Parameters of points (n, 3) in any volume, polynomial or rational.

    The distance is minimised by the method of Levenberg and Marquardt within the bounds of the
    parameters, from the affine guess and, where that fails, from the nearest of a grid of samples.
    Newton's method on the derivative of the distance, as in Fung, 1999, (4.12), squares the
    condition number and has roots that are no solutions.
    """
    matrix = affine_fit(volume)
    guess = np.clip(points @ matrix[:3] + matrix[3], 0.0, 1.0)
    parameters, residual, steps = _minimise(volume, points, guess, settings)
    tolerance = residual_tolerance(volume, settings)
    failed = residual > tolerance
    if failed.any():
        seeds = _nearest_samples(volume, points[failed], settings)
        for number in range(seeds.shape[1]):
            rows = np.flatnonzero(failed)
            still = residual[rows] > tolerance
            rows = rows[still]
            if not len(rows):
                break
            new, new_residual, more = _minimise(
                volume, points[rows], seeds[still, number], settings
            )
            steps[rows] += more
            better = new_residual < residual[rows]
            parameters[rows[better]], residual[rows[better]] = new[better], new_residual[better]
    folded = is_folded(volume, volume.first(parameters)[1])
    return Inversion(parameters, residual, residual <= tolerance, folded, steps)


def affine_fit(volume: SplineVolume) -> Floats:
    """The affine map from points to parameters that fits the control points best.

    (4, 3): points with a 1 appended, times this, are parameters.
    """
    places = np.meshgrid(*(basis.greville() for basis in volume.bases), indexing="ij")
    wanted = np.stack(places, axis=-1).reshape(-1, 3)
    points = volume.control.reshape(-1, 3)
    middle = points.mean(axis=0)
    size = max(float(np.ptp(points, axis=0).max()), np.finfo(float).tiny)
    rows = np.column_stack([(points - middle) / size, np.ones(len(points))])
    solution = np.linalg.lstsq(rows, wanted, rcond=1e-12)[0]
    matrix = np.concatenate([solution[:3] / size, solution[3:]])
    matrix[3] -= middle @ matrix[:3]
    return matrix


def _minimise(
    volume: SplineVolume, points: Floats, starts: Floats, settings: InversionSettings
) -> tuple[Floats, Floats, Ints]:
    """Result of the iteration from starts (n, 3): parameters, residuals, steps."""

    def problem(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
        reached, slopes = volume.first(parameters)
        return reached - points[rows], slopes

    ends = levenberg_marquardt(
        problem,
        starts,
        np.zeros(3),
        np.ones(3),
        steps=settings.max_steps,
        min_residual=least_residual(volume, settings),
    )
    return ends.parameters, np.sqrt(2.0 * ends.cost), ends.steps


def least_residual(
    volume: SplineVolume, settings: InversionSettings = InversionSettings()
) -> float:
    """Residual [m] at which the iteration ends."""
    return _length(volume, settings.min_residual, 16)


def residual_tolerance(
    volume: SplineVolume, settings: InversionSettings = InversionSettings()
) -> float:
    """Largest residual [m] of a solution."""
    return _length(volume, settings.max_residual, 64)


def _length(volume: SplineVolume, fraction: float, roundings: int) -> float:
    """Fraction of the volume's size plus some rounding errors [m]."""
    points = volume.control.reshape(-1, 3)
    size = float(np.ptp(points, axis=0).max())
    return fraction * size + roundings * EPSILON * float(np.abs(points).max())


def _nearest_samples(volume: SplineVolume, points: Floats, settings: InversionSettings) -> Floats:
    from scipy.spatial import cKDTree

    axis = np.linspace(0.0, 1.0, settings.n_samples)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    tree = cKDTree(volume.grid(axis, axis, axis).reshape(-1, 3))
    return grid[tree.query(points, k=settings.n_starts)[1]]


def is_folded(volume: SplineVolume, slopes: Floats, min_determinant: float = 1e-12) -> Bools:
    """Whether slopes (n, 3, 3) of a volume have no determinant of the volume's sign.

    That is the sign of the mean determinant: a volume may be a ring and fold nowhere.
    `min_determinant`: over the product of the slopes' largest components; smaller ones are 0.
    """
    own = mean_determinant(rescaled_volume(volume, volume.control[0, 0, 0], control_extent(volume)))
    largest = np.abs(slopes).max(axis=1, keepdims=True)
    s, t, u = (slopes / np.where(largest > 0.0, largest, 1.0)).transpose(2, 0, 1)
    determinant = np.einsum("ni,ni->n", np.cross(s, t), u)
    return np.asarray((determinant if own >= 0.0 else -determinant) <= min_determinant)


class Inversion(NamedTuple):
    """Parameters of some points."""

    parameters: Floats  # s, t, u (n, 3), from 0 to 1; of a nearest point without solution
    residual: Floats  # distance (n,) [m] between the point and that of the parameters
    converged: Bools  # (n,): the residual is 0 but for rounding; never of a point outside
    folded: Bools  # (n,): inside out there, or flat: other parameters may give the point too
    steps: Ints  # of the iteration, (n,)


class MonotoneRoots(NamedTuple):
    """Parameters at which a spline takes values."""

    parameters: Floats  # (n,)
    residual: Floats  # error of the value, (n,)
    steps: Ints  # (n,)
