"""A general solid of touched points: which cells its surface passes through, and the fit over them.

A first spline is fitted over the cells at the coarse solid's surface; where its own surface leaves
these cells, the band is widened. Where touches are dense, a spline of finer cells follows. Where
thin walls are torn (the solid has holes), it is fitted anew with cells as small as the walls.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, Ints, check_extent, finite_array, positive
from palpate.core.geometry import linked_groups
from palpate.core.rebuild.contours import ContactPoints, checked_contacts
from palpate.core.rebuild.general.band import Band, basis_values, make_band
from palpate.core.rebuild.general.bends import (
    BendSettings,
    displacement_shares,
    surface_bends,
)
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
from palpate.core.rebuild.general.placements import found_motions, shared_motions
from palpate.core.rebuild.general.settings import (
    DEFAULT_GENERAL,
    GeneralSettings,
    GridSettings,
    SamplingSettings,
    WideningSettings,
)
from palpate.core.rebuild.general.solid import GeneralSolid, cell_weights
from palpate.core.rebuild.general.topology import CoarseSolid, coarse_solid
from palpate.core.rebuild.general.walls import wall_cell
from palpate.core.shapes import Mesh
from palpate.core.steps import Steps, no_steps

CUBE = np.moveaxis(np.indices((2, 2, 2)), 0, -1).reshape(-1, 3).astype(float)  # Its corners


def least_cell(
    points: Floats,
    platform: float | None = None,
    grid: GridSettings = DEFAULT_GENERAL.grid,
    sampling: SamplingSettings = DEFAULT_GENERAL.sampling,
) -> float:
    """Edge of the smallest cells that a fit of points (n, 3) may have [m]."""
    sides = np.ptp(points, axis=0)
    if platform is not None:  # the coarse solid has its mirror image below
        sides[2] = 2.0 * max(float(points[:, 2].max()) - platform, 0.0)
    area = _hull_area(points, grid.max_hull_points)
    by_band = grid.cells_per_square * area / grid.max_cells
    by_voxels = float(np.prod(sides)) / grid.max_voxels
    return max(math.sqrt(by_band), math.cbrt(by_voxels) / sampling.voxel)


def fitting_cell(contacts: ContactPoints, settings: GeneralSettings = DEFAULT_GENERAL) -> float:
    """Edge of cells [m] as fine as the spacing of the touches can resolve."""
    area = _hull_area(contacts.points, settings.grid.max_hull_points)
    spacing = math.sqrt(area / len(np.unique(contacts.touch)))
    is_dense = spacing < settings.grid.dense
    return settings.spline.cell if is_dense else settings.spline.draft_cell


def rebuild_general(
    contacts: ContactPoints | ArrayLike,
    normals: ArrayLike | None = None,
    *,
    free: Floats | None = None,
    spanned: Floats | None = None,
    platform: float | None = None,
    cell: float | None = None,
    pose: float | None = None,
    outward: bool = False,
    placement: Ints | None = None,
    underside: Floats | None = None,
    start: GeneralSolid | None = None,
    draft: bool = False,
    step: Steps = no_steps,
    settings: GeneralSettings = DEFAULT_GENERAL,
) -> GeneralSolid:
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
    `pose`: standard deviation of a touch's place [m]. Both are those of `settings.spline` if left
    out. `start`: a solid of the first of these contacts, from which the fit starts: it takes a
    fraction of the time. `draft`: an intermediate solid, for planning more touches: its band is
    widened less, and the error calibration of `start` is kept. `settings`: how it is fitted; the
    solid keeps them for its mesh, its errors and its updates. Cells are larger than `cell` if there
    would be too many (`GridSettings`). Raises ValueError if there are no normals, if normals
    disagree, if all points lie in one plane, or if they span more than a metre (coordinates are in
    metres).
    """
    contacts = _contacts_with_normals(contacts, normals)
    cell = settings.spline.cell if cell is None else cell
    pose = settings.spline.pose if pose is None else pose
    positive("cell", cell, "m")
    check_extent("patches", contacts.points, settings.grid.max_extent)
    if is_flat(contacts.points, settings.sampling):
        raise ValueError("patches must not all lie in one plane")
    touched = contacts if start is not None else _thinned(contacts, settings.grid.max_points)
    touched = touched if outward else oriented(touched, settings.orientation).contacts
    none, placed = np.zeros((0, 3)), np.zeros(0, np.int32) if placement is None else placement
    known = Known(
        touched,
        free,
        none if spanned is None else spanned,
        _far_from_touch(underside, touched.points, settings.underside.min_distance),
        platform,
        max(pose, settings.motions.least_pose) if placed.any() else pose,
        placed,
        draft,
        settings,
    )
    return _solid_with_whole_walls(known, cell, start, step)


