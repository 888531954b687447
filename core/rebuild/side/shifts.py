"""A shift of each touch, estimated with the radial spline, and what it leaves in that.

A pose that is believed a tenth of a millimetre off moves a whole patch. Neighbouring patches
overlap, so that the surface and one small shift of each touch can be found in one system: least
squares with a block of correlated errors for each touch. How large shifts are believed to be is
told by themselves, and how surely by what the surface leaves of the taxels: without noise, or where
the surface does not follow edges, the one falls and the other rises until no shift is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from palpate.core.arrays import Floats, probable_error_sigma
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.side.radial import FEWEST_TAXELS, Drift, RadialSpline
from palpate.core.steps import Steps, no_steps

SWEEPS = 3  # Fits, each about the points as the shifts before have moved them
# How many taxels weigh as much as the belief that a touch is not shifted: at first, and as many
# times their squared misfit over that of the poses. By their own noise alone each would count by
# itself; but what a smooth surface leaves, neighbours share.
STRICTNESS, TOGETHER = 0.1, 8.0
# Of the height: less noise, or smaller shifts, are not looked into; nothing is smoothed for them.
WORTHWHILE = 6e-5
FEWEST_TOUCHES = 8  # Fewer tell no shifts
ITERATIONS, ENOUGH = 35, 1e-3  # Of the conjugate gradients, and the residual at which they end
STIFFER, MOST_STIFFER = 10.0, 5  # Steps of stiffness where there is noise, and their number
MOST_WHOLE = 400  # Touches whose drift is told in all directions; of more, along their normals


def fit_shifted_spline(
    contacts: ContactPoints, plain: RadialSpline, step: Steps = no_steps
) -> tuple[RadialSpline, float | None]:
    """The plain spline's contacts fitted again with a shift of each touch.

    And the poses' standard deviation along the normals, from the median shift, m; None without.
    """
    used = np.unique(plain.rows.touch, return_counts=True)[1]
    least = WORTHWHILE * (plain.high - plain.low)
    if not plain.sigma > least:
        return plain, None
    few = len(used) < FEWEST_TOUCHES or np.median(used) < FEWEST_TAXELS
    shifts = np.zeros((int(contacts.touch.max()) + 1, 3))
    spline, moved, strictness, pose = plain, contacts, STRICTNESS, 0.0
    for _ in range(0 if few else SWEEPS):
        shifts += _more_shifts(spline, shifts, strictness)
        moved = contacts._replace(points=contacts.points - shifts[contacts.touch])
        spline = plain.refitted(moved)
        by_row = shifts[spline.rows.touch]
        pose = probable_error_sigma(np.einsum("ni,ni->n", spline.rows.normals, by_row))
        if not pose > least:
            break
        strictness = TOGETHER * spline.square / pose**2
    with step("cross-validation"):
        if not pose > least:
            return stiffened(plain), None
        spline = stiffened(spline)
    return replace(spline, drift=_drift(spline, len(shifts), strictness, pose)), pose


def stiffened(spline: RadialSpline) -> RadialSpline:
    """The spline as stiff as its points ask for: at least as stiff as it is."""
    for _ in range(MOST_STIFFER):
        stiffer = spline.stiffer(STIFFER)
        if not stiffer.score < spline.score:
            break
        spline = stiffer
    return spline


def _more_shifts(spline: RadialSpline, believed: Floats, strictness: float) -> Floats:
    """Shifts (k, 3) on top of those believed, whose points have been moved back by them."""
    rows, count = spline.rows, len(believed)
    blocks = _blocks(spline, np.broadcast_to(np.eye(3), (count, 3, 3)))
    own = np.zeros((count, 3, 3))  # Each touch's block of the system
    np.add.at(own, rows.touch, rows.normals[:, :, None] * rows.normals[:, None, :])
    own += strictness * np.eye(3)
    inverse = np.linalg.inv(own)
    # What a shift does to the surface's equations, summed over its taxels once.
    told = scipy.sparse.csr_array(blocks.T @ rows.matrix)
    told_by = scipy.sparse.csr_array(told.T)

    def system(shifts: Floats) -> Floats:
        smooth = told @ spline.system.solve(told_by @ shifts.ravel())
        return np.asarray(np.einsum("kij,kj->ki", own, shifts) - smooth.reshape(-1, 3))

    right = (blocks.T @ spline.misfits).reshape(-1, 3) - strictness * believed
    found = np.zeros_like(right)
    rest = right
    ahead = direction = np.einsum("kij,kj->ki", inverse, rest)
    size = start = float(np.vdot(rest, ahead))
    for _ in range(ITERATIONS):
        if not size > ENOUGH**2 * start:
            break
        image = system(direction)
        step = size / float(np.vdot(direction, image))
        found, rest = found + step * direction, rest - step * image
        ahead = np.einsum("kij,kj->ki", inverse, rest)
        size, before = float(np.vdot(rest, ahead)), size
        direction = ahead + size / before * direction
    return found


def _blocks(spline: RadialSpline, directions: Floats) -> scipy.sparse.csr_array:
    """From shifts (k d,) along directions (k, d, 3) of the touches to distances along normals."""
    rows, (count, each) = spline.rows, directions.shape[:2]
    along = np.einsum("ndi,ni->nd", directions[rows.touch], rows.normals)
    columns = (each * rows.touch[:, None] + np.arange(each)).ravel()
    pointers = each * np.arange(len(rows.touch) + 1)
    return scipy.sparse.csr_array(
        (along.ravel(), columns, pointers), shape=(len(along), each * count)
    )


def _drift(spline: RadialSpline, count: int, strictness: float, pose: float) -> Drift:
    """Of the shifts of so many touches, of a deviation in m, by the Schur complement."""
    rows = spline.rows
    directions = np.broadcast_to(np.eye(3), (count, 3, 3))
    if count > MOST_WHOLE:
        means = np.zeros((count, 3))
        np.add.at(means, rows.touch, rows.normals)
        length = np.linalg.norm(means, axis=1, keepdims=True)
        directions = (means / np.maximum(length, np.finfo(float).tiny))[:, None]
    blocks = _blocks(spline, directions)
    along = spline.system.half((blocks.T @ rows.matrix).toarray())
    own = (blocks.T @ blocks).toarray() + strictness * np.eye(blocks.shape[1])
    factor = scipy.linalg.cholesky(own - along @ along.T, lower=True, check_finite=False)
    return Drift(float(np.sqrt(strictness)) * pose, along, np.asarray(factor))
