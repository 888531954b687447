"""Free-form deformation: what stands in a control lattice moves as its control points do.

A point keeps its parameters: those that it has in the undeformed lattice are put into the
deformed one. Over a parallelepiped with control points at the Greville abscissae they are the
point's coordinates along the edges, and the displacement of the control points from there is
all that deforms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.splines.basis import clamped_basis
from palpate.core.splines.determinant import extent, mean_determinant, scaled, slope_determinant
from palpate.core.splines.frame import Frame, upright_frame
from palpate.core.splines.invert import invert
from palpate.core.splines.knots import CUBIC
from palpate.core.splines.surface import deformed_normals, same_winding
from palpate.core.splines.volume import Volume


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """A control lattice.

    Parameters
    ----------
    volume : Volume
        The deformed solid.
    undeformed : Frame or Volume
        What it was: a parallelepiped with control points at the Greville abscissae, or control
        points anywhere, by which lattices of any shape can stand side by side (Coquillart,
        *Extended free-form deformation*, 1990) or at even steps (Fung, 1999, (2.19)).

    Notes
    -----
    Fung, 1999, section 2.4. Points outside, by more than rounding, are refused.
    """

    volume: Volume
    undeformed: Frame | Volume

    @property
    def control(self) -> Floats:
        """Control points (l, m, n, 3) along s, t, u, m."""
        return self.volume.control

    def with_control(self, control: Floats, weights: Floats | None = None) -> Lattice:
        """The same lattice with its control points (l, m, n, 3) elsewhere, and other weights.

        Raises
        ------
        ValueError
            If their shape differs, one is not finite, or a weight is not positive.
        """
        weights = self.volume.weights if weights is None else weights
        return Lattice(Volume(control, self.volume.bases, weights), self.undeformed)

    def local(self, points: Floats) -> Floats:
        """Parameters s, t, u (n, 3) of points (n, 3) in the undeformed lattice.

        Raises
        ------
        ValueError
            If points are not finite or lie outside: how many, and the worst of them.
        """
        points = finite_array("points", points, (None, 3))
        if isinstance(self.undeformed, Volume):
            found = invert(self.undeformed, points)
            _refuse(points, np.where(found.converged, 0.0, found.residual), "m")
            return found.parameters
        local = self.undeformed.local(points)
        clipped: Floats = np.clip(local, 0.0, 1.0)
        if (clipped != local).any():
            beyond = np.abs(local - clipped).max(axis=1)
            beyond[beyond <= self.undeformed.rounding(points)] = 0.0
            _refuse(points, beyond, "of an edge")
        return clipped

    def deform(self, points: Floats) -> Floats:
        """Where points (n, 3) of the undeformed lattice go, m.

        Raises
        ------
        ValueError
            If points lie outside, here and below.
        """
        return self.volume.at(self.local(points))

    def jacobian(self, points: Floats) -> Floats:
        """Derivative of `deform` at points (n, 3): (n, 3, 3), a column for each of x, y, z.

        Where an undeformed lattice without parallelepiped is itself squeezed flat, directions
        that it does not span count as held.
        """
        return self.deform_with_jacobian(points)[1]

    def deform_with_jacobian(self, points: Floats) -> tuple[Floats, Floats]:
        """What `deform` and `jacobian` give, for little more than one of them costs."""
        local = self.local(points)
        moved, slopes = self.volume.first(local)
        if isinstance(self.undeformed, Frame):
            return moved, slopes @ self.undeformed.inverse.T
        before = self.undeformed.first(local)[1]
        return moved, slopes @ np.linalg.pinv(before)

    def jacobian_determinant(self, points: Floats) -> Floats:
        """Local change of volume (n,): 1 where nothing is deformed, negative in a fold."""
        x, y, z = self.jacobian(points).transpose(2, 0, 1)
        determinant: Floats = np.einsum("ni,ni->n", np.cross(x, y), z)
        return determinant

    @property
    def relative(self) -> Volume:
        """The deformed volume in such units that its slopes' determinant is the change of volume.

        Against the mean of the undeformed lattice where that is no parallelepiped; against 1
        where it is squeezed flat.
        """
        if isinstance(self.undeformed, Frame):
            local = self.undeformed.local(self.control)
            return Volume(local, self.volume.bases, self.volume.weights)
        origin, size = self.undeformed.control[0, 0, 0], extent(self.undeformed)
        mean = mean_determinant(scaled(self.undeformed, origin, size))
        moved = scaled(self.volume, origin, size)
        unit = np.array([mean if mean else 1.0, 1.0, 1.0])
        return Volume(moved.control / unit, moved.bases, moved.weights)

    def change_on_grid(self, s: Floats, t: Floats, u: Floats) -> Floats:
        """Local change of volume on a grid of parameters (a,), (b,), (c,): (a, b, c).

        Against the mean of the undeformed lattice where that is no parallelepiped.
        """
        return slope_determinant(self.relative, s, t, u)

    def deform_normals(self, points: Floats, normals: Floats) -> Floats:
        """Unit normals (n, 3) of a deformed surface, from normals (n, 3) at points (n, 3).

        Outwards stays outwards. They are finite where the lattice is squeezed flat, too.

        Raises
        ------
        ValueError
            If points lie outside, or a normal has no direction.
        """
        normals = finite_array("normals", normals, (len(points), 3))
        if not np.abs(normals).max(axis=1, initial=0.0).all():
            raise ValueError("normals must have a direction, got zero")
        return deformed_normals(self.jacobian(points), normals)

    def deform_mesh(self, vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
        """Vertices (n, 3) and triangles (m, 3) of a deformed surface.

        The triangles are turned round if the lattice mirrors, so that a closed surface keeps
        its outside.

        Raises
        ------
        ValueError
            If vertices lie outside, or a triangle has not three of them.
        """
        vertices, faces = finite_array("vertices", vertices, (None, 3)), np.asarray(faces)
        if faces.shape[1:] != (3,):
            raise ValueError(f"faces must have shape (any, 3), got {faces.shape}")
        unknown = faces[(faces < 0) | (faces >= len(vertices))]
        if len(unknown):
            raise ValueError(f"faces must name the {len(vertices)} vertices, got {unknown[0]}")
        moved = self.deform(vertices)
        return moved, same_winding(vertices, moved, faces)


def box_lattice(
    low: Floats, extent: Floats, counts: tuple[int, int, int], degree: int = CUBIC
) -> Lattice:
    """An undeformed lattice over an upright box, with clamped uniform knots.

    Parameters
    ----------
    low : (3,) array
        Smallest coordinates, m.
    extent : (3,) array
        Edge lengths, m.
    counts : tuple of three integers
        Control points along x, y and z.
    degree : int
        Of all three bases; one less than a count makes them Bernstein polynomials there.

    Raises
    ------
    ValueError
        If a length is not positive, or a count not larger than the degree.
    """
    frame = upright_frame(low, extent)
    s, t, u = (clamped_basis(count, degree) for count in counts)
    return Lattice(Volume(frame.greville_control((s, t, u)), (s, t, u)), frame)


def _refuse(points: Floats, beyond: Floats, unit: str) -> None:
    """Refuse points that lie beyond the lattice."""
    if not beyond.any():
        return
    worst = int(beyond.argmax())
    x, y, z = points[worst]
    raise ValueError(
        f"points must lie in the lattice, got {np.count_nonzero(beyond)} of {len(points)} "
        f"outside, the worst ({x:g}, {y:g}, {z:g}) m by {beyond[worst]:g} {unit}"
    )
