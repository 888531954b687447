"""Closed curves and point inversion as Fung, 1999, has them, for comparison.

Curves, 4.4.2, have clamped knots and pseudo-vertices. Their equations contradict each other: on
clamped knots a curve whose first vertices come again as its last ones, and whose derivatives agree
where it closes, has its first three vertices in one point. So it never closes, and moving the
parameters does not help. Inversion, 4.2.2, is Newton's method on the derivative of the distance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, finite_array
from palpate.core.splines import (
    Basis,
    ClosedCurve,
    CurveFit,
    Inversion,
    SplineVolume,
    affine_fit,
    clamped_basis,
    closed_curve_of,
    curve_parameters,
    is_folded,
    least_residual,
    local_noise,
    order_closed_points,
)

VERTICES = 16  # Around a layer of 5 by 5
PSEUDO = 3  # Pseudo-vertices of a cubic
ENOUGH = 0.02  # Distance of the pseudo-vertices that is let pass, as a share of the mean diameter
MOST_PASSES = 300
DAMPING = 0.5  # Of the parameters' steps; it stands in the thesis's program, not in (4.40)
CUTOFF = 1e-10  # Of the pseudo-inverse
TINY = 1e-300
MOST_STEPS = 50
COINCIDENCE = 1e-6  # Of the volume's size, where (4.14), (4.16) have metres
ZERO_COSINE = 1e-6  # (4.15)


def fit_closed_curve_thesis(points: ArrayLike, count: int = VERTICES) -> ClosedCurve:
    """Closed cubic of `count` vertices, at least 4, near points (m, 2) or (m, 3), m.

    The points are put in order, and their parameters set, as by `fit_closed_curve`. Raises
    ValueError if they have another shape or fewer than 2 are different.
    """
    ring = order_closed_points(np.asarray(points, np.float64))
    if len(ring.points) < 2:
        raise ValueError(f"points must lie in at least 2 places, got {len(ring.points)}")
    turns = curve_parameters(ring.points, "auto")
    fit = fit_closed_thesis(ring.points, turns, count)
    return closed_curve_of(ring, fit, local_noise(ring.points, turns))


def fit_closed_thesis(points: Floats, parameters: Floats, count: int) -> CurveFit:
    """Cubic by (4.27) to (4.40), of `count` vertices, at least 4; see the module.

    `points` (m, d): around the curve; the first is used once more at the end. `parameters` (m,): of
    the points, increasing from 0, in turns. `count`: vertices, without the pseudo-vertices.
    """
    basis = clamped_basis(count + PSEUDO)
    closed = np.vstack([points, points[:1]])
    parameters = np.append(parameters, 1.0)
    enough = ENOUGH * float(np.ptp(points, axis=0).mean())
    wanted = np.vstack([closed, np.zeros((PSEUDO + 2, points.shape[1]))])
    for _ in range(MOST_PASSES):
        seen = basis.matrix(parameters).toarray()
        system = np.vstack([seen, _closing_rows(basis, count, parameters[[0, -1]])])
        vertices = np.linalg.pinv(system, rcond=CUTOFF) @ wanted
        open_by = float(np.linalg.norm(vertices[:PSEUDO] - vertices[count:]))
        if open_by < enough:
            break
        around = np.vstack([vertices[:count], vertices[:PSEUDO]])
        slopes = basis.matrix(parameters, 1) @ around
        step = ((closed - seen @ around) * slopes).sum(axis=1)
        step /= np.maximum((slopes * slopes).sum(axis=1), TINY)
        parameters = np.maximum.accumulate(np.clip(parameters + DAMPING * step, 0.0, 1.0))
    return CurveFit(
        control=vertices[:count],
        knots=basis.knots,
        parameters=parameters[:-1],
        condition=float(np.linalg.cond(system)),
        effective=float(count),
        smoothing=0.0,
    )


def _closing_rows(basis: Basis, count: int, ends: Floats) -> Floats:
    """Rows (5, count + 3) of (4.37): equal vertices, equal derivatives where the curve closes."""
    same = np.eye(PSEUDO, basis.count) - np.eye(PSEUDO, basis.count, count)
    first, second = (basis.matrix(ends, order).toarray() for order in (1, 2))
    return np.vstack([same, first[0] - first[1], second[0] - second[1]])


def invert_thesis(volume: SplineVolume, points: Floats) -> Inversion:
    """Parameters of points (n, 3) by (4.8) to (4.16), all points side by side.

    The iteration begins at the affine guess. It stops at the first of coincidence, zero cosine and
    insignificant change; the text asks for the first two together in one sentence and for any of
    the three in the next. A singular matrix of (4.9) ends the iteration without an answer.
    """
    points = finite_array("points", points, (None, 3))
    matrix = affine_fit(volume)
    size = float(np.ptp(volume.control.reshape(-1, 3), axis=0).max())
    close = max(COINCIDENCE * size, least_residual(volume))
    parameters = np.clip(points @ matrix[:3] + matrix[3], 0.0, 1.0)
    steps = np.zeros(len(points), np.int32)
    going = np.arange(len(points))
    for _ in range(MOST_STEPS):
        reached, slopes, bends = volume.second(parameters[going])
        offset = reached - points[going]
        still = ~_stands(slopes, offset, close)
        going, slopes, bends, offset = going[still], slopes[still], bends[still], offset[still]
        if not len(going):
            break
        change, regular = _newton_step(slopes, bends, offset)
        moved = np.clip(parameters[going] + change, 0.0, 1.0)
        steps[going] += 1
        moves = np.linalg.norm((slopes @ change[:, :, None])[:, :, 0], axis=1) > close
        parameters[going[regular]] = moved[regular]
        going = going[regular & moves]
    reached, slopes = volume.first(parameters)
    residual = np.linalg.norm(reached - points, axis=1)
    folded = is_folded(volume, slopes)
    return Inversion(parameters, residual, residual <= close, folded, steps)


def _stands(slopes: Floats, offset: Floats, close: float) -> Bools:
    """Point coincidence (4.14), or zero cosine (4.15) multiplied out: it is 0/0 at the answer."""
    distance = np.linalg.norm(offset, axis=1)
    product = np.abs(np.einsum("nij,ni->nj", slopes, offset))
    lengths = np.linalg.norm(slopes, axis=1)
    square = product <= ZERO_COSINE * lengths * distance[:, None]
    return np.asarray((distance <= close) | square.all(axis=1))


def _newton_step(slopes: Floats, bends: Floats, offset: Floats) -> tuple[Floats, Bools]:
    """Solution (n, 3) of (4.12), and where its matrix (4.9) was regular."""
    matrix = slopes.transpose(0, 2, 1) @ slopes + np.einsum("ni,nijk->njk", offset, bends)
    right = -np.einsum("nij,ni->nj", slopes, offset)
    size = np.abs(matrix).max(axis=(1, 2))
    scaled = matrix / np.where(size > 0.0, size, 1.0)[:, None, None]
    regular = np.abs(np.linalg.det(scaled)) > np.finfo(float).eps
    scaled[~regular] = np.eye(3)
    change = np.linalg.solve(scaled, right[:, :, None])[:, :, 0]
    return change / np.where(size > 0.0, size, 1.0)[:, None], regular
