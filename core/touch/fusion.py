"""Curvatures of overlapping touches, fused by a Kalman filter.

Fung, 1999, section 6.1, suggests one over the derivatives of the tactile surface. Its state here is
the shape operator, which does not depend on how the pads are turned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.touch import forms
from palpate.core.touch.jet import Jet, taylor_coefficients
from palpate.reprs import readable


@dataclass(frozen=True, slots=True, kw_only=True)
class FusionSettings:
    """Estimate of the rate at which curvature changes along a surface."""

    # Squared innovation above which a touch is followed at once: chi-squared with three degrees of
    # freedom exceeds it in 5 % of cases.
    max_surprise: float = 7.815
    memory: float = 0.7  # factor of the weight of earlier touches at each new one
    min_cosine: float = 0.1  # between normal and pad axis; a jet is not corrected below it


@readable
class LocalCurvature(NamedTuple):
    """Curvature at one place of a surface, with its covariance."""

    point: Floats  # (3,) [m]
    shape: forms.ShapeOperator  # there, in the same frame as `point`
    covariance: Floats  # of its three parts, (3, 3) [1/m^2]


class FusedCurvature(NamedTuple):
    """Curvature at the last touch, estimated from all touches so far."""

    place: LocalCurvature
    changed: float  # [1/m^2] weighted squared changes of curvature beyond noise; may be negative
    travelled: float  # [m^2] equally weighted squared distances over which they occurred
    # Normalised squared innovation of the last touch: 3 on average if the model holds; 0 for the
    # first touch.
    surprise: float
    touches: int  # number of touches fused

    @property
    def principal(self) -> forms.PrincipalCurvatures:
        """Principal curvatures and direction."""
        return forms.principal_curvatures(self.place.shape)


def begin_fusion(measured: LocalCurvature) -> FusedCurvature:
    """State after the first touch."""
    return FusedCurvature(measured, 0.0, 0.0, 0.0, 1)


def fuse(
    fused: FusedCurvature, measured: LocalCurvature, settings: FusionSettings = FusionSettings()
) -> FusedCurvature:
    """One more touch, which should overlap the last.

    The estimate is transported along the surface to the new place, where the curvature may have
    changed by a random amount that grows with the distance. Its rate follows from the differences
    of earlier touches beyond their noise. If the innovation of a touch is still too large, the
    change that explains it is assumed, so that a sudden bend is followed at once.
    """
    before, covariance = _transported(fused.place, measured.shape)
    measured_parts = np.array(measured.shape.parts)
    innovation = measured_parts - before
    total = covariance + measured.covariance
    if not float(np.trace(total)) > 0.0:  # both are exact
        return FusedCurvature(measured, fused.changed, fused.travelled, 0.0, fused.touches + 1)
    squared = float(((measured.point - fused.place.point) ** 2).sum())
    size = float(innovation @ innovation)
    changed = settings.memory * fused.changed + size - float(np.trace(total))
    travelled = settings.memory * fused.travelled + float(np.trace(forms.ISOTROPIC)) * squared
    rate = fused.changed / fused.travelled if fused.travelled > 0.0 else 0.0
    drift = max(rate, 0.0) * squared
    whitened = np.linalg.solve(np.linalg.cholesky(total + drift * forms.ISOTROPIC), innovation)
    surprise = float(whitened @ whitened)
    if travelled > 0.0:
        drift = max(drift, changed / travelled * squared)
    if surprise > settings.max_surprise:
        drift = max(drift, size / float(np.trace(forms.ISOTROPIC)))
    predicted = covariance + drift * forms.ISOTROPIC
    gain = np.linalg.solve(predicted + measured.covariance, predicted).T
    keep = np.eye(3) - gain
    # Joseph's form keeps a covariance positive definite under rounding.
    posterior = keep @ predicted @ keep.T + gain @ measured.covariance @ gain.T
    parts = before + gain @ innovation
    shape = measured.shape._replace(parts=(float(parts[0]), float(parts[1]), float(parts[2])))
    place = LocalCurvature(measured.point, shape, posterior)
    return FusedCurvature(place, changed, travelled, surprise, fused.touches + 1)


def _transported(place: LocalCurvature, there: forms.ShapeOperator) -> tuple[Floats, Floats]:
    """Parts and covariance in the tangents of another place, by parallel transport."""
    normal, new_normal = place.shape.normal, there.normal
    axis, cosine = np.cross(normal, new_normal), float(normal @ new_normal)
    tangent = place.shape.tangents[0]  # turned like the normal (Rodrigues)
    turned = cosine * tangent + np.cross(axis, tangent)
    turned = turned + axis * (float(axis @ tangent) / max(1.0 + cosine, 1e-9))
    # Both pairs of tangents may be left- or right-handed.
    mirrored = float(np.linalg.det(np.vstack([place.shape.tangents, normal]))) * float(
        np.linalg.det(np.vstack([there.tangents, new_normal]))
    )
    u, v = (there.tangents @ turned).tolist()
    angle = math.atan2(v, u)
    c, s = math.cos(angle), math.sin(angle)
    flip = -1.0 if mirrored < 0.0 else 1.0
    # The old tangents in the new ones are (c, s) and flip * (-s, c).
    turn = np.array(
        [
            [c * c, -2.0 * flip * c * s, s * s],
            [c * s, flip * (c * c - s * s), -c * s],
            [s * s, 2.0 * flip * c * s, c * c],
        ]
    )
    return turn @ np.array(place.shape.parts), turn @ place.covariance @ turn.T


def curvature_error(shape: forms.ShapeOperator, covariance: Floats, direction: Floats) -> float:
    """Standard error of the normal curvature along a direction (3,) [1/m]; 0 along the normal.

    `covariance` (3, 3) is that of the shape operator's three parts [1/m^2].
    """
    components = forms.tangent_components(shape, direction)
    if components is None:
        return 0.0
    u, v = components
    gradient = np.array([u * u, 2.0 * u * v, v * v])
    return math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))


def corrected_jet(
    jet: Jet,
    measured: forms.ShapeOperator,
    fused: forms.ShapeOperator,
    place: tuple[float, float],
    settings: FusionSettings = FusionSettings(),
) -> Jet:
    """The jet with second derivatives changed from a measured to a fused shape operator.

    Both are in the pad's frame and have the same tangents. `place`: where they hold, x and y [m];
    height and slopes there are kept. The second derivatives of a graph are its second form times
    the length of its normal. The jet is unchanged if it is no quadric, or the surface is too steep.
    """
    cosine = abs(float(fused.normal[2]))
    if jet.degree < 2 or cosine < settings.min_cosine:
        return jet
    s11, s12, s22 = np.subtract(fused.parts, measured.parts).tolist()
    from_pad = np.linalg.inv(fused.tangents[:, :2].T)  # x and y to the tangents
    change = from_pad.T @ np.array([[s11, s12], [s12, s22]]) @ from_pad / cosine
    derivatives = np.array([0.0, 0.0, 0.0, change[0, 0], change[0, 1], change[1, 1]])
    coefficients = jet.coefficients.copy()
    coefficients[:6] += taylor_coefficients(*place, jet.scale) @ derivatives
    return Jet(coefficients, jet.scale)
