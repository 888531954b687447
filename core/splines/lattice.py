"""Free-form deformation by a B-spline control lattice.

A box is spanned by a grid of control points; a point in the box moves as they do. With the
control points at the Greville abscissae the deformation is the identity, so that the
displacement of the control points from there is all that deforms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.basis import clamped_matrix, clamped_slopes, greville


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """A control lattice over an upright box.

    Parameters
    ----------
    control : (layers, columns, rows, 3) array
        Control points, m; at least 4 along z, x and y: the basis is cubic.
    low : (3,) array
        Smallest coordinates of the undeformed box, m.
    extent : (3,) array
        Its edge lengths, m.

    Raises
    ------
    ValueError
        If there are fewer than 4 control points along an axis, or the box is flat.

    Notes
    -----
    Fung, 1999, section 2.4, with edge vectors instead of the unit vectors of (2.17) to (2.19).
    """

    control: Floats
    low: Floats
    extent: Floats

    def __post_init__(self) -> None:
        control = finite_array("control", self.control, (None, None, None, 3))
        if min(control.shape[:3]) < 4:
            raise ValueError(f"control needs 4 points along each axis, got {control.shape[:3]}")
        extent = finite_array("extent", self.extent, (3,))
        if not (extent > 0).all():
            raise ValueError(f"extent must be positive, got {extent.tolist()} m")
        object.__setattr__(self, "control", control)
        object.__setattr__(self, "low", finite_array("low", self.low, (3,)))
        object.__setattr__(self, "extent", extent)

    def deform(self, points: Floats) -> Floats:
        """Where points (n, 3) of the box go; points outside move as the nearest face does."""
        along, x, y = self._bases(points)
        return self._combine(along, x, y)

    def jacobian(self, points: Floats) -> Floats:
        """Derivative of `deform` at points (n, 3): (n, 3, 3), a column for each of x, y, z."""
        along, x, y = self._bases(points)
        local = (points - self.low) / self.extent
        layers, columns, rows = self.control.shape[:3]
        by_x = self._combine(along, clamped_slopes(local[:, 0], columns), y)
        by_y = self._combine(along, x, clamped_slopes(local[:, 1], rows))
        by_z = self._combine(clamped_slopes(local[:, 2], layers), x, y)
        result: Floats = np.stack([by_x, by_y, by_z], axis=2) / self.extent
        return result

    def jacobian_determinant(self, points: Floats) -> Floats:
        """Local change of volume (n,): 1 where nothing is deformed, negative in a fold."""
        by_x, by_y, by_z = self.jacobian(points).transpose(2, 0, 1)
        result: Floats = np.einsum("ni,ni->n", np.cross(by_x, by_y), by_z)
        return result

    def _bases(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        layers, columns, rows = self.control.shape[:3]
        local = (points - self.low) / self.extent
        return (
            clamped_matrix(local[:, 2], layers).toarray(),
            clamped_matrix(local[:, 0], columns).toarray(),
            clamped_matrix(local[:, 1], rows).toarray(),
        )

    def _combine(self, along: Floats, x: Floats, y: Floats) -> Floats:
        layers, columns, rows = self.control.shape[:3]
        section = (x[:, :, None] * y[:, None, :]).reshape(len(x), columns * rows)
        by_layer = section @ self.control.reshape(layers, columns * rows, 3)  # (layers, n, 3)
        result: Floats = np.einsum("nl,lnc->nc", along, by_layer)
        return result


def undeformed_control(low: Floats, extent: Floats, counts: tuple[int, int, int]) -> Floats:
    """Control points (layers, columns, rows, 3) that deform nothing; counts in that order."""
    layers, columns, rows = (greville(count) for count in counts)
    z, x, y = np.meshgrid(layers, columns, rows, indexing="ij")
    result: Floats = low + extent * np.stack([x, y, z], axis=-1)
    return result
