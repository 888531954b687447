"""Where a pad touches: where its face is pressed, not wherever it has moved.

An elastic face is drawn down beside a contact, so that a taxel reads compression although
nothing touches it. Which load makes a face take the felt shape is a linear question, with a
local or a well-conditioned answer; where there is no load there is no contact.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.love import displacements
from palpate.core.touch.pad import Pad


def touched(pad: Pad, compression: Floats, least: float) -> Bools:
    """Taxels under load, (rows, cols).

    Parameters
    ----------
    pad : Pad
        With what its data sheet says of its face.
    compression : (rows, cols) array
        m.
    least : float
        What counts: compression from here on, m, under a load that would press a lone taxel
        as deep, with noise in proportion.

    Notes
    -----
    On a bed of springs load and compression are one. A membrane on springs is loaded with
    ``u - decay^2 lap(u)``, taken at the pitch with free borders. On a half-space the load is
    the inverse of Love's displacements; those of a 16 by 16 array have a condition of 27. A
    contact that runs off the array presses from outside as well, and adds load at the border,
    where it is a contact anyway.
    """
    moved = compression > least
    if pad.face.kind == "springs" or not moved.any():
        return moved
    loads, noise = _loads(pad)
    load = (loads @ compression.ravel()).reshape(compression.shape)
    result: Bools = moved & (load > least * noise)
    return result


@cache
def _loads(pad: Pad) -> tuple[Floats, float]:
    """Operator from the face's shape to its load, (n, n), and how it magnifies noise."""
    if pad.face.kind == "membrane":
        loads = np.eye(pad.rows * pad.cols) - pad.face.decay**2 * _laplacian(pad)
    else:
        kernel = displacements(pad)
        loads = np.linalg.inv(kernel / kernel[0, 0])
    return loads, float(np.sqrt((loads**2).sum(axis=1)).max())


def _laplacian(pad: Pad) -> Floats:
    """Five-point Laplacian over the taxels, (n, n), 1/m2; level at the borders."""
    along_rows = np.kron(np.eye(pad.rows), _second_difference(pad.cols))
    along_columns = np.kron(_second_difference(pad.rows), np.eye(pad.cols))
    result: Floats = (along_rows + along_columns) / pad.pitch**2
    return result


def _second_difference(count: int) -> Floats:
    matrix: Floats = np.eye(count, k=1) + np.eye(count, k=-1) - 2.0 * np.eye(count)
    matrix[0, 0] = matrix[-1, -1] = -1.0
    return matrix