def _contacts_with_normals(
    contacts: ContactPoints | ArrayLike, normals: ArrayLike | None
) -> ContactPoints:
    """The contacts as `rebuild_general` is given them, checked."""
    if not isinstance(contacts, ContactPoints):
        points = finite_array("contacts", contacts, (None, 3))
        directions = None if normals is None else np.asarray(normals, np.float64)
        contacts = ContactPoints(points, directions, np.arange(len(points), dtype=np.int32))
    contacts = checked_contacts(contacts)
    if contacts.normals is None or not len(contacts.points):
        raise ValueError("patches must have points and normals for a general solid, got none")
    return contacts


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
    settings: GeneralSettings

    @property
    def origin(self) -> Floats:
        """Origin of the grid of cells, (3,)."""
        return np.array([0.0, 0.0, self.platform or 0.0])

    @property
    def widening(self) -> WideningSettings:
        """How the band is widened."""
        bands = self.settings.bands
        return bands.draft_widening if self.draft else bands.widening


def _solid_with_whole_walls(
    known: Known, cell: float, start: GeneralSolid | None, step: Steps
) -> GeneralSolid:
    """The solid with cells of an edge [m], or smaller ones where that one's thin walls are torn."""
    grid, sampling = known.settings.grid, known.settings.sampling
    where = known.touched.points, known.platform
    cell = max(cell, least_cell(*where, grid, sampling))
    finer_grid = replace(grid, max_cells=grid.max_wall_cells)
    walls = wall_cell(known.touched, cell, known.settings.walls)
    walls = max(walls, least_cell(*where, finer_grid, sampling))
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


def _tears(rebuilt: GeneralSolid) -> int:
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
    known: Known, cell: float, grid: GridSettings, start: GeneralSolid | None, step: Steps
) -> GeneralSolid:
    """The solid with cells of an edge [m], or larger ones if there would be too many."""
    touched, settings = known.touched, known.settings
    with step("topology"):
        coarse = _coarse(known, cell)
    with step("implicit spline"):
        problem = SplineProblem(known, coarse, grid)
        before = None if start is None else Spline(start.cell, start.fit)
        draft_cell = settings.spline.draft_cell
        if before is None and cell < draft_cell and grid == settings.grid:
            before = problem.fit(draft_cell, None, 1).spline
        fitted = problem.fit(cell, before, settings.sampling.min_rounds if before is None else 1)
    with step("held-out touches"):
        predicted_before = start.predicted if known.draft and start is not None else None
        fit, predicted = surface_errors(fitted, predicted_before, settings.errors, settings.bends)
    count = int(touched.touch.max()) + 1
    displacements, fit = fit.displacements, fit.of_first(len(touched.points), count)
    rebuilt = GeneralSolid(
        known.origin,
        fitted.spline.cell,
        fit,
        coarse,
        touched,
        known.platform,
        predicted,
        known.pose,
        settings=settings,
    )
    if fitted.shared is None:
        return rebuilt
    unknowns = fitted.shared.of(displacements)
    motions = found_motions(touched, known.placement, unknowns, settings.motions)
    return replace(rebuilt, placement=known.placement, motions=motions)


def _far_from_touch(underside: Floats | None, touched: Floats, min_distance: float) -> Floats:
    """Those places (k, 3) of an underside that lie far [m] from all touched points."""
    if underside is None or not len(underside):
        return np.zeros((0, 3))
    away = scipy.spatial.cKDTree(touched).query(underside)[0]
    return np.asarray(underside[away > min_distance])


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


