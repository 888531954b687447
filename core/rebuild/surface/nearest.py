"""The nearest point of a closed surface, and on which side of it a point lies.

The nearest point of a mesh says where to begin, Newton's method on (v, turn) ends on the surface
itself. It is run within one piece at a time; a point that ends at a seam is tried on from the
other side, and one at a pole from across.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry import (
    Nearest,
    NearestSearch,
    are_outside,
    nearest_points,
    nearest_search,
)
from palpate.core.rebuild.surface.closed import Surface, dot
from palpate.core.rebuild.surface.meshing import DEFAULT_TOLERANCE, SurfaceMesh, mesh_surface

STEPS = 40  # Most steps of Newton's method
ENOUGH = 1e-11  # Of the size: a step that moves the point by less ends it
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-9, 1e9
WIDEST_TURN = 0.1  # Of a step around
ACROSS = 0.02  # Of the piece: how far from a pole the other side is tried
BELOW = 1e-9  # v below a seam at which the lower piece answers
# Tolerances of the mesh: nearer than this the surface's own normal says which side it is.
CLOSE = 4.0


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
    search: NearestSearch
    tolerance: float  # Of the mesh

    def nearest(self, points: ArrayLike) -> NearestOnSurface:
        """Nearest points to points (n, 3), signed; ValueError if one is not finite."""
        queries = finite_array("points", points, (None, 3))
        seed = nearest_points(self.search, queries)
        v, turns = _places(self.mesh, seed)
        run = _newton(self.surface, queries, self.surface.piece_of(v), v, turns)
        run = _beyond_seams(self.surface, queries, run)
        nearest = self.surface.at(run.v, run.turns)
        # Not by the square: next to the surface it would lose half the digits.
        distances = np.linalg.norm(queries - nearest, axis=1)
        far = are_outside(self.mesh.vertices, self.mesh.faces, queries, seed)
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
    return SurfaceSearch(surface, mesh, nearest_search(mesh.vertices[mesh.faces]), off)


def _places(mesh: SurfaceMesh, seed: Nearest) -> tuple[Floats, Floats]:
    """Where points of the mesh are, as v and turn."""
    rows = mesh.faces[seed.faces]
    corners = mesh.vertices[rows]
    apart = np.linalg.norm(corners - seed.points[:, None], axis=2)
    following, beyond = np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)
    areas = np.linalg.norm(
        np.cross(following - seed.points[:, None], beyond - seed.points[:, None]), axis=2
    )
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
