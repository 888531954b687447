"""Shifts of touches by the errors of their poses, which are found together with the side.

A pose that is off by a tenth of a millimetre moves a whole patch. Neighbouring patches overlap, so
the surface and one small shift of each touch are found in one system: least squares with a block of
correlated errors for each touch. The prior size of shifts follows from the shifts themselves, and
its weight from the residuals of the taxels: without noise, or where the surface does not follow
edges, the size falls and the weight rises until no shift is left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from palpate.core.arrays import Floats, probable_error_sigma
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.side.radial import Drift, RadialSpline
from palpate.core.steps import Steps, no_steps


@dataclass(frozen=True, slots=True, kw_only=True)
class ShiftSettings:
    """How shifts of touches are found with the side; tuned on the shipped scenes."""

    n_sweeps: int = 3  # fits, each to points moved back by the last shifts
    # Weight of the prior that a touch is not shifted, in taxels: larger, smaller shifts. After the
    # first sweep it is `n_correlated`, the number of neighbouring taxels with the same error, times
    # their squared residual over the squared pose error.
    first_weight: float = 0.1
    n_correlated: float = 8.0
    min_error: float = 6e-5  # fraction of the height; less noise and smaller shifts are ignored
    min_touches: int = 8  # with fewer, shifts are not determined
    max_iterations: int = 35  # of the conjugate gradients
    tolerance: float = 1e-3  # of their residual over the first one, at which they stop
    stiffening: float = 10.0  # ratio of one stiffness that is tried to the next
    max_stiffenings: int = 5  # largest number of times that it is made stiffer
    max_whole_drift: int = 400  # touches; with more, drift is along their mean normals only


def fit_shifted_spline(
    contacts: ContactPoints,
    plain: RadialSpline,
    step: Steps = no_steps,
    settings: ShiftSettings = ShiftSettings(),
) -> tuple[RadialSpline, float | None]:
    """Fit the contacts of the plain spline again, with a shift of each touch.

    Returns the spline, and the standard deviation of the poses along the normals [m], from the
    median shift; None if shifts are too small or not determined. `step` is as of `reconstruct`.
    """
    counts = np.unique(plain.rows.touch, return_counts=True)[1]
    least = settings.min_error * (plain.high - plain.low)
    if not plain.sigma > least:
        return plain, None
    is_few = len(counts) < settings.min_touches or np.median(counts) < plain.settings.min_taxels
    shifts = np.zeros((int(contacts.touch.max()) + 1, 3))
    spline, weight, pose = plain, settings.first_weight, 0.0
    for _ in range(0 if is_few else settings.n_sweeps):
        shifts += _shift_corrections(spline, shifts, weight, settings)
        spline = plain.refitted(contacts._replace(points=contacts.points - shifts[contacts.touch]))
        by_row = shifts[spline.rows.touch]
        pose = probable_error_sigma(np.einsum("ni,ni->n", spline.rows.normals, by_row))
        if not pose > least:
            break
        weight = settings.n_correlated * spline.mean_square / pose**2
    with step("cross-validation"):
        if not pose > least:
            return stiffened(plain, settings), None
        spline = stiffened(spline, settings)
    drift = _drift(spline, len(shifts), weight, pose, settings.max_whole_drift)
    return replace(spline, drift=drift), pose


def stiffened(spline: RadialSpline, settings: ShiftSettings) -> RadialSpline:
    """The spline, made stiffer step by step as long as its score improves."""
    for _ in range(settings.max_stiffenings):
        stiffer = spline.stiffer(settings.stiffening)
        if not stiffer.score < spline.score:
            break
        spline = stiffer
    return spline


def _shift_corrections(
    spline: RadialSpline, shifts: Floats, weight: float, settings: ShiftSettings
) -> Floats:
    """Corrections (k, 3) of the shifts by which the spline's points were moved back.

    `weight` is that of the prior of no shift. By preconditioned conjugate gradients.
    """
    rows, count = spline.rows, len(shifts)
    blocks = _blocks(spline, np.broadcast_to(np.eye(3), (count, 3, 3)))
    own = np.zeros((count, 3, 3))  # block of each touch in the system
    np.add.at(own, rows.touch, rows.normals[:, :, None] * rows.normals[:, None, :])
    own += weight * np.eye(3)
    inverse = np.linalg.inv(own)
    # From the coefficients to the shifts' equations, summed over the taxels once.
    coupling = scipy.sparse.csr_array(blocks.T @ rows.matrix)
    transposed = scipy.sparse.csr_array(coupling.T)

    def system(direction: Floats) -> Floats:
        smooth = coupling @ spline.system.solve(transposed @ direction.ravel())
        return np.asarray(np.einsum("kij,kj->ki", own, direction) - smooth.reshape(-1, 3))

    rest = (blocks.T @ spline.misfits).reshape(-1, 3) - weight * shifts
    solution = np.zeros_like(rest)
    ahead = direction = np.einsum("kij,kj->ki", inverse, rest)
    size = start = float(np.vdot(rest, ahead))
    for _ in range(settings.max_iterations):
        if not size > settings.tolerance**2 * start:
            break
        image = system(direction)
        step = size / float(np.vdot(direction, image))
        solution, rest = solution + step * direction, rest - step * image
        ahead = np.einsum("kij,kj->ki", inverse, rest)
        size, before = float(np.vdot(rest, ahead)), size
        direction = ahead + size / before * direction
    return solution


def _blocks(spline: RadialSpline, directions: Floats) -> scipy.sparse.csr_array:
    """Matrix from shifts (k d,) along directions (k, d, 3) to distances along normals."""
    rows, (count, n) = spline.rows, directions.shape[:2]
    along = np.einsum("ndi,ni->nd", directions[rows.touch], rows.normals)
    columns = (n * rows.touch[:, None] + np.arange(n)).ravel()
    pointers = n * np.arange(len(rows.touch) + 1)
    return scipy.sparse.csr_array((along.ravel(), columns, pointers), shape=(len(along), n * count))


def _drift(spline: RadialSpline, count: int, weight: float, pose: float, max_whole: int) -> Drift:
    """Drift by shifts of `count` touches of standard deviation `pose` [m], by Schur complement."""
    rows = spline.rows
    directions = np.broadcast_to(np.eye(3), (count, 3, 3))
    if count > max_whole:
        means = np.zeros((count, 3))
        np.add.at(means, rows.touch, rows.normals)
        length = np.linalg.norm(means, axis=1, keepdims=True)
        directions = (means / np.maximum(length, np.finfo(float).tiny))[:, None]
    blocks = _blocks(spline, directions)
    along = spline.system.half((blocks.T @ rows.matrix).toarray())
    own = (blocks.T @ blocks).toarray() + weight * np.eye(blocks.shape[1])
    factor = scipy.linalg.cholesky(own - along @ along.T, lower=True, check_finite=False)
    return Drift(float(np.sqrt(weight)) * pose, along, np.asarray(factor))
