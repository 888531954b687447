"""Normal and curvatures of a touched patch, with errors.

Fung, 1999, section 3.5, with a jet in place of the interpolating spline, which turns every taxel's
noise into curvature.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, finite_array, in_metres, positive
from palpate.core.touch import forms
from palpate.core.touch.edges import classify_surface, isolated_outliers
from palpate.core.touch.faults import (
    MIN_SIDE,
    FrameFault,
    check_image,
    cut_off_taxels,
    pressed_fault,
)
from palpate.core.touch.filters import clean
from palpate.core.touch.jet import Jet, JetFit, fit_jet
from palpate.core.touch.pad import CONTACT, Pad
from palpate.reprs import readable

# Longest lengths of a sensor that is meant in metres; what is longer was given in millimetres.
MAX_PITCH, MAX_THICKNESS, MAX_RADIUS, MAX_NOISE, MAX_CONTACT = 0.01, 0.05, 1.0, 1e-3, 1e-3
ALONG_ROWS: Floats = np.array([1.0, 0.0, 0.0])  # The pad's x axis, along which `across` is told
PatchKind = Literal["smooth", "edge", "corner", "insufficient", "miss", "invalid"]
# Derivatives at the middle of the contact from pad, height, touched taxels and noise as `fit_patch`
# has them; None if there are too few taxels.
Estimator = Callable[[Pad, Floats, Bools, float], JetFit | None]
CONFIDENT = 0.04  # In pitches: such a misfit, or 4 deviations of the noise, halves the confidence
CONFIDENT_DEVIATIONS = 4.0
ALONE = 0.5  # Of the touched taxels: if more stand alone, what lies between them is no surface
DIRECTED = 3.0  # Standard deviations by which k1 and k2 differ if their directions mean anything
LEVEL = 1e-9  # In 1 / pads' widths: k1 and k2 that differ by less are equal but for rounding
AWAY: Floats = np.array([0.0, 0.0, -1.0])  # Normal of an unknown patch: the pad's
NOWHERE: Floats = np.zeros(3)  # Principal direction where there is none
for _shared in (AWAY, NOWHERE):
    _shared.setflags(write=False)


def surface_patch(
    compression: Floats,
    pitch: float,
    *,
    radius: float | None = None,
    noise: float = 0.0,
    contact: float = CONTACT,
    thickness: float | None = None,
    saturation: float = 1.0,
) -> Patch:
    """Normal, curvatures and verdict of one touch, from any array over an elastic pad.

    `compression` (rows, cols): compression of the pad under each taxel, m, at least 4 by 4. Row i
    lies at ``y = (i - (rows - 1) / 2) * pitch``. `pitch`: distance between neighbouring taxels, m.
    `radius`: radius of a domed pad, m; None for a flat one. `noise`: standard deviation of one
    taxel, m, as far as known: errors are for no less. `contact`: least compression that counts as
    touched, m. `thickness`: of the pad, m, and `saturation`: largest compression as a share of it,
    if they are known: what reads more is at fault. The patch is told in the pad's frame: x along
    the columns, y along the rows, z into the object. Raises ValueError if the image is no finite
    array of at least 4 by 4, or a length is not positive, or too long to be meant in metres.
    """
    image = finite_array("compression", compression, (None, None))
    if min(image.shape) < MIN_SIDE:
        raise ValueError(
            f"compression must be at least {MIN_SIDE} by {MIN_SIDE}, got {image.shape}"
        )
    if not 0.0 <= noise < np.inf:
        raise ValueError(f"noise must not be negative, got {noise} m")
    if not 0.0 < saturation <= 1.0:
        raise ValueError(f"saturation must be a share above 0 and at most 1, got {saturation}")
    positive("contact", contact, "m")
    given = positive("thickness", MAX_THICKNESS if thickness is None else thickness, "m")
    lengths = {
        "pitch": (pitch, MAX_PITCH),
        "thickness": (given, MAX_THICKNESS),
        "radius": (radius or 0.0, MAX_RADIUS),
        "noise": (noise, MAX_NOISE),
        "contact": (contact, MAX_CONTACT),
        "compression": (_typical(image, contact), MAX_THICKNESS),
    }
    for name, (length, most) in lengths.items():
        in_metres(name, length, most)
    pad = Pad(
        rows=image.shape[0],
        cols=image.shape[1],
        pitch=positive("pitch", pitch, "m"),
        thickness=given,
        dome=0.0 if radius is None else 1.0 / positive("radius", radius, "m"),
        saturation=saturation,
    )
    cleaned = clean(pad, image, noise, contact, "auto")
    if cleaned.fault != "none":
        return Patch("invalid", fault=cleaned.fault)
    surface = pad.surface(cleaned.compression, cleaned.touched)
    return fit_patch(pad, surface, cleaned.touched, ALONG_ROWS, noise)


def _typical(image: Floats, contact: float) -> float:
    """Median size of what is more than a touch, m; single taxels may read anything."""
    sizes = np.abs(image)
    return float(np.median(sizes[sizes > contact])) if (sizes > contact).any() else 0.0


@readable
class Patch(NamedTuple):
    """A touched patch of surface, in the pad's frame.

    Curvatures and their errors are 0 unless the patch is smooth. An ``invalid`` patch comes of a
    frame that no surface can have made: its `fault` says what is wrong with it.
    """

    kind: PatchKind  # What it is
    jet: Jet | None = None  # The fitted jet; None if too few taxels were touched for any
    normal: Floats = AWAY  # Outward unit normal at the middle of the contact, (3,)
    principal: tuple[float, float] = (0.0, 0.0)  # Curvatures k1 >= k2, 1/m; convex is positive
    across: float = 0.0  # Normal curvature along the asked direction, 1/m
    confidence: float = 0.0  # From 0 to 1: share of taxels that touch, damped by the misfit
    residual: float = 0.0  # Root mean square misfit of the jet, m
    gaussian: float = 0.0  # Product of the principal curvatures, 1/m^2
    mean: float = 0.0  # Their mean, 1/m
    principal_direction: Floats = NOWHERE  # Unit tangent of k1, (3,); zero unless it is smooth
    umbilic: bool = True  # Whether k1 and k2 are alike within their errors: no direction counts
    normal_error: float = math.pi  # Deviation of the normal's angle, rad; pi if it is unknown
    # Standard deviations of the principal curvatures by noise alone, 1/m: what a quartic cannot
    # follow, on balls below 20 pitches, comes on top.
    principal_error: tuple[float, float] = (0.0, 0.0)
    across_error: float = 0.0  # Standard deviation of `across`, 1/m
    place: Floats = NOWHERE  # Where all this holds: over the middle of the contact, (3,), m
    shape: forms.ShapeOperator | None = (
        None  # The shape operator there; None unless the patch is smooth
    )
    shape_covariance: Floats | None = None  # Of its parts, (3, 3), 1/m^2; None unless smooth
    fault: FrameFault = "none"  # What is wrong with the frame; some of it if its top is cut off
    cut: Bools | None = None  # Touched taxels that were left out as cut off, (rows, cols)


def fit_patch(
    pad: Pad,
    height: Floats,
    touched: Bools,
    direction: Floats,
    noise: float,
    estimator: Estimator = fit_jet,
) -> Patch:
    """Normal and curvatures of the touched surface, each with its standard error.

    `height` (rows, cols): surface over the plane of the pad's face, m. `touched` (rows, cols) of
    bool: where the pad touches, impulses left out. `direction` (3,): direction in which `across` is
    wanted, pad frame; its part in the tangent plane counts. `noise`: standard deviation of one
    taxel, m, as far as known. Errors are for the larger of this and what the misfit shows.
    `estimator`: what normal and curvatures of a smooth surface come from; that it is smooth is for
    the jet to say. Fung, 1999, section 3.5, with a jet in place of the interpolating spline, which
    turns taxels' noise into curvature (`palpate.core.thesis.fit_bspline`). Convex is positive, as
    (3.1) expects and (3.15) does not give. Taxels that all read the same largest compression, as a
    saturated array does, are left out where the surface goes on beyond it. Raises ValueError if
    `height` is not finite, or no image of this pad.
    """
    check_image(pad, "height", height)
    check_image(pad, "touched", touched)
    if not touched.any():
        return Patch("miss")
    fault = pressed_fault(pad, height, touched)
    if fault != "none":
        return Patch("invalid", fault=fault)
    cut = cut_off_taxels(pad, height, touched, noise)
    if cut is not None:
        return _fit_beside(pad, height, touched, cut, direction, noise, estimator)
    return _fit_touched(pad, height, touched, direction, noise, estimator)


def _fit_beside(
    pad: Pad,
    height: Floats,
    touched: Bools,
    cut: Bools,
    direction: Floats,
    noise: float,
    estimator: Estimator,
) -> Patch:
    """The patch of what is not cut off, its errors for what may be under the rest."""
    share = float(cut.sum() / touched.sum())
    patch = _fit_touched(pad, height, touched & ~cut, direction, noise, estimator)
    patch = patch._replace(fault="saturated", cut=cut, confidence=patch.confidence * (1.0 - share))
    if patch.kind != "smooth" or patch.shape_covariance is None:
        return patch._replace(kind="insufficient", confidence=0.0)
    # Nothing was seen of the middle: its curvature may be off by that share of what is beside it.
    k1, k2 = patch.principal
    unseen = share * max(abs(k1), abs(k2))
    return patch._replace(
        principal_error=(
            math.hypot(patch.principal_error[0], unseen),
            math.hypot(patch.principal_error[1], unseen),
        ),
        across_error=math.hypot(patch.across_error, unseen),
        shape_covariance=patch.shape_covariance + unseen**2 * forms.ISOTROPIC,
    )


def _fit_touched(
    pad: Pad,
    height: Floats,
    touched: Bools,
    direction: Floats,
    noise: float,
    estimator: Estimator,
) -> Patch:
    """The patch of all taxels that are touched."""
    fit = fit_jet(pad, height, touched, noise)
    if fit is None:
        return Patch("insufficient")
    used = touched
    kind, shape = _judged(pad, height, touched, fit, noise)
    single = None
    if kind in ("edge", "corner"):
        single = isolated_outliers(pad, height, touched, fit, noise)
    if single is not None:
        less = touched & ~single
        again = fit_jet(pad, height, less, noise)
        if again is not None:
            called, there = _judged(pad, height, less, again, noise)
            if called == "smooth":
                kind, shape, fit, used = called, there, again, less
    if kind == "smooth" and estimator is not fit_jet:
        other = estimator(pad, height, used, noise)
        if other is None:
            return Patch("insufficient")
        fit, shape = other, _shape(other)
    return _patch(pad, touched, direction, noise, kind, shape, fit)


def _judged(
    pad: Pad, height: Floats, used: Bools, fit: JetFit, noise: float
) -> tuple[PatchKind, forms.ShapeOperator]:
    """What a jet was fitted to, and the jet's shape operator at the middle of the contact."""
    shape = _shape(fit)
    if fit.jet.degree < 2 or _alone(used) > ALONE:
        return "insufficient", shape
    k1, k2, *_ = forms.principal_curvatures(shape)
    return classify_surface(pad, height, used, fit, max(abs(k1), abs(k2)), noise), shape


