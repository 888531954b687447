"""What a patch of surface is like: its normal, its curvatures, or why there are none."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.jet import Jet, fit_jet
from palpate.core.touch.pad import Pad

Kind = Literal["smooth", "edge", "insufficient", "miss"]

EDGE_SPREADS = 4.0
"""A jet that misses its taxels by more than 4 standard deviations of the noise, and by more
than `EDGE_MISFIT`, has met an edge: no curvature can be had there."""
EDGE_MISFIT = 0.04
"""In pitches: what a quartic leaves over on the tightest curve that a pad resolves."""


EDGE_CURVATURE = 0.5
"""In 1 / pitches: what curves within two pitches is an edge to this array, however well a
polynomial passes through the few taxels that touch it."""


class Patch(NamedTuple):
    """A felt patch of surface, in the pad's frame."""

    kind: Kind
    """What it is."""
    jet: Jet | None
    """The fitted jet; None if too few taxels were touched for any."""
    normal: Floats
    """Outward unit normal at the middle of the contact, (3,)."""
    principal: tuple[float, float]
    """Principal curvatures k1 >= k2, 1/m; convex is positive; 0 unless smooth."""
    across: float
    """Normal curvature along the asked direction, 1/m; 0 unless smooth."""
    trust: float
    """From 0 to 1."""
    residual: float
    """Root mean square misfit of the jet, m."""


def feel_patch(pad: Pad, height: Floats, touched: Bools, direction: Floats, noise: float) -> Patch:
    """Normal and curvatures of the touched surface.

    Parameters
    ----------
    pad : Pad
        The array.
    height : (rows, cols) array
        Surface over the plane of the pad's face, m.
    touched : (rows, cols) array of bool
        Where the pad touches.
    direction : (3,) array
        Direction in which `across` is wanted, pad frame.
    noise : float
        Standard deviation of one taxel, m.

    Notes
    -----
    Fung, 1999, section 3.5, with a jet in place of the interpolating spline, which turns
    every taxel's noise into curvature. A convex surface has positive curvature, as (3.1)
    expects and (3.15) does not give. The principal curvatures are the eigenvalues of the
    shape operator made symmetric by the Cholesky factor of the first form, so that umbilics
    cannot make a discriminant negative.
    """
    away = np.array([0.0, 0.0, -1.0])
    if not touched.any():
        return Patch("miss", None, away, (0.0, 0.0), 0.0, 0.0, 0.0)
    x, y = pad.grid()
    fitted = fit_jet(x, y, height, touched, scale=0.5 * pad.pitch * pad.cols)
    share = float(touched.mean())
    if fitted is None:
        return Patch("insufficient", None, away, (0.0, 0.0), 0.0, 0.0, 0.0)
    jet, residual = fitted
    middle = x[touched].mean(keepdims=True), y[touched].mean(keepdims=True)
    slope_x, slope_y = (float(s[0]) for s in jet.slopes(*middle))
    normal = np.array([slope_x, slope_y, -1.0]) / math.sqrt(slope_x**2 + slope_y**2 + 1.0)
    limit = max(EDGE_SPREADS * noise, EDGE_MISFIT * pad.pitch)
    trust = share / (1.0 + (residual / limit) ** 2)
    if residual > limit or jet.degree < 2:
        kind: Kind = "edge" if residual > limit else "insufficient"
        return Patch(kind, jet, normal, (0.0, 0.0), 0.0, trust, residual)
    by_xx, by_xy, by_yy = (float(s[0]) for s in jet.second_derivatives(*middle))
    k1, k2, across = _curvatures((slope_x, slope_y), (by_xx, by_xy, by_yy), direction)
    if max(abs(k1), abs(k2)) * pad.pitch > EDGE_CURVATURE:
        return Patch("edge", jet, normal, (0.0, 0.0), 0.0, trust, residual)
    return Patch("smooth", jet, normal, (k1, k2), across, trust, residual)


def _curvatures(
    slopes: tuple[float, float], seconds: tuple[float, float, float], direction: Floats
) -> tuple[float, float, float]:
    """Principal curvatures, and that along `direction`, of a graph with these derivatives."""
    (p, q), (r, s, t) = slopes, seconds
    steep = math.sqrt(1.0 + p * p + q * q)
    r, s, t = r / steep, s / steep, t / steep
    # The first form is L L^T; the shape operator is L^-1 II L^-T, symmetric.
    l11 = math.sqrt(1.0 + p * p)
    l21, l22 = p * q / l11, steep / l11
    a11 = r / (l11 * l11)
    a12 = (s - l21 * r / l11) / (l11 * l22)
    a22 = (t - 2.0 * l21 * s / l11 + l21 * l21 * r / (l11 * l11)) / (l22 * l22)
    mean, spread = 0.5 * (a11 + a22), math.hypot(0.5 * (a11 - a22), a12)
    u, v = float(direction[0]), float(direction[1])
    length = (1.0 + p * p) * u * u + 2.0 * p * q * u * v + (1.0 + q * q) * v * v
    across = (r * u * u + 2.0 * s * u * v + t * v * v) / length if length > 0.0 else 0.0
    return mean + spread, mean - spread, across
