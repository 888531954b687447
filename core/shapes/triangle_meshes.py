"""A triangle mesh as a solid, and solids after a deformation of space, which are cast as triangles.

First hits come from Embree or from a z-buffer, because Embree has no wheel for some platforms. For
crossings, the side on which a ray passes an edge is decided once for both faces at the edge, and a
ray that meets it counts as passing beside it (Edelsbrunner and Muecke, *Simulation of simplicity*,
1990): no ray slips between two faces, or counts a corner twice. Optionally Newton's method leads
from the facet to the exact deformed surface: with the place p in the undeformed solid and the
distance s along the ray, deform(p) = start + s direction and f(p) = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry import face_edges, is_closed, is_inside_out
from palpate.core.poses import axes_along
from palpate.core.shapes.protocol import INSIDE, MISS, ImplicitShape, Mesh, Shape

HAS_EMBREE = find_spec("embreex") is not None  # False without a wheel for this machine
SHIFT_DIRECTION = np.array([0.8, 0.6])  # of rays that are moved aside
Longs = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerSettings:
    """Rays that continue behind back faces."""

    max_layers: int = 64  # back faces that a ray may pass; beyond them it misses
    # Fraction of the extent at which a ray restarts behind a back face; ten single roundings.
    restart_offset: float = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class PolishSettings:
    """Newton's method from facets to the exact surface; lengths are fractions of its size."""

    max_steps: int = 12
    step_tolerance: float = 1e-8  # of the last step; the next would be its square
    max_move: float = 0.05  # a larger one ends on another part of the surface


class TriangleShape(Shape):
    """A triangle mesh.

    A mesh that is inside out is reversed. A ray that starts inside a closed mesh has the range
    `INSIDE`, at any distance of its exit. A mesh with holes has no inside: its faces are met from
    outside only. `vertices` (n, 3) [m]. `faces` (m, 3): indices of vertices, consistently oriented.
    `embree`: false for the z-buffer, which needs numpy only.
    """

    def __init__(
        self,
        vertices: Floats,
        faces: Ints,
        embree: bool = HAS_EMBREE,
        settings: LayerSettings = LayerSettings(),
    ):
        self.flipped = is_inside_out(vertices, faces)  # whether the faces were reversed
        self.closed = is_closed(faces)  # whether the mesh has no holes
        faces = np.ascontiguousarray(faces[:, ::-1]) if self.flipped else faces
        self._mesh = Mesh(vertices, faces)
        a, b, c = vertices[faces].transpose(1, 0, 2)
        self._normals = np.cross(b - a, c - a)
        self._restart = settings.restart_offset * float(np.ptp(vertices, axis=0).max())
        self._max_layers = settings.max_layers
        self._backend = Embree(vertices, faces) if embree else ZBuffer(vertices, faces)

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        ranges = self.first_hits(origins, direction).ranges
        return np.where(ranges <= reach, ranges, MISS)

    def mesh(self, level: int) -> Mesh:
        """The mesh itself, outward, at any level."""
        return self._mesh

    def first_hits(self, origins: Floats, direction: Floats) -> Hits:
        """First faces met from outside along parallel rays; `INSIDE` for rays that start inside."""
        hits = self._backend.first_hits(origins, direction)
        behind = np.flatnonzero(self._from_behind(hits, direction))
        if self.closed and len(behind):
            # A ray along a silhouette may show the back of an edge: cast backwards too.
            back = self._backend.first_hits(origins[behind], -direction)
            inside = self._from_behind(back, -direction)
            hits.ranges[behind[inside]] = INSIDE
            behind = behind[~inside]
        for _ in range(self._max_layers):
            if not len(behind):
                return hits
            start = hits.ranges[behind] + self._restart
            places = origins[behind] + start[:, None] * direction
            beyond = self._backend.first_hits(places, direction)
            hits.ranges[behind] = start + beyond.ranges
            hits.faces[behind], hits.weights[behind] = beyond.faces, beyond.weights
            behind = behind[self._from_behind(beyond, direction)]
        hits.ranges[behind], hits.faces[behind] = MISS, -1
        return hits

    def _from_behind(self, hits: Hits, direction: Floats) -> Bools:
        return (hits.faces >= 0) & (self._normals[hits.faces] @ direction > 0.0)


class Hits(NamedTuple):
    """First hits of rays."""

    ranges: Floats  # (n,) [m]; infinite without a hit
    faces: Ints  # (n,); -1 without a hit
    weights: Floats  # of the face's second and third corner, (n, 2)


