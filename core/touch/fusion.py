"""Curvatures of overlapping touches, fused by a Kalman filter.

Fung, 1999, section 6.1, wishes for one over the derivatives of the tactile surface. Its state here
is the shape operator, which does not depend on how the pads are turned.
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
    """How the filter learns how quickly curvature changes along a surface."""

    # Squared innovation above which a touch is followed at once: chi-squared with three degrees of
    # freedom exceeds it in 5 % of cases.
    max_surprise: float = 7.815
    memory: float = 0.7  # weight of the evidence so far at each new touch
    min_cosine: float = 0.1  # between normal and pad axis; a jet is not corrected below it


@readable
class LocalCurvature(NamedTuple):
    """Curvature at one place of a surface, with its covariance."""

    point: Floats  # Where, (3,), m
    shape: forms.ShapeOperator  # The shape operator there, its vectors in the same frame as `point`
    covariance: Floats  # Of its three parts, (3, 3), 1/m^2


class FusedCurvature(NamedTuple):
    """What the touches so far say of the curvature at the last one's place."""

    place: LocalCurvature  # Curvature there
    changed: float  # Squared changes of curvature beyond noise, weighted, 1/m^2; may be negative
    travelled: float  # Squared distances over which they came about, likewise weighted, m^2
    # Normalised squared innovation of the last touch: 3 on average if all is well; 0 for the first
    # touch.
    surprise: float
    touches: int  # How many touches went into it

    @property
    def principal(self) -> forms.PrincipalCurvatures:
        """Principal curvatures and direction."""
        return forms.principal_curvatures(self.place.shape)


def begin_fusion(measured: LocalCurvature) -> FusedCurvature:
    """The first touch."""
    return FusedCurvature(measured, 0.0, 0.0, 0.0, 1)


def fuse(
    fused: FusedCurvature, measured: LocalCurvature, settings: FusionSettings = FusionSettings()
) -> FusedCurvature:
    """One more touch, which should overlap the last.

    What was known is carried along the surface to the new place, where the curvature may have
    changed by a random amount that grows with the distance. How much is learnt from earlier
    touches: by as much as they differed beyond their noise. A touch that still surprises is given
    the change that explains it, so that a sudden bend is followed at once.
    """
    before, covariance = _carried(fused.place, measured.shape)
    seen = np.array(measured.shape.parts)
    innovation = seen - before
    certain = covariance + measured.covariance
    if not float(np.trace(certain)) > 0.0:  # nothing to weigh: both are exact
        return FusedCurvature(measured, fused.changed, fused.travelled, 0.0, fused.touches + 1)
    squared = float(((measured.point - fused.place.point) ** 2).sum())
    size = float(innovation @ innovation)
    changed = settings.memory * fused.changed + size - float(np.trace(certain))
    travelled = settings.memory * fused.travelled + float(np.trace(forms.ISOTROPIC)) * squared
    learnt = fused.changed / fused.travelled if fused.travelled > 0.0 else 0.0
    drift = max(learnt, 0.0) * squared
    # The innovation in its own covariance.
    whitened = np.linalg.solve(np.linalg.cholesky(certain + drift * forms.ISOTROPIC), innovation)
    surprise = float(whitened @ whitened)
    if travelled > 0.0:
        drift = max(drift, changed / travelled * squared)
    if surprise > settings.max_surprise:
        drift = max(drift, size / float(np.trace(forms.ISOTROPIC)))
    predicted = covariance + drift * forms.ISOTROPIC
    gain = np.linalg.solve(predicted + measured.covariance, predicted).T
    keep = np.eye(3) - gain
    # Joseph's form: a covariance stays one, whatever is rounded.
    left = keep @ predicted @ keep.T + gain @ measured.covariance @ gain.T
    parts = before + gain @ innovation
    shape = measured.shape._replace(parts=(float(parts[0]), float(parts[1]), float(parts[2])))
    place = LocalCurvature(measured.point, shape, left)
    return FusedCurvature(place, changed, travelled, surprise, fused.touches + 1)


def _carried(place: LocalCurvature, there: forms.ShapeOperator) -> tuple[Floats, Floats]:
    """Parts and covariance in the tangents of another place: parallel transport."""
    one, other = place.shape.normal, there.normal
    axis, cosine = np.cross(one, other), float(one @ other)
    tangent = place.shape.tangents[0]  # Turned by the shortest way to the normal: Rodrigues
    turned = cosine * tangent + np.cross(axis, tangent)
    turned = turned + axis * (float(axis @ tangent) / max(1.0 + cosine, 1e-9))
    # The tangents of both may be of either hand.
    mirrored = float(np.linalg.det(np.vstack([place.shape.tangents, one]))) * float(
        np.linalg.det(np.vstack([there.tangents, other]))
    )
    u, v = (there.tangents @ turned).tolist()
    angle = math.atan2(v, u)
    c, s = math.cos(angle), math.sin(angle)
    flip = -1.0 if mirrored < 0.0 else 1.0
    # Old tangents, told in the new ones, are (c, s) and flip * (-s, c).
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
    height and slopes there are kept. The second derivatives of a graph are
    its second form times the length of its normal. The jet is unchanged if it is no quadric, or the
    surface is too steep.
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
