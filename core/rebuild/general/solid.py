"""A solid of any genus, where an implicit spline over a narrow band is negative, and its error.

A coarse solid decides which places lie inside. The band consists of the cells at its surface and of
those that were touched; the spline is fitted over them, and beyond them the coarse solid is used. A
standing object is cut off at its platform. Parts without touched points, and closed hollows inside,
are ripples of the fit: the parts are left out, and the hollows are filled.

The expected error depends on the distance from touched points and on the bend (see `errors`).
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
from palpate.core.rebuild.general.bends import displacement_shares, surface_bends
from palpate.core.rebuild.general.edges import Edges, find_edges, sharpened
from palpate.core.rebuild.general.errors import (
    SurfaceErrors,
    touch_distances,
)
from palpate.core.rebuild.general.fitting import (
    ImplicitFit,
    TouchedPoints,
    Weights,
    refit_locally,
)
from palpate.core.rebuild.general.placements import contradicts
from palpate.core.rebuild.general.settings import (
    DEFAULT_GENERAL,
    GeneralSettings,
    ProtrusionSettings,
    SplineSettings,
)
from palpate.core.rebuild.general.topology import CoarseSolid
from palpate.core.rebuild.protocol import Closest, Solid
from palpate.core.shapes import Mesh, grid_surface, without_crossings


@dataclass(frozen=True, eq=False)
class GeneralSolid(Solid):
    """A solid as an implicit spline; lengths in m, places in the world."""

    origin: Floats  # Origin of the grid of cells, (3,), on the platform
    cell: float  # Edge of a cell [m]
    fit: ImplicitFit  # Lengths in cells
    coarse: CoarseSolid  # Used beyond the band
    contacts: ContactPoints  # Touched points with normals
    platform: float | None  # Height on which it stands [m]; None if it is held
    predicted: SurfaceErrors  # Expected errors of the surface [m]
    pose: float  # Standard deviation of the error of a touch's place [m]
    # How often the object had been turned over before each touch, (t,); empty: never
    placement: Ints = field(default_factory=lambda: np.zeros(0, np.int32))
    # Rigid motion of each later placement that moves its `contacts` onto the others
    motions: tuple[Pose, ...] = ()
    tried_walls: int = 0  # Number of touches when wall-sized cells last failed to help; 0: never
    # How it was fitted and is meshed. Archives store solids of the default settings alone.
    settings: GeneralSettings = field(default=DEFAULT_GENERAL, metadata={"archived": False})

    def evaluate(self, places: Floats) -> tuple[Floats, Floats]:
        """The spline, m, and its gradient at places (n, 3): (n,), (n, 3); NaN beyond the band."""
        value, gradient = self.fit.band.evaluate(
            self.fit.control, (places - self.origin) / self.cell
        )
        return value * self.cell, gradient

    def project(self, places: Floats, flat: Bools | None = None) -> Floats:
        """Places (n, 3) moved onto the surface along the gradient; `flat` (n,) stay level."""
        settings = self.settings.spline
        for _ in range(settings.n_projections):
            value, gradient = self.evaluate(places)
            if flat is not None:
                gradient[flat, 2] = 0.0
            square = np.maximum((gradient**2).sum(axis=1), settings.min_slope**2)
            step = (value / square)[:, None] * gradient
            small = np.linalg.norm(step, axis=1) < self.cell  # false where it is NaN
            places = np.where(small[:, None], places - step, places)
        return places

    def mesh(self, parts: int = 2) -> Mesh:
        """Closed triangle mesh with vertices on the surface; cells are cut into `parts` an axis.

        At sharp edges vertices lie on the faces that meet there. Vertices whose triangles would
        cross after the move onto the surface stay where the grid has them.
        """
        max_retreats = self.settings.spline.max_retreats
        places, moved, faces = self._surface(parts)
        vertices = without_crossings(places, moved, faces, max_retreats)
        if self.edges is None:
            return Mesh(vertices, faces)
        sharp = sharpened(self.edges, vertices, faces, self.settings.edges)
        if self.platform is not None:
            standing = vertices[:, 2] <= self.platform
            sharp[standing] = vertices[standing]
            sharp[:, 2] = np.maximum(sharp[:, 2], self.platform)
        return Mesh(without_crossings(vertices, sharp, faces, max_retreats), faces)

    @cached_property
    def edges(self) -> Edges | None:
        """Its sharp edges, confirmed by touched points on both sides; None if there are none."""
        vertices, settings = self._surface(2)[1], self.settings.edges
        touched, normals = self.contacts.points, np.asarray(self.contacts.normals)
        touched = touched + self.cell * self.fit.displacements[self.contacts.touch]
        bent = vertices[self.bends(vertices) > settings.min_bend]
        return find_edges(bent, touched, normals, settings)

    @property
    def rough_mesh(self) -> Mesh:
        """Coarse triangle mesh for intermediate steps: at sharp edges some triangles may cross."""
        return self._rough[1]

    @property
    def rough_parts(self) -> int:
        """Parts of a cell along each axis in it: 2 if whole cells would lose a thin end, else 1."""
        return self._rough[0]

    @cached_property
    def _rough(self) -> tuple[int, Mesh]:
        _, moved, faces = self._surface(1)
        if self.cell >= self.settings.spline.cell and len(moved):
            away = point_tree(moved, balanced=False).query(self.contacts.points)[0]
            if np.max(away) > self.cell:
                return 2, self.plain_mesh(2)
        return 1, Mesh(moved, faces)

    def plain_mesh(self, parts: int) -> Mesh:
        """Triangles of cells cut into `parts` an axis: edges are round, some may cross there."""
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
        """Angles (n,) by which the normal turns within 3 mm of places (n, 3) on it [rad]."""
        return self._bends((places - self.origin) / self.cell)

    def _bends(self, places: Floats) -> Floats:
        """Bends at places (n, 3) in cells."""
        band, control = self.fit.band, self.fit.control
        return surface_bends(band, control, places, self.cell, self.settings.bends)

    def _shares(self, places: Floats) -> Floats:
        """Shares of displacements in which points at places (n, 3) in cells take part."""
        return displacement_shares(self._bends(places), self.settings.bends)

    def is_sharp(self, places: Floats) -> Bools:
        """Mask of the places (n, 3) within `EdgeSettings.full_shift_reach` of a sharp edge."""
        if self.edges is None:
            return np.zeros(len(places), np.bool_)
        away = point_tree(self.edges.places).query(places)[0]
        return np.asarray(away < self.settings.edges.full_shift_reach)

    def __repr__(self) -> str:
        return f"<GeneralSolid {self._size()} m, of {len(self.fit.displacements)} touches>"

    def closest(self, points: ArrayLike) -> Closest:
        """As `Solid.closest`, moved from the mesh onto the spline where that is the surface.

        The spline is not the surface where the solid is cut off at its platform, near to its sharp
        edges, or where the spline's gradient and the mesh's normal differ by more than an angle.
        """
        nearest = self.final_mesh.closest(points)
        places = self.project(nearest.points)
        gradient = self.evaluate(places)[1]
        min_slope = self.settings.spline.min_slope
        slope = np.linalg.norm(gradient, axis=1, keepdims=True)
        normals = gradient / np.maximum(slope, min_slope)
        along = np.einsum("ni,ni->n", normals, nearest.normals)
        # False where the gradient is NaN
        on_spline = (along > np.cos(DEFAULT_MESH.sharp_angle)) & (slope[:, 0] >= min_slope)
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
        """Distances (n,) of places (n, 3) from the surface [m]; near it, to first order."""
        value, gradient = self.evaluate(places)
        slope = np.maximum(np.linalg.norm(gradient, axis=1), self.settings.spline.min_slope)
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
        settings = self.settings.protrusions
        errors, bounds = self.predicted.at(places - self.origin, distances, self.settings.errors)
        outer = distances > settings.min_height  # the height over the hull is never larger
        beyond = protrusions(self.contacts.points, places[outer], settings) - settings.min_height
        errors[outer] = np.maximum(errors[outer], beyond)
        bounds[outer] = np.maximum(bounds[outer], settings.bound_factor * beyond)
        return errors, bounds

    def covers(self, places: Floats) -> bool:
        """Whether all places (n, 3) lie in the band, so that `update` can use them."""
        cells = np.floor((places - self.origin) / self.cell).astype(np.int32)
        return bool((self.fit.band.find(cells) >= 0).all())

    def update(self, touched: ContactPoints, placement: int = 0) -> GeneralSolid:
        """The solid with one touch more, fitted anew within `SplineSettings.local_reach` of it.

        `placement`: how often the object had been turned over before. Elsewhere the solid is
        unchanged, so that the time does not depend on the number of touches.
        The band is unchanged, too: points beyond it have no effect before `rebuild_general`.
        """
        touched = checked_contacts(touched)
        if touched.normals is None or not len(touched.points):
            return self
        first = len(self.fit.displacements)
        more = touched._replace(touch=touched.touch + np.int32(first))
        places = (more.points - self.origin) / self.cell
        settings = self.settings.spline
        weights = cell_weights(self.cell, self.pose, settings)
        reach = settings.local_reach / self.cell
        points = TouchedPoints(places, np.asarray(more.normals), more.touch, self._shares(places))
        before = self._points()
        # Shares of points farther away have no effect.
        near = np.asarray(point_tree(places).query(before.places)[0] < 2.0 * reach)
        shares = np.ones(len(near))
        shares[near] = self._shares(before.places[near])
        before = before._replace(shares=shares)
        fit = refit_locally(self.fit, before, points, weights, reach)
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

    def contradicted_placements(self) -> list[float]:
        """Errors [m] of those later placements whose known pose their touches contradict.

        Each is the root mean square of how far the fit displaces these touches along their normals.
        """
        placement, errors = self.placements_of_touches[self.contacts.touch], list[float]()
        moved = self.cell * self.fit.displacements[self.contacts.touch]
        along = np.einsum("ni,ni->n", np.asarray(self.contacts.normals), moved)
        for number, motion in enumerate(self.motions, 1):
            own = placement == number
            touched = ContactPoints(self.contacts.points[own], None, self.contacts.touch[own])
            if own.any() and contradicts(motion, touched, self.settings.motions):
                errors.append(float(np.sqrt(np.square(along[own]).mean())))
        return errors

    def _points(self) -> TouchedPoints:
        places = (self.contacts.points - self.origin) / self.cell
        return TouchedPoints(places, np.asarray(self.contacts.normals), self.contacts.touch)

    def health(self) -> dict[str, float]:
        """Figures of the fit by name; lengths in m.

        Numbers of `control_values` and `touches`; fraction of `outliers` (points that lost half
        their weight); root mean square `residual` of the other points, `displacement` of touches,
        and `held_out` offset of touches that were left out and predicted from the others.
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
        """First node (3,) of a grid around the band, in its steps, and its values [cells]."""
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
        """Mask of the nodes in ripples, which rise steeply over the hull (`ProtrusionSettings`)."""
        nodes, settings = np.argwhere(inside), self.settings.protrusions
        places = (nodes + corner) * step + self.origin
        beyond = protrusions(self.contacts.points, places, settings)
        high = np.flatnonzero(beyond > settings.cut_height)
        away = touch_distances(self.contacts, places[high])
        steep = beyond[high] > settings.cut_height + settings.cut_slope * away
        ripples = np.zeros_like(inside)
        ripples[tuple(nodes[high[steep & (away < settings.cut_distance)]].T)] = True
        return ripples

    def _supported(self, inside: Bools, corner: Ints, step: float) -> Bools:
        """The mask `inside` without parts that few points touch, and with closed hollows filled."""
        at = np.round((self.contacts.points - self.origin) / step).astype(int) - corner
        at = np.clip(at, 1, np.array(inside.shape) - 2)
        touched = np.zeros(inside.shape, np.bool_)
        for shift in np.ndindex(3, 3, 3):
            touched[tuple((at + shift - 1).T)] = True
        parts, _ = scipy.ndimage.label(inside)
        counts = np.bincount(parts[touched & inside], minlength=int(parts.max()) + 1)
        counts[0] = 0
        least = self.settings.spline.min_part * counts.max()
        inside = (counts >= least)[parts] & (parts > 0)
        parts, count = scipy.ndimage.label(~inside)
        border = np.ones(inside.shape, np.bool_)
        border[1:-1, 1:-1, 1:-1] = False
        if self.platform is not None:
            border[..., 0] = False
        reached = np.isin(np.arange(count + 1), parts[border & ~inside])
        reached[0] = False
        return ~reached[parts]