class Embree:
    """Triangles prepared for rays.

    Embree, in single precision, finds the face; the face's plane gives the range in double
    precision. `rtol`: fraction of Embree's range, or of the mesh's extent, by which it may differ;
    beyond, the face is seen edge-on, and Embree's range is kept.
    """

    def __init__(self, vertices: Floats, faces: Ints, rtol: float = 1e-5):
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        corners, self._rtol = vertices[faces], rtol
        self._places = corners[:, 0]
        self._normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._extent = float(np.ptp(vertices, axis=0).max())
        self._scene = EmbreeScene(robust=True)  # no ray slips between two triangles
        self._kept = TriangleMesh(self._scene, corners.astype(np.float32))

    def first_hits(self, origins: Floats, direction: Floats) -> Hits:
        """First faces along parallel rays, seen from either side."""
        towards = np.broadcast_to(direction.astype(np.float32), origins.shape)
        result = self._scene.run(
            origins.astype(np.float32), np.ascontiguousarray(towards), query="INTERSECT", output=1
        )
        faces = np.asarray(result["primID"], np.int32)
        ranges = np.where(faces >= 0, result["tfar"], np.inf).astype(np.float64)
        weights = np.column_stack([result["u"], result["v"]]).astype(np.float64)
        normals = self._normals[faces]
        with np.errstate(divide="ignore", invalid="ignore"):
            heights = np.einsum("ni,ni->n", self._places[faces] - origins, normals)
            exact = heights / (normals @ direction)
            near = np.abs(exact - ranges) <= self._rtol * (ranges + self._extent)
        refined = np.where(near & (faces >= 0), np.maximum(exact, 0.0), ranges)
        return Hits(refined, faces, weights)


class ZBuffer:
    """Triangles prepared for projection along any direction.

    `edge_tolerance`: of barycentric coordinates, so that no ray slips between two triangles.
    """

    def __init__(self, vertices: Floats, faces: Ints, edge_tolerance: float = 1e-9):
        self._vertices, self._faces, self._tolerance = vertices, faces, edge_tolerance

    def first_hits(self, origins: Floats, direction: Floats) -> Hits:
        """First faces along parallel rays, seen from either side."""
        axes = axes_along(direction)
        seen = self._vertices @ axes  # columns: across, across, along
        rays = origins @ axes
        corners, last = seen[self._faces], rays.max(axis=0)
        low, high, first = corners.min(axis=1), corners.max(axis=1), rays.min(axis=0)
        met = (low[:, :2] <= last[:2]) & (high[:, :2] >= first[:2])  # across
        near: Ints = np.flatnonzero(met.all(axis=1) & (high[:, 2] >= first[2])).astype(np.int32)
        count = len(origins)
        if not len(near):
            return Hits(np.full(count, np.inf), np.full(count, -1, np.int32), np.zeros((count, 2)))
        depth, second, third = _depths(corners[near], rays, self._tolerance)
        least = np.arange(count), depth.argmin(axis=1)
        ranges = depth[least]
        faces = np.where(np.isfinite(ranges), near[least[1]], -1).astype(np.int32)
        return Hits(ranges, faces, np.column_stack([second[least], third[least]]))