def is_flat(points: Floats, settings: SamplingSettings = DEFAULT_GENERAL.sampling) -> bool:
    """Whether points (n, 3) [m] lie in one plane, and so enclose no solid."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(len(points) < 4 or spread[2] < settings.flat * np.sqrt(len(points)))


def _coarse(known: Known, cell: float) -> CoarseSolid:
    touched = _with_underside(known.touched, known.below)
    settings, sampling = known.settings, known.settings.sampling
    hull = _hull_area(touched.points, settings.grid.max_hull_points)
    touches = int(touched.touch.max()) + 1
    spread = sampling.spread * np.sqrt(hull / touches)
    return coarse_solid(
        touched.points,
        np.asarray(touched.normals),
        np.zeros((0, 3)) if known.free is None else known.free,
        step=sampling.voxel * cell,
        spread=float(np.clip(spread, sampling.min_spread, sampling.max_spread)),
        most_area=sampling.max_area * hull / touches,
        platform=known.platform,
        settings=settings.coarse,
    )


class SplineProblem(NamedTuple):
    """What a spline is fitted to."""

    known: Known
    coarse: CoarseSolid
    grid: GridSettings  # Where cells are small because walls are thin, with a larger limit

    def fit(self, cell: float, before: Spline | None, rounds: int) -> Fitted:
        """The spline over the cells at the surface; the band is widened where it leaves them.

        `before`: a spline of the first of these touches: it is the first estimate of the surface,
        of displacements and of outliers. `rounds`: least number of fits, to weigh outliers.
        """
        known, settings, grid = self.known, self.known.settings, self.grid
        places = (known.touched.points - known.origin) / cell
        touched = TouchedPoints(places, np.asarray(known.touched.normals), known.touched.touch)
        points = _with_underside_points(known, _with_spanned(known, touched, cell, before), cell)
        start = plain_start(len(points.places), int(points.touch.max()) + 1)
        start.weights[len(places) :] = settings.spanned.weight
        start.weights[len(points.places) - len(known.below) :] = settings.underside.weight
        shared = shared_motions(points, known.placement, cell, known.pose, settings.motions)
        if before is not None:
            start = start.begun(before.fit, before.cell / cell)
            points = _shared_by_bend(points, before, cell, settings.bends)
        cells = _surface_cells(self, before, points, cell)
        over = len(make_band(cells).cells) / (grid.excess * grid.max_cells)
        if over > 1.0:  # the surface is larger than the hull of the touched points
            return self.fit(cell * math.sqrt(grid.excess * over), before, rounds)
        solution: Solution | None = None
        weighed = 0
        for turn in range(known.widening.max_rounds + 1):
            band = make_band(cells)
            order = dissect(band.cells, band.local, len(band.control))
            control = self.coarse.at(band.control * cell + known.origin) / cell
            terms = control, cell_weights(cell, known.pose, settings.spline)
            swept = _swept_weights(known, band, cell)
            solution = None  # memory: never two factors at a time
            solution = fit_implicit(band, points, *terms, start, order, shared, swept, settings.fit)
            beyond = surface_neighbours(solution.fit, standing=known.platform is not None)
            is_whole = len(beyond) <= known.widening.max_missing * len(band.cells)
            if turn == known.widening.max_rounds or is_whole:
                break
            cells = np.concatenate([band.cells, beyond])
            start, weighed = start.begun(solution.fit, 1.0), weighed + 1
            points = _shared_by_bend(points, Spline(cell, solution.fit), cell, settings.bends)
        assert solution is not None
        for _ in range(weighed, rounds - 1):
            points = _shared_by_bend(points, Spline(cell, solution.fit), cell, settings.bends)
            start, solution = start.begun(solution.fit, 1.0), None
            solution = fit_implicit(band, points, *terms, start, order, shared, swept, settings.fit)
        return Fitted(Spline(cell, solution.fit), solution, touched, *terms, shared)


def _shared_by_bend(
    points: TouchedPoints, spline: Spline, cell: float, settings: BendSettings
) -> TouchedPoints:
    """The points [cells], whose shares in displacements follow from the bends of a spline."""
    band, control, places = spline.fit.band, spline.fit.control, points.places * cell / spline.cell
    bends = surface_bends(band, control, places, spline.cell, settings)
    return points._replace(shares=displacement_shares(bends, settings))


def _swept_weights(known: Known, band: Band, cell: float) -> Floats:
    """Weights (c,) of the distance to the coarse solid in cells that fingers swept, far from touch.

    The spline does not know what was swept. Without these weights it is extrapolated from the rim
    of a cavity to a lid in front of places where fingers met nothing.
    """
    weights = np.zeros(len(band.cells))
    if known.free is not None and len(known.free):
        number = band.find(np.floor((known.free - known.origin) / cell).astype(np.int32))
        number = np.unique(number[number >= 0])
        middles = np.asarray(band.cells[number] + 0.5, np.float64)
        number = number[_are_untouched(known, middles, cell)]
        weights[number] = (cell / known.settings.bands.swept) ** 2
    return weights


def _with_spanned(
    known: Known, touched: TouchedPoints, cell: float, before: Spline | None
) -> TouchedPoints:
    """The touched points, and the spanned places that an earlier spline does not lie behind.

    Each spanned place belongs to the touch of the nearest point, and is displaced with it.
    """
    if before is None or not len(known.spanned):
        return touched
    places = known.spanned - known.origin
    value, gradient = before.fit.band.evaluate(before.fit.control, places / before.cell)
    inside = before.cell * value < known.settings.spanned.max_depth  # False where it is NaN
    places, gradient = places[inside] / cell, gradient[inside]
    slope = np.linalg.norm(gradient, axis=1, keepdims=True)
    slope = np.maximum(slope, known.settings.spline.min_slope)
    nearest = scipy.spatial.cKDTree(touched.places).query(places)[1]
    return TouchedPoints(
        np.concatenate([touched.places, places]),
        np.concatenate([touched.normals, gradient / slope]),
        np.concatenate([touched.touch, touched.touch[nearest]]),
    )


def _with_underside_points(known: Known, points: TouchedPoints, cell: float) -> TouchedPoints:
    """The points, and those of the flat underside as one more touch."""
    if not len(known.below):
        return points
    down = np.broadcast_to([0.0, 0.0, -1.0], known.below.shape)
    last = np.full(len(known.below), known.touched.touch.max() + 1, np.int32)
    return TouchedPoints(
        np.concatenate([points.places, (known.below - known.origin) / cell]),
        np.concatenate([points.normals, down]),
        np.concatenate([points.touch, last]),
    )


def _surface_cells(
    problem: SplineProblem, before: Spline | None, points: TouchedPoints, cell: float
) -> Ints:
    """Cells (k, 3) whose middle lies near the estimated surface, or that hold a point."""
    known, coarse, bands = problem.known, problem.coarse, problem.known.settings.bands
    origin, standing = known.origin, known.platform is not None
    low = np.floor((coarse.low - origin) / cell).astype(int)
    shape = np.array(coarse.distances.shape) * coarse.step
    high = np.ceil((coarse.low + shape - origin) / cell).astype(int)
    if standing:
        low[2] = -1
    middles = np.moveaxis(np.indices(high - low), 0, -1).reshape(-1, 3) + low + 0.5
    distances = coarse.at(middles * cell + origin) / cell
    if before is not None:
        close = np.flatnonzero(np.abs(distances) < bands.searched)
        there = before.distances(middles[close] * cell, known.settings.fit.min_slope) / cell
        in_band = np.isfinite(there)
        # Near the band of the earlier spline the coarse solid is not used: its surface is better.
        beside = scipy.spatial.cKDTree(before.fit.band.cells + 0.5).query(
            middles[close][~in_band] * (cell / before.cell), distance_upper_bound=bands.lacked
        )
        there[~in_band] = np.where(beside[0] < bands.lacked, np.inf, distances[close][~in_band])
        gone = (distances[close] > bands.outside) & _are_untouched(known, middles[close], cell)
        distances[close] = np.where(gone, distances[close], there)
    near = np.abs(distances) < bands.width
    if standing:  # the spline decides how it ends below, not the mirrored coarse solid
        lowest = np.percentile(points.places[:, 2], bands.lowest) + bands.foot
        near |= (middles[:, 2] < lowest) & (distances < bands.width)
    places = [middles[near], points.places]
    if before is not None:
        crossed = _crossed_places(before.fit) * (before.cell / cell)
        outside = coarse.at(crossed * cell + origin) / cell > bands.outside
        places.append(crossed[~(outside & _are_untouched(known, crossed, cell))])
    return np.asarray(np.floor(np.concatenate(places)), np.int32)


def _are_untouched(known: Known, places: Floats, cell: float) -> Bools:
    """Mask of the places (n, 3) [cells] far from touched points: there the coarse solid decides."""
    touched = (known.touched.points - known.origin) / cell
    return np.asarray(
        scipy.spatial.cKDTree(touched).query(places)[0] > known.settings.bands.untouched
    )


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


def _thinned(contacts: ContactPoints, max_points: int) -> ContactPoints:
    """Every n-th point of each touch, from its first one on, so that no touch is lost."""
    stride = -(-len(contacts.points) // max_points)
    if stride <= 1:
        return contacts
    order = np.argsort(contacts.touch, kind="stable")
    sizes = np.bincount(contacts.touch)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    kept = rank % stride == 0
    assert contacts.normals is not None
    return ContactPoints(contacts.points[kept], contacts.normals[kept], contacts.touch[kept])


def _hull_area(points: Floats, max_points: int) -> float:
    stride = max(1, len(points) // max_points)
    return float(scipy.spatial.ConvexHull(points[::stride]).area)
