"""A solid of any genus: where an implicit spline over a narrow band is negative; how far it is off.

A coarse solid tells which places lie inside; the band are the cells at its surface and those that
were touched; over them the spline is fitted. Beyond the band the coarse solid goes on. An object
that stands is cut off at its platform. Parts that no touch supports, and hollows that none has
reached, are nothing but ripples of the fit, and are left out.

How far it is off depends on the distance from what was touched, and its bend (`errors`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry import DEFAULT_MESH, nearest_points, nearest_search, point_tree
from palpate.core.poses import Pose
from palpate.core.rebuild.contours import ContactPoints, checked_contacts
from palpate.core.rebuild.general.band import basis_values
from palpate.core.rebuild.general.edges import EDGES, Edges, find_edges, sharpened
from palpate.core.rebuild.general.errors import (
    ERRORS,
    SurfaceErrors,
    surface_bends,
    touch_distances,
)
from palpate.core.rebuild.general.fitting import (
    ImplicitFit,
    TouchedPoints,
    Weights,
    refit_locally,
)
from palpate.core.rebuild.general.topology import CoarseSolid
from palpate.core.rebuild.protocol import Closest, Solid
from palpate.core.shapes import Mesh, grid_surface, without_crossings

FINE, COARSE = 4.0e-3, 5.0e-3  # Edge of a cell in the end, and before it, m
POINT, NORMAL = 0.06e-3, 0.2  # Standard deviations of a touched point, m, and of its normal
VARIATION, ANCHOR = 0.05, 1e6  # m and 1/m^5: of the energy's last two terms
DETAIL = 3.0  # Power of a cell's edge by which variation counts less in finer ones
POSE = 0.1e-3  # Of a touch's displacement, m
PROJECTIONS = 2
RETREATS = 20  # Rounds in which vertices of faces that cross go back to where they came from
LEAST_PART = 0.02  # Of what was touched: a part with less of it is no part of the object
LOCAL_REACH = 12.0e-3  # Of a touch: the solid is fitted anew so far about it, m
LEAST_SLOPE = 0.2  # Of the spline's gradient: a flatter one is no distance
LOWEST = 0.5  # Percent of the points: those are not the height above which an object was touched
FARTHEST = 15.0e-3  # m


@dataclass(frozen=True, slots=True)
class ProtrusionSettings:
    """The error of surface beyond the convex hull of all touched points."""

    min_height: float = 1.0e-3  # [m] over the hull: the error is the height over this
    bound_factor: float = 1.5  # of a bound, over that error
    # The hull is that of one point for each cube of the larger of both edges.
    grid: float = 2.0e-3  # [m]
    grid_share: float = 0.01  # fraction of the extent of the touched points
    n_pairs: int = 1_000_000  # of a place and a face of the hull, compared at a time


PROTRUSIONS = ProtrusionSettings()


@dataclass(frozen=True, eq=False)
class GeneralSolid(Solid):
    """A solid as an implicit spline; lengths in m, places in the world."""

    origin: Floats  # Of the cells, (3,), on the platform
    cell: float  # Edge of a cell
    fit: ImplicitFit  # In cells
    coarse: CoarseSolid  # Beyond the band
    contacts: ContactPoints  # What was touched
    platform: float | None
    predicted: SurfaceErrors  # How far it is off, m
    pose: float  # Standard deviation of the error of a touch's place
    # How often the object had been turned over before each touch, (t,); empty: never
    placement: Ints = field(default_factory=lambda: np.zeros(0, np.int32))
    # What moves `contacts` of each later placement to where they fit
    motions: tuple[Pose, ...] = ()
    tried_walls: int = 0  # Touches with which cells as small as its walls tore it no less; 0: never

    def evaluate(self, places: Floats) -> tuple[Floats, Floats]:
        """The spline, m, and its gradient at places (n, 3): (n,), (n, 3); NaN beyond the band."""
        value, gradient = self.fit.band.evaluate(
            self.fit.control, (places - self.origin) / self.cell
        )
        return value * self.cell, gradient

    def project(self, places: Floats, flat: Bools | None = None) -> Floats:
        """Places (n, 3) moved onto the surface along the gradient; `flat` (n,) stay level."""
        for _ in range(PROJECTIONS):
            value, gradient = self.evaluate(places)
            if flat is not None:
                gradient[flat, 2] = 0.0
            square = np.maximum((gradient**2).sum(axis=1), LEAST_SLOPE**2)
            step = (value / square)[:, None] * gradient
            small = np.linalg.norm(step, axis=1) < self.cell  # false where it is NaN
            places = np.where(small[:, None], places - step, places)
        return places

    def mesh(self, parts: int = 2) -> Mesh:
        """Triangles, closed, with vertices on the surface; each cell is cut into `parts`.

        At sharp edges they lie on the faces that meet there. Vertices stay where the grid has them
        where the surface is so sharp that, moved onto it, their triangles would cross.
        """
        places, moved, faces = self._surface(parts)
        vertices = without_crossings(places, moved, faces, RETREATS)
        if self.edges is None:
            return Mesh(vertices, faces)
        sharp = sharpened(self.edges, vertices, faces)
        if self.platform is not None:
            standing = vertices[:, 2] <= self.platform
            sharp[standing] = vertices[standing]
            sharp[:, 2] = np.maximum(sharp[:, 2], self.platform)
        return Mesh(without_crossings(vertices, sharp, faces, RETREATS), faces)

    @cached_property
    def edges(self) -> Edges | None:
        """Its sharp edges, as touched points on both sides tell; None if there are none."""
        vertices = self._surface(2)[1]
        touched, normals = self.contacts.points, np.asarray(self.contacts.normals)
        touched = touched + self.cell * self.fit.displacements[self.contacts.touch]
        return find_edges(vertices[self.bends(vertices) > EDGES.min_bend], touched, normals)

    @property
    def rough_mesh(self) -> Mesh:
        """Triangles for a look on the way: at sharp edges some may cross."""
        return self._rough[1]

    @property
    def rough_parts(self) -> int:
        """Into how many parts it cuts cells: 2 where an end is so thin that whole ones lose it."""
        return self._rough[0]

    @cached_property
    def _rough(self) -> tuple[int, Mesh]:
        _, moved, faces = self._surface(1)
        if self.cell >= FINE and len(moved):
            away = point_tree(moved, balanced=False).query(self.contacts.points)[0]
            if np.max(away) > self.cell:
                return 2, self.plain_mesh(2)
        return 1, Mesh(moved, faces)

    def plain_mesh(self, parts: int) -> Mesh:
        """Triangles of cells cut into `parts`: edges are round, and some may cross there."""
        return Mesh(*self._surface(parts)[1:])

    def _surface(self, parts: int) -> tuple[Floats, Floats, Ints]:
        """Vertices (n, 3) on the grid, moved onto the surface, m, and their faces (m, 3)."""
        corner, values = self._volume(parts)
        step = self.cell / parts
        standing = self.platform is not None
        inside = self._supported(values < 0.0, corner, step)
        values = np.where(inside, np.minimum(values, -1e-6), np.maximum(values, 1e-6))
        vertices, faces = grid_surface(values, level_bottom=standing)
        flat = (vertices[:, 2] == 0.0) & standing
        places = self.origin + (vertices + corner) * step
        moved = self.project(places, flat)
        near = np.linalg.norm(moved - places, axis=1) < step
        moved = np.where(near[:, None], moved, places)
        if standing:
            for one in (places, moved):
                one[:, 2] = np.maximum(one[:, 2], self.origin[2])
                one[flat, 2] = self.origin[2]
        return places, moved, faces

    def bends(self, places: Floats) -> Floats:
        """By how much (n,) the surface turns about places (n, 3) on it, within 3 mm [rad]."""
        reach = ERRORS.bend_reach / self.cell
        return surface_bends(self.fit, (places - self.origin) / self.cell, reach)

    def is_sharp(self, places: Floats) -> Bools:
        """Which places (n, 3) of the surface lie on the faces that meet at a sharp edge."""
        if self.edges is None:
            return np.zeros(len(places), np.bool_)
        return np.asarray(point_tree(self.edges.places).query(places)[0] < EDGES.moved)

    def __repr__(self) -> str:
        return f"<GeneralSolid {self._size()} m, of {len(self.fit.displacements)} touches>"

    def closest(self, points: ArrayLike) -> Closest:
        """As `Solid.closest`, moved from the mesh onto the spline where that is the surface.

        It is not where the solid is cut off at its platform, near to its sharp edges, or where the
        spline's gradient and the mesh's normal point apart.
        """
        found = self.final_mesh.closest(points)
        places = self.project(found.points)
        gradient = self.evaluate(places)[1]
        slope = np.linalg.norm(gradient, axis=1, keepdims=True)
        normals = gradient / np.maximum(slope, LEAST_SLOPE)
        along = np.einsum("ni,ni->n", normals, found.normals)
        on_spline = (along > np.cos(DEFAULT_MESH.sharp_angle)) & (
            slope[:, 0] >= LEAST_SLOPE
        )  # False where it is NaN
        if self.platform is not None:
            on_spline &= found.points[:, 2] > self.platform
        on_spline &= ~self.is_sharp(found.points)
        places = np.where(on_spline[:, None], places, found.points)
        normals = np.where(on_spline[:, None], normals, found.normals)
        offset = np.asarray(points, np.float64).reshape(-1, 3) - places
        distances = np.linalg.norm(offset, axis=1)
        side = np.where(
            on_spline & (distances < self.cell),
            np.einsum("ni,ni->n", offset, normals),
            found.distances,
        )
        return Closest(places, normals, np.where(side < 0.0, -distances, distances))

    def residuals(self, places: Floats) -> Floats:
        """Distances (n,) of places (n, 3) from the surface, m: to first order where it is near."""
        value, gradient = self.evaluate(places)
        slope = np.maximum(np.linalg.norm(gradient, axis=1), LEAST_SLOPE)
        found = np.abs(value) / slope
        far = ~(found < self.cell)
        if far.any():
            mesh = self.rough_mesh
            search = nearest_search(mesh.vertices[mesh.faces])
            found[far] = nearest_points(search, places[far]).distances
        return np.asarray(found)

    def expected_errors(self, places: Floats) -> tuple[Floats, Floats]:
        """Errors that are expected at places (n, 3) of its surface, and their bounds of 95 %, m."""
        distances = touch_distances(self.contacts, places)
        errors, bounds = self.predicted.at(places - self.origin, distances)
        outer = distances > PROTRUSIONS.min_height  # no other place lies as far over the hull
        beyond = protrusions(self.contacts.points, places[outer]) - PROTRUSIONS.min_height
        errors[outer] = np.maximum(errors[outer], beyond)
        bounds[outer] = np.maximum(bounds[outer], PROTRUSIONS.bound_factor * beyond)
        return errors, bounds

    def covers(self, places: Floats) -> bool:
        """Whether all places (n, 3) lie in the band, so that `update` takes them up."""
        cells = np.floor((places - self.origin) / self.cell).astype(np.int32)
        return bool((self.fit.band.find(cells) >= 0).all())

    def update(self, touched: ContactPoints, placement: int = 0) -> GeneralSolid:
        """The solid with what one touch more has touched, fitted anew within `LOCAL_REACH` of it.

        `placement`: how often the object had been turned over before. Elsewhere the solid stays as
        it is, so that a touch takes the same time however many there were.
        Topology stays, too: what lies beyond the band counts at the next `rebuild_general`.
        """
        touched = checked_contacts(touched)
        if touched.normals is None or not len(touched.points):
            return self
        first = len(self.fit.displacements)
        more = touched._replace(touch=touched.touch + np.int32(first))
        places = (more.points - self.origin) / self.cell
        points = TouchedPoints(places, np.asarray(more.normals), more.touch)
        weights = cell_weights(self.cell, self.pose)
        fit = refit_locally(self.fit, self._points(), points, weights, LOCAL_REACH / self.cell)
        contacts = ContactPoints(
            np.concatenate([self.contacts.points, more.points]),
            np.concatenate([np.asarray(self.contacts.normals), points.normals]),
            np.concatenate([self.contacts.touch, more.touch]).astype(np.int32),
        )
        known = np.append(self.placements_of_touches, np.int32(placement))
        return replace(self, fit=fit, contacts=contacts, placement=known)

    @property
    def placements_of_touches(self) -> Ints:
        """How often the object had been turned over before each touch, (t,)."""
        count = len(self.fit.displacements)
        return self.placement if len(self.placement) else np.zeros(count, np.int32)

    def _points(self) -> TouchedPoints:
        places = (self.contacts.points - self.origin) / self.cell
        return TouchedPoints(places, np.asarray(self.contacts.normals), self.contacts.touch)

    def health(self) -> dict[str, float]:
        """Figures of the fit by name; lengths in m.

        `control_values` and `touches` of it, the share of `outliers` among points (those that lost
        half their weight), root mean square `residual` of the others and `displacement` of touches,
        and `held_out`, the error of touches that were predicted from the others.
        """
        fit = self.fit
        inlying = np.isfinite(fit.residuals) & (fit.weights**2 > 0.5)
        residual = fit.residuals[inlying]
        return {
            "control_values": float(len(fit.control)),
            "touches": float(len(fit.displacements)),
            "outliers": float(1.0 - inlying.mean()),
            "residual": self.cell * float(np.sqrt(np.mean(residual**2))) if len(residual) else 0.0,
            "displacement": self.cell * float(np.sqrt((fit.displacements**2).sum(axis=1).mean())),
            "held_out": self.predicted.held_out,
        }

    def _volume(self, parts: int) -> tuple[Ints, Floats]:
        """First node (3,) of a grid that holds the band, and values at its nodes, cells."""
        cells = self.fit.band.cells
        low, high = cells.min(axis=0) - 1, cells.max(axis=0) + 2
        if self.platform is not None:
            low[2] = 0
        shape = (high - low) * parts + 1
        nodes = (np.moveaxis(np.indices(shape), 0, -1) / parts + low) * self.cell + self.origin
        values = (self.coarse.at(nodes.reshape(-1, 3)) / self.cell).reshape(shape)
        within = np.moveaxis(np.indices((parts + 1,) * 3), 0, -1).reshape(-1, 3)
        found = self.fit.control[self.fit.band.local] @ basis_values(within / parts).T
        at = (cells - low)[:, None] * parts + within
        above = (at >= 0).all(axis=2)
        values[tuple(at[above].T)] = found[above]
        return low * parts, values

    def _supported(self, inside: Bools, corner: Ints, step: float) -> Bools:
        """Without parts, and without hollows, at which nothing was touched."""
        at = np.round((self.contacts.points - self.origin) / step).astype(int) - corner
        at = np.clip(at, 1, np.array(inside.shape) - 2)
        touched = np.zeros(inside.shape, np.bool_)
        for shift in np.ndindex(3, 3, 3):
            touched[tuple((at + shift - 1).T)] = True
        parts, _ = scipy.ndimage.label(inside)
        counts = np.bincount(parts[touched & inside], minlength=int(parts.max()) + 1)
        counts[0] = 0
        inside = (counts >= LEAST_PART * counts.max())[parts] & (parts > 0)
        parts, count = scipy.ndimage.label(~inside)
        border = np.ones(inside.shape, np.bool_)
        border[1:-1, 1:-1, 1:-1] = False
        if self.platform is not None:
            border[..., 0] = False
        reached = np.isin(np.arange(count + 1), parts[border & ~inside])
        reached[0] = False
        return ~reached[parts]


def cell_weights(cell: float, pose: float) -> Weights:
    """Weights of the energy in cells of this edge, m; `pose` in m."""
    return Weights(
        POINT / cell,
        NORMAL,
        pose / cell,
        VARIATION * (cell / COARSE) ** DETAIL / cell,
        ANCHOR * cell**5,
    )


def touch_squares(touched: ContactPoints, distances: Floats) -> Floats:
    """Of each touch, the mean square (t,) of the distances (n,) of its points from a solid, m^2.

    What is farther off than `FARTHEST` counts as that: how much farther says nothing.
    """
    found = np.minimum(distances, FARTHEST) ** 2
    _, touch, counts = np.unique(touched.touch, return_inverse=True, return_counts=True)
    return np.asarray(np.bincount(touch, found) / counts)


def protrusions(touched: Floats, places: Floats) -> Floats:
    """How far places (n, 3) lie beyond the convex hull of touched points (k, 3), (n,), m, or 0."""
    extent = float(np.ptp(touched, axis=0).max())
    grid = max(PROTRUSIONS.grid, PROTRUSIONS.grid_share * extent)
    _, first = np.unique(np.floor(touched / grid), axis=0, return_index=True)
    beyond = np.zeros(len(places))
    if len(first) <= touched.shape[1]:
        return beyond
    faces = scipy.spatial.ConvexHull(touched[first], qhull_options="QJ").equations
    block = max(PROTRUSIONS.n_pairs // len(faces), 1)
    for begin in range(0, len(places), block):
        some = slice(begin, begin + block)
        beyond[some] = (places[some] @ faces[:, :3].T + faces[:, 3]).max(axis=1)
    return np.maximum(beyond, 0.0)
