"""Free-form deformation: what stands in a control lattice moves as its control points do.

A point keeps its parameters: those that it has in the undeformed lattice are put into the deformed
one. Over a parallelepiped with control points at the Greville abscissae they are the point's
coordinates along the edges, and the displacement of the control points from there is all that
deforms. Lattices are made over a box, layer by layer, or by pulling points to targets; a report
proves that one folds nothing, or shows where it does.
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

LEAST_STRETCH = 1e-9  # Of the largest: what is squeezed more counts as squeezed by that much
SIDE = 4  # Control points across a layer, each way: the fewest that a cubic basis takes
LEAST_CHANGE = 0.005  # Of its volume: the least to which a part of the box may shrink
ACROSS, ALONG = 5, 257  # Places at which that is looked at, across the box each way and along it
NEGLIGIBLE = 1e-10  # Of the largest singular value: what moves the points less is left out
FOLD_SAMPLES = 25  # Along each axis, in the middle of equal steps, if no points are given
FOLD_ROUNDS = 4  # How often undecided pieces are halved
MOST_NUMBERS = 1 << 22  # Coefficients of pieces that are halved: more would take too much room
FoldVerdict = Literal["sound", "folded", "undecided"]


@readable
@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """A control lattice.

    `volume`: the deformed solid. `undeformed`: what it was: a parallelepiped with control points at
    the Greville abscissae, or control points anywhere, by which lattices of any shape can stand
    side by side (Coquillart, *Extended free-form deformation*, 1990) or at even steps (Fung, 1999,
    (2.19)). Fung, 1999, section 2.4. Points outside, by more than rounding, are refused.
    """

    volume: spline_volumes.SplineVolume
    undeformed: spline_volumes.Parallelepiped | spline_volumes.SplineVolume

    @property
    def control(self) -> Floats:
        """Control points (l, m, n, 3) along s, t, u, m."""
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

        Raises ValueError if points are not finite or lie outside: how many, and the worst of them.
        """
        points = finite_array("points", points, (None, 3))
        if isinstance(self.undeformed, spline_volumes.SplineVolume):
            found = invert_points(self.undeformed, points)
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

        Raises ValueError if points lie outside, here and below.
        """
        return self.volume.at(self.local(points))

    def jacobian(self, points: Floats) -> Floats:
        """Derivative of `deform` at points (n, 3): (n, 3, 3), a column for each of x, y, z.

        Where an undeformed lattice without parallelepiped is itself squeezed flat, directions that
        it does not span count as held.
        """
        return self.deform_with_jacobian(points)[1]

    def deform_with_jacobian(self, points: Floats) -> tuple[Floats, Floats]:
        """What `deform` and `jacobian` give, for little more than one of them costs."""
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
        """The deformed volume in such units that its slopes' determinant is the change of volume.

        Against the mean of the undeformed lattice where that is no parallelepiped; against 1 where
        it is squeezed flat.
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

        Against the mean of the undeformed lattice where that is no parallelepiped.
        """
        return spline_volumes.slope_determinant(self.relative, s, t, u)

    def deform_normals(self, points: Floats, normals: Floats) -> Floats:
        """Unit normals (n, 3) of a deformed surface, from normals (n, 3) at points (n, 3).

        Outwards stays outwards. They are finite where the lattice is squeezed flat, too. Raises
        ValueError if points lie outside, or a normal has no direction.
        """
        normals = finite_array("normals", normals, (len(points), 3))
        if not np.abs(normals).max(axis=1, initial=0.0).all():
            raise ValueError("normals must have a direction, got zero")
        return deformed_normals(self.jacobian(points), normals)

    def deform_mesh(self, vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
        """Vertices (n, 3) and triangles (m, 3) of a deformed surface.

        The triangles are turned round if the lattice mirrors, so that a closed surface keeps its
        outside. Raises ValueError if vertices lie outside, or a triangle has not three of them.
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


def _refuse(points: Floats, beyond: Floats, unit: str) -> None:
    if beyond.any():
        worst = int(beyond.argmax())
        x, y, z = points[worst]
        raise ValueError(
            f"points must lie in the lattice, got {np.count_nonzero(beyond)} of {len(points)} "
            f"outside, the worst ({x:g}, {y:g}, {z:g}) m by {beyond[worst]:g} {unit}"
        )


