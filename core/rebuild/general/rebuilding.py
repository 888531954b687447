"""A general solid of touched points: which cells its surface passes through, and the fit over them.

A first spline is fitted over the cells at the coarse solid's surface; where its own surface leaves
these cells, the band is widened. Where touches are dense, a spline of finer cells follows. Where
thin walls are torn (the solid has holes), it is fitted anew with cells as small as the walls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, Ints, check_extent, finite_array, positive
from palpate.core.geometry import linked_groups
from palpate.core.rebuild.contours import ContactPoints, checked_contacts
from palpate.core.rebuild.general import solid
from palpate.core.rebuild.general.band import basis_values, make_band
from palpate.core.rebuild.general.dissection import dissect
from palpate.core.rebuild.general.errors import surface_errors
from palpate.core.rebuild.general.fitting import (
    Fitted,
    ImplicitFit,
    Solution,
    Spline,
    TouchedPoints,
    fit_implicit,
    plain_start,
)
from palpate.core.rebuild.general.orientation import oriented
from palpate.core.rebuild.general.placements import MOTIONS, found_motions, shared_motions
from palpate.core.rebuild.general.topology import CoarseSolid, coarse_solid
from palpate.core.rebuild.general.walls import wall_cell
from palpate.core.shapes import Mesh
from palpate.core.steps import Steps, no_steps

CUBE = np.moveaxis(np.indices((2, 2, 2)), 0, -1).reshape(-1, 3).astype(float)  # Its corners


class GridSettings(NamedTuple):
    """How large objects may be, and how fine their grids: so that a fit stays within 0.4 GB.

    The factor of a bottle's band of 11,000 cells takes 0.36 GB, that of a ball of 51,000 2.3 GB.
    """

    max_extent: float = 1.0  # [m] of all points
    max_cells: int = 5_000  # of a spline's band; larger takes more memory and time
    max_wall_cells: int = 12_000  # of a band whose cells are small because walls are thin
    small_cell: float = 0.9  # fraction of the requested edge; smaller cells were made for walls
    more_touches: float = 1.25  # ratio of touches, after which a draft tries such cells again
    cells_per_square: float = 2.0  # expected cells of a band, per area of surface in cells^2
    max_voxels: float = 1.5e6  # of the coarse solid, without its padding
    excess: float = 1.15  # ratio of cells to `max_cells` that a fit still accepts
    dense: float = 12.0e-3  # [m] mean spacing of touches, below which drafts take final cells
    max_points: int = 30_000  # touched points; of more, every n-th point of a touch is used
    max_hull_points: int = 5_000  # used for the area of the hull


@dataclass(frozen=True, slots=True, kw_only=True)
class BandSettings:
    """Which cells the spline covers; lengths in cells."""

    width: float = 1.0  # [cells] on both sides of the estimated surface; larger costs more
    foot: float = 0.5  # [cells] over the lowest touches; the band has all inner cells below
    lowest: float = 0.5  # [%] percentile of the points' heights that is the lowest touches' height
    searched: float = 4.0  # [cells] from the coarse surface, where an earlier spline is evaluated
    # An earlier spline's surface is given up where it is farther outside the coarse solid, and
    # farther from touched points, than this: a lid over a hollow that a finger entered since.
    outside: float = 1.0  # [cells]
    untouched: float = 2.0  # [cells]
    lacked: float = 3.0  # [cells] from an earlier band, beyond which the coarse solid is used


BANDS = BandSettings()


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplingSettings:
    """Voxels of the coarse solid, and the area of surface that each touched point stands for."""

    voxel: float = 0.57  # [cells] edge of a voxel
    spread: float = 0.35  # width of a point's kernel over the spacing of touches; larger bridges
    min_spread: float = 3.0e-3  # [m]
    max_spread: float = 12.0e-3  # [m]
    max_area: float = 1.5  # largest area of one point, over the hull's area per touch
    min_rounds: int = 2  # fits, each with outliers weighed by the one before, if none is known
    flat: float = 1e-6  # [m] rms distance from a plane, below which points enclose no solid


SAMPLING = SamplingSettings()


def least_cell(
    points: Floats, platform: float | None = None, settings: GridSettings | None = None
) -> float:
    """Edge of the smallest cells that a fit of points (n, 3) may have [m]."""
    settings = settings or GridSettings()
    sides = np.ptp(points, axis=0)
    if platform is not None:  # the coarse solid has its mirror image below
        sides[2] = 2.0 * max(float(points[:, 2].max()) - platform, 0.0)
    by_band = settings.cells_per_square * _hull_area(points) / settings.max_cells
    by_voxels = float(np.prod(sides)) / settings.max_voxels
    return max(math.sqrt(by_band), math.cbrt(by_voxels) / SAMPLING.voxel)


def fitting_cell(contacts: ContactPoints) -> float:
    """Edge of cells [m] as fine as the spacing of the touches can resolve."""
    spacing = math.sqrt(_hull_area(contacts.points) / len(np.unique(contacts.touch)))
    return solid.SPLINES.cell if spacing < GridSettings().dense else solid.SPLINES.draft_cell


def rebuild_general(
    contacts: ContactPoints | ArrayLike,
    normals: ArrayLike | None = None,
    *,
    free: Floats | None = None,
    spanned: Floats | None = None,
    platform: float | None = None,
    cell: float = solid.SPLINES.cell,
    pose: float = solid.SPLINES.pose,
    outward: bool = False,
    placement: Ints | None = None,
    underside: Floats | None = None,
    start: solid.GeneralSolid | None = None,
    draft: bool = False,
    step: Steps = no_steps,
) -> solid.GeneralSolid:
    """The solid of touched points with normals, of any genus.

    `contacts`: world frame, m; or points (n, 3), each a touch of its own, with `normals` (n, 3) of
    any length, outward: those that point inwards are turned (`oriented`), unless `outward` says
    that none do, as with a pad. `placement` (t,): how often the object had been turned over before
    each touch; touches of later placements are moved back to the first one as far as it is known,
    and the rest, a rigid motion, is fitted with the solid (`GeneralSolid.motions`). `underside`
    (m, 3): places on which it stood at first, assumed flat where no touched point is near. `free`
    (k, 3): places that a finger has swept. `spanned` (l, 3): places on the face of a pad that has
    contacts on both sides of them but none there: the surface lies behind them. `platform`: height
    on which the object stands [m]; None if it is held. `cell`: edge of the spline's cells [m].
    `pose`: standard deviation of a touch's place [m]. `start`: a solid of the first of these
    contacts, from which the fit starts: it takes a fraction of the time. `draft`: an intermediate
    solid, for planning more touches: its band is widened less, and the error calibration of `start`
    is kept. Cells are larger than `cell` if there would be too many (`GridSettings`). Raises
    ValueError if there are no normals, if normals disagree, if all points lie in one plane, or if
    they span more than a metre (coordinates are in metres).
    """
    if not isinstance(contacts, ContactPoints):
        points = finite_array("contacts", contacts, (None, 3))
        directions = None if normals is None else np.asarray(normals, np.float64)
        contacts = ContactPoints(points, directions, np.arange(len(points), dtype=np.int32))
    contacts = checked_contacts(contacts)
    if contacts.normals is None or not len(contacts.points):
        raise ValueError("patches must have points and normals for a general solid, got none")
    positive("cell", cell, "m")
    check_extent("patches", contacts.points, GridSettings().max_extent)
    if is_flat(contacts.points):
        raise ValueError("patches must not all lie in one plane")
    touched = contacts if start is not None else _thinned(contacts)
    touched = touched if outward else oriented(touched).contacts
    none, placed = np.zeros((0, 3)), np.zeros(0, np.int32) if placement is None else placement
    known = Known(
        touched,
        free,
        none if spanned is None else spanned,
        _far_from_touch(underside, touched.points),
        platform,
        max(pose, MOTIONS.least_pose) if placed.any() else pose,
        placed,
        draft,
    )
    return _solid_with_whole_walls(known, cell, start, step)


class Known(NamedTuple):
    """Input of a reconstruction; lengths in [m]."""

    touched: ContactPoints
    free: Floats | None  # Places that a finger has swept, (k, 3)
    spanned: Floats  # Places (l, 3) behind which the surface lies
    below: Floats  # Places (j, 3) where the underside is assumed flat
    platform: float | None  # Height on which it stands
    pose: float  # Standard deviation of a touch's place
    placement: Ints  # Of each touch, (t,); empty if all are of the first
    draft: bool


def _solid_with_whole_walls(
    known: Known, cell: float, start: solid.GeneralSolid | None, step: Steps
) -> solid.GeneralSolid:
    """The solid with cells of an edge [m], or smaller ones where that one's thin walls are torn."""
    grid, points = GridSettings(), known.touched.points
    cell = max(cell, least_cell(points, known.platform))
    finer_grid = grid._replace(max_cells=grid.max_wall_cells)
    walls = max(wall_cell(known.touched, cell), least_cell(points, known.platform, finer_grid))
    if walls < cell and start is not None and start.cell <= grid.small_cell * cell:
        torn = _tears(start)
        if known.draft and not torn:
            return _solid_of_cells(known, walls, finer_grid, start, step)
        finer_solid = _solid_of_cells(known, walls, finer_grid, None, step)
        if known.draft or _tears(finer_solid) <= torn:
            return finer_solid
        return min(finer_solid, _solid_of_cells(known, walls, finer_grid, start, step), key=_tears)
    plain = _solid_of_cells(known, cell, grid, start, step)
    if walls >= cell or not (torn := _tears(plain)):
        return plain
    touches = len(plain.fit.displacements)
    tried = 0 if start is None or not known.draft else start.tried_walls
    if touches < grid.more_touches * tried:
        return replace(plain, tried_walls=tried)
    # Without `start`: walls that larger cells have torn would stay torn.
    finer_solid = _solid_of_cells(known, walls, finer_grid, None, step)
    if _tears(finer_solid) < torn:
        return finer_solid
    return replace(plain, tried_walls=touches)  # too few touches for small cells


