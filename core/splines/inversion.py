"""Point inversion: which parameters of a spline volume belong to a point of space.

The closed form where the control points are an affine image of the Greville abscissae, three
inversions of one variable where they lie on parallel planes, else small least-squares problems.
"""

from __future__ import annotations

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

GENERAL_MOST_STEPS = 40  # Of one start
START_SAMPLES = 13  # Along each axis: where to begin again when the first start failed
STARTS = 6  # Nearest samples that are tried
EPSILON = float(np.finfo(float).eps)
ENOUGH = 1e-12  # Of the volume's size: no iteration goes on below that residual
CONVERGED = 1e-9  # Of the volume's size: a larger residual is no answer
LEAST_DETERMINANT = 1e-12  # Of the product of the slopes' largest components: below, it is none
ROUNDING = 16 * float(np.finfo(float).eps)  # Of the largest coordinate
MONOTONE_MOST_STEPS = 60
MONOTONE_ROUNDING = 4 * float(np.finfo(float).eps)  # Of the spline's range


def invert_points(volume: SplineVolume, points: Floats) -> Inversion:
    """Parameters of points in a volume.

    `volume`: polynomial or rational, undeformed or deformed, folded or not. `points` (n, 3), m. The
    closed form where the control points are an affine image of the Greville abscissae; three
    inversions of one variable where they lie on parallel planes; else least squares in three
    variables. Raises ValueError if points are not finite (n, 3).
    """
    points = finite_array("points", points, (None, 3))
    frame = affine_image(volume)
    if frame is not None:
        return _closed_form(volume, frame, points)
    regular = regular_planes(volume)
    if regular is not None:
        return _axis_by_axis(volume, *regular, points)
    return invert_general(volume, points)


def affine_image(volume: SplineVolume) -> Parallelepiped | None:
    """The parallelepiped of which a volume is an undeformed lattice, or None: then it is affine."""
    if _has_unequal_weights(volume):
        return None
    places = [basis.greville() for basis in volume.bases]
    control, corner, ends = _corners(volume)
    edges = (ends - corner) / np.array([[place[-1] - place[0]] for place in places])
    frame = _parallelepiped(corner - np.array([place[0] for place in places]) @ edges, edges)
    if frame is None:
        return None
    off = float(np.abs(frame.greville_control(volume.bases) - control).max())
    return frame if off <= _allowed(control) else None


def _closed_form(volume: SplineVolume, frame: Parallelepiped, points: Floats) -> Inversion:
    parameters = frame.local(points)
    if parameters.min(initial=0.0) < 0.0 or parameters.max(initial=0.0) > 1.0:
        parameters = np.clip(parameters, 0.0, 1.0)
    left = frame.points(parameters) - points
    residual = np.sqrt(np.einsum("ni,ni->n", left, left))
    return _finish(volume, points, parameters, residual, np.zeros(len(points), np.int32))


def regular_planes(
    volume: SplineVolume,
) -> tuple[Parallelepiped, tuple[Floats, Floats, Floats]] | None:
    """The planes on which a volume's control points lie, or None if they are not regular.

    The frame from one corner to the three next to it, and where planes cut its edges, from 0 to 1.
    Each parameter depends on one coordinate alone, for the bases sum to 1 along the others.
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
    off = float(np.abs(again - control).max())
    rising = all((np.diff(plane) > 0.0).all() for plane in planes)
    return (frame, planes) if rising and off <= _allowed(control) else None


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


def _allowed(control: Floats) -> float:
    return ROUNDING * float(np.abs(control).max())


def _axis_by_axis(
    volume: SplineVolume,
    frame: Parallelepiped,
    planes: tuple[Floats, Floats, Floats],
    points: Floats,
) -> Inversion:
    axes = zip(volume.bases, planes, frame.local(points).T, strict=True)
    roots = [invert_monotone(*axis) for axis in axes]
    left = np.stack([root.residual for root in roots], axis=1) @ frame.edges
    parameters = np.stack([root.parameters for root in roots], axis=1)
    steps = np.max([root.steps for root in roots], axis=0)
    return _finish(volume, points, parameters, np.linalg.norm(left, axis=1), steps)


def invert_monotone(basis: Basis, coefficients: Floats, values: Floats) -> MonotoneRoots:
    """Parameters at which a spline with coefficients that rise takes values (n,), or its ends.

    It rises too, so that its values at the knots tell between which two a root lies. There it is
    one polynomial, of which Newton's method finds the root, by halves where a step would leave the
    bracket. A root that is found stays: the bracket's end is on it, and halving would drive it away
    again. Raises ValueError if coefficients do not rise, or a value is NaN.
    """
    coefficients = finite_array("coefficients", coefficients, (basis.count,))
    values = np.asarray(values, np.float64)
    if np.isnan(values).any():
        raise ValueError(f"values must be numbers, got {np.count_nonzero(np.isnan(values))} nan")
    if not (np.diff(coefficients) > 0.0).all():
        raise ValueError("coefficients must rise")
    breaks = basis.breaks()
    taylor = _taylor(basis, coefficients, breaks)
    heights = taylor[0]
    span = np.clip(np.searchsorted(heights, values, side="right") - 1, 0, len(breaks) - 2)
    width = np.diff(breaks)[span]
    pieces = taylor[:, span] * width ** np.arange(len(taylor))[:, None]
    rise = heights[span + 1] - heights[span]
    least = MONOTONE_ROUNDING * float(heights[-1] - heights[0])
    place = np.clip((values - heights[span]) / rise, 0.0, 1.0)
    low, high = np.zeros(len(values)), np.ones(len(values))
    steps = np.zeros(len(values), np.int32)
    for _ in range(MONOTONE_MOST_STEPS):
        value, slope = _horner(pieces, place)
        left = value - values
        going = np.abs(left) > least
        low, high = np.where(left < 0.0, place, low), np.where(left > 0.0, place, high)
        going &= high > low
        if not going.any():
            break
        with np.errstate(divide="ignore", invalid="ignore"):  # then by halves
            ahead = place - left / slope
        inside = (ahead > low) & (ahead < high)
        # Where the root lies beyond the piece's end, by rounding or because the value does.
        at_end = ((place == 0.0) & (left > 0.0)) | ((place == 1.0) & (left < 0.0))
        ahead = np.where(inside, ahead, np.where(at_end, place, 0.5 * (low + high)))
        going &= ahead != place
        place = np.where(going, ahead, place)
        steps += going
        if not going.any():
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


def _finish(
    volume: SplineVolume, points: Floats, parameters: Floats, residual: Floats, steps: Ints
) -> Inversion:
    """The answer; points outside, for which clipping need not give the nearest, anew."""
    converged = residual <= residual_tolerance(volume)
    folded = np.zeros(len(points), bool)  # neither kind of volume can fold
    outside = np.flatnonzero(~converged)
    if len(outside):
        nearest = invert_general(volume, points[outside])
        parameters[outside], residual[outside] = nearest.parameters, nearest.residual
        converged[outside], steps[outside] = nearest.converged, nearest.steps
    return Inversion(parameters, residual, converged, folded, steps)


def invert_general(volume: SplineVolume, points: Floats) -> Inversion:
    """Parameters of points (n, 3) in any volume, polynomial or rational.

    The distance is minimised by the method of Levenberg and Marquardt within the bounds of the
    parameters, from the affine guess and, where that fails, from the nearest of a grid of samples.
    Newton's method on the derivative of the distance, as in Fung, 1999, (4.12), squares the
    condition number and has roots that are no answers.
    """
    matrix = affine_fit(volume)
    guess = np.clip(points @ matrix[:3] + matrix[3], 0.0, 1.0)
    parameters, residual, steps = _from(volume, points, guess)
    failed = residual > residual_tolerance(volume)
    if failed.any():
        seeds = _near_samples(volume, points[failed])
        for number in range(seeds.shape[1]):
            rows = np.flatnonzero(failed)
            still = residual[rows] > residual_tolerance(volume)
            rows = rows[still]
            if not len(rows):
                break
            other, left, more = _from(volume, points[rows], seeds[still, number])
            steps[rows] += more
            better = left < residual[rows]
            parameters[rows[better]], residual[rows[better]] = other[better], left[better]
    folded = is_folded(volume, volume.first(parameters)[1])
    return Inversion(parameters, residual, residual <= residual_tolerance(volume), folded, steps)


def affine_fit(volume: SplineVolume) -> Floats:
    """The affine map from points to parameters that fits the control points best.

    (4, 3): points with a 1 behind, times this, are parameters.
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