def _shape(fit: JetFit) -> forms.ShapeOperator:
    by_x, by_y, by_xx, by_xy, by_yy = fit.derivatives.tolist()
    return forms.graph_shape_operator((by_x, by_y), (by_xx, by_xy, by_yy))


def _alone(touched: Bools) -> float:
    """Share of the touched taxels beside which no other is touched, in their row or column."""
    around = np.pad(touched, 1)
    beside = around[:-2, 1:-1] | around[2:, 1:-1] | around[1:-1, :-2] | around[1:-1, 2:]
    return float(np.mean(~beside[touched]))


def _patch(
    pad: Pad,
    touched: Bools,
    direction: Floats,
    noise: float,
    kind: PatchKind,
    shape: forms.ShapeOperator,
    fit: JetFit,
) -> Patch:
    """All that a jet says, as far as its kind allows."""
    off = max(noise, fit.deviation)
    errors = forms.graph_errors(fit.derivatives, fit.derivative_factor, off, shape, direction)
    limit = max(CONFIDENT_DEVIATIONS * noise, CONFIDENT * pad.pitch)
    confidence = float(touched.mean()) / (1.0 + (fit.residual / limit) ** 2)
    patch = Patch(
        kind,
        fit.jet,
        shape.normal,
        confidence=0.0 if kind == "insufficient" else confidence,
        residual=fit.residual,
        normal_error=min(errors.normal, math.pi),
        place=np.array(fit.middle),
    )
    if kind != "smooth":
        return patch
    k1, k2, along_k1, umbilic = forms.principal_curvatures(shape)
    rounding = LEVEL / (pad.pitch * pad.cols)
    return patch._replace(
        principal=(k1, k2),
        across=forms.curvature_along(shape, direction),
        gaussian=k1 * k2,
        mean=0.5 * (k1 + k2),
        principal_direction=along_k1,
        umbilic=umbilic or 0.5 * (k1 - k2) <= max(DIRECTED * errors.difference, rounding),
        principal_error=errors.principal,
        across_error=errors.across,
        shape=shape,
        shape_covariance=errors.parts,
    )
