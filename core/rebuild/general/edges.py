"""Sharp edges of a general solid: the faces that meet there are fitted separately and intersected.

A spline bends over a cell or two, and rounds an edge off however many touches lie on it. Where it
is strongly bent, touched points about a place are divided into faces by their normals, and each
face is fitted as a paraboloid. The solid is the intersection of both where they meet at a ridge,
their union where they meet in a groove (as in *Robust moving least-squares fitting with sharp
features*, Fleishman, Cohen-Or and Silva, 2005). We depart from it: an edge is sharp only if points
close to it on both sides fit the two faces; or, where no points are so close, if most edges of the
object are sharp. So rounded edges stay as the spline has them.

Vertices of a mesh near to edges are moved onto these faces. Where a side of a triangle crosses an
edge, one of its ends is moved onto the edge; the vertex nearest to a corner is moved onto it (as by
Kobbelt et al., *Feature sensitive surface extraction from volume data*, 2001, who add vertices).
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
    """Where edges are searched, when they are sharp, and which vertices are moved onto them."""

    min_bend: float = 0.5  # [rad] of the spline's surface within 3 mm; edges are searched above it
    spacing: float = 2.5e-3  # [m] between places at which faces are fitted
    reach: float = 8.0e-3  # [m] from a place, of the touched points to which its faces are fitted
    max_points: int = 300  # nearest touched points that are used
    n_faces: int = 3  # largest number of faces that meet at a place
    max_face_angle: float = math.radians(28.0)  # [rad] of a face's normals to their mean
    min_other_angle: float = math.radians(40.0)  # [rad] of another face's normals to that mean
    min_points: int = 12  # of a face
    bandwidth: float = 5.0e-3  # [m] standard deviation of the Gaussian weights of points
    curvature: float = 30.0  # [1/m] prior standard deviation of a face's curvature
    point_error: float = 0.05e-3  # [m] standard deviation of a touched point
    outlier_sigmas: float = 2.5  # standard deviations at which the rows of a point are halved
    min_angle: float = math.radians(40.0)  # [rad] between the faces at an edge
    max_shift: float = 5.0e-3  # [m] of an edge from the spline's surface
    # An edge is sharp if a fraction of the touched points near to it fits the faces, and if each
    # face has points close to the edge.
    test_distance: float = 2.5e-3  # [m] from the edge, up to which points are tested
    min_share: float = 0.75  # fraction of the tested points that must fit
    max_misfit: float = 0.12e-3  # [m] distance from the faces of a point that fits
    close_distance: float = 1.5e-3  # [m] of a close point from the other face
    min_close: int = 2  # close points of each face
    # An edge with fewer tested points is undecided: it is sharp if so large a fraction of the
    # object's decided edges is.
    min_tested: int = 6  # points
    min_sharp_share: float = 0.7  # the fraction
    full_shift_reach: float = 4.5e-3  # [m] from an edge; nearer vertices move by the whole shift
    shift_reach: float = 7.0e-3  # [m] from an edge; the shift fades up to there, and ends
    n_blended: int = 3  # nearest places on edges, whose faces are averaged to move a vertex
    # Largest shift of a vertex onto an edge, over the length of the triangle side that crosses it.
    max_shift_ratio: float = 2.0
    max_fold: float = math.radians(30.0)  # [rad] between normals of one face; more is another face
    fit_rounds: int = 6  # weighted fits of a face, to weigh outliers
    crease_rounds: int = 8  # Newton steps onto two or three faces
    move_rounds: int = 3  # steps of vertices onto the solid


class Edges(NamedTuple):
    """Places on edges, and the faces that meet there."""

    places: Floats  # (e, 3) [m]
    origins: Floats  # of the faces, (e, 3) [m]
    frames: Floats  # columns are two axes across and the mean normal of each face, (e, 3, 3, 3)
    coefficients: Floats  # of 1, x, y, x^2, x y, y^2 in the height over a frame, (e, 3, 6) [m]
    # Whether the first two faces meet at a ridge, and whether the third face and these two do: the
    # solid is the intersection at a ridge, else the union. The third face may repeat the second.
    ridges: Bools  # (e, 2)

    def only(self, kept: Bools) -> Edges:
        """The places and faces where a mask (e,) is set."""
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
        """Number (n,) of the face that is the solid's surface, by distances (n, 3) from all."""
        ridges = self.ridges[which]
        rows = np.arange(len(which))
        of_two = np.where((distances[:, 0] > distances[:, 1]) == ridges[:, 0], 0, 1)
        of_all = (distances[rows, of_two] > distances[:, 2]) == ridges[:, 1]
        return np.where(of_all, of_two, 2)


