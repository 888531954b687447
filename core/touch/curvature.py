"""What a patch of surface is like: its normal, its curvatures, or why there are none."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.curvature_errors import graph_errors
from palpate.core.touch.forms import ShapeOperator, curvature_along, graph_shape, principal
from palpate.core.touch.jet import Jet
from palpate.core.touch.jet_fit import JetFit, fit_jet
from palpate.core.touch.pad import Pad
from palpate.core.touch.strays import strays
from palpate.core.touch.verdict import judge

Kind = Literal["smooth", "edge", "corner", "insufficient", "miss"]

TRUSTED = 0.04
"""In pitches: a misfit of this size, or of 4 standard deviations of the noise, halves the
trust."""
TRUSTED_SPREADS = 4.0
DIRECTED = 3.0
"""Standard deviations by which k1 and k2 must differ before their directions mean anything."""
LEVEL = 1e-9
"""In 1 / pads' widths: k1 and k2 that differ by less are equal but for rounding."""
AWAY: Floats = np.array([0.0, 0.0, -1.0])
"""Normal of a patch of which nothing is known: that of the pad."""
AWAY.setflags(write=False)
NOWHERE: Floats = np.zeros(3)
"""Principal direction where there is none."""
NOWHERE.setflags(write=False)


class Patch(NamedTuple):
    """A felt patch of surface, in the pad's frame.

    Curvatures and their errors are 0 unless the patch is smooth.
    """

    kind: Kind
    """What it is."""
    jet: Jet | None = None
    """The fitted jet; None if too few taxels were touched for any."""
    normal: Floats = AWAY
    """Outward unit normal at the middle of the contact, (3,)."""
    principal: tuple[float, float] = (0.0, 0.0)
    """Principal curvatures k1 >= k2, 1/m; convex is positive."""
    across: float = 0.0
    """Normal curvature along the asked direction, 1/m."""
    trust: float = 0.0
    """From 0 to 1: share of the taxels that touch, damped by the misfit of the jet."""
    residual: float = 0.0
    """Root mean square misfit of the jet, m."""
    gaussian: float = 0.0
    """Product of the principal curvatures, 1/m^2."""
    mean: float = 0.0
    """Their mean, 1/m."""
    principal_direction: Floats = NOWHERE
    """Unit tangent along which the curvature is k1, (3,); zero unless the patch is smooth."""
    umbilic: bool = True
    """Whether k1 and k2 are the same within their errors: then any direction would do."""
    normal_error: float = math.pi
    """Standard deviation of the normal's angle, rad; pi if nothing is known of it."""
    principal_error: tuple[float, float] = (0.0, 0.0)
    """Standard deviations of the principal curvatures by noise alone, 1/m: what a quartic
    cannot follow, on balls below 20 pitches, comes on top."""
    across_error: float = 0.0
    """Standard deviation of `across`, 1/m."""
    place: Floats = NOWHERE
    """Where on the surface all this holds: over the middle of the contact, (3,), m."""
    shape: ShapeOperator | None = None
    """The shape operator there; None unless the patch is smooth."""
    shape_covariance: Floats | None = None
    """Covariance of its three parts, (3, 3), 1/m^2; None unless the patch is smooth."""


def feel_patch(
    pad: Pad,
    height: Floats,
    touched: Bools,
    direction: Floats,
    noise: float,
    weights: Floats | None = None,
) -> Patch:
    """Normal and curvatures of the touched surface, each with its standard error.

    Parameters
    ----------
    pad : Pad
        The array.
    height : (rows, cols) array
        Surface over the plane of the pad's face, m.
    touched : (rows, cols) array of bool
        Where the pad touches, impulses left out.
    direction : (3,) array
        Direction in which `across` is wanted, pad frame; its part in the tangent plane counts.
    noise : float
        Standard deviation of one taxel, m, as far as known. Errors are for the larger of this
        and what the misfit shows.
    weights : (rows, cols) array, optional
        How much each taxel counts, from 0 to 1.

    Notes
    -----
    Fung, 1999, section 3.5, with a jet in place of the interpolating spline, which turns
    every taxel's noise into curvature. A convex surface has positive curvature, as (3.1)
    expects and (3.15) does not give.
    """
    if not touched.any():
        return Patch("miss")
    used = touched if weights is None else touched & (weights > 0.0)
    fit = fit_jet(pad, height, used, weights, noise)
    if fit is None:
        return Patch("insufficient")
    kind, shape = _judged(pad, height, used, fit, noise)
    single = strays(pad, height, used, fit, noise) if kind in ("edge", "corner") else None
    if single is not None:
        less = used & ~single
        again = fit_jet(pad, height, less, weights, noise)
        if again is not None:
            called, there = _judged(pad, height, less, again, noise)
            if called == "smooth":
                kind, shape, fit = called, there, again
    return _patch(pad, touched, direction, noise, kind, shape, fit)


def _judged(
    pad: Pad, height: Floats, used: Bools, fit: JetFit, noise: float
) -> tuple[Kind, ShapeOperator]:
    """What a jet was fitted to, and the jet's shape operator at the middle of the contact."""
    by_x, by_y, by_xx, by_xy, by_yy = fit.derivatives.tolist()
    shape = graph_shape((by_x, by_y), (by_xx, by_xy, by_yy))
    if fit.jet.degree < 2:
        return "insufficient", shape
    k1, k2, *_ = principal(shape)
    return judge(pad, height, used, fit, max(abs(k1), abs(k2)), noise), shape


def _patch(
    pad: Pad,
    touched: Bools,
    direction: Floats,
    noise: float,
    kind: Kind,
    shape: ShapeOperator,
    fit: JetFit,
) -> Patch:
    """All that a jet says, as far as its kind allows."""
    errors = graph_errors(
        fit.derivatives, fit.derivative_factor, max(noise, fit.deviation), shape, direction
    )
    limit = max(TRUSTED_SPREADS * noise, TRUSTED * pad.pitch)
    trust = float(touched.mean()) / (1.0 + (fit.residual / limit) ** 2)
    patch = Patch(
        kind,
        fit.jet,
        shape.normal,
        trust=0.0 if fit.jet.degree < 2 else trust,
        residual=fit.residual,
        normal_error=min(errors.normal, math.pi),
        place=np.array(fit.middle),
    )
    if kind != "smooth":
        return patch
    k1, k2, along_k1, umbilic = principal(shape)
    rounding = LEVEL / (pad.pitch * pad.cols)
    return patch._replace(
        principal=(k1, k2),
        across=curvature_along(shape, direction),
        gaussian=k1 * k2,
        mean=0.5 * (k1 + k2),
        principal_direction=along_k1,
        umbilic=umbilic or 0.5 * (k1 - k2) <= max(DIRECTED * errors.difference, rounding),
        principal_error=errors.principal,
        across_error=errors.across,
        shape=shape,
        shape_covariance=errors.parts,
    )
