"""Normal and curvatures of a touched patch, with errors.

Fung, 1999, section 3.5, with a jet in place of the interpolating spline, which turns the noise of
single taxels into curvature.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
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
from palpate.core.touch.pad import DEFAULT_CONTACT, Pad
from palpate.reprs import readable

# [m] Longest lengths of a sensor; longer ones are in millimetres.
MAX_PITCH, MAX_THICKNESS, MAX_RADIUS, MAX_NOISE, MAX_CONTACT = 0.01, 0.05, 1.0, 1e-3, 1e-3
PAD_X_AXIS: Floats = np.array([1.0, 0.0, 0.0])
PatchKind = Literal["smooth", "edge", "corner", "insufficient", "miss", "invalid"]
# From pad, height, touched taxels and noise, as of `fit_patch`, to derivatives at the middle of the
# contact; None if there are too few taxels.
Estimator = Callable[[Pad, Floats, Bools, float], JetFit | None]
PAD_NORMAL: Floats = np.array([0.0, 0.0, -1.0])  # of a surface that faces the pad
ZERO: Floats = np.zeros(3)
for _shared in (PAD_NORMAL, ZERO):
    _shared.setflags(write=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class PatchSettings:
    """When a patch has curvatures and principal directions, and its confidence."""

    # The confidence is halved at the larger of both misfits.
    doubtful_misfit: float = 0.04  # [pitches]
    doubtful_sigmas: float = 4.0  # of a taxel's noise
    max_isolated_share: float = 0.5  # fraction of the touched taxels that touch without neighbours
    # k1 and k2 have directions if half their difference exceeds both.
    min_difference_sigmas: float = 3.0  # of its standard deviation
    curvature_rounding: float = 1e-9  # [1 / pad widths]


def surface_patch(
    compression: Floats,
    pitch: float,
    *,
    radius: float | None = None,
    noise: float = 0.0,
    contact: float = DEFAULT_CONTACT.min_compression,
    thickness: float | None = None,
    saturation: float = 1.0,
) -> Patch:
    """Normal, curvatures and verdict of one touch, from any array over an elastic pad.

    `compression` (rows, cols): compression of the pad under each taxel [m], at least 4 by 4. Row i
    lies at ``y = (i - (rows - 1) / 2) * pitch``. `pitch`: distance between neighbouring taxels [m].
    `radius`: of a domed pad [m]; None for a flat one. `noise`: standard deviation of one taxel [m],
    as far as known; a lower bound of the errors. `contact`: least compression that counts as
    touched [m]. `thickness`: of the pad [m], and `saturation`: largest compression as a fraction of
    it, if they are known: frames that read more are at fault. The patch is in the pad's frame: x
    along the columns, y along the rows, z into the object. Raises ValueError if the image is not a
    finite array of at least 4 by 4, or a length is not positive, or too long to be in metres.
    """
    image = finite_array("compression", compression, (None, None))
    if min(image.shape) < MIN_SIDE:
        raise ValueError(
            f"compression must be at least {MIN_SIDE} by {MIN_SIDE}, got {image.shape}"
        )
    if not 0.0 <= noise < np.inf:
        raise ValueError(f"noise must not be negative, got {noise} m")
    if not 0.0 < saturation <= 1.0:
        raise ValueError(f"saturation must be a fraction above 0 and at most 1, got {saturation}")
    positive("contact", contact, "m")
    thickness = positive("thickness", MAX_THICKNESS if thickness is None else thickness, "m")
    lengths = {
        "pitch": (pitch, MAX_PITCH),
        "thickness": (thickness, MAX_THICKNESS),
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
        thickness=thickness,
        dome=0.0 if radius is None else 1.0 / positive("radius", radius, "m"),
        saturation=saturation,
    )
    cleaned = clean(pad, image, noise, contact, "auto")
    if cleaned.fault != "none":
        return Patch("invalid", fault=cleaned.fault)
    surface = pad.surface(cleaned.compression, cleaned.touched)
    return fit_patch(pad, surface, cleaned.touched, PAD_X_AXIS, noise)


def _typical(image: Floats, contact: float) -> float:
    """Median absolute reading [m] of the taxels beyond contact; single taxels may read anything."""
    sizes = np.abs(image)
    return float(np.median(sizes[sizes > contact])) if (sizes > contact).any() else 0.0


@readable
class Patch(NamedTuple):
    """A touched patch of surface, in the pad's frame.

    Curvatures and their errors are 0 unless the patch is smooth. An ``invalid`` patch is from a
    frame that no surface can have made, because of its `fault`.
    """

    kind: PatchKind
    jet: Jet | None = None  # None if too few taxels were touched
    normal: Floats = PAD_NORMAL  # outward unit normal at the middle of the contact, (3,)
    principal: tuple[float, float] = (0.0, 0.0)  # [1/m] curvatures k1 >= k2; convex is positive
    across: float = 0.0  # [1/m] normal curvature along the requested direction
    confidence: float = 0.0  # from 0 to 1: fraction of taxels that touch, reduced by the misfit
    residual: float = 0.0  # [m] root mean square misfit of the jet
    gaussian: float = 0.0  # [1/m^2] product of the principal curvatures
    mean: float = 0.0  # [1/m] of the principal curvatures
    principal_direction: Floats = ZERO  # unit tangent of k1, (3,); zero unless smooth
    umbilic: bool = True  # whether k1 and k2 are equal within their errors: no direction counts
    normal_error: float = math.pi  # [rad] standard deviation of the normal; pi if it is unknown
    # [1/m] Standard deviations of the principal curvatures by noise alone: on balls below 20
    # pitches the misfit of a quartic adds to them.
    principal_error: tuple[float, float] = (0.0, 0.0)
    across_error: float = 0.0  # [1/m] standard deviation of `across`
    place: Floats = ZERO  # [m] of all these values: over the middle of the contact, (3,)
    shape: forms.ShapeOperator | None = None  # there; None unless the patch is smooth
    shape_covariance: Floats | None = None  # [1/m^2] of its parts, (3, 3); None unless smooth
    fault: FrameFault = "none"  # of the frame; ``saturated`` if only its top is cut off
    cut: Bools | None = None  # touched taxels left out as cut off, (rows, cols)


def fit_patch(
    pad: Pad,
    height: Floats,
    touched: Bools,
    direction: Floats,
    noise: float,
    estimator: Estimator = fit_jet,
    settings: PatchSettings = PatchSettings(),
) -> Patch:
    """Normal and curvatures of the touched surface, each with its standard error.

    `height` (rows, cols): surface over the plane of the pad's face [m]. `touched` (rows, cols) of
    bool: where the pad touches, without impulses. `direction` (3,): of the curvature `across`, in
    the pad's frame; its tangential part counts. `noise`: standard deviation of one taxel [m], as
    far as known; errors are for the larger of this and the misfit. `estimator`: gives normal and
    curvatures of a smooth surface; the jet decides whether it is smooth. Fung, 1999, section 3.5,
    with a jet in place of the interpolating spline, which turns taxels' noise into curvature
    (`palpate.core.thesis.fit_bspline`). Convex is positive, as (3.1) expects and (3.15) does not
    give. Taxels that read the same largest compression, as in a saturated array, are left out where
    the surface rises beyond it. Raises ValueError if `height` is not finite, or has another shape
    than the pad.
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
        return _fit_beside(pad, height, touched, cut, direction, noise, estimator, settings)
    return _fit_touched(pad, height, touched, direction, noise, estimator, settings)


