"""Meshes of a closed surface to a tolerance, and its nearest points.

A triangle whose corners lie on the surface leaves it by at most (|X_vv| dv^2 + 2 |X_vt| dv dt +
|X_tt| dt^2) / 8, of which the part along the normal counts. Rows and columns are spaced by that,
then checked on the surface and split where they are too wide. Towards the poles rings have fewer
points. The search for nearest points starts Newton's method on (v, turn) at the nearest point of a
mesh. It runs within one piece; where it ends at a seam or a pole, it is repeated from the other
side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core import geometry
from palpate.core.arrays import Bools, Floats, Ints, finite_array, positive
from palpate.core.rebuild.surface.closed import Surface, dot
from palpate.reprs import readable


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSettings:
    """Spacing of rows and columns of a mesh that keeps a tolerance."""

    default_tolerance: float = 2e-4  # fraction of the surface's size
    # Of the tolerance, for rows and columns; the rest is for thinned rings.
    grid_share: float = 0.65
    n_rows: int = 33  # places along each piece at which second derivatives are taken
    n_turns: int = 128  # places around at which second derivatives are taken
    max_halvings: int = 3  # of the number of points of a ring near a pole
    max_aspect: float = 4.0  # distance of rows over distance of columns
    min_density: float = 0.3  # of columns anywhere, fraction of their mean density
    n_rounds: int = 8  # of checks and splits
    max_vertices: int = 2_000_000


@readable
class SurfaceMesh(NamedTuple):
    """Triangles whose vertices have places on the surface."""

    vertices: Floats  # (n, 3)
    faces: Ints  # (m, 3), counter-clockwise seen from outside
    v: Floats  # (n,)
    turns: Floats  # (n,); arbitrary at a pole


def mesh_surface(
    surface: Surface, tolerance: float | None = None, settings: MeshSettings = MeshSettings()
) -> SurfaceMesh:
    """A watertight mesh of genus 0 that leaves the surface by at most `tolerance`, in its unit.

    If left out, the tolerance is 2e-4 of the surface's size. Raises ValueError if it is not
    positive, or so small that the mesh would have more than 2,000,000 vertices.
    """
    wanted = settings.default_tolerance * surface.size if tolerance is None else tolerance
    wanted = positive("tolerance", wanted, "in the unit of the surface")
    rows, columns = _spaced(surface, wanted, settings)
    for _ in range(settings.n_rounds):
        wide_rows, wide_columns = _too_wide(surface, rows, columns, settings.grid_share * wanted)
        if not wide_rows.any() and not wide_columns.any():
            break
        rows, columns = _split(rows, wide_rows), _split(columns, wide_columns)
        _check_count(len(rows) * len(columns), wanted, settings.max_vertices)
    ring_tolerance = (1.0 - settings.grid_share) * wanted
    return _joined(surface, rows, columns, ring_tolerance, settings.max_halvings)


def grid_mesh(
    surface: Surface, n_rows: int = 48, min_rows: int = 6, n_columns: int = 64
) -> SurfaceMesh:
    """A watertight mesh of genus 0 on an even grid, without a tolerance: for views and estimates.

    It has `n_rows` in all, at least `min_rows` for each piece, and `n_columns` around.
    """
    rows = [
        np.linspace(low, high, max(round(n_rows * (high - low)), min_rows) + 1)[1:]
        for low, high in zip(surface.seams[:-1], surface.seams[1:], strict=True)
    ]
    columns = np.arange(n_columns + 1) / n_columns
    every_row = np.concatenate([np.zeros(1), *rows])
    return _joined(surface, every_row, columns, 0.0, MeshSettings().max_halvings)


def _joined(
    surface: Surface, rows: Floats, columns: Floats, tolerance: float, max_halvings: int
) -> SurfaceMesh:
    """Triangles of rows and columns; rings are thinned where that errs by less than a tolerance."""
    missing = -(len(columns) - 1) % (1 << max_halvings)  # columns, until rings can be halved
    widest = np.zeros(len(columns) - 1, bool)
    widest[np.argsort(-np.diff(columns), kind="stable")[:missing]] = True
    columns = _split(columns, widest)
    grid = surface.on_grid(rows[1:-1], columns[:-1])
    levels = _levels(grid, tolerance, max_halvings)
    sizes = (len(columns) - 1) >> levels
    faces = geometry.join_rings(sizes)
    rings = [ring[:: 1 << level] for ring, level in zip(grid, levels, strict=True)]
    turns = [columns[: -1 : 1 << level] for level in levels]
    poles = surface.at(np.array([0.0, 1.0]), np.zeros(2))
    return SurfaceMesh(
        np.concatenate([poles[:1], *rings, poles[1:]]),
        faces,
        np.concatenate([[0.0], np.repeat(rows[1:-1], sizes), [1.0]]),
        np.concatenate([[0.0], *turns, [0.0]]),
    )


def _spaced(surface: Surface, tolerance: float, settings: MeshSettings) -> tuple[Floats, Floats]:
    """Rows from 0 to 1, seams among them, and columns from 0 to 1."""
    turns = np.arange(settings.n_turns + 1) / settings.n_turns
    samples = [
        np.linspace(low, high, settings.n_rows)
        for low, high in zip(surface.seams[:-1], surface.seams[1:], strict=True)
    ]
    half = 4.0 * (settings.grid_share * tolerance)
    bends = [_bends(surface, piece, v, turns) for piece, v in enumerate(samples)]
    dense = np.sqrt(np.max([bend[2].max(axis=0) for bend in bends], axis=0) / half)
    dense = np.maximum(dense, settings.min_density * dense.mean())
    # A ring that is halved as often as possible still has 3 points.
    columns = _spread(turns, dense, 3 << settings.max_halvings)
    around = []
    for piece, v in enumerate(samples):
        ring = surface.piece_on_grid(piece, v, turns)
        around.append(np.linalg.norm(np.diff(ring, axis=1), axis=2).sum(axis=1))
    most = max(float(lengths.max()) for lengths in around)
    # Lengths of the edges along each ring, after small rings are thinned.
    factor = 1 << settings.max_halvings
    edges = [np.clip(factor * lengths, 0.25 * most, most) / len(columns) for lengths in around]
    rows = [np.zeros(1)]
    for v, (along, mixed, _, speed), edge in zip(samples, bends, edges, strict=True):
        by_twist = (2.0 * mixed / np.maximum(dense, 1e-9)).max(axis=1) / half
        density = np.maximum(np.sqrt(along.max(axis=1) / half), by_twist)
        density = np.maximum(density, speed / (settings.max_aspect * edge))
        count = int((v[-1] - v[0]) * density.mean()) * len(columns)
        _check_count(count, tolerance, settings.max_vertices)
        rows.append(_spread(v, density, 1)[1:])
    return np.concatenate(rows), columns


def _bends(
    surface: Surface, piece: int, v: Floats, turns: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Normal parts of X_vv, X_vt and X_tt, (rows, turns) each, and mean length of X_v (rows,)."""
    low, high = surface.seams[piece], surface.seams[piece + 1]
    # The upper seam itself belongs to the next piece.
    normals = surface.normals_on_grid(np.minimum(v, high - 1e-9 * (high - low)), turns)
    along, mixed, around = (
        np.abs(dot(surface.piece_on_grid(piece, v, turns, by), normals))
        for by in ((2, 0), (1, 1), (0, 2))
    )
    speed = np.linalg.norm(surface.piece_on_grid(piece, v, turns, (1, 0)), axis=2)
    return along, mixed, around, speed.mean(axis=1)