def find_edges(
    bent: Floats, points: Floats, normals: Floats, settings: EdgeSettings = EdgeSettings()
) -> Edges | None:
    """Sharp edges near to places (n, 3) [m] of a strongly bent surface; None if there are none.

    `points` [m], `normals` (k, 3): touched points, displaced as they are in the fit.
    """
    tree, fitted, ranks = point_tree(points), [], np.arange(1, settings.max_points + 1)
    for place in _thinned(bent, settings.spacing):
        near = np.asarray(tree.query(place, ranks, distance_upper_bound=settings.reach)[1])
        near = near[near < len(points)]
        faces = [
            (_paraboloid(points[near][own] - place, mean, settings), points[near][own].mean(axis=0))
            for own, mean in _side_masks(normals[near], settings)
        ]
        if len(faces) > 1:
            fitted.append(_edge_row(place, faces))
    if not fitted:
        return None
    edges = Edges(*map(np.array, zip(*fitted, strict=True)))
    return _sharp_ones(edges, points, settings)


def _thinned(places: Floats, spacing: float) -> Floats:
    """One of the places in each cube with an edge of `spacing`."""
    _, first = np.unique(np.floor(places / spacing), axis=0, return_index=True)
    return places[np.sort(first)]


def _side_masks(normals: Floats, settings: EdgeSettings) -> list[tuple[Bools, Floats]]:
    """Mask (n,) of the points of each face, by their normals (n, 3), and its mean normal.

    The face with the most points comes first; no point belongs to two faces.
    """
    alike = normals @ normals.T > math.cos(settings.max_face_angle)
    left, sides = np.ones(len(normals), np.bool_), list[tuple[Bools, Floats]]()
    while len(sides) < settings.n_faces and left.sum() >= settings.min_points:
        counts = (alike & left).sum(axis=1) * left
        own, mean = left & alike[counts.argmax()], normals[counts.argmax()]
        for _ in range(3):
            mean = normals[own].mean(axis=0)
            mean = mean / np.linalg.norm(mean)
            own = left & (normals @ mean > math.cos(settings.max_face_angle))
            if own.sum() < settings.min_points:
                return sides
        left &= normals @ mean < math.cos(settings.min_other_angle)
        sides.append((own, mean))
    return sides


class _Face(NamedTuple):
    frame: Floats  # (3, 3)
    coefficients: Floats  # (6,)


def _paraboloid(points: Floats, normal: Floats, settings: EdgeSettings) -> _Face:
    """Paraboloid through points (n, 3) [m] about a normal, weighted by distance from the origin."""
    frame = np.column_stack([*axes_across(normal), normal])
    x, y, z = (points @ frame).T
    terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    shares = np.exp(-0.5 * (x * x + y * y) / settings.bandwidth**2) / settings.point_error
    curved = 1.0 / settings.curvature**2  # [m^2]
    prior = np.diag([1.0, 1.0, 1.0, curved, curved, curved])  # weak: 1 m of height, slope 1
    inlying, coefficients = np.ones(len(z)), np.zeros(6)
    for _ in range(settings.fit_rounds):
        rows = terms * (shares * inlying)[:, None]
        squares = rows.T @ rows + prior
        coefficients = np.linalg.solve(squares, rows.T @ (z * shares * inlying))
        off = np.abs(z - terms @ coefficients)
        scale = max(1.48 * float(np.median(off)), settings.point_error)
        inlying = 1.0 / (1.0 + (off / (settings.outlier_sigmas * scale)) ** 2)
    return _Face(frame, coefficients)


