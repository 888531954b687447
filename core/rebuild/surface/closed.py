"""A closed surface given by a rule, exact at every place: pieces, curvatures, volume and moments.

It runs from a pole at v = 0 to a pole at v = 1, through the lower end, the side and the upper end;
around it runs the turn. The pieces meet at seams, where it may have an edge. Integrals over the
solid are taken over its surface by the divergence theorem, by Gauss's rule on cells that are halved
until the result stands still. Samples of a piece lie evenly along and around, whatever the
parameters of what gives them: the spline's own error then shows only at edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from palpate.core import splines
from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.geometry import area_centroid, kernel_point, signed_area
from palpate.core.poses import Pose
from palpate.core.rebuild.contours import are_star_shaped
from palpate.core.rebuild.ends import (
    End,
    ProfileCurve,
    Relief,
    Shear,
    StraightCurve,
    profile_curves,
)
from palpate.core.shapes import MassMoments
from palpate.reprs import readable

# Of the way from pole to pole: within this of a pole, normals and curvatures are told as they are
# at this distance, where the tangents do not vanish.
POLE = 1e-5
OPEN = 1e-6  # Of the size: a ring at a pole that is wider than this leaves a hole
LENGTH_ROWS, LENGTH_TURNS = 17, 24  # Grid on which a piece's length is taken
LEAST_PIECE = 0.02  # Least share of v that a piece gets
NODES = 4  # Of Gauss's rule in a cell, each way
FIRST_ROWS, FIRST_COLUMNS = 4, 12  # Cells of each piece to begin with
HALVINGS = 4  # Most halvings of the cells
ENOUGH = 1e-8  # Change of the volume and of the area, as a share, at which they stand still
RIM = 720  # Points of a rim from which its middle is taken
ROWS, TURNS = 161, 256  # Points along and around
FINER = 8  # Times as many places tell how to set them evenly,
FEW = 31  # each on so many lines across
# Share of the steps that goes with the parameter and not with the length: what has no length still
# has places.
SPREAD = 0.05
# Points (a, b, 3) at places (a,) along, from 0 to 1, and turns (b,), from 0 to 1.
Grid = Callable[[Floats, Floats], Floats]
Ring = Callable[[int], Floats]  # Points (..., 3) of a ring, or a derivative by the turn
Orders = tuple[int, int]  # Times it is differentiated by v and by turns; together up to 2


@readable
@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Pieces from pole to pole; `close_surface` makes one."""

    pieces: tuple[Patch, ...]  # From the bottom to the top
    seams: Floats  # v at which they begin and end, (pieces + 1,), from 0 to 1
    middle: Floats  # About the middle of its box, (3,)
    size: float  # Diagonal of its box, about
    frame: Floats | None = None  # Pose (7,) of the pieces' frame; None: where the surface is
    shear: Shear | None = None  # How the pieces are sheared before

    def at(self, v: ArrayLike, turns: ArrayLike, by: Orders = (0, 0)) -> Floats:
        """Points (..., 3) at v and turns, which are broadcast, or derivatives of them.

        v runs from 0, the lower pole, to 1, the upper; at a seam the upper piece answers. A whole
        turn is 1. Raises ValueError if a place is not finite or v lies outside 0 to 1, or more
        derivatives are wanted than together 2.
        """
        v, turns = np.broadcast_arrays(np.asarray(v, float), np.asarray(turns, float))
        shape = v.shape
        v = finite_array("v", v.ravel(), (None,))
        turns = finite_array("turns", turns.ravel(), (None,))
        _check_v(v)
        if min(by) < 0 or sum(by) > 2:
            raise ValueError(f"by must be 0 or more and together at most 2, got {by}")
        points = np.empty((len(v), 3))
        owner = self.piece_of(v)
        for piece in np.unique(owner):
            rows = owner == piece
            points[rows] = self.piece_at(int(piece), v[rows], turns[rows], by)
        return points.reshape(*shape, 3)

    def on_grid(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """The same at each pair of v (a,) and turns (b,), one after the other: (a, b, 3)."""
        points = np.empty((len(v), len(turns), 3))
        owner = self.piece_of(v)
        for piece in np.unique(owner):
            rows = owner == piece
            points[rows] = self.piece_on_grid(int(piece), v[rows], turns, by)
        return points

    def piece_of(self, v: Floats) -> Ints:
        """The piece (n,) at each v (n,); the upper one at a seam."""
        found = np.searchsorted(self.seams, v, side="right") - 1
        return np.clip(found, 0, len(self.pieces) - 1).astype(np.int32)

    def piece_at(self, piece: int, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """Points (n, 3) of one piece, at v (n,) between its seams, or derivatives of them."""
        local = self._local(piece, v)
        return self._placed(piece, lambda order: self.pieces[piece].at(local, turns, order), by)

    def piece_on_grid(self, piece: int, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """The same at each pair of v (a,) and turns (b,): (a, b, 3)."""
        local = self._local(piece, v)

        def points(order: Orders) -> Floats:
            return np.asarray(self.pieces[piece].on_grid(local, turns, order).reshape(-1, 3))

        found: Floats = self._placed(piece, points, by)
        return found.reshape(len(v), len(turns), 3)

    def _local(self, piece: int, v: Floats) -> Floats:
        low, high = self.seams[piece], self.seams[piece + 1]
        return np.asarray(np.clip((v - low) / (high - low), 0.0, 1.0))

    def _placed(self, piece: int, patch: Callable[[Orders], Floats], by: Orders) -> Floats:
        """Points (n, 3) of a patch, or derivatives, where they are: by v, sheared and moved."""
        found = patch(by) if self.shear is None else self.shear.carried(patch, by)
        if self.frame is not None:
            position, axes = Pose.from_array(self.frame)
            found = found @ axes.T
            found = found + position if by == (0, 0) else found
        extent = float(self.seams[piece + 1] - self.seams[piece])
        return np.asarray(found / extent ** by[0] if by[0] else found)

    def normals(self, v: ArrayLike, turns: ArrayLike) -> Floats:
        """Outward unit normals (..., 3), at a tip the limit; errors as of `at`."""
        inside = _off_poles(v)
        by_v, by_t = self.at(inside, turns, (1, 0)), self.at(inside, turns, (0, 1))
        return unit_normals(by_v, by_t)

    def normals_on_grid(self, v: Floats, turns: Floats) -> Floats:
        """The same at each pair of v (a,) and turns (b,): (a, b, 3)."""
        inside = _off_poles(v)
        return unit_normals(*(self.on_grid(inside, turns, by) for by in ((1, 0), (0, 1))))

    def curvatures(self, v: ArrayLike, turns: ArrayLike) -> Curvatures:
        """Principal curvatures at places (n,); arguments and errors as for `at`."""
        inside = _off_poles(v)
        orders = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        return curvatures_of(*(self.at(inside, turns, by).reshape(-1, 3) for by in orders))


def _check_v(v: Floats) -> None:
    if v.size and not (v.min() >= 0.0 and v.max() <= 1.0):
        raise ValueError(f"v must lie between 0 and 1, got {v.min():g} to {v.max():g}")


def _off_poles(v: ArrayLike) -> Floats:
    v = np.asarray(v, float)
    _check_v(v)
    return np.asarray(np.clip(v, POLE, 1.0 - POLE))


def curvatures_of(
    by_v: Floats, by_t: Floats, by_vv: Floats, by_vt: Floats, by_tt: Floats
) -> Curvatures:
    """By derivatives (n, 3), not parallel: L^-1 II L^-T, with L by Gram-Schmidt."""
    a = np.linalg.norm(by_v, axis=1)
    along = by_v / a[:, None]
    normals = unit_normals(by_v, by_t)
    beside = np.cross(along, normals)
    c = np.linalg.norm(by_t, axis=1)
    rest = by_t / c[:, None]
    b, d = dot(rest, along), dot(rest, beside)
    uu, uv = -dot(normals, by_vv) / a**2, -dot(normals, by_vt) / (a * c)
    vv = -dot(normals, by_tt) / c**2
    s12 = (uv - b * uu) / d
    s22 = (vv - 2.0 * b * uv + b * b * uu) / d**2
    mean, spread = 0.5 * (uu + s22), np.hypot(0.5 * (uu - s22), s12)
    turn = 0.5 * np.arctan2(2.0 * s12, uu - s22)[:, None]
    directions = np.cos(turn) * along + np.sin(turn) * beside
    return Curvatures(normals, mean + spread, mean - spread, directions)


def unit_normals(by_v: Floats, by_t: Floats) -> Floats:
    """Outward unit normals (..., 3) from tangents upwards and counter-clockwise; 0 if parallel."""

    def unit(vectors: Floats) -> Floats:
        lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
        return np.asarray(vectors / np.where(lengths > 0.0, lengths, 1.0))

    return unit(np.cross(unit(by_t), unit(by_v)))


def dot(one: Floats, other: Floats) -> Floats:
    """Products (...) of vectors (..., d)."""
    return np.asarray(np.einsum("...i,...i->...", one, other))


def close_surface(side: Patch, bottom: End | None = None, top: End | None = None) -> Surface:
    """A side and what is set onto its ends; ValueError if it runs clockwise or is open."""
    below = end_patches(side, bottom, upper=False) if bottom is not None else ()
    above = end_patches(side, top, upper=True) if top is not None else ()
    area = signed_area(_grid(side)[LENGTH_ROWS // 2, :, :2])
    if not area > 0.0:
        raise ValueError(f"side must run counter-clockwise, got a ring of signed area {area:g}")
    return closed_surface((*below, side, *above))


def closed_surface(pieces: tuple[Patch, ...]) -> Surface:
    """Pieces, upwards, that make a closed surface; ValueError if an end is open."""
    grid = np.stack([_grid(piece) for piece in pieces])
    points = grid.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.linalg.norm(high - low))
    for name, ring in (("bottom", grid[0, 0]), ("top", grid[-1, -1])):
        width = float(np.ptp(ring, axis=0).max())
        if width > OPEN * size:
            raise ValueError(
                f"{name} must be given, for the side does not close there: "
                f"its last ring is {width:g} wide"
            )
    steps = np.linalg.norm(np.diff(grid, axis=1), axis=-1).mean(axis=2).sum(axis=1)
    shares = np.maximum(steps / steps.sum(), LEAST_PIECE)
    seams = np.concatenate([[0.0], np.cumsum(shares) / shares.sum()])
    seams[-1] = 1.0
    return Surface(pieces, seams, 0.5 * (low + high), size)


def _grid(piece: Patch) -> Floats:
    """Points (LENGTH_ROWS, LENGTH_TURNS, 3) of a piece."""
    turns = np.arange(LENGTH_TURNS) / LENGTH_TURNS
    return piece.on_grid(np.linspace(0.0, 1.0, LENGTH_ROWS), turns)


def placed(surface: Surface, frame: Floats | None, shear: Shear | None = None) -> Surface:
    """A surface that is where its pieces are, sheared and carried along by a frame's pose (7,)."""
    if frame is None and shear is None:
        return surface
    middle = surface.middle[None] if shear is None else shear.sheared(surface.middle[None])
    if frame is not None:
        middle = Pose.from_array(frame).to_outer(middle)
    return replace(surface, middle=middle[0], frame=frame, shear=shear)


@readable
class Curvatures(NamedTuple):
    """Of a surface at points; convex positive."""

    normals: Floats  # Outward unit normals, (n, 3)
    k1: Floats  # Larger principal curvature, (n,), one over the surface's unit
    k2: Floats  # Smaller one, (n,)
    directions: Floats  # Unit tangents along which the curvature is k1, (n, 3)


@readable
class SurfaceMeasures(NamedTuple):
    """Of a solid of density 1, in the unit of its surface."""

    moments: MassMoments  # Volume, centroid, and second moments from the frame's origin
    area: float
    # By how much the last halving changed the volume or the area, the larger share: a bound in
    # practice, for each halving takes away more than half of what is left.
    error: float

    def inertia(self) -> Floats:
        """Inertia (3, 3) about the centroid."""
        volume, centroid, second = self.moments
        about = second - volume * np.outer(centroid, centroid)
        return np.asarray(np.trace(about) * np.eye(3) - about)


def measure_surface(surface: Surface) -> SurfaceMeasures:
    """Volume, area, centroid and second moments, taken about the middle of the box and moved."""
    sums, error = _sums(surface, 0), np.inf
    for level in range(1, HALVINGS + 1):
        finer = _sums(surface, level)
        error = float(np.max(np.abs(finer[:2] / sums[:2] - 1.0)))
        sums = finer
        if error <= ENOUGH:
            break
    volume, area = float(sums[0]), float(sums[1])
    offset = sums[2:5] / volume
    second = np.empty((3, 3))
    upper = np.triu_indices(3)
    second[upper] = sums[5:]
    second.T[upper] = sums[5:]
    middle, centroid = surface.middle, surface.middle + offset
    moved = np.outer(offset, middle)
    second = second + volume * (moved + moved.T + np.outer(middle, middle))
    return SurfaceMeasures(MassMoments(volume, centroid, second), area, error)


def _sums(surface: Surface, level: int) -> Floats:
    """Volume, area, three first and six second moments about the middle, (11,)."""
    turns, across = _nodes(0.0, 1.0, FIRST_COLUMNS << level)
    total = np.zeros(11)
    for piece, (low, high) in enumerate(zip(surface.seams[:-1], surface.seams[1:], strict=True)):
        v, along = _nodes(low, high, FIRST_ROWS << level)
        weights = (along[:, None] * across).reshape(-1, 1)
        x, by_v, by_t = (
            surface.piece_on_grid(piece, v, turns, by).reshape(-1, 3)
            for by in ((0, 0), (1, 0), (0, 1))
        )
        total += _flux(x - surface.middle, np.cross(by_t, by_v) * weights)
    return total


def _nodes(low: float, high: float, cells: int) -> tuple[Floats, Floats]:
    """Places and weights of Gauss's rule on equal cells."""
    place, weight = np.polynomial.legendre.leggauss(NODES)
    width = (high - low) / cells
    begin = low + width * np.arange(cells)
    places = begin[:, None] + 0.5 * width * (1.0 + place)
    return places.ravel(), np.tile(0.5 * width * weight, cells)


def _flux(x: Floats, n: Floats) -> Floats:
    """What fields whose divergences are 1, coordinates, and products of them send out."""
    i, j = np.triu_indices(3)
    # x_i x_j is the divergence of x_i^2 x_j e_i / 2, or of x_i^3 e_i / 3 where they are one.
    share = np.where(i == j, 1.0 / 3.0, 0.5)
    return np.concatenate(
        [
            [np.sum(x * n) / 3.0, np.linalg.norm(n, axis=1).sum()],
            np.sum(x * x * n, axis=0) / 2.0,
            share * np.sum(x[:, i] ** 2 * x[:, j] * n[:, i], axis=0),
        ]
    )


class Patch(Protocol):
    """A piece of a surface, from one ring to another; who inherits this needs but `at`."""

    def at(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """Points (n, 3) at v, upwards from 0 to 1, and turns (n,), or derivatives by them."""
        raise NotImplementedError

    def on_grid(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """The same at each pair of v (a,) and turns (b,): (a, b, 3)."""
        each = self.at(np.repeat(v, len(turns)), np.tile(turns, len(v)), by)
        return each.reshape(len(v), len(turns), 3)


@dataclass(frozen=True, slots=True, eq=False)
class EndPatch:
    """A ring's shape, scaled along a curve until it is a point or another ring."""

    side: Patch  # Whose last ring it begins at
    curve: ProfileCurve
    rim: Floats  # Middle of the side's last ring, (3,): from where it is seen whole, if it can be
    middle: Floats  # Middle of the end, (3,)
    upper: bool  # Whether it lies on the side or under it
    relief: Relief | None = None  # What it rises besides, in full at the end's height

    def at(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """See `Patch.at`."""
        edge = np.full(len(turns), float(self.upper))
        return self._set_on(v, cache(lambda order: self.side.at(edge, turns, (0, order))), by)

    def on_grid(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """See `Patch.on_grid`."""
        edge = np.array([float(self.upper)])
        ring = cache(lambda order: self.side.on_grid(edge, turns, (0, order)))
        return self._set_on(v[:, None], ring, by)

    def _set_on(self, v: Floats, ring: Ring, by: Orders) -> Floats:
        """At v and places of the ring, which are broadcast."""
        found = self._on_profile(v, ring, by)
        if self.relief is not None:
            found[..., 2] += self._rise(self.relief, v, ring, by)
        return found

    def _rise(self, relief: Relief, v: Floats, ring: Ring, by: Orders) -> Floats:
        """The relief times the way, or derivatives: product and chain rule."""
        ways = [self._along(v, k)[0] for k in range(by[0] + 1)]
        places = self._on_profile(v, ring, (0, 0))[..., :2]
        height = relief.at(places)
        if by == (0, 0):
            return np.asarray(ways[0] * height)
        slopes = np.stack([relief.at(places, (1, 0)), relief.at(places, (0, 1))], axis=-1)
        found = ways[0] * dot(slopes, self._on_profile(v, ring, by)[..., :2])
        found += ways[-1] * height if by[1] == 0 else 0.0
        if sum(by) == 1:
            return np.asarray(found)
        one, other = ((1, 0), (0, 1)) if by == (1, 1) else ((by[0] // 2, by[1] // 2),) * 2
        first, second = (self._on_profile(v, ring, each)[..., :2] for each in (one, other))
        x, xy, y = (relief.at(places, each) for each in ((2, 0), (1, 1), (0, 2)))
        found += ways[0] * x * first[..., 0] * second[..., 0]
        found += ways[0] * y * first[..., 1] * second[..., 1]
        found += ways[0] * xy * (first[..., 0] * second[..., 1] + first[..., 1] * second[..., 0])
        if by[0]:
            found += (2.0 if by == (2, 0) else 1.0) * ways[1] * dot(slopes, second)
        return np.asarray(found)

    def _on_profile(self, v: Floats, ring: Ring, by: Orders) -> Floats:
        along, share = (one[..., None] for one in self._along(v, by[0]))
        offset = ring(by[1])
        if by[1]:
            return np.asarray(share * offset)
        moved = along * (self.middle - self.rim) + share * (offset - self.rim)
        return np.asarray(moved + self.rim if by[0] == 0 else moved)

    def _along(self, v: Floats, order: int) -> tuple[Floats, Floats]:
        """How far along the curve, and its share of the ring, at v, or derivatives."""
        way = v if self.upper else 1.0 - v
        sign = 1.0 if self.upper else (-1.0) ** order
        along, share = (sign * self.curve.at(way.ravel(), order)).T
        return along.reshape(v.shape), share.reshape(v.shape)

    @property
    def folded(self) -> float:
        """How much of a level end lies on itself, over the area that its ring encloses."""
        curve = self.curve
        rises = isinstance(curve, StraightCurve) and curve.begin[0] != curve.end[0]
        if not isinstance(curve, StraightCurve) or (rises and self.middle[2] != self.rim[2]):
            return 0.0
        seen = _ring(self.side, self.upper)[:, :2] - self.rim[:2]
        onwards = np.roll(seen, -1, axis=0)
        twice = seen[:, 0] * onwards[:, 1] - seen[:, 1] * onwards[:, 0]
        whole = float(twice.sum())
        return float(np.maximum(-twice, 0.0).sum()) / whole if whole > 0.0 else 1.0


def end_patches(side: Patch, end: End, *, upper: bool) -> tuple[Patch, ...]:
    """What closes a side at an end, upwards, set onto the side's last ring, wherever that lies."""
    ring = _ring(side, upper)
    centroid = area_centroid(ring)
    # From where the ring is seen whole: its centroid, if from nowhere or from there, too.
    seen_whole = are_star_shaped(ring[None, :, :2] - centroid)[0]
    kernel = None if seen_whole else kernel_point(ring[:, :2])
    shift = np.zeros(2) if kernel is None else kernel - centroid
    rim = np.array([*(centroid + shift), ring[:, 2].mean()])
    gap = end.height - float(rim[2]) if end.height != end.rim else 0.0
    middle = np.array([*(end.middle + shift), rim[2] + gap]) if gap else rim
    curves = profile_curves(end.profile, gap)
    found = tuple(EndPatch(side, curve, rim, middle, upper, end.relief) for curve in curves)
    return found if upper else found[::-1]


def _ring(side: Patch, upper: bool) -> Floats:
    """Points (n, 3) of a side's last ring."""
    return side.at(np.full(RIM, 1.0 if upper else 0.0), np.arange(RIM) / RIM)


@dataclass(frozen=True, slots=True, eq=False)
class SampledPatch:
    """A spline through samples: see `Patch`."""

    control: Floats  # (n, k, 3)
    miss: float  # Largest distance from what was sampled, seen at places between the samples

    def at(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """See `Patch.at`."""
        at = np.stack([np.clip(v, 0.0, 1.0), np.mod(turns, 1.0)], axis=-1)
        return np.asarray(splines.evaluate_scattered(self._bases, self._wound, at, [by])[0])

    def on_grid(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """See `Patch.on_grid`."""
        places = [np.clip(v, 0.0, 1.0), np.mod(turns, 1.0)]
        return splines.evaluate_grid(self._bases, self._wound, places, by)

    @property
    def _bases(self) -> tuple[splines.Basis, splines.Basis]:
        along, around = self.control.shape[:2]
        return splines.clamped_basis(along), splines.wound_basis(around)

    @property
    def _wound(self) -> Floats:
        return np.concatenate([self.control, self.control[:, : splines.CUBIC]], axis=1)


def sampled_patch(grid: Grid, rows: int = ROWS, turns: int = TURNS) -> SampledPatch:
    """Spline through so many evenly spaced points of a surface that is closed around."""
    alongs, arounds = (np.linspace(0.0, 1.0, FINER * count + 1) for count in (rows, turns))
    few = np.linspace(0.0, 1.0, FEW + 2)[1:-1]
    lengths, widths = _ways(grid(alongs, few), axis=0), _ways(grid(few, arounds), axis=1)

    def points(v: Floats, t: Floats) -> Floats:
        return grid(np.interp(v, lengths, alongs), np.interp(t, widths, arounds))

    along = splines.clamped_basis(rows)
    places, ends = along.greville(), np.arange(turns) / turns
    values = points(places, ends).transpose(1, 0, 2)
    circle = splines.PeriodicBasis(turns).matrix(ends).toarray()
    around = np.linalg.solve(circle, values.reshape(turns, -1)).reshape(values.shape)
    rings = around.transpose(1, 0, 2).reshape(rows, -1)
    control = splines.interpolate_grid([along], [places], rings).control
    patch = SampledPatch(control.reshape(rows, turns, 3), 0.0)
    between = 0.5 * (places[1:] + places[:-1])
    middles = ends + 0.5 / turns
    off = np.linalg.norm(patch.on_grid(between, middles) - points(between, middles), axis=-1)
    return SampledPatch(patch.control, float(off.max()))


def _ways(points: Floats, axis: int) -> Floats:
    """Share of the way along an axis of a grid of points at which each lies, on the mean."""
    steps = np.linalg.norm(np.diff(points, axis=axis), axis=-1).mean(axis=1 - axis)
    total = max(float(steps.sum()), np.finfo(float).tiny)
    steps = (1.0 - SPREAD) * steps / total + SPREAD / len(steps)
    ways = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(ways / ways[-1])
