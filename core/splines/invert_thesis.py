"""Point inversion as Fung, 1999, section 4.2.2, does it: for comparison only.

Newton's method on the equations that the point's offset is at right angles to all three
slopes (4.8). They have roots that are no answers, and their condition is that of the slopes,
squared: `invert_general` solves the same problem without either.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.splines.inversion import Inversion, enough, is_folded
from palpate.core.splines.placement import affine_fit
from palpate.core.splines.volume import Volume

MOST_STEPS = 50
COINCIDENCE = 1e-6
"""Of the volume's size, where the thesis has metres or whatever the unit is: (4.14), (4.16)."""
ZERO_COSINE = 1e-6
"""(4.15)."""


def invert_thesis(volume: Volume, points: Floats) -> Inversion:
    """Parameters of points (n, 3) by (4.8) to (4.16), all points side by side.

    The iteration begins at the affine guess. It stops at the first of coincidence, zero cosine
    and insignificant change; the text asks for the first two together in one sentence and for
    any of the three in the next. A singular matrix of (4.9) ends the iteration without an
    answer.
    """
    matrix = affine_fit(volume)
    size = float(np.ptp(volume.control.reshape(-1, 3), axis=0).max())
    close = max(COINCIDENCE * size, enough(volume))
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
    stands: Bools = (distance <= close) | square.all(axis=1)
    return stands


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