def _from(volume: SplineVolume, points: Floats, starts: Floats) -> tuple[Floats, Floats, Ints]:
    """Where the iteration ends from some starts (n, 3): parameters, residuals, steps."""

    def problem(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
        reached, slopes = volume.first(parameters)
        return reached - points[rows], slopes

    ends = levenberg_marquardt(
        problem,
        starts,
        np.zeros(3),
        np.ones(3),
        steps=GENERAL_MOST_STEPS,
        enough=least_residual(volume),
    )
    return ends.parameters, np.sqrt(2.0 * ends.cost), ends.steps


def least_residual(volume: SplineVolume) -> float:
    """Residual below which nothing is to be gained, m."""
    return _of_size(volume, ENOUGH, 16)


def residual_tolerance(volume: SplineVolume) -> float:
    """Residual above which there is no answer, m."""
    return _of_size(volume, CONVERGED, 64)


def _of_size(volume: SplineVolume, share: float, roundings: int) -> float:
    points = volume.control.reshape(-1, 3)
    size = float(np.ptp(points, axis=0).max())
    return share * size + roundings * EPSILON * float(np.abs(points).max())


def _near_samples(volume: SplineVolume, points: Floats) -> Floats:
    from scipy.spatial import cKDTree

    axis = np.linspace(0.0, 1.0, START_SAMPLES)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    tree = cKDTree(volume.grid(axis, axis, axis).reshape(-1, 3))
    return grid[tree.query(points, k=STARTS)[1]]


def is_folded(volume: SplineVolume, slopes: Floats) -> Bools:
    """Where slopes (n, 3, 3) of a volume have no determinant of its own sign.

    That is the sign of the mean: a volume may run round a ring and yet fold nowhere.
    """
    own = mean_determinant(rescaled_volume(volume, volume.control[0, 0, 0], control_extent(volume)))
    largest = np.abs(slopes).max(axis=1, keepdims=True)
    s, t, u = (slopes / np.where(largest > 0.0, largest, 1.0)).transpose(2, 0, 1)
    determinant = np.einsum("ni,ni->n", np.cross(s, t), u)
    return np.asarray((determinant if own >= 0.0 else -determinant) <= LEAST_DETERMINANT)


class Inversion(NamedTuple):
    """Parameters of some points."""

    parameters: Floats  # s, t, u (n, 3), from 0 to 1; of a nearest point if nothing else was found
    residual: Floats  # Distance (n,) between the point and that of the parameters, m
    converged: Bools  # (n,): the residual is 0 but for rounding. A point outside never converges.
    folded: Bools  # (n,): turned inside out there, or flat: others may give the point too
    steps: Ints  # Steps of the iteration, (n,)


class MonotoneRoots(NamedTuple):
    """Where a spline takes given values."""

    parameters: Floats  # (n,)
    residual: Floats  # What is left there, (n,)
    steps: Ints  # Steps, (n,)
