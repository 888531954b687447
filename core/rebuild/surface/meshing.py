"""Triangles as fine as a closed surface needs them: rows and columns from its second derivatives.

A triangle whose corners lie on the surface leaves it by at most (|X_vv| dv^2 + 2 |X_vt| dv dt +
|X_tt| dt^2) / 8, of which the part along the normal counts. Rows and columns are laid by that,
then checked on the surface and split where they do not suffice. Towards the poles rings get
fewer points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, positive
from palpate.core.geometry import join_rings
from palpate.core.rebuild.surface.closed import Surface

DEFAULT_TOLERANCE = 2e-4  # Tolerance, of the size, where none is asked for
MOST_PLACES = 2_000_000  # Most vertices
SAMPLE_ROWS, SAMPLE_TURNS = 33, 128  # Places of each piece at which second derivatives are taken
GRID_SHARE = 0.65  # Of the tolerance, for rows and columns; the rest is for thinner rings
FEWEST = 24  # Columns: thinned to the last, a ring still has 3 points
HALVINGS = 3  # Rings near a pole have down to this power of a half of the others' points
SLENDER = 4.0  # Rows are at most this many times farther apart than columns
EVEN = 0.3  # Columns lie nowhere less close than this share of their mean density
ROUNDS = 8  # Of checks and splits


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
    columns = _divisible(columns)
    grid = surface.at(rows[1:-1, None], columns[None, :-1])
    levels = _levels(grid, (1.0 - GRID_SHARE) * wanted)
    sizes = (len(columns) - 1) >> levels
    faces = join_rings(sizes)
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
        along_v, around_v = np.repeat(v, len(turns)), np.tile(turns, len(v))
        ring = surface.piece_at(piece, along_v, around_v).reshape(len(v), len(turns), 3)
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
    shape = (len(v), len(turns))
    rows, columns = np.repeat(v, len(turns)), np.tile(turns, len(v))
    low, high = surface.seams[piece], surface.seams[piece + 1]
    # At the upper seam the next piece would answer.
    normals = surface.normals(np.minimum(rows, high - 1e-9 * (high - low)), columns)
    found = [
        np.abs(np.einsum("ni,ni->n", surface.piece_at(piece, rows, columns, by), normals))
        for by in ((2, 0), (1, 1), (0, 2))
    ]
    speed = np.linalg.norm(surface.piece_at(piece, rows, columns, (1, 0)), axis=1)
    along, mixed, around = (part.reshape(shape) for part in found)
    return along, mixed, around, speed.reshape(shape).mean(axis=1)


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
    grid = surface.at(rows[:, None], columns[None, :])
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
    v, turns = np.broadcast_arrays(rows[:, None], columns[None, :])
    offset = surface.at(v, turns) - chords
    return np.asarray(np.abs(np.einsum("ijk,ijk->ij", offset, surface.normals(v, turns))))


def _split(places: Floats, which: Bools) -> Floats:
    """Places with the middles of some steps put in."""
    middles = 0.5 * (places[1:] + places[:-1])[which]
    return np.sort(np.concatenate([places, middles]))


def _divisible(columns: Floats) -> Floats:
    """Columns with the widest steps split, until rings can be halved often enough."""
    missing = -(len(columns) - 1) % (1 << HALVINGS)
    which = np.zeros(len(columns) - 1, bool)
    which[np.argsort(-np.diff(columns), kind="stable")[:missing]] = True
    return _split(columns, which)


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
