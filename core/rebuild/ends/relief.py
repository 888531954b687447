"""How an end rises and falls over its profile: a height field from all taxels that lie on it.

The face of an object bulges, or is hollow, where its profile has a level disc. A polynomial over
the place is fitted together with a shift of each touch. How large it is believed to be is told by
the likelihood of what was touched, in which the polynomial itself has no say (empirical Bayes;
Wahba, *A comparison of GCV and GML*, 1985): where faces are flat it vanishes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.geometry import area_centroid
from palpate.core.rebuild.contours import ContactPoints, taxel_pitch
from palpate.core.rebuild.ends.closing import End
from palpate.core.rebuild.ends.profiles import DEGREE, Relief
from palpate.core.rebuild.ends.touched import FEW, on_end


@dataclass(frozen=True, slots=True)
class ReliefSettings:
    """How a relief is fitted.

    A relief is kept only where the face determines it: the fit has at least as many spare equations
    as coefficients, its noise is no smaller than what taxels resolve, and it rises nowhere on the
    face by much more than where it was touched.
    """

    n_ways: int = 65  # places at which a profile is sampled
    face_way: float = 0.9  # fraction of the way to the end; taxels beyond it lie on the face
    inner_radius: float = 0.7  # fraction of the rim's radius; some touches must lie within it
    n_deviations: int = 25  # prior standard deviations of the coefficients that are tried
    min_deviation: float = 1e-4  # fraction of the radius
    max_deviation: float = 3e-2  # fraction of the radius
    decay: float = 0.5  # ratio of the squared coefficients from one degree to the next
    n_correlated: float = 8.0  # taxels that err together: neighbours share what a polynomial misses
    min_noise: float = 0.01  # fraction of the pitch: a sensor resolves no smaller difference
    min_spare: float = 1.0  # spare equations for each coefficient
    min_log_likelihood_ratio: float = 3.0  # over that of no relief
    min_relief: float = 5e-4  # fraction of the radius; less is none
    max_rise_ratio: float = 2.0  # largest rise on the face over the largest where it was touched
    n_rings: int = 8  # rings of equal area at which the relief's error is averaged


def with_relief(
    end: End,
    contacts: ContactPoints,
    row: Floats,
    pose: float | None,
    settings: ReliefSettings = ReliefSettings(),
) -> End:
    """The end with a relief, if its touches determine one, inside a last row (k, 2), m.

    `pose` is the standard deviation of a touch's height, m; None without noise to be seen.
    """
    points_on = on_end(contacts, end.rim, 1.0 if end.height > end.rim else -1.0)
    if end.pointed or end.height == end.rim or not points_on.any():
        return end
    points, touch = contacts.points[points_on], contacts.touch[points_on]
    ways, shares = end_ways(end, row, points, settings)
    face = ways > settings.face_way
    if len(np.unique(touch[face & (shares < settings.inner_radius)])) < FEW:
        return end
    points, ways = points[face], ways[face]
    touch = np.unique(touch[face], return_inverse=True)[1].astype(np.int32)
    above = points[:, 2] - end.rim - ways * (end.height - end.rim)
    scale = float(np.sqrt(np.mean(np.sum((row - area_centroid(row)) ** 2, axis=1))))
    powers = np.array([(i, d - i) for d in range(DEGREE + 1) for i in range(d + 1)])
    rows = ways[:, None] * np.prod(((points[:, :2] - end.middle) / scale)[:, None] ** powers, 2)
    noise = _noise(rows, touch, above, settings.min_noise * taxel_pitch(contacts), settings)
    if noise is None:
        return end
    sizes = scale * np.sqrt(settings.decay ** powers.sum(axis=1))
    found, spread = _coefficients(rows, touch, above, sizes, pose or 0.0, noise, settings)
    if not float(np.sqrt(np.mean((rows @ found) ** 2))) > settings.min_relief * scale:
        return end
    # As many places for each part of the face's area, touched or not.
    away = row - area_centroid(row)
    rings = np.sqrt((np.arange(settings.n_rings) + 0.5) / settings.n_rings)[:, None, None] * away
    everywhere = np.prod((rings.reshape(-1, 1, 2) / scale) ** powers, axis=2)
    rise = float(np.abs(rows @ found).max())
    if not float(np.abs(everywhere @ found).max()) <= settings.max_rise_ratio * rise:
        return end
    coefficients = np.zeros((DEGREE + 1, DEGREE + 1))
    coefficients[tuple(powers.T)] = found
    variance = np.maximum(np.sum(everywhere @ spread * everywhere, axis=1), 0.0)
    deviation = float(np.sqrt(np.mean(variance)))
    return replace(end, relief=Relief(end.middle, scale, coefficients, deviation))


def _noise(
    rows: Floats, touch: Ints, above: Floats, least: float, settings: ReliefSettings
) -> float | None:
    """Standard deviation of heights `above`, m, at least `least`; None if too few equations."""
    both = np.concatenate([rows, np.eye(int(touch.max()) + 1)[touch]], axis=1)
    solved, _, rank, _ = np.linalg.lstsq(both, above, rcond=None)
    spare = len(above) - int(rank)
    if spare < settings.min_spare * rows.shape[1]:
        return None
    squares = float(np.sum((above - both @ solved) ** 2))
    rounding = float(np.finfo(float).eps * np.abs(above).max(initial=0.0))
    return max(float(np.sqrt(settings.n_correlated * squares / spare)), least) + rounding


def end_ways(
    end: End, row: Floats, points: Floats, settings: ReliefSettings = ReliefSettings()
) -> tuple[Floats, Floats]:
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
    ways = np.linspace(0.0, 1.0, settings.n_ways)
    falling = np.minimum.accumulate(end.profile.shares(ways))
    return np.interp(-shares, -falling, ways, right=1.0), shares


def _coefficients(
    rows: Floats,
    touch: Ints,
    above: Floats,
    sizes: Floats,
    pose: float,
    noise: float,
    settings: ReliefSettings,
) -> tuple[Floats, Floats]:
    """Coefficients of the likeliest prior deviation, per sizes (k,), and their covariance, m."""
    both = np.concatenate([rows, np.eye(int(touch.max()) + 1)[touch]], axis=1)
    normal, right = both.T @ both / noise**2, both.T @ above / noise**2
    count = rows.shape[1]
    likeliest, found, covariance = -np.inf, np.zeros(count), np.zeros((count, count))
    none = 0.0
    limits = settings.min_deviation, settings.max_deviation
    for deviation in (0.0, *np.geomspace(*limits, settings.n_deviations)):
        spread = np.concatenate([deviation * sizes, np.full(both.shape[1] - len(sizes), pose)])
        system = np.eye(len(spread)) + spread[:, None] * normal * spread
        solved = np.linalg.solve(system, spread * right)
        likelihood = 0.5 * float(spread * right @ solved) - 0.5 * np.linalg.slogdet(system)[1]
        none = likelihood if deviation == 0.0 else none
        if likelihood > max(likeliest, none + settings.min_log_likelihood_ratio):
            likeliest, found = likelihood, (spread * solved)[:count]
            covariance = (spread[:, None] * np.linalg.inv(system) * spread)[:count, :count]
    return found, covariance
