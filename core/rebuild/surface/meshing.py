"""Triangles as fine as a closed surface needs them, and its nearest points, which begin in them.

A triangle whose corners lie on the surface leaves it by at most (|X_vv| dv^2 + 2 |X_vt| dv dt +
|X_tt| dt^2) / 8, of which the part along the normal counts. Rows and columns are laid by that, then
checked on the surface and split where they do not suffice. Towards the poles rings get fewer
points. The nearest point of a mesh says where Newton's method on (v, turn) begins. It is run within
one piece at a time; a point that ends at a seam or a pole is tried on from across.
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

DEFAULT_TOLERANCE = 2e-4  # Tolerance, of the size, where none is asked for
MOST_PLACES = 2_000_000  # Most vertices
SAMPLE_ROWS, SAMPLE_TURNS = 33, 128  # Places of each piece at which second derivatives are taken
GRID_SHARE = 0.65  # Of the tolerance, for rows and columns; the rest is for thinner rings
FEWEST = 24  # Columns: thinned to the last, a ring still has 3 points
HALVINGS = 3  # Rings near a pole have down to this power of a half of the others' points
SLENDER = 4.0  # Rows are at most this many times farther apart than columns
EVEN = 0.3  # Columns lie nowhere less close than this share of their mean density
ROUNDS = 8  # Of checks and splits
EVEN_ROWS, FEWEST_ROWS, EVEN_COLUMNS = 48, 6, 64  # Of an even grid: in all, of a piece, and around
# Of nearest points.
STEPS = 40  # Most steps of Newton's method
ENOUGH = 1e-11  # Of the size: a step that moves the point by less ends it
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-9, 1e9
WIDEST_TURN = 0.1  # Of a step around
ACROSS = 0.02  # Of the piece: how far from a pole the other side is tried
BELOW = 1e-9  # v below a seam at which the lower piece answers
CLOSE = 4.0  # Tolerances of the mesh: nearer, the surface's own normal says which side it is


@readable
class SurfaceMesh(NamedTuple):
    """Triangles whose vertices know their places on the surface."""

    vertices: Floats  # (n, 3)
    faces: Ints  # (m, 3), counter-clockwise seen from outside
    v: Floats  # (n,)
    turns: Floats  # (n,); of a pole, of no meaning


def mesh_surface(surface: Surface, tolerance: float | None = None) -> SurfaceMesh:
    """A watertight mesh of genus 0 that leaves the surface by at most `tolerance`, in its unit.

    That is 2e-4 of its size if left out. Raises ValueError if it is not positive, or so small that
    more than 2,000,000 vertices would be needed.
    """
    wanted = DEFAULT_TOLERANCE * surface.size if tolerance is None else tolerance
    wanted = positive("tolerance", wanted, "in the unit of the surface")
    rows, columns = _laid(surface, GRID_SHARE * wanted)
    for _ in range(ROUNDS):
        short_rows, short_columns = _short(surface, rows, columns, GRID_SHARE * wanted)
        if not short_rows.any() and not short_columns.any():
            break
        rows, columns = _split(rows, short_rows), _split(columns, short_columns)
        _check_count(len(rows) * len(columns), wanted)
    return _joined(surface, rows, columns, (1.0 - GRID_SHARE) * wanted)


def grid_mesh(surface: Surface) -> SurfaceMesh:
    """A watertight mesh of genus 0 on an even grid: to look at and decide by, to no tolerance."""
    rows = [
        np.linspace(low, high, max(round(EVEN_ROWS * (high - low)), FEWEST_ROWS) + 1)[1:]
        for low, high in zip(surface.seams[:-1], surface.seams[1:], strict=True)
    ]
    columns = np.arange(EVEN_COLUMNS + 1) / EVEN_COLUMNS
    return _joined(surface, np.concatenate([np.zeros(1), *rows]), columns, 0.0)


def _joined(surface: Surface, rows: Floats, columns: Floats, tolerance: float) -> SurfaceMesh:
    """Triangles of rows and columns; rings are thinned where that costs less than a tolerance."""
    missing = -(len(columns) - 1) % (1 << HALVINGS)  # So that rings can be halved often enough
    widest = np.zeros(len(columns) - 1, bool)
    widest[np.argsort(-np.diff(columns), kind="stable")[:missing]] = True
    columns = _split(columns, widest)
    grid = surface.on_grid(rows[1:-1], columns[:-1])
    levels = _levels(grid, tolerance)
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


def _laid(surface: Surface, tolerance: float) -> tuple[Floats, Floats]:
    """Rows from 0 to 1, seams among them, and columns from 0 to 1."""
    turns = np.arange(SAMPLE_TURNS + 1) / SAMPLE_TURNS
    near = [
        np.linspace(low, high, SAMPLE_ROWS)
        for low, high in zip(surface.seams[:-1], surface.seams[1:], strict=True)
    ]
    half = 4.0 * tolerance
    bends = [_bends(surface, piece, v, turns) for piece, v in enumerate(near)]
    dense = np.sqrt(np.max([bend[2].max(axis=0) for bend in bends], axis=0) / half)
    dense = np.maximum(dense, EVEN * dense.mean())
    columns = _spread(turns, dense, FEWEST)
    around = []
    for piece, v in enumerate(near):
        ring = surface.piece_on_grid(piece, v, turns)
        around.append(np.linalg.norm(np.diff(ring, axis=1), axis=2).sum(axis=1))
    most = max(float(each.max()) for each in around)
    # Length of the edges along each ring, once thin rings have fewer of them.
    edges = [np.clip((1 << HALVINGS) * each, 0.25 * most, most) / len(columns) for each in around]
    rows = [np.zeros(1)]
    for v, (along, mixed, _, speed), edge in zip(near, bends, edges, strict=True):
        by_twist = (2.0 * mixed / np.maximum(dense, 1e-9)).max(axis=1) / half
        density = np.maximum(np.sqrt(along.max(axis=1) / half), by_twist)
        density = np.maximum(density, speed / (SLENDER * edge))
        places = int((v[-1] - v[0]) * density.mean()) * len(columns)
        _check_count(places, tolerance / GRID_SHARE)
        rows.append(_spread(v, density, 1)[1:])
    return np.concatenate(rows), columns


def _bends(
    surface: Surface, piece: int, v: Floats, turns: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Normal parts of X_vv, X_vt and X_tt, (rows, turns) each, and mean length of X_v (rows,)."""
    low, high = surface.seams[piece], surface.seams[piece + 1]
    # At the upper seam the next piece would answer.
    normals = surface.normals_on_grid(np.minimum(v, high - 1e-9 * (high - low)), turns)
    along, mixed, around = (
        np.abs(dot(surface.piece_on_grid(piece, v, turns, by), normals))
        for by in ((2, 0), (1, 1), (0, 2))
    )
    speed = np.linalg.norm(surface.piece_on_grid(piece, v, turns, (1, 0)), axis=2)
    return along, mixed, around, speed.mean(axis=1)