def _depths(corners: Floats, rays: Floats, tolerance: float) -> tuple[Floats, Floats, Floats]:
    """Ranges (rays, triangles), infinite without a hit, and weights of two corners."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    edge_on = area == 0.0
    area = np.where(edge_on, 1.0, area)
    x, y = rays[:, :1], rays[:, 1:2]
    of_a = ((b[:, 0] - x) * (c[:, 1] - y) - (c[:, 0] - x) * (b[:, 1] - y)) / area
    of_b = ((c[:, 0] - x) * (a[:, 1] - y) - (a[:, 0] - x) * (c[:, 1] - y)) / area
    of_c = 1.0 - of_a - of_b
    inside = np.minimum(np.minimum(of_a, of_b), of_c) >= -tolerance
    depth = of_a * a[:, 2] + of_b * b[:, 2] + of_c * c[:, 2] - rays[:, 2:]
    return np.where(inside & ~edge_on & (depth >= 0.0), depth, np.inf), of_b, of_c


class CrossedMesh:
    """A closed mesh prepared for spans of rays.

    `vertices` (n, 3) [m]. `faces` (m, 3): counter-clockwise from outside; each edge has two.
    `shift`: fraction of the extent by which a ray is moved aside whose crossings are inconsistent
    by rounding. `n_tries`: of these moves. `block`: pairs of ray and edge at once.
    """

    def __init__(
        self,
        vertices: Floats,
        faces: Ints,
        *,
        shift: float = 1e-12,
        n_tries: int = 4,
        block: int = 1 << 19,
    ):
        self._vertices, self._faces = vertices, faces
        self._shift, self._n_tries, self._block = shift, n_tries, block
        self._edges, self._edge, _ = face_edges(faces)
        self._against = faces > np.roll(faces, -1, axis=1)
        self._extent = float(np.ptp(vertices, axis=0).max())

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Spans inside of parallel rays from origins (n, 3): see `CsgSolid.spans`."""
        axes = axes_along(direction)
        seen, rays = self._vertices @ axes, origins @ axes
        size = max(self._block // len(self._edges), 1)
        parts = [self._crossed(seen, rays[i : i + size]) for i in range(0, len(rays), size)]
        if not parts:
            return np.full((0, 1, 2), np.inf)
        width = max(part.shape[1] for part in parts)
        filled = [
            np.pad(part, ((0, 0), (0, width - part.shape[1]), (0, 0)), constant_values=np.inf)
            for part in parts
        ]
        return np.concatenate(filled)

    def _crossed(self, seen: Floats, rays: Floats) -> Floats:
        """Spans (n, k, 2) of some rays; mesh and rays are in axes with the rays along the last."""
        rays = rays.copy()
        for number in range(self._n_tries):
            row, place, turn = self._hits(seen, rays)
            wrong = np.bincount(row, turn, len(rays)) != 0.0
            if not wrong.any():
                break
            rays[wrong, :2] += (number + 1) * self._shift * self._extent * SHIFT_DIRECTION
        kept = ~wrong[row]
        return _spans_of(row[kept], place[kept], turn[kept], len(rays))

    def _hits(self, seen: Floats, rays: Floats) -> tuple[Longs, Floats, Longs]:
        """Rays, places and turns (1 inwards, -1 outwards) of all crossings, in order."""
        side, left = self._sides(seen, rays)
        left = left[:, self._edge] ^ self._against
        row, face = np.nonzero(left.all(axis=2) | ~left.any(axis=2))
        turn = np.where(left[row, face, 0], -1, 1)
        weight = np.abs(side[row[:, None], np.roll(self._edge[face], -1, axis=1)])
        depth = seen[self._faces[face], 2]
        total = weight.sum(axis=1)
        weight = np.where(total[:, None] > 0.0, weight, 1.0)
        place = (weight * depth).sum(axis=1) / weight.sum(axis=1) - rays[row, 2]
        order = np.lexsort((-turn, place, row))
        return row[order], place[order], turn[order]

    def _sides(self, seen: Floats, rays: Floats) -> tuple[Floats, Bools]:
        """Side of each edge on which each ray passes, (n, e): twice an area, and whether left."""
        x, y = (seen[None, :, axis] - rays[:, axis, None] for axis in (0, 1))
        first, last = self._edges.T
        side = x[:, first] * y[:, last] - x[:, last] * y[:, first]
        rise = seen[first, 1] - seen[last, 1]
        tie = np.where(rise == 0.0, seen[last, 0] - seen[first, 0], rise) > 0.0
        return side, np.where(side == 0.0, tie, side > 0.0)


def _spans_of(row: Longs, place: Floats, turn: Longs, count: int) -> Floats:
    """Spans (n, k, 2) from sorted crossings, whose turns add up to 0 for each ray."""
    depth = np.cumsum(turn)
    begins = np.flatnonzero((depth > 0) & (depth - turn <= 0))
    ends = np.flatnonzero((depth <= 0) & (depth - turn > 0))
    ahead = (place[ends] > 0.0) & (place[ends] > place[begins])
    begins, ends = begins[ahead], ends[ahead]
    own = row[begins]
    number = np.arange(len(own)) - np.searchsorted(own, own)
    spans = np.full((count, int(number.max(initial=0)) + 1, 2), np.inf)
    begin = place[begins]
    spans[own, number, 0] = np.where(begin <= 0.0, INSIDE, begin)
    spans[own, number, 1] = place[ends]
    return spans


class Deformation(Protocol):
    """A map of space."""

    def deform(self, points: Floats) -> Floats:
        """Images (n, 3) [m] of points."""

    def deform_with_jacobian(self, points: Floats) -> tuple[Floats, Floats]:
        """Images, and derivatives (n, 3, 3) with a column for each of x, y, z."""


class Polished(NamedTuple):
    """Ranges of rays to the exact surface."""

    ranges: Floats  # (n,), as of `Shape.cast`
    met: int  # number of rays that meet a facet
    kept: int  # number of these with the facet's range, because the exact surface was not reached


class DeformedShape:
    """A solid of which every point is moved.

    `base`: the undeformed solid. `deformation`: without folds. `exact`: whether rays that meet
    facets are continued to the exact surface, at six times the cost. `cast_level`: of the facets;
    82,000 faces of a 0.1 m ball differ from it by less than 10 um.
    """

    def __init__(
        self,
        base: ImplicitShape,
        deformation: Deformation,
        exact: bool = False,
        cast_level: int = 6,
    ):
        self._base, self._deformation, self._exact = base, deformation, exact
        self._cast_level = cast_level

    @cached_property
    def _undeformed(self) -> Mesh:
        return self._base.mesh(self._cast_level)

    @cached_property
    def _facets(self) -> Mesh:
        vertices, faces = self._undeformed
        return Mesh(self._deformation.deform(vertices), faces)

    @cached_property
    def _triangles(self) -> TriangleShape:
        return TriangleShape(*self._facets)

    def bounds(self) -> Floats:
        """Smallest and largest coordinates of the facets, (2, 3) [m]."""
        return self._triangles.bounds()

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) along parallel rays: see `Shape.cast`."""
        if self._exact:
            return self.cast_exactly(origins, direction, reach).ranges
        return self._triangles.cast(origins, direction, reach)

    def cast_exactly(self, origins: Floats, direction: Floats, reach: float) -> Polished:
        """Ranges to the exact surface, from the facets that the rays meet."""
        hits = self._triangles.first_hits(origins, direction)
        met = np.flatnonzero(np.isfinite(hits.ranges))
        if not len(met):
            return Polished(hits.ranges, 0, 0)
        corners = self._undeformed.vertices[self._undeformed.faces[hits.faces[met]]]
        second, third = hits.weights[met].T
        weights = np.stack([1.0 - second - third, second, third])
        exact, done = polish(
            self._base,
            self._deformation,
            np.einsum("kn,nkc->nc", weights, corners),
            origins[met] + hits.ranges[met, None] * direction,
            direction,
        )
        ranges = hits.ranges
        ranges[met[done]] += exact[done]
        started = met[done & (ranges[met] < 0.0)]  # start between facets and exact surface: inside
        ranges = np.where(ranges <= reach, ranges, MISS)
        ranges[started] = INSIDE
        return Polished(ranges, len(met), int(np.count_nonzero(~done)))

    def mesh(self, level: int) -> Mesh:
        """The base's tessellation, deformed: see `Shape.mesh`."""
        if level == self._cast_level:
            return self._facets
        vertices, faces = self._base.mesh(level)
        return Mesh(self._deformation.deform(vertices), faces)


