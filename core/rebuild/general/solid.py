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


@dataclass(frozen=True, slots=True, kw_only=True)
class SplineSettings:
    """The energy of the implicit spline, and what is made of the spline."""

    cell: float = 4.0e-3  # [m] edge of a cell of the final solid
    draft_cell: float = 5.0e-3  # [m] edge of a cell before that
    point: float = 0.06e-3  # [m] standard deviation of a touched point
    normal: float = 0.2  # standard deviation of its normal
    pose: float = 0.1e-3  # [m] standard deviation of a touch's displacement
    variation: float = 0.05  # [m] weight of squared third derivatives, in cells of `draft_cell`
    detail: float = 3.0  # power of a cell's edge with which that weight falls in smaller cells
    anchor: float = 1e6  # [1/m^5] weight of the coarse solid
    min_slope: float = 0.2  # of the spline's gradient: a flatter spline is no distance
    n_projections: int = 2  # steps of Newton's method onto the surface
    max_retreats: int = 20  # rounds in which vertices of faces that cross go back to the grid
    min_part: float = 0.02  # fraction of the touched points on the largest part; fewer: no part
    local_reach: float = 12.0e-3  # [m] about a new touch, within which `update` fits anew
    max_residual: float = 15.0e-3  # [m] touched points farther off count as this far


SPLINES = SplineSettings()


@dataclass(frozen=True, slots=True)
class ProtrusionSettings:
    """Surface beyond the convex hull of all touched points: what is cut off, and its error."""

    # Near to touch, what rises higher over the hull than `cut_height` and `cut_slope` times the
    # distance from touch is a ripple of the spline, and is cut off: up to 5 mm high on cups and
    # bowls with walls of 2 and 3 mm, 0.7 % of their surface, and nothing on scanned objects.
    cut_height: float = 1.5e-3  # [m]
    cut_slope: float = 0.5
    cut_distance: float = 8.0e-3  # [m] from touch, up to which ripples are cut off
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
        for _ in range(SPLINES.n_projections):
            value, gradient = self.evaluate(places)
            if flat is not None:
                gradient[flat, 2] = 0.0
            square = np.maximum((gradient**2).sum(axis=1), SPLINES.min_slope**2)
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
        vertices = without_crossings(places, moved, faces, SPLINES.max_retreats)
        if self.edges is None:
            return Mesh(vertices, faces)
        sharp = sharpened(self.edges, vertices, faces)
        if self.platform is not None:
            standing = vertices[:, 2] <= self.platform
            sharp[standing] = vertices[standing]
            sharp[:, 2] = np.maximum(sharp[:, 2], self.platform)
        return Mesh(without_crossings(vertices, sharp, faces, SPLINES.max_retreats), faces)

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
        if self.cell >= SPLINES.cell and len(moved):
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
        ripples = self._ripples(values < 0.0, corner, step)
        inside = self._supported((values < 0.0) & ~ripples, corner, step)
        values = np.where(inside, np.minimum(values, -1e-6), np.maximum(values, 1e-6))
        vertices, faces = grid_surface(values, level_bottom=standing)
        flat = (vertices[:, 2] == 0.0) & standing
        places = self.origin + (vertices + corner) * step
        moved = self.project(places, flat)
        near = np.linalg.norm(moved - places, axis=1) < step
        moved = np.where(near[:, None], moved, places)
        if standing:
            for heights in (places[:, 2], moved[:, 2]):
                np.maximum(heights, self.origin[2], out=heights)
                heights[flat] = self.origin[2]
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
        nearest = self.final_mesh.closest(points)
        places = self.project(nearest.points)
        gradient = self.evaluate(places)[1]
        slope = np.linalg.norm(gradient, axis=1, keepdims=True)
        normals = gradient / np.maximum(slope, SPLINES.min_slope)
        along = np.einsum("ni,ni->n", normals, nearest.normals)
        # False where the gradient is NaN
        on_spline = (along > np.cos(DEFAULT_MESH.sharp_angle)) & (slope[:, 0] >= SPLINES.min_slope)
        if self.platform is not None:
            on_spline &= nearest.points[:, 2] > self.platform
        on_spline &= ~self.is_sharp(nearest.points)
        places = np.where(on_spline[:, None], places, nearest.points)
        normals = np.where(on_spline[:, None], normals, nearest.normals)
        offset = np.asarray(points, np.float64).reshape(-1, 3) - places
        distances = np.linalg.norm(offset, axis=1)
        side = np.where(
            on_spline & (distances < self.cell),
            np.einsum("ni,ni->n", offset, normals),
            nearest.distances,
        )
        return Closest(places, normals, np.where(side < 0.0, -distances, distances))

    def residuals(self, places: Floats) -> Floats:
        """Distances (n,) of places (n, 3) from the surface, m: to first order where it is near."""
        value, gradient = self.evaluate(places)
        slope = np.maximum(np.linalg.norm(gradient, axis=1), SPLINES.min_slope)
        distances = np.abs(value) / slope
        far = ~(distances < self.cell)
        if far.any():
            mesh = self.rough_mesh
            search = nearest_search(mesh.vertices[mesh.faces])
            distances[far] = nearest_points(search, places[far]).distances
        return np.asarray(distances)

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
        """The solid with one touch more, fitted anew within `SplineSettings.local_reach` of it.

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
        fit = refit_locally(
            self.fit, self._points(), points, weights, SPLINES.local_reach / self.cell
        )
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
        offsets = np.moveaxis(np.indices((parts + 1,) * 3), 0, -1).reshape(-1, 3)
        cell_values = self.fit.control[self.fit.band.local] @ basis_values(offsets / parts).T
        at = (cells - low)[:, None] * parts + offsets
        above = (at >= 0).all(axis=2)
        values[tuple(at[above].T)] = cell_values[above]
        return low * parts, values

    def _ripples(self, inside: Bools, corner: Ints, step: float) -> Bools:
        """Nodes inside ripples, which rise steeply over the hull of what was touched."""
        nodes = np.argwhere(inside)
        places = (nodes + corner) * step + self.origin
        beyond = protrusions(self.contacts.points, places)
        high = np.flatnonzero(beyond > PROTRUSIONS.cut_height)
        away = touch_distances(self.contacts, places[high])
        steep = beyond[high] > PROTRUSIONS.cut_height + PROTRUSIONS.cut_slope * away
        ripples = np.zeros_like(inside)
        ripples[tuple(nodes[high[steep & (away < PROTRUSIONS.cut_distance)]].T)] = True
        return ripples

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
        inside = (counts >= SPLINES.min_part * counts.max())[parts] & (parts > 0)
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
        SPLINES.point / cell,
        SPLINES.normal,
        pose / cell,
        SPLINES.variation * (cell / SPLINES.draft_cell) ** SPLINES.detail / cell,
        SPLINES.anchor * cell**5,
    )


def touch_squares(touched: ContactPoints, distances: Floats) -> Floats:
    """Of each touch, the mean square (t,) of the distances (n,) of its points from a solid, m^2.

    Points farther off than `SplineSettings.max_residual` count as that far.
    """
    squares = np.minimum(distances, SPLINES.max_residual) ** 2
    _, touch, counts = np.unique(touched.touch, return_inverse=True, return_counts=True)
    return np.asarray(np.bincount(touch, squares) / counts)


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
