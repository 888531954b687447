"""Whether points were felt at even steps around a contour, as far as their noise lets one see."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.curve_noise import LEAST_POINTS
from palpate.core.splines.curve_parameters import EVEN_GAP, EVEN_MIDDLE, curve_parameters

ISOTROPIC = 1.6
"""Noise leaves a point off its neighbours' course along it as far as across it; points at
uneven steps lie off along it alone. So many times farther is more than chance."""
CLEAR = 8.0
"""Chords so many times longer than the noise tell how even the steps are."""
WIDEST = 6
"""Of the points, one in so many is the longest such chord: a sixth of a turn."""
GAIN = float(np.sqrt(1.0 + 34.0 / 36.0))
"""Deviation of a point from the cubic through two neighbours on either side, of its noise."""
MEDIAN = 0.6745
"""Median size of an error of deviation 1."""


def slice_parameters(points: Floats) -> Floats:
    """Parameters (m,) of points (m, 2) around a closed curve, in turns; the first is 0.

    Even steps where the points were felt at even distances, else in proportion to the chords.
    Of points that are hardly farther apart than their noise, chords tell the noise: there
    only chords over several steps are compared.
    """
    parameters = curve_parameters(points, "even")
    count = len(points)
    even = np.arange(count) / count
    if count < LEAST_POINTS or same_steps(parameters) or not _noisy_even(points):
        return parameters
    return even


def _noisy_even(points: Floats) -> bool:
    """Whether noise is all that makes the steps of points (m, 2) uneven."""
    count = len(points)
    one, two = (np.roll(points, n, 0) + np.roll(points, -n, 0) for n in (1, 2))
    off = points - (4.0 * one - two) / 6.0
    ahead = np.roll(points, -2, 0) - np.roll(points, 2, 0)
    length = np.linalg.norm(ahead, axis=1)
    ahead = ahead / np.where(length > 0.0, length, 1.0)[:, None]
    along = float(np.median(np.abs((off * ahead).sum(axis=1))))
    across = float(np.median(np.abs(off[:, 0] * ahead[:, 1] - off[:, 1] * ahead[:, 0])))
    if not 0.0 < along <= ISOTROPIC * across:
        return False
    noise = across / MEDIAN / GAIN
    step = float(np.median(length)) / 4.0
    reach = int(np.clip(np.ceil(CLEAR * noise / max(step, noise)), 3, max(count // WIDEST, 3)))
    chords = np.linalg.norm(np.roll(points, -reach, 0) - points, axis=1)
    tenth, quarter, most = np.quantile(chords, [0.1, 0.25, 0.75])
    return bool(chords.max() <= EVEN_GAP * tenth and most <= EVEN_MIDDLE * quarter)


def same_steps(parameters: Floats) -> bool:
    """Whether parameters (m,) are at even steps."""
    return bool(np.array_equal(parameters, np.arange(len(parameters)) / len(parameters)))