def _spread(places: Floats, density: Floats, least: int) -> Floats:
    """Places from the first to the last, as close together as a density says."""
    steps = 0.5 * (density[1:] + density[:-1]) * np.diff(places)
    total = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(int(np.ceil(total[-1])), least)
    if not total[-1] > 0.0:
        return np.linspace(places[0], places[-1], count + 1)
    spread = np.interp(np.linspace(0.0, total[-1], count + 1), total, places)
    spread[0], spread[-1] = places[0], places[-1]
    return spread


def _short(
    surface: Surface, rows: Floats, columns: Floats, tolerance: float
) -> tuple[Bools, Bools]:
    """Which steps between rows, and between columns, are too wide."""
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
    # A diagonal that is too long alone is a twist: more rows cure it.
    alone = by_cell & ~wide_columns & ~wide_rows[:, None]
    return wide_rows | alone.any(axis=1), wide_columns


def _sag(surface: Surface, rows: Floats, columns: Floats, chords: Floats) -> Floats:
    offset = surface.on_grid(rows, columns) - chords
    return np.abs(dot(offset, surface.normals_on_grid(rows, columns)))


def _split(places: Floats, which: Bools) -> Floats:
    """Places with the middles of some steps put in."""
    return np.sort(np.concatenate([places, 0.5 * (places[1:] + places[:-1])[which]]))


