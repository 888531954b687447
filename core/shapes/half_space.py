"""Half-space: all that lies behind a plane. It has no bounds, but may cut what has."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.shapes.polytope import polytope_box


class HalfSpace:
    """The points p with normal p <= offset.

    Parameters
    ----------
    normal : (3,) array
        Outward normal of any length but 0.
    offset : float
        Distance of the plane from the origin along the normal, m.

    Raises
    ------
    ValueError
        If a number is not finite or the normal has no length.
    """

    def __init__(self, normal: Floats, offset: float):
        normal = finite_array("normal", normal, (3,))
        largest = float(np.abs(normal).max())
        if not largest > 0.0:
            raise ValueError("normal must have a length, got [0, 0, 0]")
        normal = normal / largest  # so that no square overflows, or is lost
        self.normal: Floats = normal / np.linalg.norm(normal)
        self.offset = float(finite_array("offset", offset, ()))

    def enclosure(self) -> Floats:
        """The box about it, (2, 3), infinite but for one side at most, m."""
        return polytope_box(self.normal[None], np.array([self.offset]))

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distance from the plane, negative inside, and its slope."""
        return points @ self.normal - self.offset, directions @ self.normal

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays are inside: see `spans`. A ray in the plane is inside."""
        height, rate = origins @ self.normal - self.offset, float(direction @ self.normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            way = -height / rate
        inside = height <= 0.0
        begin = np.where(inside, -np.inf, way if rate < 0.0 else np.inf)
        end = np.where(inside & (rate > 0.0), way, np.inf)
        return np.stack([begin, end], axis=1)[:, None]

    def complement(self) -> HalfSpace:
        """All that lies before the plane."""
        return HalfSpace(-self.normal, -self.offset)
