"""Sharp edges of a general solid: faces that meet there are fitted apart, and intersected.

A spline bends over a cell or two, and rounds an edge off however many touches tell of it. Where it
is bent much, touched points about a place are told apart by their normals, and each side is fitted
as a paraboloid of its own. The solid is the intersection of both where they meet at a ridge, their
union where they meet in a groove (as in *Robust moving least-squares fitting with sharp features*,
Fleishman, Cohen-Or and Silva, 2005). We depart from it: an edge is taken for sharp only if points
beside it, close to it on both sides, agree; or, where there are none, if that is so of most edges
of the object. So edges that are rounded stay as the spline has them.

Vertices of a mesh near to edges are moved onto these faces. Of each side of a triangle that crosses
an edge one end is moved onto the edge itself, and to each corner the nearest vertex (as by Kobbelt
et al., *Feature sensitive surface extraction from volume data*, 2001, where vertices are added).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry import axes_across, point_tree


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeSettings:
    """Where edges are looked for, and when they are taken for sharp."""

    min_bend: float = 0.5  # [rad] of the spline's surface about a place, over 3 mm
    spacing: float = 2.5e-3  # [m] between places at which faces are fitted
    reach: float = 8.0e-3  # [m] of the touched points that tell of the faces about a place
    max_points: int = 300  # of these, the nearest
    n_faces: int = 3  # that may meet at a place
    cone: float = math.radians(28.0)  # [rad] of the normals of one face about their mean
    apart: float = math.radians(40.0)  # [rad] from that mean, where normals of another may begin
    min_points: int = 12  # of a face
    bandwidth: float = 5.0e-3  # [m] standard deviation of the weights of points by distance
    curvature: float = 30.0  # [1/m] standard deviation of a face's, before it is fitted
    point_error: float = 0.05e-3  # [m] standard deviation of a touched point
    outlier: float = 2.5  # deviations from which on a point counts as an outlier
    min_angle: float = math.radians(40.0)  # [rad] between the faces at an edge
    max_shift: float = 5.0e-3  # [m] of an edge from the spline's surface
    # An edge is sharp if this share of the touched points so near to it lies so near to the faces,
    # and so many points of each face lie so near to it.
    tested: float = 2.5e-3  # [m] from the edge
    min_share: float = 0.75
    fits: float = 0.12e-3  # [m] from the faces
    beside: float = 1.5e-3  # [m] from the other face
    min_beside: int = 2
    # Where fewer points lie so near, most of the object's edges elsewhere tell: where this share of
    # those that were tested is sharp, the others are taken for sharp as well.
    min_tested: int = 6
    usual_share: float = 0.7
    moved: float = 4.5e-3  # [m] from an edge, up to where vertices are moved all the way
    kept: float = 7.0e-3  # [m] from an edge, from where on they stay
    n_blended: int = 3  # places on edges, the nearest, whose faces move a vertex
    # Way of a vertex onto an edge, of the side's length that crosses it.
    max_way: float = 2.0
    max_fold: float = math.radians(30.0)  # [rad] between ends of a triangle's side on one face
    fit_rounds: int = 6  # of weighing outliers of a face
    crease_rounds: int = 8  # of Newton's method onto two or three faces
    move_rounds: int = 3  # of moving vertices onto the solid


EDGES = EdgeSettings()


class Edges(NamedTuple):
    """Places on edges, and the faces that meet there."""

    places: Floats  # (e, 3) [m]
    origins: Floats  # of the faces, (e, 3) [m]
    frames: Floats  # columns are two axes across and the mean normal of each face, (e, 3, 3, 3)
    coefficients: Floats  # of 1, x, y, x^2, x y, y^2 in the height over a frame, (e, 3, 6) [m]
    # The solid is what the first two faces enclose together, and the third with these: of each two
    # the intersection where they meet at a ridge, else the union. The third may be the second.
    ridges: Bools  # (e, 2)

    def only(self, kept: Bools) -> Edges:
        """Those where a mask (e,) is set."""
        surfaces = self.origins[kept], self.frames[kept], self.coefficients[kept]
        return Edges(self.places[kept], *surfaces, self.ridges[kept])

    def faces_at(self, which: Ints, places: Floats) -> tuple[Floats, Floats]:
        """Signed distances (n, 3) of places (n, 3) from the faces about edges `which` (n,).

        To first order [m]; and unit normals there, (n, 3, 3).
        """
        frames = self.frames[which]
        local = np.einsum("ni,nfij->nfj", places - self.origins[which], frames)
        x, y, z = np.moveaxis(local, 2, 0)
        terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)
        c = self.coefficients[which]
        height = np.einsum("nfk,nfk->nf", terms, c)
        slope_x = c[..., 1] + 2.0 * c[..., 3] * x + c[..., 4] * y
        slope_y = c[..., 2] + c[..., 4] * x + 2.0 * c[..., 5] * y
        normals = np.stack([-slope_x, -slope_y, np.ones_like(x)], axis=2)
        lengths = np.linalg.norm(normals, axis=2)
        normals = np.einsum("nfij,nfj->nfi", frames, normals / lengths[..., None])
        return (z - height) / lengths, normals

    def active(self, which: Ints, distances: Floats) -> Ints:
        """The face (n,) whose distance, of those (n, 3) from all, is that from the solid."""
        ridges = self.ridges[which]
        rows = np.arange(len(which))
        of_two = np.where((distances[:, 0] > distances[:, 1]) == ridges[:, 0], 0, 1)
        of_all = (distances[rows, of_two] > distances[:, 2]) == ridges[:, 1]
        return np.where(of_all, of_two, 2)


def find_edges(bent: Floats, points: Floats, normals: Floats) -> Edges | None:
    """Sharp edges near to places (n, 3) [m] where a surface is much bent; None if there are none.

    `points`, `normals` (k, 3): what was touched, where the fit has it [m].
    """
    tree, fitted, most = point_tree(points), [], np.arange(1, EDGES.max_points + 1)
    for place in _spaced(bent):
        near = np.asarray(tree.query(place, most, distance_upper_bound=EDGES.reach)[1])
        near = near[near < len(points)]
        faces = [
            (_paraboloid(points[near][own] - place, mean), points[near][own].mean(axis=0))
            for own, mean in _sides(normals[near])
        ]
        if len(faces) > 1:
            fitted.append(_joined(place, faces))
    if not fitted:
        return None
    edges = Edges(*map(np.array, zip(*fitted, strict=True)))
    return _sharp_ones(edges, points)


def _spaced(places: Floats) -> Floats:
    """Some of the places, one in each cube of an edge `spacing`."""
    _, first = np.unique(np.floor(places / EDGES.spacing), axis=0, return_index=True)
    return places[np.sort(first)]


def _sides(normals: Floats) -> list[tuple[Bools, Floats]]:
    """Which points (n,) belong to each side, by their normals (n, 3), and its mean normal.

    The side of most points comes first, and none belongs to two of them.
    """
    alike = normals @ normals.T > math.cos(EDGES.cone)
    left, sides = np.ones(len(normals), np.bool_), list[tuple[Bools, Floats]]()
    while len(sides) < EDGES.n_faces and left.sum() >= EDGES.min_points:
        counts = (alike & left).sum(axis=1) * left
        own, mean = left & alike[counts.argmax()], normals[counts.argmax()]
        for _ in range(3):
            mean = normals[own].mean(axis=0)
            mean = mean / np.linalg.norm(mean)
            own = left & (normals @ mean > math.cos(EDGES.cone))
            if own.sum() < EDGES.min_points:
                return sides
        left &= normals @ mean < math.cos(EDGES.apart)
        sides.append((own, mean))
    return sides


class _Face(NamedTuple):
    frame: Floats  # (3, 3)
    coefficients: Floats  # (6,)


def _paraboloid(points: Floats, normal: Floats) -> _Face:
    """Fitted to points (n, 3) [m] that face along a normal; those near to the origin count most."""
    frame = np.column_stack([*axes_across(normal), normal])
    x, y, z = (points @ frame).T
    terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    shares = np.exp(-0.5 * (x * x + y * y) / EDGES.bandwidth**2) / EDGES.point_error
    curved = 1.0 / EDGES.curvature**2
    believed = np.diag([1.0, 1.0, 1.0, curved, curved, curved])  # a metre and 45 degrees are large
    inlying, coefficients = np.ones(len(z)), np.zeros(6)
    for _ in range(EDGES.fit_rounds):
        rows = terms * (shares * inlying)[:, None]
        squares = rows.T @ rows + believed
        coefficients = np.linalg.solve(squares, rows.T @ (z * shares * inlying))
        off = np.abs(z - terms @ coefficients)
        scale = max(1.48 * float(np.median(off)), EDGES.point_error)
        inlying = 1.0 / (1.0 + (off / (EDGES.outlier * scale)) ** 2)
    return _Face(frame, coefficients)


def _joined(
    place: Floats, faces: list[tuple[_Face, Floats]]
) -> tuple[Floats, Floats, Floats, Floats, Bools]:
    """A row of `Edges`, of two or three faces and the mean of the points of each."""
    if len(faces) == 2:
        faces = [*faces, faces[1]]
    frames = np.array([face.frame for face, _ in faces])
    coefficients = np.array([face.coefficients for face, _ in faces])
    single = Edges(
        place[None], place[None], frames[None], coefficients[None], np.ones((1, 2), bool)
    )
    means = np.array([mean for _, mean in faces])
    # Of a face at a ridge the other face's points lie inside.
    inside = single.faces_at(np.zeros(3, np.int32), means)[0].T
    ridge = inside + inside.T < 0.0
    pairs = [(0, 1, 2), (0, 2, 1), (1, 2, 0)]
    alike = [bool(ridge[i, j]) for i, j, _ in pairs]
    # The pair that meets otherwise than the two others is joined first.
    first = alike.index(sum(alike) == 1) if 0 < sum(alike) < 3 else 0
    order = list(pairs[first])
    ridges = np.array([alike[first], alike[first - 1]])
    return place, place, frames[order], coefficients[order], ridges


def _sharp_ones(edges: Edges, points: Floats) -> Edges | None:
    """Those whose faces meet near to their places at an angle, as points beside them confirm."""
    numbers = np.arange(len(edges.places), dtype=np.int32)
    distances, normals = edges.faces_at(numbers, edges.places)
    pair = _crossing_pair(edges, numbers, distances, normals)
    creases, angles = _onto_crease(edges, numbers, edges.places, pair)
    shifts = np.linalg.norm(creases - edges.places, axis=1)
    good = (angles > EDGES.min_angle) & (shifts < EDGES.max_shift)
    if not good.any():
        return None
    edges, creases, pair = edges.only(good), creases[good], pair[good]
    counts, confirmed = _confirmed(edges, creases, pair, points)
    tested = counts >= EDGES.min_tested
    usual = tested.any() and confirmed[tested].mean() >= EDGES.usual_share
    kept = confirmed | (~tested if usual else False)
    if not kept.any():
        return None
    return edges.only(kept)._replace(places=creases[kept])


def _confirmed(edges: Edges, creases: Floats, pair: Ints, points: Floats) -> tuple[Ints, Bools]:
    """How many points lie beside each crease (e, 3), and whether they agree with the faces there.

    `pair` (e, 2): the two faces that meet.
    """
    near = point_tree(creases).query_ball_tree(point_tree(points), EDGES.tested)
    counts = np.array([len(indices) for indices in near], np.int32)
    number = np.repeat(np.arange(len(creases), dtype=np.int32), counts)
    beside = points[np.concatenate([np.array(indices, np.int64) for indices in near])]
    distances, rows = edges.faces_at(number, beside)[0], np.arange(len(number))
    fits = np.abs(distances[rows, edges.active(number, distances)]) < EDGES.fits
    confirmed = np.bincount(number, fits, len(creases)) >= EDGES.min_share * counts
    for own, other in ((0, 1), (1, 0)):
        on_face = np.abs(distances[rows, pair[number, own]]) < EDGES.fits
        close = np.abs(distances[rows, pair[number, other]]) < EDGES.beside
        confirmed &= np.bincount(number, on_face & close, len(creases)) >= EDGES.min_beside
    return counts, confirmed


def _crossing_pair(edges: Edges, which: Ints, distances: Floats, normals: Floats) -> Ints:
    """The active face (n, 2) at places, and the nearest one that is another."""
    rows = np.arange(len(which))
    active = edges.active(which, distances)
    alike = np.einsum("nfi,ni->nf", normals, normals[rows, active]) > math.cos(EDGES.max_fold)
    other = np.where(alike, np.inf, np.abs(distances)).argmin(axis=1)
    return np.column_stack([active, other]).astype(np.int32)


def _onto_crease(edges: Edges, which: Ints, places: Floats, pair: Ints) -> tuple[Floats, Floats]:
    """Places (n, 3) moved to where two faces (n, 2) meet, and the angles (n,) at which they do."""
    rows = np.arange(len(which))[:, None]
    for _ in range(EDGES.crease_rounds):
        distances, normals = edges.faces_at(which, places)
        both, across = distances[rows, pair], normals[rows, pair]
        places = places - _newton_step(both, across)
    cosines = np.einsum("ni,ni->n", across[:, 0], across[:, 1])
    return places, np.arccos(np.clip(cosines, -1.0, 1.0))


def _newton_step(distances: Floats, normals: Floats) -> Floats:
    """What moves places (n, 3) off two or three faces, at distances (n, k), back onto all."""
    square = np.einsum("nai,nbi->nab", normals, normals) + 1e-6 * np.eye(normals.shape[1])
    shares = np.linalg.solve(square, distances[..., None])[..., 0]
    step = np.einsum("nai,na->ni", normals, shares)
    return np.asarray(np.clip(step, -EDGES.reach, EDGES.reach), np.float64)


def sharpened(edges: Edges, vertices: Floats, faces: Ints) -> Floats:
    """Vertices (n, 3) of a mesh, those near to edges moved onto the faces that meet there [m]."""
    ranks = np.arange(1, min(EDGES.n_blended, len(edges.places)) + 1)
    nearest_edges = scipy.spatial.cKDTree(edges.places).query(vertices, ranks)
    away, which = np.asarray(nearest_edges[0], np.float64), np.asarray(nearest_edges[1], np.int32)
    near = np.flatnonzero(away[:, 0] < EDGES.kept).astype(np.int32)
    if not len(near):
        return vertices
    away, which = away[near], which[near]
    shares = np.exp(-0.5 * (away / EDGES.spacing) ** 2) + np.finfo(float).tiny
    shares /= shares.sum(axis=1, keepdims=True)
    places = vertices[near]
    for _ in range(EDGES.move_rounds):
        step = np.zeros_like(places)
        for numbers, share in zip(which.T, shares.T, strict=True):
            distances, normals = edges.faces_at(numbers, places)
            rows = np.arange(len(numbers)), edges.active(numbers, distances)
            step += (share * distances[rows])[:, None] * normals[rows]
        places = places - step
    places = _snapped(edges, vertices, faces, near, which[:, 0], places)
    corners = _corners(edges)
    if len(corners):
        ways, nearest = map(np.asarray, scipy.spatial.cKDTree(places).query(corners))
        close = ways < EDGES.spacing
        places[nearest[close]] = corners[close]
    shift = places - vertices[near]
    fading = np.clip((EDGES.kept - away[:, 0]) / (EDGES.kept - EDGES.moved), 0.0, 1.0)
    fading[np.linalg.norm(shift, axis=1) > EDGES.max_shift] = 0.0
    moved = vertices.copy()
    moved[near] += fading[:, None] * shift
    return moved


def _corners(edges: Edges) -> Floats:
    """Where three faces meet near to an edge, (c, 3) [m]."""
    numbers, places = np.arange(len(edges.places), dtype=np.int32), edges.places
    for _ in range(EDGES.crease_rounds):
        distances, normals = edges.faces_at(numbers, places)
        places = places - _newton_step(distances, normals)
    cosines = np.einsum("nai,nai->na", normals, np.roll(normals, 1, axis=1))
    good = (cosines < math.cos(EDGES.min_angle)).all(axis=1)
    return _spaced(places[good & (np.linalg.norm(places - edges.places, axis=1) < EDGES.moved)])


def _snapped(
    edges: Edges, vertices: Floats, faces: Ints, near: Ints, which: Ints, places: Floats
) -> Floats:
    """Places (k, 3) of the vertices `near`; of a side across an edge one end is on it."""
    distances, normals = edges.faces_at(which, places)
    pair = _crossing_pair(edges, which, distances, normals)
    facing = normals[np.arange(len(which)), pair[:, 0]]
    number = np.full(len(vertices), -1, np.int64)
    number[near] = np.arange(len(near))
    sides = number[np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])]
    first, second = sides[(sides >= 0).all(axis=1)].T
    across = np.einsum("ni,ni->n", facing[first], facing[second]) < math.cos(EDGES.max_fold)
    first, second = first[across], second[across]
    creases, angles = _onto_crease(edges, which, places, pair)
    ways = np.linalg.norm(creases - places, axis=1)
    ways[angles < EDGES.min_angle] = np.inf
    nearer = np.where(ways[first] < ways[second], first, second)
    length = np.linalg.norm(places[first] - places[second], axis=1)
    snapped = np.unique(nearer[ways[nearer] < EDGES.max_way * length])
    places = places.copy()
    places[snapped] = creases[snapped]
    return places