def _fit_beside(
    pad: Pad,
    height: Floats,
    touched: Bools,
    cut: Bools,
    direction: Floats,
    noise: float,
    estimator: Estimator,
    settings: PatchSettings,
) -> Patch:
    """Patch of the taxels that are not cut off, with errors that allow for the others."""
    share = float(cut.sum() / touched.sum())
    patch = _fit_touched(pad, height, touched & ~cut, direction, noise, estimator, settings)
    patch = patch._replace(fault="saturated", cut=cut, confidence=patch.confidence * (1.0 - share))
    if patch.kind != "smooth" or patch.shape_covariance is None:
        return patch._replace(kind="insufficient", confidence=0.0)
    # The middle was not measured: its curvature may differ by this fraction of that beside it.
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
    settings: PatchSettings,
) -> Patch:
    """Patch of all touched taxels."""
    fit = fit_jet(pad, height, touched, noise)
    if fit is None:
        return Patch("insufficient")
    used = touched
    kind, shape = _classified(pad, height, touched, fit, noise, settings)
    outliers = None
    if kind in ("edge", "corner"):
        outliers = isolated_outliers(pad, height, touched, fit, noise)
    if outliers is not None:
        inliers = touched & ~outliers
        refit = fit_jet(pad, height, inliers, noise)
        if refit is not None:
            new_kind, new_shape = _classified(pad, height, inliers, refit, noise, settings)
            if new_kind == "smooth":
                kind, shape, fit, used = new_kind, new_shape, refit, inliers
    if kind == "smooth" and estimator is not fit_jet:
        estimate = estimator(pad, height, used, noise)
        if estimate is None:
            return Patch("insufficient")
        fit, shape = estimate, _shape(estimate)
    return _patch(pad, touched, direction, noise, kind, shape, fit, settings)


def _classified(
    pad: Pad, height: Floats, used: Bools, fit: JetFit, noise: float, settings: PatchSettings
) -> tuple[PatchKind, forms.ShapeOperator]:
    """Kind of the surface, and its jet's shape operator at the middle of the contact."""
    shape = _shape(fit)
    if fit.jet.degree < 2 or _isolated_share(used) > settings.max_isolated_share:
        return "insufficient", shape
    k1, k2, *_ = forms.principal_curvatures(shape)
    return classify_surface(pad, height, used, fit, max(abs(k1), abs(k2)), noise), shape


def _shape(fit: JetFit) -> forms.ShapeOperator:
    by_x, by_y, by_xx, by_xy, by_yy = fit.derivatives.tolist()
    return forms.graph_shape_operator((by_x, by_y), (by_xx, by_xy, by_yy))


def _isolated_share(touched: Bools) -> float:
    """Fraction of the touched taxels without a touched neighbour in their row or column."""
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
    settings: PatchSettings,
) -> Patch:
    """Patch with the values that its kind has."""
    deviation = max(noise, fit.deviation)
    errors = forms.graph_errors(fit.derivatives, fit.derivative_factor, deviation, shape, direction)
    limit = max(settings.doubtful_sigmas * noise, settings.doubtful_misfit * pad.pitch)
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
    rounding = settings.curvature_rounding / (pad.pitch * pad.cols)
    min_difference = max(settings.min_difference_sigmas * errors.difference, rounding)
    return patch._replace(
        principal=(k1, k2),
        across=forms.curvature_along(shape, direction),
        gaussian=k1 * k2,
        mean=0.5 * (k1 + k2),
        principal_direction=along_k1,
        umbilic=umbilic or 0.5 * (k1 - k2) <= min_difference,
        principal_error=errors.principal,
        across_error=errors.across,
        shape=shape,
        shape_covariance=errors.parts,
    )