def _edge_row(
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
    # At a ridge, the points of each face lie inside the other face.
    inside = single.faces_at(np.zeros(3, np.int32), means)[0].T
    ridge = inside + inside.T < 0.0
    pairs = [(0, 1, 2), (0, 2, 1), (1, 2, 0)]
    alike = [bool(ridge[i, j]) for i, j, _ in pairs]
    # If one pair is a ridge and two are grooves, or the reverse, that one pair is joined first.
    first = alike.index(sum(alike) == 1) if 0 < sum(alike) < 3 else 0
    order = list(pairs[first])
    ridges = np.array([alike[first], alike[first - 1]])
    return place, place, frames[order], coefficients[order], ridges


def _sharp_ones(edges: Edges, points: Floats, settings: EdgeSettings) -> Edges | None:
    """The edges whose faces meet at an angle near to their places, confirmed by touched points."""
    numbers = np.arange(len(edges.places), dtype=np.int32)
    distances, normals = edges.faces_at(numbers, edges.places)
    pair = _crossing_pair(edges, numbers, distances, normals, settings.max_fold)
    creases, angles = _onto_crease(edges, numbers, edges.places, pair, settings)
    shifts = np.linalg.norm(creases - edges.places, axis=1)
    good = (angles > settings.min_angle) & (shifts < settings.max_shift)
    if not good.any():
        return None
    edges, creases, pair = edges.only(good), creases[good], pair[good]
    counts, confirmed = _confirmed(edges, creases, pair, points, settings)
    tested = counts >= settings.min_tested
    usual = tested.any() and confirmed[tested].mean() >= settings.min_sharp_share
    kept = confirmed | (~tested if usual else False)
    if not kept.any():
        return None
    return edges.only(kept)._replace(places=creases[kept])


def _confirmed(
    edges: Edges, creases: Floats, pair: Ints, points: Floats, settings: EdgeSettings
) -> tuple[Ints, Bools]:
    """Number of points near to each crease (e, 3), and whether they fit the faces there.

    `pair` (e, 2): the two faces that meet.
    """
    near = point_tree(creases).query_ball_tree(point_tree(points), settings.test_distance)
    counts = np.array([len(indices) for indices in near], np.int32)
    number = np.repeat(np.arange(len(creases), dtype=np.int32), counts)
    tested_points = points[np.concatenate([np.array(indices, np.int64) for indices in near])]
    distances, rows = edges.faces_at(number, tested_points)[0], np.arange(len(number))
    fits = np.abs(distances[rows, edges.active(number, distances)]) < settings.max_misfit
    confirmed = np.bincount(number, fits, len(creases)) >= settings.min_share * counts
    for own, other in ((0, 1), (1, 0)):
        on_face = np.abs(distances[rows, pair[number, own]]) < settings.max_misfit
        close = np.abs(distances[rows, pair[number, other]]) < settings.close_distance
        confirmed &= np.bincount(number, on_face & close, len(creases)) >= settings.min_close
    return counts, confirmed


def _crossing_pair(
    edges: Edges, which: Ints, distances: Floats, normals: Floats, max_fold: float
) -> Ints:
    """Numbers (n, 2) of the active face at places, and of the nearest face that differs from it."""
    rows = np.arange(len(which))
    active = edges.active(which, distances)
    alike = np.einsum("nfi,ni->nf", normals, normals[rows, active]) > math.cos(max_fold)
    other = np.where(alike, np.inf, np.abs(distances)).argmin(axis=1)
    return np.column_stack([active, other]).astype(np.int32)


def _onto_crease(
    edges: Edges, which: Ints, places: Floats, pair: Ints, settings: EdgeSettings
) -> tuple[Floats, Floats]:
    """Places (n, 3) moved to where two faces (n, 2) meet, and the angles (n,) at which they do."""
    rows = np.arange(len(which))[:, None]
    for _ in range(settings.crease_rounds):
        distances, normals = edges.faces_at(which, places)
        both, across = distances[rows, pair], normals[rows, pair]
        places = places - _newton_step(both, across, settings.reach)
    cosines = np.einsum("ni,ni->n", across[:, 0], across[:, 1])
    return places, np.arccos(np.clip(cosines, -1.0, 1.0))


def _newton_step(distances: Floats, normals: Floats, max_shift: float) -> Floats:
    """Step to subtract from places (n, 3) at distances (n, k) from k faces, to lie on all.

    Each coordinate of the step is at most `max_shift` [m].
    """
    square = np.einsum("nai,nbi->nab", normals, normals) + 1e-6 * np.eye(normals.shape[1])
    shares = np.linalg.solve(square, distances[..., None])[..., 0]
    step = np.einsum("nai,na->ni", normals, shares)
    return np.asarray(np.clip(step, -max_shift, max_shift), np.float64)


def sharpened(
    edges: Edges, vertices: Floats, faces: Ints, settings: EdgeSettings = EdgeSettings()
) -> Floats:
    """Vertices (n, 3) of a mesh, those near to edges moved onto the faces that meet there [m]."""
    ranks = np.arange(1, min(settings.n_blended, len(edges.places)) + 1)
    nearest_edges = scipy.spatial.cKDTree(edges.places).query(vertices, ranks)
    away, which = np.asarray(nearest_edges[0], np.float64), np.asarray(nearest_edges[1], np.int32)
    near = np.flatnonzero(away[:, 0] < settings.shift_reach).astype(np.int32)
    if not len(near):
        return vertices
    away, which = away[near], which[near]
    shares = np.exp(-0.5 * (away / settings.spacing) ** 2) + np.finfo(float).tiny
    shares /= shares.sum(axis=1, keepdims=True)
    places = vertices[near]
    for _ in range(settings.move_rounds):
        step = np.zeros_like(places)
        for numbers, share in zip(which.T, shares.T, strict=True):
            distances, normals = edges.faces_at(numbers, places)
            rows = np.arange(len(numbers)), edges.active(numbers, distances)
            step += (share * distances[rows])[:, None] * normals[rows]
        places = places - step
    places = _snapped(edges, vertices, faces, near, which[:, 0], places, settings)
    corners = _corners(edges, settings)
    if len(corners):
        shifts, nearest = map(np.asarray, scipy.spatial.cKDTree(places).query(corners))
        close = shifts < settings.spacing
        places[nearest[close]] = corners[close]
    shift = places - vertices[near]
    fading_width = settings.shift_reach - settings.full_shift_reach
    fading = np.clip((settings.shift_reach - away[:, 0]) / fading_width, 0.0, 1.0)
    fading[np.linalg.norm(shift, axis=1) > settings.max_shift] = 0.0
    moved = vertices.copy()
    moved[near] += fading[:, None] * shift
    return moved


def _corners(edges: Edges, settings: EdgeSettings) -> Floats:
    """Where three faces meet near to an edge, (c, 3) [m]."""
    numbers, places = np.arange(len(edges.places), dtype=np.int32), edges.places
    for _ in range(settings.crease_rounds):
        distances, normals = edges.faces_at(numbers, places)
        places = places - _newton_step(distances, normals, settings.reach)
    cosines = np.einsum("nai,nai->na", normals, np.roll(normals, 1, axis=1))
    good = (cosines < math.cos(settings.min_angle)).all(axis=1)
    good &= np.linalg.norm(places - edges.places, axis=1) < settings.full_shift_reach
    return _thinned(places[good], settings.spacing)


def _snapped(
    edges: Edges,
    vertices: Floats,
    faces: Ints,
    near: Ints,
    which: Ints,
    places: Floats,
    settings: EdgeSettings,
) -> Floats:
    """Places (k, 3) of the vertices `near`; of each side across an edge, one end is put on it."""
    distances, normals = edges.faces_at(which, places)
    pair = _crossing_pair(edges, which, distances, normals, settings.max_fold)
    facing = normals[np.arange(len(which)), pair[:, 0]]
    number = np.full(len(vertices), -1, np.int64)
    number[near] = np.arange(len(near))
    sides = number[np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])]
    first, second = sides[(sides >= 0).all(axis=1)].T
    across = np.einsum("ni,ni->n", facing[first], facing[second]) < math.cos(settings.max_fold)
    first, second = first[across], second[across]
    creases, angles = _onto_crease(edges, which, places, pair, settings)
    shifts = np.linalg.norm(creases - places, axis=1)
    shifts[angles < settings.min_angle] = np.inf
    nearer = np.where(shifts[first] < shifts[second], first, second)
    length = np.linalg.norm(places[first] - places[second], axis=1)
    snapped = np.unique(nearer[shifts[nearer] < settings.max_shift_ratio * length])
    places = places.copy()
    places[snapped] = creases[snapped]
    return places