def _tears(rebuilt: solid.GeneralSolid) -> int:
    """Tears of a mesh of half cells: whole cells do not resolve a wall as thick as a cell."""
    return tears(rebuilt.plain_mesh(2))


def tears(mesh: Mesh) -> int:
    """Number of holes through a closed surface, plus its number of parts beyond the first."""
    if not len(mesh.faces):
        return 0
    used, numbers = np.unique(mesh.faces, return_inverse=True)
    first, second, third = numbers.reshape(-1, 3).T
    ends = np.concatenate([first, second]), np.concatenate([second, third])
    parts = int(linked_groups(len(used), *ends).max()) + 1
    euler = len(used) - len(mesh.faces) // 2
    return parts - 1 + (2 * parts - euler) // 2


def _solid_of_cells(
    known: Known, cell: float, grid: GridSettings, start: solid.GeneralSolid | None, step: Steps
) -> solid.GeneralSolid:
    """The solid with cells of an edge [m], or larger ones if there would be too many."""
    touched, platform, placed = known.touched, known.platform, known.placement
    with step("topology"):
        coarse = _coarse(_with_underside(touched, known.below), known.free, platform, cell)
    with step("implicit spline"):
        following = Following(1, 0.01) if known.draft else Following()
        beside, below, pose = known.spanned, known.below, known.pose
        setting = Setting(touched, coarse, beside, below, platform, pose, following, placed, grid)
        before = None if start is None else Spline(start.cell, start.fit)
        if before is None and cell < solid.SPLINES.draft_cell and grid == GridSettings():
            before = setting.fit(solid.SPLINES.draft_cell, None, 1).spline
        fitted = setting.fit(cell, before, SAMPLING.min_rounds if before is None else 1)
    with step("held-out touches"):
        predicted_before = start.predicted if known.draft and start is not None else None
        fit, predicted = surface_errors(fitted, predicted_before)
    count = int(touched.touch.max()) + 1
    displacements, fit = fit.displacements, fit.of_first(len(touched.points), count)
    rebuilt = solid.GeneralSolid(
        setting.origin, fitted.spline.cell, fit, coarse, touched, platform, predicted, pose
    )
    if fitted.shared is None:
        return rebuilt
    motions = found_motions(touched, placed, fitted.shared.of(displacements))
    return replace(rebuilt, placement=placed, motions=motions)