def _spread(places: Floats, density: Floats, least: int) -> Floats:
    """Places from the first to the last, at least `least` steps, spaced by a density."""
    steps = 0.5 * (density[1:] + density[:-1]) * np.diff(places)
    total = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(int(np.ceil(total[-1])), least)
    if not total[-1] > 0.0:
        return np.linspace(places[0], places[-1], count + 1)
    spread = np.interp(np.linspace(0.0, total[-1], count + 1), total, places)
    spread[0], spread[-1] = places[0], places[-1]
    return spread


def _too_wide(
    surface: Surface, rows: Floats, columns: Floats, tolerance: float
) -> tuple[Bools, Bools]:
    """Steps between rows, and between columns, that are too wide for a tolerance."""
    half_rows, half_columns = 0.5 * (rows[1:] + rows[:-1]), 0.5 * (columns[1:] + columns[:-1])
    grid = surface.on_grid(rows, columns)
    along = 0.5 * (grid[1:] + grid[:-1])
    around = 0.5 * (grid[:, 1:] + grid[:, :-1])
    across = 0.5 * (grid[1:, 1:] + grid[:-1, :-1])
    by_row = _sag(surface, half_rows, columns, along) > tolerance
    by_column = _sag(surface, rows, half_columns, around) > tolerance
    by_cell = _sag(surface, half_rows, half_columns, across) > tolerance
    wide_rows = np.asarray(by_row.any(axis=1))
    wide_columns = np.asarray(by_column.any(axis=0))
    # A diagonal alone is too long where the surface twists: more rows correct that.
    alone = by_cell & ~wide_columns & ~wide_rows[:, None]
    return wide_rows | alone.any(axis=1), wide_columns


