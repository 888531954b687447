"""Relief of an end: the height of its face over its profile, from all taxels that lie on it.

The face of an object bulges, or is hollow, where its profile has a level disc. A polynomial over
the plane is fitted together with a shift of each touch. Its prior size has the largest marginal
likelihood (empirical Bayes; Wahba, *A comparison of GCV and GML*, 1985): of flat faces it is 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.geometry import area_centroid
from palpate.core.rebuild.contours import ContactPoints, taxel_pitch
from palpate.core.rebuild.ends.closing import End
from palpate.core.rebuild.ends.profiles import Relief
from palpate.core.rebuild.ends.touched import on_end


@dataclass(frozen=True, slots=True)
class ReliefSettings:
    """How a relief is fitted.

    A relief is kept only where the face determines it: the fit has at least as many spare equations
    as coefficients, its noise is no smaller than what taxels resolve, and it rises nowhere on the
    face by much more than where it was touched.
    """

    degree: int = 4  # of the polynomial; larger follows finer shapes
    min_face_fraction: float = 0.9  # of the height from rim to end; taxels beyond are on the face
    inner_radius: float = 0.7  # fraction of the rim's radius, within which touches are counted
    min_touches: int = 3  # on the face within that radius
    n_deviations: int = 25  # prior standard deviations of the coefficients that are tried
    min_deviation: float = 1e-4  # least of these, as a fraction of the radius
    max_deviation: float = 3e-2  # largest of these, as a fraction of the radius
    decay: float = 0.5  # prior ratio of squared coefficients from one degree to the next
    n_correlated: float = 8.0  # neighbouring taxels with the same error, which a polynomial misses
    min_noise: float = 0.01  # least noise, as a fraction of the pitch: the sensor's resolution
    min_spare: float = 1.0  # spare equations for each coefficient
    min_log_likelihood_ratio: float = 3.0  # over that of no relief
    min_relief: float = 5e-4  # fraction of the radius; a smaller relief (rms) is left out
    max_rise_ratio: float = 2.0  # largest rise on the face over the largest where it was touched
    n_rings: int = 8  # rings of equal area at which the relief's error is averaged


def with_relief(
    end: End,
    contacts: ContactPoints,
    row: Floats,
    pose: float | None,
    settings: ReliefSettings = ReliefSettings(),
) -> End:
    """The end with a relief, if its touches determine one, inside a last row (k, 2) [m].

    `pose` is the standard deviation of a touch's height [m]; None without noise.
    """
    points_on = on_end(contacts, end.rim, 1.0 if end.height > end.rim else -1.0)
    if end.pointed or end.height == end.rim or not points_on.any():
        return end
    points, touch = contacts.points[points_on], contacts.touch[points_on]
    fractions, radii = end_fractions(end, row, points)
    face = fractions > settings.min_face_fraction
    if len(np.unique(touch[face & (radii < settings.inner_radius)])) < settings.min_touches:
        return end
    points, fractions = points[face], fractions[face]
    touch = np.unique(touch[face], return_inverse=True)[1].astype(np.int32)
    above = points[:, 2] - end.rim - fractions * (end.height - end.rim)
    scale = float(np.sqrt(np.mean(np.sum((row - area_centroid(row)) ** 2, axis=1))))
    count = settings.degree + 1
    powers = np.array([(i, degree - i) for degree in range(count) for i in range(degree + 1)])
    terms = np.prod(((points[:, :2] - end.middle) / scale)[:, None] ** powers, 2)
    rows = fractions[:, None] * terms
    noise = _noise(rows, touch, above, settings.min_noise * taxel_pitch(contacts), settings)
    if noise is None:
        return end
    sizes = scale * np.sqrt(settings.decay ** powers.sum(axis=1))
    solution, covariance = _coefficients(rows, touch, above, sizes, pose or 0.0, noise, settings)
    if not float(np.sqrt(np.mean((rows @ solution) ** 2))) > settings.min_relief * scale:
        return end
    everywhere = np.prod((_face_places(row, settings.n_rings) / scale) ** powers, axis=2)
    rise = float(np.abs(rows @ solution).max())
    if not float(np.abs(everywhere @ solution).max()) <= settings.max_rise_ratio * rise:
        return end
    coefficients = np.zeros((count, count))
    coefficients[tuple(powers.T)] = solution
    variance = np.maximum(np.sum(everywhere @ covariance * everywhere, axis=1), 0.0)
    deviation = float(np.sqrt(np.mean(variance)))
    return replace(end, relief=Relief(end.middle, scale, coefficients, deviation))


def _face_places(row: Floats, n_rings: int) -> Floats:
    """Places (n, 1, 2) of equal area on the whole face inside a row (k, 2), about its middle."""
    away = row - area_centroid(row)
    rings = np.sqrt((np.arange(n_rings) + 0.5) / n_rings)[:, None, None] * away
    return np.asarray(rings.reshape(-1, 1, 2))


def _noise(
    rows: Floats, touch: Ints, above: Floats, least: float, settings: ReliefSettings
) -> float | None:
    """Standard deviation of heights `above` [m], at least `least`; None of too few equations."""
    both = np.concatenate([rows, np.eye(int(touch.max()) + 1)[touch]], axis=1)
    solved, _, rank, _ = np.linalg.lstsq(both, above, rcond=None)
    spare = len(above) - int(rank)
    if spare < settings.min_spare * rows.shape[1]:
        return None
    squares = float(np.sum((above - both @ solved) ** 2))
    rounding = float(np.finfo(float).eps * np.abs(above).max(initial=0.0))
    return max(float(np.sqrt(settings.n_correlated * squares / spare)), least) + rounding


def end_fractions(
    end: End, row: Floats, points: Floats, n_fractions: int = 65
) -> tuple[Floats, Floats]:
    """Fractions (n,) of the height to an end at which places (n, 3) lie on its profile.

    Also their distances (n,) from its axis, over those of the last row (k, 2). The profile is
    inverted by interpolation between `n_fractions` places.
    """
    centre = area_centroid(row)
    rim = row - centre
    along = np.clip((points[:, 2] - end.rim) / (end.height - end.rim), 0.0, 1.0)
    away = points[:, :2] - centre - along[:, None] * (end.middle - centre)
    angles = np.arctan2(rim[:, 1], rim[:, 0])
    order = np.argsort(angles)
    azimuth, radii = np.arctan2(away[:, 1], away[:, 0]), np.hypot(*rim[order].T)
    ratios = np.hypot(*away.T) / np.interp(azimuth, angles[order], radii, period=2.0 * np.pi)
    fractions = np.linspace(0.0, 1.0, n_fractions)
    falling = np.minimum.accumulate(end.profile.radius_ratios(fractions))
    return np.interp(-ratios, -falling, fractions, right=1.0), ratios


def _coefficients(
    rows: Floats,
    touch: Ints,
    above: Floats,
    sizes: Floats,
    pose: float,
    noise: float,
    settings: ReliefSettings,
) -> tuple[Floats, Floats]:
    """Coefficients [m] with the likeliest prior, a multiple of `sizes`, and covariance [m^2]."""
    both = np.concatenate([rows, np.eye(int(touch.max()) + 1)[touch]], axis=1)
    normal, right = both.T @ both / noise**2, both.T @ above / noise**2
    count = rows.shape[1]
    likeliest, solution, covariance = -np.inf, np.zeros(count), np.zeros((count, count))
    without = 0.0  # log likelihood of no relief
    limits = settings.min_deviation, settings.max_deviation
    for deviation in (0.0, *np.geomspace(*limits, settings.n_deviations)):
        spread = np.concatenate([deviation * sizes, np.full(both.shape[1] - len(sizes), pose)])
        system = np.eye(len(spread)) + spread[:, None] * normal * spread
        solved = np.linalg.solve(system, spread * right)
        likelihood = 0.5 * float(spread * right @ solved) - 0.5 * np.linalg.slogdet(system)[1]
        without = likelihood if deviation == 0.0 else without
        if likelihood > max(likeliest, without + settings.min_log_likelihood_ratio):
            likeliest, solution = likelihood, (spread * solved)[:count]
            covariance = (spread[:, None] * np.linalg.inv(system) * spread)[:count, :count]
    return solution, covariance
