"""Where a pad touches: where its face is pressed, not wherever it has moved.

An elastic face is drawn down beside a contact, so that a taxel reads compression although
nothing touches it. Which load makes a face take the felt shape is a linear question, with a
local or a well-conditioned answer; where there is no load there is no contact.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.love import displacements
from palpate.core.touch.pad import SPRINGS, Pad

SPREADS = 5.0
"""A taxel counts as touched from 5 standard deviations of its noise on: at 3, one in a
thousand untouched ones would put a point where there is no surface."""
KEPT_OPERATORS = 4
"""Of large arrays each takes up to 134 MB."""


def touched(pad: Pad, compression: Floats, contact: float, noise: float) -> Bools:
    """Taxels under load, (rows, cols).

    Parameters
    ----------
    pad : Pad
        With what its data sheet says of its face.
    compression : (rows, cols) array
        m.
    contact : float
        Least compression that counts, m; also as the load of a pad that is pressed evenly.
    noise : float
        Standard deviation of one taxel, m.

    Notes
    -----
    On a bed of springs load and compression are one. A membrane on springs is loaded with
    ``u - decay^2 lap(u)``, taken at the pitch with free borders. On a half-space the load is
    the inverse of Love's displacements; those of a 16 by 16 array have a condition of 27. A
    contact that runs off the array presses from outside as well, and adds load at the border,
    where it is a contact anyway. Noise counts as the operator magnifies it: a skin that is
    stiff over many taxels needs a quiet array.
    """
    moved = compression > max(contact, SPREADS * noise)
    if pad.face.kind == "springs" or not moved.any():
        return moved
    if pad.face.kind == "membrane":
        share = (pad.face.decay / pad.pitch) ** 2
        load = compression - share * _laplacian(compression)
        even, magnified = 1.0, math.hypot(1.0 + 4.0 * share, 2.0 * share)
    else:
        operator, even, magnified = _half_space_loads(replace(pad, face=SPRINGS))
        load = (operator @ compression.ravel()).reshape(compression.shape)
    result: Bools = moved & (load > max(contact * even, SPREADS * noise * magnified))
    return result


@lru_cache(maxsize=KEPT_OPERATORS)
def _half_space_loads(pad: Pad) -> tuple[Floats, float, float]:
    """Operator from the face's shape to its load, (n, n), and what it does to extremes.

    These are the least load of an even shape, and the factor by which noise is magnified.
    """
    kernel = displacements(pad)
    loads = np.linalg.inv(kernel / kernel[0, 0])
    loads.setflags(write=False)
    return loads, float(loads.sum(axis=1).min()), float(np.sqrt((loads**2).sum(axis=1)).max())


def _laplacian(image: Floats) -> Floats:
    """Sum of the four neighbours' differences; level at the borders."""
    result = np.zeros_like(image)
    down, across = np.diff(image, axis=0), np.diff(image, axis=1)
    result[:-1] += down
    result[1:] -= down
    result[:, :-1] += across
    result[:, 1:] -= across
    return result