def _sag(surface: Surface, rows: Floats, columns: Floats, chords: Floats) -> Floats:
    """Distances (rows, columns) of the surface from middles of chords, along its normal."""
    offset = surface.on_grid(rows, columns) - chords
    return np.abs(dot(offset, surface.normals_on_grid(rows, columns)))


def _split(places: Floats, which: Bools) -> Floats:
    """Places with the middles of some steps added."""
    return np.sort(np.concatenate([places, 0.5 * (places[1:] + places[:-1])[which]]))


def _levels(grid: Floats, tolerance: float, max_halvings: int) -> Ints:
    """How often the points of each ring (rows, columns, 3) are halved: most often at the poles."""
    allowed = np.zeros(len(grid), np.int32)
    for level in range(1, max_halvings + 1):
        off = _off_chords(grid, 1 << level)
        allowed[(off <= tolerance) & (allowed == level - 1)] = level
    allowed[len(grid) // 2] = 0
    # From both ends, so that adjacent rings differ by at most one level.
    for order in (range(1, len(grid)), range(len(grid) - 2, -1, -1)):
        for row in order:
            before = row - order.step
            allowed[row] = min(allowed[row], allowed[before] + 1)
    return allowed


def _off_chords(grid: Floats, step: int) -> Floats:
    """Largest distance of rings (rows, columns, 3) from chords over `step` points, (rows,)."""
    begin = grid[:, ::step]
    chord = np.roll(begin, -1, axis=1) - begin
    square = np.maximum(np.einsum("ijk,ijk->ij", chord, chord), np.finfo(float).tiny)
    off = np.zeros(len(grid))
    for first in range(1, step):
        offset = grid[:, first::step] - begin
        along = np.einsum("ijk,ijk->ij", offset, chord) / square
        beside = offset - along[:, :, None] * chord
        off = np.maximum(off, np.linalg.norm(beside, axis=2).max(axis=1))
    return off


def _check_count(count: int, tolerance: float, max_vertices: int) -> None:
    if count > max_vertices:
        raise ValueError(
            f"tolerance must need at most {max_vertices} vertices, "
            f"got {tolerance:g}, which needs {count}"
        )


@readable
class NearestOnSurface(NamedTuple):
    """Points of a surface that are nearest to given points."""

    points: Floats  # (n, 3)
    v: Floats  # (n,)
    turns: Floats  # (n,), from 0 to 1
    distances: Floats  # (n,), negative inside
    converged: Bools  # (n,): whether the last step was negligible


@dataclass(frozen=True, slots=True, kw_only=True)
class NearestSettings:
    """Newton's method for nearest points, with the damping of Levenberg and Marquardt."""

    max_steps: int = 40
    tolerance: float = 1e-11  # fraction of the surface's size: a smaller step is the last
    first_damping: float = 1e-3
    min_damping: float = 1e-9
    max_damping: float = 1e9
    max_turn_step: float = 0.1  # [turns]
    pole_distance: float = 0.02  # fraction of the piece, at which the other side of a pole is tried
    seam_distance: float = 1e-9  # in v below a seam, where the lower piece begins
    near_surface: float = 4.0  # tolerances of the mesh: nearer, the surface's normal gives the sign


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSearch:
    """A surface, prepared for the search of nearest points."""

    surface: Surface
    mesh: SurfaceMesh
    search: geometry.NearestSearch
    tolerance: float  # of the mesh
    settings: NearestSettings = NearestSettings()

    def nearest(self, points: ArrayLike) -> NearestOnSurface:
        """Nearest points to points (n, 3), signed; ValueError if one is not finite."""
        queries = finite_array("points", points, (None, 3))
        seed = geometry.nearest_points(self.search, queries)
        v, turns = _places(self.mesh, seed)
        settings = self.settings
        run = _newton(self.surface, queries, self.surface.piece_of(v), v, turns, settings)
        run = _beyond_seams(self.surface, queries, run, settings)
        nearest = self.surface.at(run.v, run.turns)
        # The root of the square would lose half the digits next to the surface.
        distances = np.linalg.norm(queries - nearest, axis=1)
        far = geometry.are_outside(self.mesh.vertices, self.mesh.faces, queries, seed)
        outwards = self.surface.normals(run.v, run.turns)
        seam = np.isin(run.v, self.surface.seams[1:-1])  # the normals of both pieces are added
        below = run.v[seam] - settings.seam_distance
        outwards[seam] += self.surface.normals(below, run.turns[seam])
        near = distances <= settings.near_surface * self.tolerance
        out = np.where(near, np.einsum("ni,ni->n", queries - nearest, outwards) >= 0.0, far)
        signed = np.where(out, distances, -distances)
        return NearestOnSurface(nearest, run.v, np.mod(run.turns, 1.0), signed, run.converged)

    def inside(self, points: ArrayLike) -> Bools:
        """Whether points (n, 3) lie inside, (n,); errors as for `nearest`."""
        return np.asarray(self.nearest(points).distances < 0.0)


class _Run(NamedTuple):
    """Results of Newton's method."""

    piece: Ints
    v: Floats
    turns: Floats
    square: Floats
    converged: Bools


def search_surface(
    surface: Surface,
    tolerance: float | None = None,
    settings: NearestSettings = NearestSettings(),
    mesh_settings: MeshSettings = MeshSettings(),
) -> SurfaceSearch:
    """Prepare a surface for the search of nearest points.

    The search begins in a mesh of this tolerance (`mesh_surface`, which has the default and the
    errors): of two places that are equally near to within the tolerance, it may return the farther.
    """
    if tolerance is None:
        tolerance = mesh_settings.default_tolerance * surface.size
    mesh = mesh_surface(surface, tolerance, mesh_settings)
    search = geometry.nearest_search(mesh.vertices[mesh.faces])
    return SurfaceSearch(surface, mesh, search, tolerance, settings)


def _places(mesh: SurfaceMesh, seed: geometry.Nearest) -> tuple[Floats, Floats]:
    """Values of v and turn at points of the mesh."""
    rows = mesh.faces[seed.faces]
    corners = mesh.vertices[rows]
    point = seed.points[:, None]
    apart = np.linalg.norm(corners - point, axis=2)
    following, beyond = np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)
    areas = np.linalg.norm(np.cross(following - point, beyond - point), axis=2)
    total = areas.sum(axis=1, keepdims=True)
    even = np.where(total > 0.0, total, 1.0)
    shares = np.where(total > 0.0, areas / even, apart == apart.min(axis=1, keepdims=True))
    turns = mesh.turns[rows]
    poles = (rows == 0) | (rows == len(mesh.vertices) - 1)
    base = np.where(poles[:, 0], turns[:, 1], turns[:, 0])[:, None]
    near = turns - base - np.round(turns - base)
    near = np.where(poles, near.sum(axis=1, keepdims=True) * 0.5, near)
    weights = np.where(poles, 0.0, shares)
    weight = weights.sum(axis=1)
    turn = base[:, 0] + np.sum(weights * near, axis=1) / np.where(weight > 0.0, weight, 1.0)
    v = np.sum(shares * mesh.v[rows], axis=1) / shares.sum(axis=1)
    return np.clip(v, 0.0, 1.0), turn