def polish(
    base: ImplicitShape,
    deformation: Deformation,
    places: Floats,
    starts: Floats,
    direction: Floats,
    settings: PolishSettings = PolishSettings(),
) -> tuple[Floats, Bools]:
    """Distances along parallel rays from near a deformed surface onto it.

    `places` (n, 3): near the surface of the base; `starts` (n, 3): their images, near the rays [m].
    Returns distances (n,) [m], and whether they converged: the last step is small, and in all steps
    the place stayed near and the surface faced the ray.
    """
    low, high = base.enclosure()  # a lattice has no images beyond
    size = float((high - low).min())
    distances, first = np.zeros(len(places)), places
    lost = np.zeros(len(places), bool)
    for _ in range(settings.max_steps):
        reached, slopes = deformation.deform_with_jacobian(places)
        target = starts + distances[:, None] * direction
        aside, along = _solved(slopes, target - reached, direction)
        value, slope_aside = base.inside_out(places, aside)
        slope = base.inside_out(places, along)[1]
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # these are lost
            advance = -(value + slope_aside) / slope
            move = aside + advance[:, None] * along
            step = np.maximum(np.abs(advance), np.abs(move).max(axis=1))
            places, distances = np.clip(places + move, low, high), distances + advance
            moved = np.maximum(np.abs(distances), np.abs(places - first).max(axis=1))
        lost |= ~((slope < 0.0) & (step < np.inf) & (moved <= settings.max_move * size))
        places = np.where(lost[:, None], first, places)
        distances = np.where(lost, 0.0, distances)
        done = ~lost & (step <= settings.step_tolerance * size)
        if (done | lost).all():
            break
    return distances, done


def _solved(matrices: Floats, first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Solutions (n, 3) of n systems of three equations for two right-hand sides.

    By Cramer's rule: the matrices are near to rotations, because no part of a solid is flattened.
    """
    x, y, z = matrices.transpose(2, 0, 1)
    rows = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
    volume = np.einsum("ni,ni->n", rows[:, 0], x)[:, None]
    return (rows @ first[:, :, None])[:, :, 0] / volume, (rows @ second) / volume