def _far_from_touch(underside: Floats | None, touched: Floats) -> Floats:
    """Those places (k, 3) of an underside that lie far from all touched points."""
    if underside is None or not len(underside):
        return np.zeros((0, 3))
    away = scipy.spatial.cKDTree(touched).query(underside)[0]
    return np.asarray(underside[away > UNDERSIDE.min_distance])


def _with_underside(touched: ContactPoints, below: Floats) -> ContactPoints:
    """Touched points, and places `below` that face down as one more touch."""
    if not len(below):
        return touched
    assert touched.normals is not None
    last = np.full(len(below), touched.touch.max() + 1, np.int32)
    return ContactPoints(
        np.concatenate([touched.points, below]),
        np.concatenate([touched.normals, np.broadcast_to([0.0, 0.0, -1.0], below.shape)]),
        np.concatenate([touched.touch, last]),
    )


def is_flat(points: Floats) -> bool:
    """Whether points (n, 3) [m] lie in one plane, and so enclose no solid."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(len(points) < 4 or spread[2] < SAMPLING.flat * np.sqrt(len(points)))


def _coarse(
    touched: ContactPoints, free: Floats | None, platform: float | None, cell: float
) -> CoarseSolid:
    hull = _hull_area(touched.points)
    touches = int(touched.touch.max()) + 1
    spread = SAMPLING.spread * np.sqrt(hull / touches)
    return coarse_solid(
        touched.points,
        np.asarray(touched.normals),
        np.zeros((0, 3)) if free is None else free,
        step=SAMPLING.voxel * cell,
        spread=float(np.clip(spread, SAMPLING.min_spread, SAMPLING.max_spread)),
        most_area=SAMPLING.max_area * hull / touches,
        platform=platform,
    )


class Following(NamedTuple):
    """How often, and when, the band is widened where the surface leaves it."""

    turns: int = 2  # Largest number of times that the band is widened
    let_go: float = 0.0  # Missing cells over cells of the band, up to which it is not widened


@dataclass(frozen=True, slots=True)
class SpannedSettings:
    """How the spline is held behind places that a pad spans without contact."""

    weight: float = 0.2  # factor of such a place's residuals at first; a touched point has 1
    max_depth: float = 0.15e-3  # [m] places with the surface farther behind them are left out


SPANNED = SpannedSettings()


@dataclass(frozen=True, slots=True)
class UndersideSettings:
    """Where the underside of an object that was turned over is assumed flat until it is touched."""

    min_distance: float = 8.0e-3  # [m] from every touched point; larger assumes less
    weight: float = 0.2  # factor of such a place's residuals at first; a touched point has 1


UNDERSIDE = UndersideSettings()


class Setting(NamedTuple):
    """What a spline is fitted to; lengths in [m]."""

    touched: ContactPoints
    coarse: CoarseSolid
    spanned: Floats  # Places (l, 3) behind which the surface lies
    below: Floats  # Places (j, 3) where the underside is assumed flat
    platform: float | None  # Height on which it stands
    pose: float  # Standard deviation of a touch's place
    following: Following
    placement: Ints  # Of each touch, (t,); empty if all are of the first
    grid: GridSettings

    @property
    def origin(self) -> Floats:
        """Origin of the grid of cells, (3,)."""
        return np.array([0.0, 0.0, self.platform or 0.0])

    def fit(self, cell: float, before: Spline | None, rounds: int) -> Fitted:
        """The spline over the cells at the surface; the band is widened where it leaves them.

        `before`: a spline of the first of these touches: it is the first estimate of the surface,
        of displacements and of outliers. `rounds`: least number of fits, to weigh outliers.
        """
        places = (self.touched.points - self.origin) / cell
        touched = TouchedPoints(places, np.asarray(self.touched.normals), self.touched.touch)
        points = self._with_underside_points(self._with_spanned(touched, cell, before), cell)
        start = plain_start(len(points.places), int(points.touch.max()) + 1)
        start.weights[len(places) :] = SPANNED.weight
        start.weights[len(points.places) - len(self.below) :] = UNDERSIDE.weight
        shared = shared_motions(points, self.placement, cell, self.pose)
        if before is not None:
            start = start.begun(before.fit, before.cell / cell)
        cells = _surface_cells(self, before, points, cell)
        over = len(make_band(cells).cells) / (self.grid.excess * self.grid.max_cells)
        if over > 1.0:  # the surface is larger than the hull of the touched points
            return self.fit(cell * math.sqrt(self.grid.excess * over), before, rounds)
        solution: Solution | None = None
        weighed = 0
        for turn in range(self.following.turns + 1):
            band = make_band(cells)
            order = dissect(band.cells, band.local, len(band.control))
            control = self.coarse.at(band.control * cell + self.origin) / cell
            terms = points, control, solid.cell_weights(cell, self.pose)
            solution = None  # memory: never two factors at a time
            solution = fit_implicit(band, *terms, start, order, shared)
            beyond = surface_neighbours(solution.fit, standing=self.platform is not None)
            if turn == self.following.turns or len(beyond) <= self.following.let_go * len(
                band.cells
            ):
                break
            cells = np.concatenate([band.cells, beyond])
            start, weighed = start.begun(solution.fit, 1.0), weighed + 1
        assert solution is not None
        for _ in range(weighed, rounds - 1):
            start, solution = start.begun(solution.fit, 1.0), None
            solution = fit_implicit(band, *terms, start, order, shared)
        return Fitted(Spline(cell, solution.fit), solution, touched, *terms[1:], shared)

    def _with_spanned(
        self, touched: TouchedPoints, cell: float, before: Spline | None
    ) -> TouchedPoints:
        """The touched points, and the spanned places that an earlier spline does not lie behind.

        Each spanned place belongs to the touch of the nearest point, and is displaced with it.
        """
        if before is None or not len(self.spanned):
            return touched
        places = self.spanned - self.origin
        value, gradient = before.fit.band.evaluate(before.fit.control, places / before.cell)
        inside = before.cell * value < SPANNED.max_depth  # False where it is NaN
        places, gradient = places[inside] / cell, gradient[inside]
        slope = np.linalg.norm(gradient, axis=1, keepdims=True)
        slope = np.maximum(slope, solid.SPLINES.min_slope)
        nearest = scipy.spatial.cKDTree(touched.places).query(places)[1]
        return TouchedPoints(
            np.concatenate([touched.places, places]),
            np.concatenate([touched.normals, gradient / slope]),
            np.concatenate([touched.touch, touched.touch[nearest]]),
        )

    def _with_underside_points(self, points: TouchedPoints, cell: float) -> TouchedPoints:
        """The points, and those of the flat underside as one more touch."""
        if not len(self.below):
            return points
        down = np.broadcast_to([0.0, 0.0, -1.0], self.below.shape)
        last = np.full(len(self.below), self.touched.touch.max() + 1, np.int32)
        return TouchedPoints(
            np.concatenate([points.places, (self.below - self.origin) / cell]),
            np.concatenate([points.normals, down]),
            np.concatenate([points.touch, last]),
        )


def _surface_cells(
    setting: Setting, before: Spline | None, points: TouchedPoints, cell: float
) -> Ints:
    """Cells (k, 3) whose middle lies near the estimated surface, or that hold a point."""
    coarse, standing = setting.coarse, setting.platform is not None
    low = np.floor((coarse.low - setting.origin) / cell).astype(int)
    shape = np.array(coarse.distances.shape) * coarse.step
    high = np.ceil((coarse.low + shape - setting.origin) / cell).astype(int)
    if standing:
        low[2] = -1
    middles = np.moveaxis(np.indices(high - low), 0, -1).reshape(-1, 3) + low + 0.5
    distances = coarse.at(middles * cell + setting.origin) / cell
    if before is not None:
        close = np.flatnonzero(np.abs(distances) < BANDS.searched)
        there = before.distances(middles[close] * cell) / cell
        known = np.isfinite(there)
        # Near the band of the earlier spline the coarse solid is not used: its surface is better.
        beside = scipy.spatial.cKDTree(before.fit.band.cells + 0.5).query(
            middles[close][~known] * (cell / before.cell), distance_upper_bound=BANDS.lacked
        )
        there[~known] = np.where(beside[0] < BANDS.lacked, np.inf, distances[close][~known])
        gone = (distances[close] > BANDS.outside) & _are_untouched(setting, middles[close], cell)
        distances[close] = np.where(gone, distances[close], there)
    near = np.abs(distances) < BANDS.width
    if standing:  # the spline decides how it ends below, not the mirrored coarse solid
        lowest = np.percentile(points.places[:, 2], BANDS.lowest) + BANDS.foot
        near |= (middles[:, 2] < lowest) & (distances < BANDS.width)
    places = [middles[near], points.places]
    if before is not None:
        crossed = _crossed_places(before.fit) * (before.cell / cell)
        outside = coarse.at(crossed * cell + setting.origin) / cell > BANDS.outside
        places.append(crossed[~(outside & _are_untouched(setting, crossed, cell))])
    return np.asarray(np.floor(np.concatenate(places)), np.int32)


def _are_untouched(setting: Setting, places: Floats, cell: float) -> Bools:
    """Mask of the places (n, 3) [cells] far from touched points: there the coarse solid decides."""
    touched = (setting.touched.points - setting.origin) / cell
    return np.asarray(scipy.spatial.cKDTree(touched).query(places)[0] > BANDS.untouched)


def _crossed_places(fit: ImplicitFit) -> Floats:
    """Middles (n, 3) of those eighths of the cells that the surface passes through."""
    nodes = np.moveaxis(np.indices((3, 3, 3)), 0, -1).reshape(-1, 3) / 2.0
    inside = _inside(fit, nodes).reshape(-1, 3, 3, 3)
    corners = [inside[:, x : x + 2, y : y + 2, z : z + 2] for x, y, z in np.ndindex(2, 2, 2)]
    crossed = [eighth.any(axis=(1, 2, 3)) & ~eighth.all(axis=(1, 2, 3)) for eighth in corners]
    middles = fit.band.cells[:, None] + 0.25 + 0.5 * CUBE
    return np.asarray(middles[np.column_stack(crossed)])


def _inside(fit: ImplicitFit, offsets: Floats) -> Bools:
    """Mask (n, k) of the places that lie inside, at offsets (k, 3) in each cell."""
    values = fit.control[fit.band.local] @ basis_values(offsets).T
    return np.asarray(values < 0.0)


def surface_neighbours(fit: ImplicitFit, *, standing: bool) -> Ints:
    """Cells (k, 3) outside a band that the surface enters through a face of a cell in it."""
    band = fit.band
    inside, neighbours = _inside(fit, CUBE), []
    for axis in range(3):
        for side in (0, 1):
            face = inside[:, CUBE[:, axis] == side]
            crossed = face.any(axis=1) & ~face.all(axis=1)
            beside = band.cells[crossed].copy()
            beside[:, axis] += 2 * side - 1
            neighbours.append(beside[band.find(beside) < 0])
    beyond = np.concatenate(neighbours)
    return beyond[beyond[:, 2] >= -1] if standing else beyond


def _thinned(contacts: ContactPoints) -> ContactPoints:
    """Every n-th point of each touch, from its first one on, so that no touch is lost."""
    stride = -(-len(contacts.points) // GridSettings().max_points)
    if stride <= 1:
        return contacts
    order = np.argsort(contacts.touch, kind="stable")
    sizes = np.bincount(contacts.touch)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    kept = rank % stride == 0
    assert contacts.normals is not None
    return ContactPoints(contacts.points[kept], contacts.normals[kept], contacts.touch[kept])


def _hull_area(points: Floats) -> float:
    stride = max(1, len(points) // GridSettings().max_hull_points)
    return float(scipy.spatial.ConvexHull(points[::stride]).area)
