"""Steps between contours that follow their lobes and corners as these turn with the height.

The least twist of a nearly round contour follows nothing: the circle in it outweighs its lobes.
Its signature, the distance from the middle along the contour, knows only the lobes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.rebuild.correspondence.circular_peak import circular_peak

REACH = 0.17
"""Turns on either side of the least twist within which lobes are sought."""
LEAST_RELIEF = 0.02
"""Standard deviation of a signature, over the mean distance, below which there is nothing in it."""
LEAST_ALIKE = 0.5
"""Correlation of two signatures below which they are not of one shape."""
CHANGE = 15.0
"""What a change of the step, squared, in turns, from one pair to the next costs, in correlation."""
TWIST = 1.5
"""What a departure from the least twist, squared, in turns, costs."""


def follow_signatures(shapes: Floats, steps: Floats) -> Floats:
    """Steps (M - 1,), in turns, under which the signatures of neighbours agree.

    Parameters
    ----------
    shapes : (M, n, 2) array
        Closed curves, each about its own middle, at even steps of the turn, m.
    steps : (M - 1,) array
        Those of the least twist.

    Notes
    -----
    Lobes look alike: any one step could as well be a lobe further. So all are chosen together,
    for the largest sum of correlations less what changes of the twist cost (dynamic
    programming: Bellman, 1957).
    """
    if not len(steps):
        return steps
    distance = np.linalg.norm(shapes, axis=2)
    mean = distance.mean(axis=1)
    relief = distance - mean[:, None]
    lengths = np.linalg.norm(relief, axis=1)
    count = shapes.shape[1]
    waves = np.fft.fft(relief, axis=1)
    turned = np.exp(2j * np.pi * np.fft.fftfreq(count, 1.0 / count) * steps[:, None])
    products = lengths[:-1] * lengths[1:]
    scale = np.where(products > 0.0, products, 1.0)
    alike = np.fft.ifft(np.conj(waves[:-1]) * waves[1:] * turned, axis=1).real / scale[:, None]
    reach = int(REACH * count)
    shifts = np.arange(-reach, reach + 1)
    near = alike[:, shifts % count]
    lobed = lengths > LEAST_RELIEF * mean * np.sqrt(count)
    tells = lobed[:-1] & lobed[1:] & (near.max(axis=1) > LEAST_ALIKE)
    best = _best_path(np.where(tells[:, None], near, 0.0), shifts / count)
    return steps + np.where(tells, circular_peak(alike, shifts[best]), shifts[best] / count)


def _best_path(gain: Floats, shifts: Floats) -> NDArray[np.intp]:
    """Which shift (k,) each pair (m,) takes, given what each gains (m, k)."""
    change = CHANGE * (shifts[:, None] - shifts) ** 2
    gain = gain - TWIST * shifts**2
    total = gain[0]
    back = np.zeros(gain.shape, np.intp)
    for pair in range(1, len(gain)):
        reached = total - change
        back[pair] = reached.argmax(axis=1)
        total = gain[pair] + reached.max(axis=1)
    path = np.zeros(len(gain), np.intp)
    path[-1] = total.argmax()
    for pair in range(len(gain) - 1, 0, -1):
        path[pair - 1] = back[pair, path[pair]]
    return path
