"""Contours as they were read from a file, in m, and what was done to get them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.felt.felt_points import FeltPoints


class PointsFound(NamedTuple):
    """What a file of points holds, in the file's own unit until `scaled`."""

    contours: tuple[Floats, ...]
    """(n, 3) each."""
    places: tuple[str, ...]
    """What each is called in messages: its number, and its lines where the file has any."""
    normals: tuple[Floats, ...] | None = None
    """(n, 3) each, outwards, or none."""
    felt: FeltPoints | None = None
    """Everything that was touched with the number of its touch, if that is known."""
    tops: Floats | None = None
    """(k, 3): where the ends were touched."""
    frame: Floats | None = None
    """Pose (7,) of the slicing frame, around whose z axis the contours run, in that of the points;
    the same if None."""
    notes: tuple[str, ...] = ()
    """What was done that a user should know, in sentences."""

    def scaled(self, metres: float) -> PointsFound:
        """Lengths times so much."""
        tops = None if self.tops is None else metres * self.tops
        frame = self.frame
        if frame is not None:
            frame = np.concatenate([metres * frame[:3], frame[3:]])
        felt = None if self.felt is None else self.felt._replace(points=metres * self.felt.points)
        contours = tuple(metres * one for one in self.contours)
        return self._replace(contours=contours, tops=tops, felt=felt, frame=frame)


def felt_of(
    contours: tuple[Floats, ...], normals: tuple[Floats, ...] | None, touches: Ints
) -> FeltPoints:
    """The points of contours as what touches, (n,) numbers from any on, have felt."""
    numbers = np.unique(touches, return_inverse=True)[1].reshape(-1).astype(np.int32)
    unit = None
    if normals is not None:
        stacked = np.concatenate(normals)
        lengths = np.linalg.norm(stacked, axis=1, keepdims=True)
        if (lengths > 0.0).all():
            unit = stacked / lengths
    return FeltPoints(np.concatenate(contours), unit, numbers)
