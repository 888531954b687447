"""A closed surface in closed form: pieces, points, normals and curvatures.

Its parameter v runs from a pole at 0 to a pole at 1, through the lower end, the side and the upper
end; the other parameter is the turn around. The pieces meet at seams, where the surface may have an
edge. Samples of a piece are spaced evenly along and around, whatever the parameters of the sampled
function: the spline's error is then visible at edges only.
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
from palpate.reprs import readable

# Points (a, b, 3) at places (a,) along, from 0 to 1, and turns (b,), from 0 to 1.
Grid = Callable[[Floats, Floats], Floats]
Ring = Callable[[int], Floats]  # points (..., 3) of a ring, or a derivative by the turn
Orders = tuple[int, int]  # of derivatives by v and by turns; of total order up to 2


@readable
@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Pieces from pole to pole; `close_surface` makes one."""

    pieces: tuple[Patch, ...]  # from the bottom to the top
    seams: Floats  # v at which they begin and end, (pieces + 1,), from 0 to 1
    middle: Floats  # approximate middle of its box, (3,)
    size: float  # approximate diagonal of its box
    frame: Floats | None = None  # pose (7,) of the pieces' frame; None for the surface's own frame
    shear: Shear | None = None  # applied to the pieces before the pose

    def at(self, v: ArrayLike, turns: ArrayLike, by: Orders = (0, 0)) -> Floats:
        """Points (..., 3) at v and turns, which are broadcast, or derivatives of them.

        v runs from 0, the lower pole, to 1, the upper pole; a seam belongs to the upper piece. A
        whole turn is 1. Raises ValueError if a place is not finite, v lies outside 0 to 1, or the
        total order of derivatives exceeds 2.
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
        """The same at each pair of v (a,) and turns (b,), without checks: (a, b, 3)."""
        points = np.empty((len(v), len(turns), 3))
        owner = self.piece_of(v)
        for piece in np.unique(owner):
            rows = owner == piece
            points[rows] = self.piece_on_grid(int(piece), v[rows], turns, by)
        return points

    def piece_of(self, v: Floats) -> Ints:
        """Number (n,) of the piece at each v (n,); the upper piece at a seam."""
        piece = np.searchsorted(self.seams, v, side="right") - 1
        return np.clip(piece, 0, len(self.pieces) - 1).astype(np.int32)

    def piece_at(self, piece: int, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """Points (n, 3) of one piece, at v (n,) between its seams, or derivatives of them."""
        local = self._local(piece, v)
        return self._placed(piece, lambda order: self.pieces[piece].at(local, turns, order), by)

    def piece_on_grid(self, piece: int, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """The same at each pair of v (a,) and turns (b,): (a, b, 3)."""
        local = self._local(piece, v)

        def points(order: Orders) -> Floats:
            return np.asarray(self.pieces[piece].on_grid(local, turns, order).reshape(-1, 3))

        grid: Floats = self._placed(piece, points, by)
        return grid.reshape(len(v), len(turns), 3)

    def _local(self, piece: int, v: Floats) -> Floats:
        low, high = self.seams[piece], self.seams[piece + 1]
        return np.asarray(np.clip((v - low) / (high - low), 0.0, 1.0))

    def _placed(self, piece: int, patch: Callable[[Orders], Floats], by: Orders) -> Floats:
        """Sheared and moved points (n, 3) of a patch, or their derivatives by v and turns."""
        points = patch(by) if self.shear is None else self.shear.carried(patch, by)
        if self.frame is not None:
            position, axes = Pose.from_array(self.frame)
            points = points @ axes.T
            points = points + position if by == (0, 0) else points
        extent = float(self.seams[piece + 1] - self.seams[piece])
        return np.asarray(points / extent ** by[0] if by[0] else points)

    def normals(self, v: ArrayLike, turns: ArrayLike) -> Floats:
        """Outward unit normals (..., 3), at a pole the limit; arguments and errors as for `at`."""
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


def _off_poles(v: ArrayLike, distance: float = 1e-5) -> Floats:
    """Values of v, kept at a distance from both poles, where tangents vanish."""
    v = np.asarray(v, float)
    _check_v(v)
    return np.asarray(np.clip(v, distance, 1.0 - distance))


def curvatures_of(
    by_v: Floats, by_t: Floats, by_vv: Floats, by_vt: Floats, by_tt: Floats
) -> Curvatures:
    """Curvatures from derivatives (n, 3), not parallel: L^-1 II L^-T, with L by Gram-Schmidt."""
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
    """Outward unit normals (..., 3) from tangents along v and turn; 0 if these are parallel."""

    def unit(vectors: Floats) -> Floats:
        lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
        return np.asarray(vectors / np.where(lengths > 0.0, lengths, 1.0))

    return unit(np.cross(unit(by_t), unit(by_v)))


def dot(a: Floats, b: Floats) -> Floats:
    """Scalar products (...) of vectors (..., d)."""
    return np.asarray(np.einsum("...i,...i->...", a, b))


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosureSettings:
    """When a surface is closed, and how v is divided among its pieces."""

    max_opening: float = 1e-6  # fraction of the size: a wider ring at a pole is a hole
    n_rows: int = 17  # of the grid by which the length of a piece is measured
    n_turns: int = 24  # columns of that grid
    min_share: float = 0.02  # of v, for a piece


def close_surface(
    side: Patch,
    bottom: End | None = None,
    top: End | None = None,
    *,
    settings: ClosureSettings = ClosureSettings(),
) -> Surface:
    """A side closed by its ends; ValueError if it runs clockwise or is open."""
    below = end_patches(side, bottom, upper=False) if bottom is not None else ()
    above = end_patches(side, top, upper=True) if top is not None else ()
    area = signed_area(_grid(side, settings)[settings.n_rows // 2, :, :2])
    if not area > 0.0:
        raise ValueError(f"side must run counter-clockwise, got a ring of signed area {area:g}")
    return closed_surface((*below, side, *above), settings)


def closed_surface(
    pieces: tuple[Patch, ...], settings: ClosureSettings = ClosureSettings()
) -> Surface:
    """A closed surface of pieces from bottom to top; ValueError if an end is open."""
    grid = np.stack([_grid(piece, settings) for piece in pieces])
    points = grid.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.linalg.norm(high - low))
    for name, ring in (("bottom", grid[0, 0]), ("top", grid[-1, -1])):
        width = float(np.ptp(ring, axis=0).max())
        if width > settings.max_opening * size:
            raise ValueError(
                f"{name} must be given, for the side does not close there: "
                f"its last ring is {width:g} wide"
            )
    steps = np.linalg.norm(np.diff(grid, axis=1), axis=-1).mean(axis=2).sum(axis=1)
    shares = np.maximum(steps / steps.sum(), settings.min_share)
    seams = np.concatenate([[0.0], np.cumsum(shares) / shares.sum()])
    seams[-1] = 1.0
    return Surface(pieces, seams, 0.5 * (low + high), size)


def _grid(piece: Patch, settings: ClosureSettings) -> Floats:
    """Points (n_rows, n_turns, 3) of a piece."""
    turns = np.arange(settings.n_turns) / settings.n_turns
    return piece.on_grid(np.linspace(0.0, 1.0, settings.n_rows), turns)


def placed(surface: Surface, frame: Floats | None, shear: Shear | None = None) -> Surface:
    """A surface in the frame of its pieces, sheared and moved by a pose (7,)."""
    if frame is None and shear is None:
        return surface
    middle = surface.middle[None] if shear is None else shear.sheared(surface.middle[None])
    if frame is not None:
        middle = Pose.from_array(frame).to_outer(middle)
    return replace(surface, middle=middle[0], frame=frame, shear=shear)


@readable
class Curvatures(NamedTuple):
    """Principal curvatures of a surface at points, positive where it is convex."""

    normals: Floats  # outward unit normals, (n, 3)
    k1: Floats  # larger principal curvature, (n,), one over the surface's unit
    k2: Floats  # smaller one, (n,)
    directions: Floats  # unit tangents along which the curvature is k1, (n, 3)


class Patch(Protocol):
    """A piece of a surface, from one ring to another; subclasses implement `at`."""

    def at(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """Points (n, 3) at v, upwards from 0 to 1, and turns (n,), or derivatives by them."""
        raise NotImplementedError

    def on_grid(self, v: Floats, turns: Floats, by: Orders = (0, 0)) -> Floats:
        """The same at each pair of v (a,) and turns (b,): (a, b, 3)."""
        points = self.at(np.repeat(v, len(turns)), np.tile(turns, len(v)), by)
        return points.reshape(len(v), len(turns), 3)


@dataclass(frozen=True, slots=True, eq=False)
class EndPatch:
    """The side's last ring, scaled along a profile curve to a point or another ring."""

    side: Patch  # at whose last ring it begins
    curve: ProfileCurve
    rim: (
        Floats  # middle of the side's last ring, (3,): a place that sees all of it, if there is one
    )
    middle: Floats  # middle of the end, (3,)
    upper: bool  # whether it is the upper end
    relief: Relief | None = None  # height added to the profile, in full at the end's height

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
        """Points at v and places of the ring, which are broadcast, or derivatives."""
        points = self._on_profile(v, ring, by)
        if self.relief is not None:
            points[..., 2] += self._rise(self.relief, v, ring, by)
        return points

    def _rise(self, relief: Relief, v: Floats, ring: Ring, by: Orders) -> Floats:
        """The relief times the profile's height, or derivatives: product and chain rule."""
        along = [self._along(v, k)[0] for k in range(by[0] + 1)]
        places = self._on_profile(v, ring, (0, 0))[..., :2]
        height = relief.at(places)
        if by == (0, 0):
            return np.asarray(along[0] * height)
        slopes = np.stack([relief.at(places, (1, 0)), relief.at(places, (0, 1))], axis=-1)
        rise = along[0] * dot(slopes, self._on_profile(v, ring, by)[..., :2])
        rise += along[-1] * height if by[1] == 0 else 0.0
        if sum(by) == 1:
            return np.asarray(rise)
        singles = ((1, 0), (0, 1)) if by == (1, 1) else ((by[0] // 2, by[1] // 2),) * 2
        first, second = (self._on_profile(v, ring, single)[..., :2] for single in singles)
        xx, xy, yy = (relief.at(places, orders) for orders in ((2, 0), (1, 1), (0, 2)))
        rise += along[0] * xx * first[..., 0] * second[..., 0]
        rise += along[0] * yy * first[..., 1] * second[..., 1]
        rise += along[0] * xy * (first[..., 0] * second[..., 1] + first[..., 1] * second[..., 0])
        if by[0]:
            rise += (2.0 if by == (2, 0) else 1.0) * along[1] * dot(slopes, second)
        return np.asarray(rise)

    def _on_profile(self, v: Floats, ring: Ring, by: Orders) -> Floats:
        along, share = (part[..., None] for part in self._along(v, by[0]))
        offset = ring(by[1])
        if by[1]:
            return np.asarray(share * offset)
        moved = along * (self.middle - self.rim) + share * (offset - self.rim)
        return np.asarray(moved + self.rim if by[0] == 0 else moved)

    def _along(self, v: Floats, order: int) -> tuple[Floats, Floats]:
        """Relative height of the profile and scale of the ring at v, or derivatives."""
        parameter = v if self.upper else 1.0 - v
        sign = 1.0 if self.upper else (-1.0) ** order
        along, share = (sign * self.curve.at(parameter.ravel(), order)).T
        return along.reshape(v.shape), share.reshape(v.shape)

    @property
    def folded(self) -> float:
        """Area of a level end that lies on itself, over the area that its ring encloses."""
        curve = self.curve
        rises = isinstance(curve, StraightCurve) and curve.begin[0] != curve.end[0]
        if not isinstance(curve, StraightCurve) or (rises and self.middle[2] != self.rim[2]):
            return 0.0
        seen = _ring(self.side, self.upper)[:, :2] - self.rim[:2]
        following = np.roll(seen, -1, axis=0)
        areas = seen[:, 0] * following[:, 1] - seen[:, 1] * following[:, 0]
        whole = float(areas.sum())
        return float(np.maximum(-areas, 0.0).sum()) / whole if whole > 0.0 else 1.0


def end_patches(side: Patch, end: End, *, upper: bool) -> tuple[Patch, ...]:
    """Patches that close a side at an end, from bottom to top; they begin at its last ring."""
    ring = _ring(side, upper)
    centroid = area_centroid(ring)
    # The middle of the rim sees the whole ring: the centroid, if it does so, or no place does.
    seen_whole = are_star_shaped(ring[None, :, :2] - centroid)[0]
    kernel = None if seen_whole else kernel_point(ring[:, :2])
    shift = np.zeros(2) if kernel is None else kernel - centroid
    rim = np.array([*(centroid + shift), ring[:, 2].mean()])
    gap = end.height - float(rim[2]) if end.height != end.rim else 0.0
    middle = np.array([*(end.middle + shift), rim[2] + gap]) if gap else rim
    curves = profile_curves(end.profile, gap)
    patches = tuple(EndPatch(side, curve, rim, middle, upper, end.relief) for curve in curves)
    return patches if upper else patches[::-1]


def _ring(side: Patch, upper: bool, count: int = 720) -> Floats:
    """Points (count, 3) of a side's last ring."""
    return side.at(np.full(count, 1.0 if upper else 0.0), np.arange(count) / count)


@dataclass(frozen=True, slots=True, eq=False)
class SampledPatch:
    """A patch that is a spline through samples."""

    control: Floats  # (n, k, 3)
    miss: float  # largest distance from the sampled function, at places between the samples

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


def sampled_patch(
    grid: Grid, rows: int = 161, turns: int = 256, oversampling: int = 8, n_lines: int = 31
) -> SampledPatch:
    """Spline through evenly spaced points, `rows` by `turns`, of a surface that is closed around.

    Lengths for the spacing are measured at `oversampling` times as many places, on `n_lines` lines
    across.
    """
    alongs, arounds = (np.linspace(0.0, 1.0, oversampling * count + 1) for count in (rows, turns))
    lines = np.linspace(0.0, 1.0, n_lines + 2)[1:-1]
    lengths = _length_shares(grid(alongs, lines), axis=0)
    widths = _length_shares(grid(lines, arounds), axis=1)

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


def _length_shares(points: Floats, axis: int, parameter_share: float = 0.05) -> Floats:
    """Mean share of the length along an axis of a grid of points (a, b, 3), at each point.

    A `parameter_share` of it is the share of the parameter, so that lines without length have
    places, too.
    """
    steps = np.linalg.norm(np.diff(points, axis=axis), axis=-1).mean(axis=1 - axis)
    total = max(float(steps.sum()), np.finfo(float).tiny)
    steps = (1.0 - parameter_share) * steps / total + parameter_share / len(steps)
    shares = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(shares / shares[-1])