def cell_weights(
    cell: float, pose: float, settings: SplineSettings = DEFAULT_GENERAL.spline
) -> Weights:
    """Weights of the energy in units of cells, for an edge `cell` [m] and a `pose` error [m]."""
    return Weights(
        settings.point_error / cell,
        settings.normal_error,
        pose / cell,
        settings.roughness_weight * (cell / settings.draft_cell) ** settings.cell_power / cell,
        settings.anchor_weight * cell**5,
    )


def touch_squares(
    touched: ContactPoints,
    distances: Floats,
    settings: SplineSettings = DEFAULT_GENERAL.spline,
) -> Floats:
    """Mean squares (t,) for each touch of the distances (n,) of its points from a solid [m^2].

    Points farther off than `SplineSettings.max_residual` count as that far.
    """
    squares = np.minimum(distances, settings.max_residual) ** 2
    _, touch, counts = np.unique(touched.touch, return_inverse=True, return_counts=True)
    return np.asarray(np.bincount(touch, squares) / counts)


def protrusions(
    touched: Floats,
    places: Floats,
    settings: ProtrusionSettings = DEFAULT_GENERAL.protrusions,
) -> Floats:
    """Heights (n,) of places (n, 3) over the hull of touched points (k, 3) [m]; 0 inside it."""
    extent = float(np.ptp(touched, axis=0).max())
    grid = max(settings.grid, settings.grid_share * extent)
    _, first = np.unique(np.floor(touched / grid), axis=0, return_index=True)
    beyond = np.zeros(len(places))
    if len(first) <= touched.shape[1]:
        return beyond
    faces = scipy.spatial.ConvexHull(touched[first], qhull_options="QJ").equations
    block = max(settings.n_pairs // len(faces), 1)
    for begin in range(0, len(places), block):
        some = slice(begin, begin + block)
        beyond[some] = (places[some] @ faces[:, :3].T + faces[:, 3]).max(axis=1)
    return np.maximum(beyond, 0.0)
