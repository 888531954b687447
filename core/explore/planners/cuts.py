"""Where one slice more is worth most: the interval, and the place in it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.explore.planners.choice import first_and_last
from palpate.core.explore.planners.cover import Run, free_height, longest_unfelt
from palpate.core.explore.planners.foretold import Foretold
from palpate.core.explore.planners.known import Known

PULLED = 0.35
"""A cut moves by up to this share of a part, towards the end that bends more."""
AMPLE = 1.3
"""Cuts are planned for an error by so much below the tolerance."""
NEAR = 1e-6
"""Values that differ by less of themselves are alike; then the shorter way counts."""
MOST_CUTS = 64
"""Slices that are planned ahead."""


class Costs(NamedTuple):
    """What is weighed; as in `palpate.core.explore.planners.predicted.Predicted`."""

    suspicion: float
    """Error that an unfelt stretch may hide, by the square of its share of the height."""
    order: float
    """Of the error, in the number of parts."""
    travel: float
    """Cost of moving by the whole height, over that of a slice."""


def best_cut(
    known: Known, shares: Floats, foretold: Foretold, runs: Sequence[Run], costs: Costs
) -> float | None:
    """The height at which one slice more is worth most.

    Parameters
    ----------
    known : Known
        What is known.
    shares : (m,) array
        Heights of its usable slices, as shares of the extent, from the bottom up.
    foretold : Foretold
        Errors between them.
    runs : sequence of Run
        What is unfelt.
    costs : Costs
        What is weighed.

    Returns
    -------
    float or None
        m; None where there is no room.
    """
    heights = (known.low + known.extent * shares).tolist()
    pairs = list(pairwise(heights))
    variances = _variances(known, pairs, foretold, runs, costs.suspicion)
    parts = parts_needed(variances, known.tolerance / known.extent / AMPLE, costs.order)
    last = known.slices[-1].height
    bottom, top = first_and_last(known)
    offers = []
    for i, (low, high) in enumerate(pairs):
        if any(low < taken < high for taken in known.taken):
            continue  # another finger cuts it at this moment
        share = _place(int(parts[i]), float(foretold.signs.pull[i]))
        inside = Run(max(low, bottom), min(high, top))  # a slice may lie beyond an end that moved
        wanted = min(max(low + (high - low) * share, inside.low), inside.high)
        height = free_height(known, wanted, inside)
        if height is not None:
            away = abs(height - last) / known.extent
            offers.append((float(variances[i]) / (1.0 + costs.travel * away), away, height))
    if not offers:
        return None
    most = max(value for value, _, _ in offers)
    alike = [offer for offer in offers if offer[0] >= most * (1.0 - NEAR)]
    return min(alike, key=lambda offer: (round(offer[1] / NEAR), -offer[2]))[2]


def parts_needed(variances: Floats, target: float, order: float) -> Ints:
    """Into how many parts each interval must be cut, with the fewest cuts in all.

    Parameters
    ----------
    variances : (m,) array
        Squared errors of the intervals, by their shares of the area.
    target : float
        Root mean square error of the whole that is wanted.
    order : float
        An interval in n parts errs by n to this power less.
    """
    parts = np.ones(len(variances), dtype=np.int32)
    for _ in range(MOST_CUTS):
        now = variances * parts ** (-2.0 * order)
        if now.sum() <= target**2:
            break
        gain = now - variances * (parts + 1.0) ** (-2.0 * order)
        parts[int(np.argmax(gain >= gain.max() * (1.0 - NEAR)))] += 1
    return parts


def _variances(
    known: Known,
    pairs: Sequence[tuple[float, float]],
    foretold: Foretold,
    runs: Sequence[Run],
    suspicion: float,
) -> Floats:
    """Squared errors of the intervals by their shares of the area, with what may be hidden."""
    hidden = np.array([longest_unfelt(runs, *pair) for pair in pairs]) / known.extent
    found: Floats = foretold.shares * (foretold.errors**2 + (suspicion * hidden**2) ** 2)
    return found


def _place(parts: int, pull: float) -> float:
    """Where to cut an interval that needs so many parts: at their border nearest to its middle."""
    count = max(parts, 2)
    border = count // 2 if pull < 0.5 - NEAR else count - count // 2
    return (border + PULLED * (2.0 * pull - 1.0)) / count
