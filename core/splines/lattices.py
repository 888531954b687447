"""Free-form deformation: objects in a control lattice move with its control points.

A point keeps its parameters: its parameters in the undeformed lattice are evaluated in the deformed
one. Over a parallelepiped with control points at the Greville abscissae they are the point's
coordinates along the edges, and only displaced control points deform. Lattices are made over a box,
layer by layer, or by pulling points to targets; a report proves that one has no folds, or shows
where it has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.geometry import signed_volume
from palpate.core.splines import spline_volumes
from palpate.core.splines.bases import CUBIC, clamped_basis
from palpate.core.splines.inversion import invert_points
from palpate.reprs import readable

FoldVerdict = Literal["sound", "folded", "undecided"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FoldSettings:
    """Search for folds of a lattice."""

    n_samples: int = 25  # along each axis, in the middle of equal steps, if there are no points
    max_halvings: int = 4  # of undecided pieces; more decide more, eight times as long for each
    max_coefficients: int = 1 << 22  # of halved pieces, to limit memory


@readable
@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """A control lattice.

    `volume`: the deformed solid. `undeformed`: its original: a parallelepiped with control points
    at the Greville abscissae, or control points anywhere, by which lattices of any shape can be
    joined (Coquillart, *Extended free-form deformation*, 1990) or at even steps (Fung, 1999,
    (2.19)). Fung, 1999, section 2.4. Points outside, by more than rounding, are refused.
    """

    volume: spline_volumes.SplineVolume
    undeformed: spline_volumes.Parallelepiped | spline_volumes.SplineVolume

    @property
    def control(self) -> Floats:
        """Control points (l, m, n, 3) along s, t, u [m]."""
        return self.volume.control

    def with_control(self, control: Floats, weights: Floats | None = None) -> Lattice:
        """The same lattice with its control points (l, m, n, 3) elsewhere, and other weights.

        Raises ValueError if their shape differs, one is not finite, or a weight is not positive.
        """
        weights = self.volume.weights if weights is None else weights
        volume = spline_volumes.SplineVolume(control, self.volume.bases, weights)
        return Lattice(volume, self.undeformed)

    def local(self, points: Floats) -> Floats:
        """Parameters s, t, u (n, 3) of points (n, 3) in the undeformed lattice.

        Raises ValueError if points are not finite or lie outside, with their number and the worst.
        """
        points = finite_array("points", points, (None, 3))
        if isinstance(self.undeformed, spline_volumes.SplineVolume):
            inversion = invert_points(self.undeformed, points)
            _check_inside(points, np.where(inversion.converged, 0.0, inversion.residual), "m")
            return inversion.parameters
        local = self.undeformed.local(points)
        clipped: Floats = np.clip(local, 0.0, 1.0)
        if (clipped != local).any():
            beyond = np.abs(local - clipped).max(axis=1)
            beyond[beyond <= self.undeformed.rounding(points)] = 0.0
            _check_inside(points, beyond, "of an edge")
        return clipped

    def deform(self, points: Floats) -> Floats:
        """Deformed points (n, 3) [m] of points in the undeformed lattice.

        Raises ValueError if points lie outside, here and below.
        """
        return self.volume.at(self.local(points))

    def jacobian(self, points: Floats) -> Floats:
        """Derivative of `deform` at points (n, 3): (n, 3, 3), a column for each of x, y, z.

        Where an undeformed lattice without parallelepiped is itself flat, directions that it does
        not span do not move.
        """
        return self.deform_with_jacobian(points)[1]

    def deform_with_jacobian(self, points: Floats) -> tuple[Floats, Floats]:
        """Results of `deform` and `jacobian` together, at the cost of one of them."""
        local = self.local(points)
        moved, slopes = self.volume.first(local)
        if isinstance(self.undeformed, spline_volumes.Parallelepiped):
            return moved, slopes @ self.undeformed.inverse.T
        return moved, slopes @ np.linalg.pinv(self.undeformed.first(local)[1])

    def jacobian_determinant(self, points: Floats) -> Floats:
        """Local change of volume (n,): 1 where nothing is deformed, negative in a fold."""
        x, y, z = self.jacobian(points).transpose(2, 0, 1)
        return np.asarray(np.einsum("ni,ni->n", np.cross(x, y), z))

    @property
    def relative(self) -> spline_volumes.SplineVolume:
        """The deformed volume in units in which its slopes' determinant is the change of volume.

        Relative to the mean of the undeformed lattice where that is no parallelepiped; to 1 where
        it is flat.
        """
        if isinstance(self.undeformed, spline_volumes.Parallelepiped):
            local = self.undeformed.local(self.control)
            return spline_volumes.SplineVolume(local, self.volume.bases, self.volume.weights)
        origin = self.undeformed.control[0, 0, 0]
        size = spline_volumes.control_extent(self.undeformed)
        before = spline_volumes.rescaled_volume(self.undeformed, origin, size)
        mean = spline_volumes.mean_determinant(before)
        moved = spline_volumes.rescaled_volume(self.volume, origin, size)
        unit = np.array([mean if mean else 1.0, 1.0, 1.0])
        return spline_volumes.SplineVolume(moved.control / unit, moved.bases, moved.weights)

    def change_on_grid(self, s: Floats, t: Floats, u: Floats) -> Floats:
        """Local change of volume on a grid of parameters (a,), (b,), (c,): (a, b, c).

        Relative to the mean of the undeformed lattice where that is no parallelepiped.
        """
        return spline_volumes.slope_determinant(self.relative, s, t, u)

    def deform_normals(self, points: Floats, normals: Floats) -> Floats:
        """Unit normals (n, 3) of a deformed surface, from normals (n, 3) at points (n, 3).

        Outward normals stay outward. They are finite where the lattice is flat, too. Raises
        ValueError if points lie outside, or a normal has no direction.
        """
        normals = finite_array("normals", normals, (len(points), 3))
        if not np.abs(normals).max(axis=1, initial=0.0).all():
            raise ValueError("normals must have a direction, got zero")
        return deformed_normals(self.jacobian(points), normals)

    def deform_mesh(self, vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
        """Vertices (n, 3) and triangles (m, 3) of a deformed surface.

        The triangles are reversed if the lattice mirrors, so that a closed surface keeps its
        outside. Raises ValueError if vertices lie outside, or a triangle has other vertices.
        """
        vertices, faces = finite_array("vertices", vertices, (None, 3)), np.asarray(faces)
        if faces.shape[1:] != (3,):
            raise ValueError(f"faces must have shape (any, 3), got {faces.shape}")
        unknown = faces[(faces < 0) | (faces >= len(vertices))]
        if len(unknown):
            raise ValueError(f"faces must name the {len(vertices)} vertices, got {unknown[0]}")
        moved = self.deform(vertices)
        mirrored = _handedness(vertices, faces) * _handedness(moved, faces) < 0.0
        return moved, faces[:, ::-1] if mirrored else faces


def _check_inside(points: Floats, beyond: Floats, unit: str) -> None:
    """Raise ValueError if points (n, 3) are outside, by distances (n,), 0 inside."""
    if beyond.any():
        worst = int(beyond.argmax())
        x, y, z = points[worst]
        raise ValueError(
            f"points must lie in the lattice, got {np.count_nonzero(beyond)} of {len(points)} "
            f"outside, the worst ({x:g}, {y:g}, {z:g}) m by {beyond[worst]:g} {unit}"
        )


def deformed_normals(slopes: Floats, normals: Floats, min_stretch: float = 1e-9) -> Floats:
    """Unit normals (n, 3) after a deformation with derivatives (n, 3, 3).

    A normal is transformed by the cofactors of the derivative, which need no inverse, with the sign
    of the determinant, so that it stays outward after a reflection. Where the cofactors vanish, the
    limit of small stretches is returned. `min_stretch`: over the largest; smaller ones are raised.
    """
    size = np.abs(slopes).max(axis=(1, 2), keepdims=True)
    slopes = slopes / np.where(size > 0.0, size, 1.0)
    x, y, z = slopes.transpose(2, 0, 1)
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=2)
    volume = np.einsum("ni,ni->n", cofactors[:, :, 0], x)
    turned = np.where(volume < 0.0, -1.0, 1.0)[:, None] * (cofactors @ normals[:, :, None])[:, :, 0]
    length = np.linalg.norm(turned, axis=1)
    lost = ~(length > min_stretch * np.linalg.norm(normals, axis=1))
    if lost.any():
        left, stretch, right = np.linalg.svd(slopes[lost])
        floor = np.maximum(min_stretch * stretch[:, :1], np.finfo(float).tiny)
        along = (right @ normals[lost][:, :, None])[:, :, 0] * (floor / np.maximum(stretch, floor))
        squeezed = (left @ along[:, :, None])[:, :, 0]
        turned[lost] = squeezed / np.abs(squeezed).max(axis=1, keepdims=True)
        length[lost] = np.linalg.norm(turned[lost], axis=1)
    return np.asarray(turned / length[:, None])


def _handedness(vertices: Floats, faces: Ints) -> float:
    """1, or -1 where faces enclose their volume clockwise; 0 where they enclose none."""
    if not len(faces):
        return 0.0
    size = float(np.ptp(vertices, axis=0).max())
    near = (vertices - vertices.mean(axis=0)) / (size if size > 0.0 else 1.0)
    return float(np.sign(signed_volume(near[faces])))


def box_lattice(
    low: Floats, extent: Floats, counts: tuple[int, int, int], degree: int = CUBIC
) -> Lattice:
    """An undeformed lattice over an upright box, with clamped uniform knots.

    `low` (3,): smallest coordinates [m]. `extent` (3,): edge lengths [m]. `counts`: control points
    along x, y and z. `degree`: of all three bases; one less than a count makes them Bernstein
    polynomials there. Raises ValueError if a length is not positive, or a count not larger than the
    degree.
    """
    frame = spline_volumes.upright_parallelepiped(low, extent)
    s, t, u = (clamped_basis(count, degree) for count in counts)
    return Lattice(spline_volumes.SplineVolume(frame.greville_control((s, t, u)), (s, t, u)), frame)


@readable
class LatticeLayer(NamedTuple):
    """Deformation of one layer of control points."""

    scale: float = 1.0  # about the z axis
    turn: float = 0.0  # [rad] about the z axis
    shift: tuple[float, float] = (0.0, 0.0)  # [m] along x and y


def layered_lattice(box: Floats, layers: Sequence[LatticeLayer]) -> Lattice:
    """A control lattice over a box, each layer scaled, turned, then shifted.

    `box` (2, 3): smallest and largest coordinates [m]. `layers`: from the bottom to the top; at
    least 4.
    """
    lattice = box_lattice(box[0], box[1] - box[0], (CUBIC + 1, CUBIC + 1, len(layers)))
    control = lattice.control.copy()
    for number, layer in enumerate(layers):
        cosine, sine = math.cos(layer.turn), math.sin(layer.turn)
        turn = np.array([[cosine, sine], [-sine, cosine]])
        across = control[:, :, number, :2]
        control[:, :, number, :2] = layer.scale * across @ turn + np.array(layer.shift)
    return lattice.with_control(control)


def folded_share(
    lattice: Lattice, *, min_change: float = 0.005, n_across: int = 5, n_along: int = 257
) -> float:
    """Fraction of a lattice's box that is turned inside out or nearly flat, 0 for a sound one.

    `min_change`: of the volume, to which a part of the box may shrink. `n_across`, `n_along`:
    samples along x and y, and along z.
    """
    across, along = np.linspace(0.0, 1.0, n_across), np.linspace(0.0, 1.0, n_along)
    change = lattice.change_on_grid(across, across, along)
    return float((change <= min_change).mean())


class Pulled(NamedTuple):
    """A lattice after its points were pulled to targets."""

    lattice: Lattice  # with moved control points
    # Distance of each point from its target, (n,) [m]: not 0 where targets contradict each other,
    # as for one point with two targets.
    residual: Floats
    rank: int  # number of independent points
    condition: float  # largest over smallest singular value used; 1 without points


def pull_points(lattice: Lattice, points: Floats, targets: Floats, rcond: float = 1e-10) -> Pulled:
    """Move points of a lattice to targets by the least change of its control points.

    `lattice`: with or without weights, which stay. `points` (n, 3): in the undeformed lattice [m].
    `targets` (n, 3): their places after the deformation [m]. `rcond`: singular values below this
    fraction of the largest are left out. Raises ValueError if shapes differ, values are not finite,
    or points lie outside the lattice. Hsu, Hughes and Kaufman, *Direct manipulation of free-form
    deformations*, 1992: the pseudo-inverse of the control points' weights in the points.
    """
    points = finite_array("points", points, (None, 3))
    targets = finite_array("targets", targets, (len(points), 3))
    if not len(points):
        return Pulled(lattice, np.zeros(0), 0, 1.0)
    local = lattice.local(points)
    shares = lattice.volume.shares(local)
    touched = np.unique(shares.indices)
    left, values, right = np.linalg.svd(shares[:, touched].toarray(), full_matrices=False)
    rank = int(np.count_nonzero(values > rcond * values[0]))
    offset = targets - lattice.volume.at(local)
    change = right[:rank].T @ ((left[:, :rank].T @ offset) / values[:rank, None])
    control = lattice.control.reshape(-1, 3).copy()
    control[touched] += change
    pulled = lattice.with_control(control.reshape(lattice.control.shape))
    residual = np.linalg.norm(pulled.volume.at(local) - targets, axis=1)
    return Pulled(pulled, residual, rank, float(values[0] / values[rank - 1]))


class FoldReport(NamedTuple):
    """Folds of a lattice. Changes of volume are 1 where nothing is deformed."""

    # ``sound`` and ``folded`` are proved for the whole lattice, up to rounding; ``undecided`` says
    # nothing.
    verdict: FoldVerdict
    share: float  # fraction of the samples at which space is inside out or flat
    least: float  # change of volume, of all that were evaluated
    where: Floats  # parameters (3,) of the least change


def fold_report(
    lattice: Lattice, points: Floats | None = None, settings: FoldSettings = FoldSettings()
) -> FoldReport:
    """Search for folds, and prove that there are none if possible.

    `points` (n, 3): samples of the share [m]; None: evenly over the lattice. Raises ValueError if
    points lie outside the lattice. The determinant's coefficients over Bernstein polynomials
    enclose it (Gain and Dodgson, *Preventing self-intersection under free-form deformation*, 2001,
    bound it more loosely); pieces for which they have both signs are halved, and are undecided in
    the end. Only the deformed volume is tested: the undeformed one is assumed to be sound.
    """
    if points is None:
        steps = (np.arange(settings.n_samples) + 0.5) / settings.n_samples
        change = lattice.change_on_grid(steps, steps, steps)
        grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
        change, places = change.ravel(), grid.reshape(-1, 3)
    else:
        change, places = lattice.jacobian_determinant(points), lattice.local(points)
    least, where = np.inf, np.full(3, 0.5)
    if len(change):
        least, where = float(change.min()), places[change.argmin()]
    verdict, corner = _prove(lattice, settings)
    there = float(lattice.change_on_grid(*corner[:, None])[0, 0, 0])
    if there < least:  # not at a sample
        least, where = there, corner
    share = float((change <= 0.0).mean()) if len(change) else 0.0
    return FoldReport(verdict, share, least, where)


def _prove(lattice: Lattice, settings: FoldSettings) -> tuple[FoldVerdict, Floats]:
    """Verdict, and the corner (3,) of a piece with the least determinant."""
    undecided, deepest, where = False, np.inf, np.full(3, 0.5)
    for pieces in spline_volumes.determinant_pieces(lattice.relative):
        for number in range(settings.max_halvings + 1):
            corner, place = _least_corner(pieces)
            if corner < deepest:
                deepest, where = corner, place
            if corner < -pieces.rounding:
                return "folded", where
            may_fold = pieces.coefficients.min(axis=(1, 2, 3)) <= pieces.rounding
            low, width, coefficients = (part[may_fold] for part in pieces[:3])
            pieces = spline_volumes.BernsteinPieces(low, width, coefficients, pieces.rounding)
            if not len(pieces.low):
                break
            # Halving makes no coefficient larger: those within rounding stay there.
            hidden = np.abs(pieces.coefficients).max() <= pieces.rounding
            too_many = pieces.coefficients.size > settings.max_coefficients
            if hidden or number == settings.max_halvings or too_many:
                undecided = True
                break
            pieces = spline_volumes.subdivide(pieces)
    return ("undecided" if undecided else "sound"), where


def _least_corner(pieces: spline_volumes.BernsteinPieces) -> tuple[float, Floats]:
    """Least corner coefficient, which is a value of the determinant, and its place."""
    ends = np.ix_(range(len(pieces.low)), [0, -1], [0, -1], [0, -1])
    corners = pieces.coefficients[ends]
    piece, *corner = np.unravel_index(corners.argmin(), corners.shape)
    return float(corners.min()), pieces.low[piece] + np.array(corner) * pieces.width[piece]
