"""The error that all taxels of a touch share, estimated together with the surface.

A pose that is believed a tenth of a millimetre off moves a whole patch. Neighbouring patches
overlap, so that the surface and one small shift of each touch can be found in one system: least
squares with a block of correlated errors for each touch. Sharp edges look like shifts to a smooth
surface; so the shifts are only believed if they explain most of what the surface alone leaves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.felt_skin import MEDIAN, FeltSkin, calmed, fit_skin

SWEEPS = 2
"""Fits, each about the points as the shifts before have moved them."""
STRICTNESS = 0.3
"""How many taxels weigh as much as the belief that a touch is not shifted. The taxels' own noise
over the poses' would be a hundredth; but a smooth surface errs by more than the taxels do."""
EXPLAINED = 0.7
"""Of the median misfit: shifts are believed if they leave no more of it."""
WORTHWHILE = 1e-4
"""Of the height: what is less noise is neither looked into nor smoothed. Edges leave half as much
without any noise, and shifts ten times as large seem to explain it."""
FEWEST_TOUCHES, FEWEST_TAXELS = 8, 12
"""With fewer touches, or fewer taxels in half of them, shifts cannot be told from the surface."""
ITERATIONS, ENOUGH = 60, 1e-6
"""Of the conjugate gradients, and the residual at which they end."""


class Shifted(NamedTuple):
    """A skin, and by how much each touch was shifted."""

    skin: FeltSkin
    """The better one of both."""
    shifts: Floats | None
    """(touches, 3), m; None if they were not believed."""


def fit_shifted_skin(felt: FeltPoints, plain: FeltSkin) -> Shifted:
    """Fit the skin once more, with a shift of each touch, if that explains its misfits.

    Parameters
    ----------
    felt : FeltPoints
        What the plain skin was fitted to; with normals.
    plain : FeltSkin
        The skin without shifts.
    """
    used = np.bincount(plain.rows.touch)
    used = used[used > 0]
    before = plain.sigma
    if not before > WORTHWHILE * (plain.high - plain.low):
        return Shifted(plain, None)
    if len(used) < FEWEST_TOUCHES or np.median(used) < FEWEST_TAXELS:
        return Shifted(calmed(felt, plain), None)
    shifts = np.zeros((int(felt.touch.max()) + 1, 3))
    skin = plain
    for _ in range(SWEEPS):
        shifts += _more_shifts(skin, shifts)
        moved = felt._replace(points=felt.points - shifts[felt.touch])
        skin = fit_skin(moved, plain.spine, plain.low, plain.high)
    if skin.sigma < EXPLAINED * before:
        return Shifted(calmed(moved, skin), shifts)
    return Shifted(calmed(felt, plain), None)


def pose_sigma(shifted: Shifted) -> float | None:
    """Standard deviation of a pose along the normals, from the median shift, m."""
    if shifted.shifts is None:
        return None
    return _along_normals(shifted.skin, shifted.shifts)


def _along_normals(skin: FeltSkin, shifts: Floats) -> float:
    """Standard deviation of shifts (k, 3) along the normals, from their median, m."""
    along = np.einsum("ni,ni->n", skin.rows.normals, shifts[skin.rows.touch])
    return float(np.median(np.abs(along))) / MEDIAN


def _more_shifts(skin: FeltSkin, believed: Floats) -> Floats:
    """Shifts (k, 3) on top of those believed, whose points have been moved back by them.

    The surface is eliminated: what remains is a system of the shifts, solved by conjugate
    gradients with each touch's own block as preconditioner.
    """
    rows, count = skin.rows, len(believed)
    blocks = _blocks(rows.normals, rows.touch, count)
    own = _own(rows.normals, rows.touch, count)
    inverse = np.linalg.inv(own)

    def system(shifts: Floats) -> Floats:
        moved = blocks @ shifts.ravel()
        smooth = rows.matrix @ skin.system.solve(rows.matrix.T @ moved)
        found: Floats = (blocks.T @ (moved - smooth)).reshape(-1, 3) + STRICTNESS * shifts
        return found

    right = (blocks.T @ skin.misfits()).reshape(-1, 3) - STRICTNESS * believed
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


def _blocks(normals: Floats, touch: Ints, count: int) -> csr_array:
    """From shifts (3 count,) to distances along the normals (n,)."""
    n = len(normals)
    columns = (3 * touch[:, None] + np.arange(3)).ravel()
    return csr_array((normals.ravel(), columns, 3 * np.arange(n + 1)), shape=(n, 3 * count))


def _own(normals: Floats, touch: Ints, count: int) -> Floats:
    """Each touch's block of the system, (count, 3, 3)."""
    own = np.zeros((count, 3, 3))
    np.add.at(own, touch, normals[:, :, None] * normals[:, None, :])
    return own + STRICTNESS * np.eye(3)
