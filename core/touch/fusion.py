"""Curvature from several overlapping touches: a Kalman filter over the shape operator.

Fung, 1999, chapter 6, wishes for one over the derivatives of the tactile surface. The shape
operator is what these say of the surface itself: three numbers that two touches share, however
their pads were turned.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.touch.forms import Principal, ShapeOperator, principal

ISOTROPIC: Floats = np.diag([1.0, 0.5, 1.0])
"""Covariance of S11, S12, S22 if curvature is as likely to change in one direction as in any
other."""
ISOTROPIC.setflags(write=False)
SURPRISE = 7.815
"""Squared innovation that three degrees of freedom exceed once in 20 times."""
FORGET = 0.7
"""What a touch's evidence of how quickly curvature changes keeps with each later one."""


class Place(NamedTuple):
    """Curvature at one place of a surface, with its covariance."""

    point: Floats
    """Where, (3,), m."""
    shape: ShapeOperator
    """The shape operator there, its vectors in the same frame as `point`."""
    covariance: Floats
    """Of its three parts, (3, 3), 1/m^2."""


class Fused(NamedTuple):
    """What the touches so far say of the curvature at the last one's place."""

    place: Place
    """Curvature there."""
    changed: float
    """Squared changes of curvature beyond noise, weighted sum, 1/m^2; may be negative."""
    travelled: float
    """Squared distances over which they came about, likewise weighted, m^2."""
    surprise: float
    """Normalised squared innovation of the last touch: 3 on average if all is well; 0 for the
    first touch."""
    touches: int
    """How many touches went into it."""

    @property
    def principal(self) -> Principal:
        """Principal curvatures and direction."""
        return principal(self.place.shape)


def begin_fusion(felt: Place) -> Fused:
    """The first touch."""
    return Fused(felt, 0.0, 0.0, 0.0, 1)


def fuse(fused: Fused, felt: Place) -> Fused:
    """One more touch, which should overlap the last.

    Parameters
    ----------
    fused : Fused
        What was known.
    felt : Place
        What the touch says at its own place.

    Notes
    -----
    What was known is carried along the surface to the new place, where the curvature may have
    changed by a random amount that grows with the distance. How much is learnt from earlier
    touches: by as much as they differed beyond their noise. A touch that still surprises is
    given the change that explains it, so that a sudden bend is followed at once.
    """
    before, covariance = _carried(fused.place, felt.shape)
    seen = np.array(felt.shape.parts)
    innovation = seen - before
    certain = covariance + felt.covariance
    if not float(np.trace(certain)) > 0.0:  # nothing to weigh: both are exact
        return Fused(felt, fused.changed, fused.travelled, 0.0, fused.touches + 1)
    squared = float(((felt.point - fused.place.point) ** 2).sum())
    size = float(innovation @ innovation)
    changed = FORGET * fused.changed + size - float(np.trace(certain))
    travelled = FORGET * fused.travelled + float(np.trace(ISOTROPIC)) * squared
    learnt = fused.changed / fused.travelled if fused.travelled > 0.0 else 0.0
    drift = max(learnt, 0.0) * squared
    surprise = _squared(innovation, certain + drift * ISOTROPIC)
    if travelled > 0.0:
        drift = max(drift, changed / travelled * squared)
    if surprise > SURPRISE:
        drift = max(drift, size / float(np.trace(ISOTROPIC)))
    predicted = covariance + drift * ISOTROPIC
    total = predicted + felt.covariance
    gain = np.linalg.solve(total, predicted).T
    keep = np.eye(3) - gain
    # Joseph's form: a covariance stays one, whatever is rounded.
    left = keep @ predicted @ keep.T + gain @ felt.covariance @ gain.T
    parts = before + gain @ innovation
    shape = felt.shape._replace(parts=(float(parts[0]), float(parts[1]), float(parts[2])))
    place = Place(felt.point, shape, left)
    return Fused(place, changed, travelled, surprise, fused.touches + 1)


def _carried(place: Place, there: ShapeOperator) -> tuple[Floats, Floats]:
    """Parts and covariance in the tangents of another place: parallel transport."""
    one, other = place.shape.normal, there.normal
    axis, cosine = np.cross(one, other), float(one @ other)
    # The shortest turn from normal to normal, applied to the first tangent: Rodrigues.
    tangent = place.shape.tangents[0]
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


def _squared(innovation: Floats, covariance: Floats) -> float:
    """Innovation squared, in its own covariance."""
    root = np.linalg.cholesky(covariance)
    whitened = np.linalg.solve(root, innovation)
    return float(whitened @ whitened)