def deformed_normals(slopes: Floats, normals: Floats) -> Floats:
    """Unit normals (n, 3) after a deformation with derivatives (n, 3, 3).

    A normal follows the cofactors of the derivative, which need no inverse, with the sign of the
    determinant, so that what pointed outwards still does after a reflection. Where the derivative
    squeezes it to nothing, the limit of squeezing a little less is given.
    """
    size = np.abs(slopes).max(axis=(1, 2), keepdims=True)
    slopes = slopes / np.where(size > 0.0, size, 1.0)
    x, y, z = slopes.transpose(2, 0, 1)
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=2)
    volume = np.einsum("ni,ni->n", cofactors[:, :, 0], x)
    turned = np.where(volume < 0.0, -1.0, 1.0)[:, None] * (cofactors @ normals[:, :, None])[:, :, 0]
    length = np.linalg.norm(turned, axis=1)
    lost = ~(length > LEAST_STRETCH * np.linalg.norm(normals, axis=1))
    if lost.any():
        left, stretch, right = np.linalg.svd(slopes[lost])
        least = np.maximum(LEAST_STRETCH * stretch[:, :1], np.finfo(float).tiny)
        along = (right @ normals[lost][:, :, None])[:, :, 0] * (least / np.maximum(stretch, least))
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

    `low` (3,): smallest coordinates, m. `extent` (3,): edge lengths, m. `counts`: control points
    along x, y and z. `degree`: of all three bases; one less than a count makes them Bernstein
    polynomials there. Raises ValueError if a length is not positive, or a count not larger than the
    degree.
    """
    frame = spline_volumes.upright_parallelepiped(low, extent)
    s, t, u = (clamped_basis(count, degree) for count in counts)
    return Lattice(spline_volumes.SplineVolume(frame.greville_control((s, t, u)), (s, t, u)), frame)


@readable
class LatticeLayer(NamedTuple):
    """What happens to one layer of control points."""

    scale: float = 1.0  # Widens it about the z axis
    turn: float = 0.0  # Turns it about the z axis, rad
    shift: tuple[float, float] = (0.0, 0.0)  # Moves it along x and y, m


def layered_lattice(box: Floats, layers: Sequence[LatticeLayer]) -> Lattice:
    """A control lattice over a box, each layer scaled, turned, then shifted.

    `box` (2, 3): smallest and largest coordinates, m. `layers`: from the bottom to the top; at
    least 4.
    """
    lattice = box_lattice(box[0], box[1] - box[0], (SIDE, SIDE, len(layers)))
    control = lattice.control.copy()
    for number, layer in enumerate(layers):
        cosine, sine = math.cos(layer.turn), math.sin(layer.turn)
        turn = np.array([[cosine, sine], [-sine, cosine]])
        across = control[:, :, number, :2]
        control[:, :, number, :2] = layer.scale * across @ turn + np.array(layer.shift)
    return lattice.with_control(control)


def folded_share(lattice: Lattice) -> float:
    """Share of a lattice's box that is turned inside out or squeezed flat, 0 for a sound one."""
    across, along = np.linspace(0.0, 1.0, ACROSS), np.linspace(0.0, 1.0, ALONG)
    change = lattice.change_on_grid(across, across, along)
    return float((change <= LEAST_CHANGE).mean())


class Pulled(NamedTuple):
    """A lattice after its points were pulled."""

    lattice: Lattice  # With its control points moved
    # How far each point stays from its target, (n,), m: more than rounding where targets contradict
    # each other, as for one point pulled two ways.
    residual: Floats
    rank: int  # Independent points: fewer than there are where some follow from others
    condition: float  # Of those: largest over smallest singular value used; 1 without points