def _levels(grid: Floats, tolerance: float) -> Ints:
    """How often each ring (rows, columns, 3) may lose every second point: most at the poles."""
    allowed = np.zeros(len(grid), np.int32)
    for level in range(1, HALVINGS + 1):
        off = _off_chords(grid, 1 << level)
        allowed[(off <= tolerance) & (allowed == level - 1)] = level
    allowed[len(grid) // 2] = 0
    # From both ends: neighbours differ by one at most, whether rings thin out or fill up again.
    for order in (range(1, len(grid)), range(len(grid) - 2, -1, -1)):
        for row in order:
            before = row - order.step
            allowed[row] = min(allowed[row], allowed[before] + 1)
    return allowed


def _off_chords(grid: Floats, step: int) -> Floats:
    """How far rings (rows, columns, 3) lie from the chords between every step-th point, (rows,)."""
    begin = grid[:, ::step]
    chord = np.roll(begin, -1, axis=1) - begin
    square = np.maximum(np.einsum("ijk,ijk->ij", chord, chord), np.finfo(float).tiny)
    off = np.zeros(len(grid))
    for each in range(1, step):
        offset = grid[:, each::step] - begin
        along = np.einsum("ijk,ijk->ij", offset, chord) / square
        beside = offset - along[:, :, None] * chord
        off = np.maximum(off, np.linalg.norm(beside, axis=2).max(axis=1))
    return off


def _check_count(count: int, tolerance: float) -> None:
    if count > MOST_PLACES:
        raise ValueError(
            f"tolerance must let {MOST_PLACES} vertices suffice, "
            f"got {tolerance:g} for which {count} would be needed"
        )


@readable
class NearestOnSurface(NamedTuple):
    """Where a surface is nearest to points."""

    points: Floats  # (n, 3)
    v: Floats  # (n,)
    turns: Floats  # (n,), from 0 to 1
    distances: Floats  # (n,), negative inside
    converged: Bools  # (n,): the last step was too small to matter


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSearch:
    """A surface, ready to be asked for its nearest points."""

    surface: Surface
    mesh: SurfaceMesh
    search: geometry.NearestSearch
    tolerance: float  # Of the mesh

    def nearest(self, points: ArrayLike) -> NearestOnSurface:
        """Nearest points to points (n, 3), signed; ValueError if one is not finite."""
        queries = finite_array("points", points, (None, 3))
        seed = geometry.nearest_points(self.search, queries)
        v, turns = _places(self.mesh, seed)
        run = _newton(self.surface, queries, self.surface.piece_of(v), v, turns)
        run = _beyond_seams(self.surface, queries, run)
        nearest = self.surface.at(run.v, run.turns)
        # Not by the square: next to the surface it would lose half the digits.
        distances = np.linalg.norm(queries - nearest, axis=1)
        far = geometry.are_outside(self.mesh.vertices, self.mesh.faces, queries, seed)
        outwards = self.surface.normals(run.v, run.turns)
        seam = np.isin(run.v, self.surface.seams[1:-1])  # there the sum of both pieces'
        outwards[seam] += self.surface.normals(run.v[seam] - BELOW, run.turns[seam])
        close = distances <= CLOSE * self.tolerance
        out = np.where(close, np.einsum("ni,ni->n", queries - nearest, outwards) >= 0.0, far)
        signed = np.where(out, distances, -distances)
        return NearestOnSurface(nearest, run.v, np.mod(run.turns, 1.0), signed, run.converged)

    def inside(self, points: ArrayLike) -> Bools:
        """Whether points (n, 3) lie inside, (n,); errors as for `nearest`."""
        return np.asarray(self.nearest(points).distances < 0.0)


class _Run(NamedTuple):
    """Where Newton's method ended."""

    piece: Ints
    v: Floats
    turns: Floats
    square: Floats
    converged: Bools


def search_surface(surface: Surface, tolerance: float | None = None) -> SurfaceSearch:
    """Prepare a surface for the search.

    It begins in a mesh of this tolerance (see `mesh_surface`, also for what it refuses): where two
    places are equally near to within that, the farther may be found.
    """
    mesh = mesh_surface(surface, tolerance)
    off = tolerance if tolerance is not None else DEFAULT_TOLERANCE * surface.size
    return SurfaceSearch(surface, mesh, geometry.nearest_search(mesh.vertices[mesh.faces]), off)


def _places(mesh: SurfaceMesh, seed: geometry.Nearest) -> tuple[Floats, Floats]:
    """Where points of the mesh are, as v and turn."""
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


def _newton(surface: Surface, points: Floats, piece: Ints, v: Floats, turns: Floats) -> _Run:
    """Descend from places, each within its own piece."""
    ends = _Run(piece, v.copy(), turns.copy(), np.empty(len(v)), np.zeros(len(v), bool))
    for each in np.unique(piece):
        rows = np.flatnonzero(piece == each)
        found = _descend(surface, int(each), points[rows], v[rows], turns[rows])
        for whole, part in zip(ends[1:], found, strict=True):
            whole[rows] = part
    return ends


def _descend(
    surface: Surface, piece: int, points: Floats, v: Floats, turns: Floats
) -> tuple[Floats, Floats, Floats, Bools]:
    low, high = surface.seams[piece], surface.seams[piece + 1]
    place = np.stack([np.clip(v, low, high), turns], axis=-1)
    damping = np.full(len(v), FIRST_DAMPING)
    done = np.zeros(len(v), bool)
    off = surface.piece_at(piece, place[:, 0], place[:, 1]) - points
    square = np.einsum("ni,ni->n", off, off)
    running = np.arange(len(v))
    for _ in range(STEPS):
        step, moved = _step(surface, piece, place[running], off[running], damping[running])
        ahead = place[running] + step
        ahead[:, 0] = np.clip(ahead[:, 0], low, high)
        there = surface.piece_at(piece, ahead[:, 0], ahead[:, 1]) - points[running]
        less = np.einsum("ni,ni->n", there, there)
        better = less <= square[running]
        rows = running[better]
        place[rows], off[rows], square[rows] = ahead[better], there[better], less[better]
        eased = np.where(better, 0.1, 10.0) * damping[running]
        damping[running] = np.maximum(eased, LEAST_DAMPING)
        done[running] = moved <= ENOUGH * surface.size
        running = running[~done[running] & (damping[running] < MOST_DAMPING)]
        if not len(running):
            break
    return place[:, 0], place[:, 1], square, done


def _step(
    surface: Surface, piece: int, place: Floats, off: Floats, damping: Floats
) -> tuple[Floats, Floats]:
    """Damped Newton steps (n, 2), and by how much they move the point (n,)."""
    orders = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    by_v, by_t, *seconds = (surface.piece_at(piece, place[:, 0], place[:, 1], by) for by in orders)
    g, h = dot(off, by_v), dot(off, by_t)
    a, b, c = dot(by_v, by_v), dot(by_v, by_t), dot(by_t, by_t)
    full = [one + dot(off, two) for one, two in zip((a, b, c), seconds, strict=True)]
    # Where the full second derivative has no minimum, its part without curvature has.
    sound = (full[0] > 0.0) & (full[0] * full[2] - full[1] ** 2 > 0.0)
    aa, bb, cc = (np.where(sound, one, two) for one, two in zip(full, (a, b, c), strict=True))
    tiny = np.finfo(float).tiny
    aa, cc = aa + damping * a + tiny, cc + damping * c + tiny
    low, high = surface.seams[piece], surface.seams[piece + 1]
    held = ((place[:, 0] <= low) & (g > 0.0)) | ((place[:, 0] >= high) & (g < 0.0))
    whole = np.maximum(aa * cc - bb * bb, tiny)
    along = np.where(held, 0.0, (bb * h - cc * g) / whole)
    along = np.clip(along, low - place[:, 0], high - place[:, 0])
    around = np.clip(-(h + bb * along) / cc, -WIDEST_TURN, WIDEST_TURN)
    moved = np.linalg.norm(along[:, None] * by_v + around[:, None] * by_t, axis=1)
    return np.stack([along, around], axis=-1), moved


def _beyond_seams(surface: Surface, points: Floats, run: _Run) -> _Run:
    """Try on in the next piece where a point ended at a seam, and across where at a pole."""
    last = len(surface.pieces) - 1
    low, high = surface.seams[run.piece], surface.seams[run.piece + 1]
    for at, way in ((run.v <= low, -1), (run.v >= high, 1)):
        rows = np.flatnonzero(at)
        piece = np.clip(run.piece[rows] + way, 0, last).astype(np.int32)
        pole = piece == run.piece[rows]
        inwards = -way * ACROSS * (high - low)[rows]
        v = run.v[rows] + np.where(pole, inwards, 0.0)
        turns = run.turns[rows] + np.where(pole, 0.5, 0.0)
        tried = _newton(surface, points[rows], piece, v, turns)
        nearer = tried.square < run.square[rows]
        better = rows[nearer]
        run.piece[better], run.converged[better] = tried.piece[nearer], tried.converged[nearer]
        run.v[better], run.turns[better] = tried.v[nearer], tried.turns[nearer]
        run.square[better] = tried.square[nearer]
    return run
