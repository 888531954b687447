"""How the control points of a volume are placed: what is known of it without any iteration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.frame import Frame
from palpate.core.splines.volume import Volume

ROUNDING = 16 * float(np.finfo(float).eps)
"""Of the largest coordinate: control points that are off by less are where they should be."""


class Regular(NamedTuple):
    """Control points on three families of parallel planes."""

    frame: Frame
    """From one corner control point to the three next to it."""
    planes: tuple[Floats, Floats, Floats]
    """Where the planes cut the frame's edges, rising from 0 to 1: (l,), (m,), (n,)."""


def affine_image(volume: Volume) -> Frame | None:
    """The parallelepiped of which a volume is an undeformed lattice, or None.

    Then the volume is the affine map of its parameters, whatever the bases: coefficients at
    the Greville abscissae reproduce the identity.
    """
    if _has_unequal_weights(volume):
        return None
    places = [basis.greville() for basis in volume.bases]
    control, corner = volume.control, volume.control[0, 0, 0]
    ends = np.stack([control[-1, 0, 0], control[0, -1, 0], control[0, 0, -1]])
    edges = (ends - corner) / np.array([[place[-1] - place[0]] for place in places])
    frame = _frame(corner - np.array([place[0] for place in places]) @ edges, edges)
    if frame is None:
        return None
    off = float(np.abs(frame.greville_control(volume.bases) - control).max())
    return frame if off <= _allowed(control) else None


def regular_planes(volume: Volume) -> Regular | None:
    """The planes on which a volume's control points lie, or None if they are not regular.

    Then each parameter depends on one coordinate alone, for the bases sum to 1 along the
    others.
    """
    if _has_unequal_weights(volume):
        return None
    control, corner = volume.control, volume.control[0, 0, 0]
    ends = np.stack([control[-1, 0, 0], control[0, -1, 0], control[0, 0, -1]])
    frame = _frame(corner, ends - corner)
    if frame is None:
        return None
    local = frame.local(control.reshape(-1, 3)).reshape(control.shape)
    planes = local[:, 0, 0, 0], local[0, :, 0, 1], local[0, 0, :, 2]
    again = frame.points(np.stack(np.meshgrid(*planes, indexing="ij"), axis=-1))
    off = float(np.abs(again - control).max())
    rising = all((np.diff(plane) > 0.0).all() for plane in planes)
    return Regular(frame, planes) if rising and off <= _allowed(control) else None


def affine_fit(volume: Volume) -> Floats:
    """The affine map from points to parameters that fits the control points best.

    (4, 3): points with a 1 behind, times this, are parameters.
    """
    places = np.meshgrid(*(basis.greville() for basis in volume.bases), indexing="ij")
    wanted = np.stack(places, axis=-1).reshape(-1, 3)
    points = volume.control.reshape(-1, 3)
    middle = points.mean(axis=0)
    size = max(float(np.ptp(points, axis=0).max()), np.finfo(float).tiny)
    rows = np.column_stack([(points - middle) / size, np.ones(len(points))])
    solution = np.linalg.lstsq(rows, wanted, rcond=1e-12)[0]
    matrix = np.concatenate([solution[:3] / size, solution[3:]])
    matrix[3] -= middle @ matrix[:3]
    return matrix


def _allowed(control: Floats) -> float:
    return ROUNDING * float(np.abs(control).max())


def _frame(corner: Floats, edges: Floats) -> Frame | None:
    try:
        return Frame(corner, edges)
    except ValueError:  # flat: no parallelepiped
        return None


def _has_unequal_weights(volume: Volume) -> bool:
    return volume.weights is not None and bool(np.ptp(volume.weights) > 0.0)
