"""Point inversion: which parameters of a volume belong to a point of space."""

from __future__ import annotations

from typing import Literal

import numpy as np

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.splines.frame import Frame
from palpate.core.splines.inversion import Inversion, tolerance
from palpate.core.splines.invert_general import invert_general
from palpate.core.splines.invert_thesis import invert_thesis
from palpate.core.splines.monotone import invert_rising
from palpate.core.splines.placement import Regular, affine_image, regular_planes
from palpate.core.splines.volume import Volume

Method = Literal["auto", "general", "thesis"]


def invert(volume: Volume, points: Floats, *, method: Method = "auto") -> Inversion:
    """Parameters of points in a volume.

    Parameters
    ----------
    volume : Volume
        Polynomial or rational, undeformed or deformed, folded or not.
    points : (n, 3) array
        m.
    method : {"auto", "general", "thesis"}
        ``auto``: the closed form where the control points are an affine image of the Greville
        abscissae; three inversions of one variable where they lie on parallel planes; else
        ``general``, least squares in three variables. ``thesis``: the iteration of Fung, 1999,
        section 4.2.2, for comparison.

    Raises
    ------
    ValueError
        If points are not finite (n, 3), or the method is none of these.
    """
    points = finite_array("points", points, (None, 3))
    if method == "general":
        return invert_general(volume, points)
    if method == "thesis":
        return invert_thesis(volume, points)
    if method != "auto":
        raise ValueError(f"method must be auto, general or thesis, got {method!r}")
    frame = affine_image(volume)
    if frame is not None:
        return _closed_form(volume, frame, points)
    regular = regular_planes(volume)
    if regular is not None:
        return _axis_by_axis(volume, regular, points)
    return invert_general(volume, points)


def _closed_form(volume: Volume, frame: Frame, points: Floats) -> Inversion:
    parameters = frame.local(points)
    if parameters.min(initial=0.0) < 0.0 or parameters.max(initial=0.0) > 1.0:
        parameters = np.clip(parameters, 0.0, 1.0)
    left = frame.points(parameters) - points
    residual = np.sqrt(np.einsum("ni,ni->n", left, left))
    return _finish(volume, points, parameters, residual, np.zeros(len(points), np.int32))


def _axis_by_axis(volume: Volume, regular: Regular, points: Floats) -> Inversion:
    coordinates = regular.frame.local(points)
    roots = [
        invert_rising(basis, planes, values)
        for basis, planes, values in zip(volume.bases, regular.planes, coordinates.T, strict=True)
    ]
    left = np.stack([root.residual for root in roots], axis=1) @ regular.frame.edges
    parameters = np.stack([root.parameters for root in roots], axis=1)
    steps = np.max([root.steps for root in roots], axis=0)
    return _finish(volume, points, parameters, np.linalg.norm(left, axis=1), steps)


def _finish(
    volume: Volume, points: Floats, parameters: Floats, residual: Floats, steps: Ints
) -> Inversion:
    """The answer; points outside, for which clipping need not give the nearest, anew."""
    converged = residual <= tolerance(volume)
    folded = np.zeros(len(points), bool)  # neither kind of volume can fold
    outside = np.flatnonzero(~converged)
    if len(outside):
        nearest = invert_general(volume, points[outside])
        parameters[outside], residual[outside] = nearest.parameters, nearest.residual
        converged[outside], steps[outside] = nearest.converged, nearest.steps
    return Inversion(parameters, residual, converged, folded, steps)
