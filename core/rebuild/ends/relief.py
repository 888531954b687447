"""How an end rises and falls over its profile: a height field from all taxels that lie on it.

The face of an object bulges, or is hollow, where its profile has a level disc. A polynomial over
the place is fitted together with a shift of each touch. How large it is believed to be is told by
the likelihood of what was touched, in which the polynomial itself has no say (empirical Bayes;
Wahba, *A comparison of GCV and GML*, 1985): where faces are flat it vanishes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.geometry import area_centroid
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.ends.closing import End
from palpate.core.rebuild.ends.profiles import DEGREE, Relief
from palpate.core.rebuild.ends.touched import FEW, on_end

WAYS = 65  # Places at which a profile is taken
# Of the way to the end: taxels that lie farther are of its face; of the rim's radius: so far inside
# of it some touches must be.
ON_FACE, INSIDE = 0.9, 0.7
DEVIATIONS = np.geomspace(1e-4, 3e-2, 25)  # Of the coefficients, over the radius, that are tried
DECAY = 0.5  # Of their squares from degree to degree
TOGETHER = 8.0  # Taxels that err together: what a polynomial leaves, neighbours share
SURE = 3.0  # Logarithm of the likelihood over that of no relief
LEAST = 5e-4  # Of the radius: less is none
RINGS = 8  # Of places at which it may be wrong, each about the same area


def with_relief(end: End, contacts: ContactPoints, row: Floats, pose: float | None) -> End:
    """The end with a relief, if its touches tell of one, inside a last row (k, 2), m.

    `pose` is the standard deviation of a touch's height, m; None without noise to be seen.
    """
    points_on = on_end(contacts, end.rim, 1.0 if end.height > end.rim else -1.0)
    if end.round or end.height == end.rim or not points_on.any():
        return end
    points, touch = contacts.points[points_on], contacts.touch[points_on]
    ways, shares = end_ways(end, row, points)
    face = ways > ON_FACE
    if len(np.unique(touch[face & (shares < INSIDE)])) < FEW:
        return end
    points, ways = points[face], ways[face]
    touch = np.unique(touch[face], return_inverse=True)[1].astype(np.int32)
    above = points[:, 2] - end.rim - ways * (end.height - end.rim)
    scale = float(np.sqrt(np.mean(np.sum((row - area_centroid(row)) ** 2, axis=1))))
    powers = np.array([(i, d - i) for d in range(DEGREE + 1) for i in range(d + 1)])
    local = (points[:, :2] - end.middle) / scale
    rows = ways[:, None] * np.prod(local[:, None] ** powers, axis=2)
    decay = np.sqrt(DECAY ** powers.sum(axis=1))
    found, spread = _coefficients(rows, touch, above, scale * decay, pose or 0.0)
    if not float(np.sqrt(np.mean((rows @ found) ** 2))) > LEAST * scale:
        return end
    coefficients = np.zeros((DEGREE + 1, DEGREE + 1))
    coefficients[tuple(powers.T)] = found
    # All over the face, touched or not: as many places for each part of its area.
    rings = np.sqrt((np.arange(RINGS) + 0.5) / RINGS)[:, None, None] * (row - area_centroid(row))
    everywhere = np.prod((rings.reshape(-1, 1, 2) / scale) ** powers, axis=2)
    deviation = float(np.sqrt(np.mean(np.sum(everywhere @ spread * everywhere, axis=1))))
    return replace(end, relief=Relief(end.middle, scale, coefficients, deviation))


def end_ways(end: End, row: Floats, points: Floats) -> tuple[Floats, Floats]:
    """How far on the way from the last row (k, 2) to its end places (n, 3) lie on its profile.

    And their distances from its axis over those of the row, (n,).
    """
    centre = area_centroid(row)
    rim = row - centre
    along = np.clip((points[:, 2] - end.rim) / (end.height - end.rim), 0.0, 1.0)
    away = points[:, :2] - centre - along[:, None] * (end.middle - centre)
    angles = np.arctan2(rim[:, 1], rim[:, 0])
    order = np.argsort(angles)
    azimuth, radii = np.arctan2(away[:, 1], away[:, 0]), np.hypot(*rim[order].T)
    shares = np.hypot(*away.T) / np.interp(azimuth, angles[order], radii, period=2.0 * np.pi)
    ways = np.linspace(0.0, 1.0, WAYS)
    falling = np.minimum.accumulate(end.profile.shares(ways))
    return np.interp(-shares, -falling, ways, right=1.0), shares


def _coefficients(
    rows: Floats, touch: Ints, above: Floats, sizes: Floats, pose: float
) -> tuple[Floats, Floats]:
    """Of the likeliest deviation over their sizes (k,), from heights above, m; and covariance."""
    both = np.concatenate([rows, np.eye(int(touch.max()) + 1)[touch]], axis=1)
    left = above - both @ np.linalg.lstsq(both, above, rcond=None)[0]
    least = float(np.finfo(float).eps * np.abs(above).max(initial=0.0))
    noise = float(np.sqrt(TOGETHER * np.mean(left**2))) + least
    normal, right = both.T @ both / noise**2, both.T @ above / noise**2
    count = rows.shape[1]
    likeliest, found, covariance = -np.inf, np.zeros(count), np.zeros((count, count))
    none = 0.0
    for deviation in (0.0, *DEVIATIONS):
        spread = np.concatenate([deviation * sizes, np.full(both.shape[1] - len(sizes), pose)])
        system = np.eye(len(spread)) + spread[:, None] * normal * spread
        solved = np.linalg.solve(system, spread * right)
        likelihood = 0.5 * float(spread * right @ solved) - 0.5 * np.linalg.slogdet(system)[1]
        none = likelihood if deviation == 0.0 else none
        if likelihood > max(likeliest, none + SURE):
            likeliest, found = likelihood, (spread * solved)[:count]
            covariance = (spread[:, None] * np.linalg.inv(system) * spread)[:count, :count]
    return found, covariance