def pull_points(lattice: Lattice, points: Floats, targets: Floats) -> Pulled:
    """Move points of a lattice to targets by the least change of its control points.

    `lattice`: with or without weights, which stay. `points` (n, 3): points of the undeformed
    lattice, m. `targets` (n, 3): where they shall be after the deformation, m. Raises ValueError if
    shapes differ, something is not finite, or points lie outside the lattice. Hsu, Hughes and
    Kaufman, *Direct manipulation of free-form deformations*, 1992: the pseudo-inverse of the shares
    that control points have in points, by singular values.
    """
    points = finite_array("points", points, (None, 3))
    targets = finite_array("targets", targets, (len(points), 3))
    if not len(points):
        return Pulled(lattice, np.zeros(0), 0, 1.0)
    local = lattice.local(points)
    shares = lattice.volume.shares(local)
    touched = np.unique(shares.indices)
    left, values, right = np.linalg.svd(shares[:, touched].toarray(), full_matrices=False)
    rank = int(np.count_nonzero(values > NEGLIGIBLE * values[0]))
    offset = targets - lattice.volume.at(local)
    change = right[:rank].T @ ((left[:, :rank].T @ offset) / values[:rank, None])
    control = lattice.control.reshape(-1, 3).copy()
    control[touched] += change
    pulled = lattice.with_control(control.reshape(lattice.control.shape))
    residual = np.linalg.norm(pulled.volume.at(local) - targets, axis=1)
    return Pulled(pulled, residual, rank, float(values[0] / values[rank - 1]))


class FoldReport(NamedTuple):
    """What is known of a lattice's folds. Changes of volume are 1 where nothing is deformed."""

    verdict: FoldVerdict  # ``sound`` and ``folded`` are certain but for rounding, everywhere
    share: float  # Share of the samples at which space is turned inside out or squeezed flat
    least: float  # Least change of volume that was met
    where: Floats  # Parameters (3,) at which it was


def fold_report(lattice: Lattice, points: Floats | None = None) -> FoldReport:
    """Look for folds, and prove that there are none if that can be done.

    `lattice`: any. `points` (n, 3): where the share is taken, m; evenly over the lattice if left
    out. Raises ValueError if points lie outside the lattice. The determinant's coefficients over
    Bernstein polynomials enclose it (Gain and Dodgson, *Preventing self-intersection under
    free-form deformation*, 2001, bound it more loosely); pieces for which they have both signs are
    halved, and given up as undecided in the end. What is judged is the deformed volume: an
    undeformed one is taken to be sound.
    """
    if points is None:
        steps = (np.arange(FOLD_SAMPLES) + 0.5) / FOLD_SAMPLES
        change = lattice.change_on_grid(steps, steps, steps)
        grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
        change, places = change.ravel(), grid.reshape(-1, 3)
    else:
        change, places = lattice.jacobian_determinant(points), lattice.local(points)
    least, where = np.inf, np.full(3, 0.5)
    if len(change):
        least, where = float(change.min()), places[change.argmin()]
    verdict, corner = _judge(lattice)
    there = float(lattice.change_on_grid(*corner[:, None])[0, 0, 0])
    if there < least:  # seen by none of the samples
        least, where = there, corner
    share = float((change <= 0.0).mean()) if len(change) else 0.0
    return FoldReport(verdict, share, least, where)


def _judge(lattice: Lattice) -> tuple[FoldVerdict, Floats]:
    """The verdict, and the corner (3,) of a piece at which the determinant is least."""
    undecided, deepest, where = False, np.inf, np.full(3, 0.5)
    for pieces in spline_volumes.determinant_pieces(lattice.relative):
        for number in range(FOLD_ROUNDS + 1):
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
            # Halving makes no coefficient larger: what rounding hides stays hidden.
            hidden = np.abs(pieces.coefficients).max() <= pieces.rounding
            if hidden or number == FOLD_ROUNDS or pieces.coefficients.size > MOST_NUMBERS:
                undecided = True
                break
            pieces = spline_volumes.subdivide(pieces)
    return ("undecided" if undecided else "sound"), where


def _least_corner(pieces: spline_volumes.BernsteinPieces) -> tuple[float, Floats]:
    """Corner coefficients are values: the least of them, and where."""
    ends = np.ix_(range(len(pieces.low)), [0, -1], [0, -1], [0, -1])
    corners = pieces.coefficients[ends]
    piece, *corner = np.unravel_index(corners.argmin(), corners.shape)
    return float(corners.min()), pieces.low[piece] + np.array(corner) * pieces.width[piece]