def _newton(
    surface: Surface,
    points: Floats,
    piece: Ints,
    v: Floats,
    turns: Floats,
    settings: NearestSettings,
) -> _Run:
    """Newton's method from places v and turns (n,), within the piece (n,) of each."""
    ends = _Run(piece, v.copy(), turns.copy(), np.empty(len(v)), np.zeros(len(v), bool))
    for number in np.unique(piece).tolist():
        rows = np.flatnonzero(piece == number)
        parts = _descend(surface, number, points[rows], v[rows], turns[rows], settings)
        for whole, part in zip(ends[1:], parts, strict=True):
            whole[rows] = part
    return ends


def _descend(
    surface: Surface,
    piece: int,
    points: Floats,
    v: Floats,
    turns: Floats,
    settings: NearestSettings,
) -> tuple[Floats, Floats, Floats, Bools]:
    """Values of v, turns, squared distances and convergence (n,) within one piece."""
    low, high = surface.seams[piece], surface.seams[piece + 1]
    place = np.stack([np.clip(v, low, high), turns], axis=-1)
    damping = np.full(len(v), settings.first_damping)
    done = np.zeros(len(v), bool)
    off = surface.piece_at(piece, place[:, 0], place[:, 1]) - points
    square = np.einsum("ni,ni->n", off, off)
    running = np.arange(len(v))
    for _ in range(settings.max_steps):
        step, moved = _step(
            surface, piece, place[running], off[running], damping[running], settings.max_turn_step
        )
        ahead = place[running] + step
        ahead[:, 0] = np.clip(ahead[:, 0], low, high)
        there = surface.piece_at(piece, ahead[:, 0], ahead[:, 1]) - points[running]
        new_square = np.einsum("ni,ni->n", there, there)
        better = new_square <= square[running]
        rows = running[better]
        place[rows], off[rows], square[rows] = ahead[better], there[better], new_square[better]
        damped = np.where(better, 0.1, 10.0) * damping[running]
        damping[running] = np.maximum(damped, settings.min_damping)
        done[running] = moved <= settings.tolerance * surface.size
        running = running[~done[running] & (damping[running] < settings.max_damping)]
        if not len(running):
            break
    return place[:, 0], place[:, 1], square, done


