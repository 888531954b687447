"""Closing the ends: by what was felt of them, or by what the side promises.

An end whose wall is steep is flat: the wall is carried on to it. Any other end is round: with
touches on it, a thin plate through them; without, the conic that leaves the side with its
slope and closes at the known height.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.interpolate import RBFInterpolator

from palpate.core.arrays import Floats

End = Literal["flat", "plate", "conic"]

STEEP = 0.4
"""Change of the radius by the height below which a wall is steep."""
RINGS = 18
"""Rings from the rim of an end to its middle."""
MOST_SITES = 240
"""Points through which a plate is laid."""
PLATE_SMOOTHING = 1e-6
"""Of the plate, in units of its radius."""
FLAT_SMOOTHING = 1e-2
"""Of a flat end: touches may tilt and bend it, not ripple it."""
LEAST_SITES = 12
INNER_RING = 0.93
"""A second ring inside the rim carries the side's slope into the plate."""


def is_steep(normals: Floats) -> bool:
    """Whether a wall with these outward normals (n, 3) stands upright."""
    level = np.linalg.norm(normals[:, :2], axis=1)
    return bool(np.median(np.abs(normals[:, 2]) / np.maximum(level, 1e-12)) < STEEP)


def conic_rings(middle: Floats, rim: Floats, slope: Floats, height: float, end: float) -> Floats:
    """Rings (rings, n, 3) from a rim to the pole of a round end that nobody has touched.

    Parameters
    ----------
    middle : (2,) array
        Place of the axis, m.
    rim : (n, 2) array
        The last ring of the side, m.
    slope : (n,) array
        Derivative of the squared radius in the direction of the end, m; negative where the
        side closes.
    height, end : float
        Heights of the rim and of the pole, m.

    Notes
    -----
    r^2 = r0^2 (1 + 2 s x - (1 + 2 s) x^2) over x from 0 at the rim to 1 at the pole: s = 0 is
    half an ellipse, -1/2 a paraboloid, -1 a cone; exact for every ellipsoid.
    """
    away = rim - middle
    squared = np.einsum("ni,ni->n", away, away)
    s = np.clip(0.5 * slope * abs(end - height) / squared, -1.0, 0.0)
    x = np.sin(0.5 * np.pi * np.arange(1, RINGS + 1) / RINGS)[:, None]
    share = np.sqrt(np.maximum(1.0 + 2.0 * s * x - (1.0 + 2.0 * s) * x**2, 0.0))
    places = middle + share[:, :, None] * away
    heights = np.broadcast_to(height + x * (end - height), share.shape)
    return np.concatenate([places, heights[:, :, None]], axis=-1)


def flat_rings(middle: Floats, rim: Floats, height: float) -> Floats:
    """Rings (rings, n, 3) of a level end, from its rim to its middle."""
    places = _shrunk(middle, rim)
    return np.concatenate([places, np.full((*places.shape[:2], 1), height)], axis=-1)


def plate_rings(middle: Floats, rim: Floats, sites: Floats, smoothing: float) -> Floats:
    """Rings (rings, n, 3) of a thin plate through touches on an end, from its rim to its middle.

    Parameters
    ----------
    middle : (2,) array
        Place of the axis, m.
    rim : (n, 2) array
        The last ring of the side, m.
    sites : (k, 3) array
        Points that the plate shall follow, m.
    smoothing : float
        0 to pass through them; larger to smooth.
    """
    places = _shrunk(middle, rim)
    scale = float(np.linalg.norm(rim - middle, axis=1).max())
    plate = RBFInterpolator(
        (sites[:, :2] - middle) / scale,
        sites[:, 2] / scale,
        kernel="thin_plate_spline",
        smoothing=smoothing,
        degree=1,
    )
    heights = scale * plate(((places - middle) / scale).reshape(-1, 2))
    return np.concatenate([places, heights.reshape(*places.shape[:2], 1)], axis=-1)


def slope_sites(middle: Floats, rim: Floats, height: float, slope: Floats, most: float) -> Floats:
    """The rim and a ring inside it that carries the side's slope on: (2 n, 3), m.

    Parameters
    ----------
    middle : (2,) array
        Place of the axis, m.
    rim : (n, 2) array
        The last ring of the side, m.
    height : float
        Its height, m.
    slope : (n,) array
        Derivative of the squared radius by the height, m; negative where the side closes.
    most : float
        The inner ring rises by no more than this, m.
    """
    away = rim - middle
    squared = np.einsum("ni,ni->n", away, away)
    rise = squared * (INNER_RING**2 - 1.0) / np.minimum(slope, -1e-12)
    inner = np.column_stack([middle + INNER_RING * away, height + np.clip(rise, 0.0, most)])
    return np.concatenate([np.column_stack([rim, np.full(len(rim), height)]), inner])


def _shrunk(middle: Floats, rim: Floats) -> Floats:
    shares = (1.0 - np.arange(1, RINGS + 1) / RINGS)[:, None, None]
    result: Floats = middle + shares * (rim - middle)
    return result


def thin_out(points: Floats, most: int = MOST_SITES) -> Floats:
    """At most this many of the points (n, 3), evenly taken from their order."""
    if len(points) <= most:
        return points
    return points[np.linspace(0, len(points) - 1, most).round().astype(int)]