def _step(
    surface: Surface,
    piece: int,
    place: Floats,
    off: Floats,
    damping: Floats,
    max_turn_step: float,
) -> tuple[Floats, Floats]:
    """Damped Newton steps (n, 2), and the distances (n,) that they move the point."""
    orders = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    by_v, by_t, *seconds = (surface.piece_at(piece, place[:, 0], place[:, 1], by) for by in orders)
    g, h = dot(off, by_v), dot(off, by_t)
    a, b, c = dot(by_v, by_v), dot(by_v, by_t), dot(by_t, by_t)
    full = [flat + dot(off, second) for flat, second in zip((a, b, c), seconds, strict=True)]
    # Where the full second derivative is not positive definite, its part without curvature is.
    definite = (full[0] > 0.0) & (full[0] * full[2] - full[1] ** 2 > 0.0)
    aa, bb, cc = (np.where(definite, *pair) for pair in zip(full, (a, b, c), strict=True))
    tiny = np.finfo(float).tiny
    aa, cc = aa + damping * a + tiny, cc + damping * c + tiny
    low, high = surface.seams[piece], surface.seams[piece + 1]
    held = ((place[:, 0] <= low) & (g > 0.0)) | ((place[:, 0] >= high) & (g < 0.0))
    whole = np.maximum(aa * cc - bb * bb, tiny)
    along = np.where(held, 0.0, (bb * h - cc * g) / whole)
    along = np.clip(along, low - place[:, 0], high - place[:, 0])
    around = np.clip(-(h + bb * along) / cc, -max_turn_step, max_turn_step)
    moved = np.linalg.norm(along[:, None] * by_v + around[:, None] * by_t, axis=1)
    return np.stack([along, around], axis=-1), moved


def _beyond_seams(surface: Surface, points: Floats, run: _Run, settings: NearestSettings) -> _Run:
    """Repeat from the next piece where a point ended at a seam, from across the axis at a pole."""
    last = len(surface.pieces) - 1
    low, high = surface.seams[run.piece], surface.seams[run.piece + 1]
    for at, side in ((run.v <= low, -1), (run.v >= high, 1)):
        rows = np.flatnonzero(at)
        piece = np.clip(run.piece[rows] + side, 0, last).astype(np.int32)
        pole = piece == run.piece[rows]
        inwards = -side * settings.pole_distance * (high - low)[rows]
        v = run.v[rows] + np.where(pole, inwards, 0.0)
        turns = run.turns[rows] + np.where(pole, 0.5, 0.0)
        tried = _newton(surface, points[rows], piece, v, turns, settings)
        nearer = tried.square < run.square[rows]
        better = rows[nearer]
        run.piece[better], run.converged[better] = tried.piece[nearer], tried.converged[nearer]
        run.v[better], run.turns[better] = tried.v[nearer], tried.turns[nearer]
        run.square[better] = tried.square[nearer]
    return run
