"""Repair of meshes to one closed surface that does not cross itself, with a list of the repairs.

A sound mesh is returned unchanged, to the last bit. Otherwise open edges are stitched and small
holes closed, faces are oriented alike, and pieces are united and crossings resolved by the manifold
library, whose booleans are closed for any input (Julian Smith, *Towards robust inexact geometric
computation*, 2009). A patch of crossings that no plane separates is cut out and closed like a hole
(Attene, *A lightweight approach to repairing digitized polygon meshes*, 2010).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.geometry import face_edges, linked_groups, self_intersection, solidity
from palpate.core.shapes.face_cutting import by_ears
from palpate.core.shapes.junctions import split_at_junctions
from palpate.core.shapes.walls import loose_walls, outer_surface

if TYPE_CHECKING:
    from manifold3d import Manifold


@dataclass(frozen=True, slots=True, kw_only=True)
class MendSettings:
    """Limits of the repair of a mesh; lengths are fractions of its largest extent."""

    max_hole: float = 0.1  # width; wider holes are refused, because a patch would be a guess
    min_piece: float = 0.01  # extent; smaller loose pieces are left out
    stitch_distance: float = 1e-4  # between corners of open edges that are joined
    # Upper limit of that distance, as a fraction of the median edge, so that no face is stitched to
    # itself.
    max_stitch_edge: float = 0.1
    max_outside: float = 1e-6  # share of a hollow outside the object; with more it is a piece
    max_rounds: int = 4  # of cutting crossings out, with the faces that touch them
    max_cuts: int = 6  # successive planes through a piece that crosses itself
    n_planes: int = 6  # tried along each axis
    max_cut_faces: int = 20_000  # of a piece for which planes are tried; more take many seconds


NO_SOLID = "bounds no solid: its faces enclose nothing, or cannot form one closed surface"


class MeshFault(ValueError):
    """A fault of a mesh that cannot be repaired; the message adds the reason."""

    def __init__(self, fault: str, why: str = ""):
        super().__init__(fault + why)
        self.fault = fault


class MendedMesh(NamedTuple):
    """One closed, outward surface that does not cross itself, and its repairs."""

    vertices: Floats  # (n, 3) [m]
    faces: Ints  # (m, 3)
    mends: tuple[str, ...]  # each a phrase; empty if the mesh is unchanged


def mend_mesh(vertices: Floats, faces: Ints, settings: MendSettings = MendSettings()) -> MendedMesh:
    """Repair a mesh to one closed solid, of any genus.

    `vertices` (n, 3): distinct [m]. `faces` (m, 3): indices of vertices. Raises MeshFault, a
    ValueError whose message continues the mesh's name, if a hole or a crossing is wider than
    `max_hole`, pieces do not touch, or the surface has one side only.
    """
    if _is_sound(vertices, faces):
        return MendedMesh(vertices, faces, ())
    size = float(np.ptp(vertices, axis=0).max())
    mends: list[str] = []
    faces = _stitched(vertices, faces, size, mends, settings)
    crossed = 0
    for _ in range(settings.max_rounds):
        solid = as_manifold(vertices, faces)
        if solid is None:
            solid = as_manifold(
                *_closed(vertices, faces, size, mends, settings, is_cut=crossed > 0)
            )
        if solid is None:
            raise MeshFault(NO_SOLID)
        crossed = crossed or len(np.unique(_crossings(solid).through))
        pieces = _without_specks(solid, size, mends, settings)
        crossings = _crossings(_united(pieces, size, mends, settings))
        hole = _widest(crossings.vertices, _loops(crossings.without_them()))
        if hole > settings.max_hole * size:
            parts = _separated(crossings, settings, settings.max_cuts)
            crossings = _crossings(_united(parts, size, [], settings))
        vertices, faces = crossings.vertices, crossings.without_them()
        if not len(crossings.through):
            _report(mends, crossed, "face", "that crossed others cut where they did")
            _report(mends, solidity(vertices, faces).genus or 0, "handle", "kept")
            return MendedMesh(vertices, faces, tuple(mends))
    raise MeshFault("crosses itself in ways that cannot be mended", "; mend it in a mesh editor")


def _is_sound(vertices: Floats, faces: Ints) -> bool:
    topology = solidity(vertices, faces)
    is_single = topology.watertight and topology.components == 1 and topology.volume > 0.0
    solid = as_manifold(vertices, faces) if is_single else None
    return solid is not None and not self_intersection(vertices, faces).count


def as_manifold(vertices: Floats, faces: Ints) -> Manifold | None:
    """The mesh as the library's solid; None if it is not closed or not consistently oriented."""
    from manifold3d import Error, Manifold, Mesh64

    rows = np.ascontiguousarray(faces, np.uint64)
    solid = Manifold(Mesh64(np.ascontiguousarray(vertices, np.float64), rows))
    return solid if solid.status() == Error.NoError and not solid.is_empty() else None


def arrays_of(solid: Manifold) -> tuple[Floats, Ints]:
    """Vertices (n, 3) [m] and faces (m, 3) of the library's solid."""
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties[:, :3], np.float64), np.array(mesh.tri_verts, np.int32)


class Crossings(NamedTuple):
    """Crossings of faces, and their mesh."""

    places: Floats  # (n, 3) [m]
    through: Ints  # (n, 2), faces that cross
    vertices: Floats  # (v, 3) [m]
    faces: Ints  # (m, 3)

    def without_them(self) -> Ints:
        """The faces that neither cross another nor touch one that does."""
        return self.faces[~np.isin(self.faces, self.faces[self.through]).any(axis=1)]


def _crossings(solid: Manifold) -> Crossings:
    vertices, faces = arrays_of(solid)
    pairs = self_intersection(vertices, faces)
    return Crossings(pairs.places, pairs.faces, vertices, faces)


def _stitched(
    vertices: Floats, faces: Ints, size: float, mends: list[str], settings: MendSettings
) -> Ints:
    """Faces without repetitions, with close corners of open edges joined."""
    ends, _, counts = face_edges(faces)
    opened = np.unique(ends[counts == 1])
    from scipy.spatial import cKDTree

    lengths = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)
    limit = settings.max_stitch_edge * float(np.median(lengths))
    distance = min(settings.stitch_distance * size, limit)
    near = cKDTree(vertices[opened]).query_pairs(distance, output_type="ndarray")
    if len(near):
        group = linked_groups(len(vertices), *opened[near].T)
        _, first = np.unique(group, return_index=True)
        faces = first[group][faces].astype(np.int32)
        a, b, c = faces.T
        faces = faces[(a != b) & (b != c) & (c != a)]
        _report(mends, len(vertices) - len(first), "corner", "on open edges stitched to others")
    faces, n_inserted = split_at_junctions(vertices, faces, distance)
    _report(mends, n_inserted, "corner", "on open edges set into edges that passed them")
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    _report(mends, len(faces) - len(kept), "face", "that stood twice left out")
    return faces[np.sort(kept)]


def _closed(
    vertices: Floats,
    faces: Ints,
    size: float,
    mends: list[str],
    settings: MendSettings,
    *,
    is_cut: bool,
) -> tuple[Floats, Ints]:
    """The mesh without inner walls and sheets, oriented alike, its holes closed.

    `is_cut`: whether the holes are cut-out crossings.
    """
    if _has_crowded_edges(faces):
        outer = outer_surface(vertices, faces)
        _report(mends, outer.walls, "face", "of walls within it left out")
        _report(mends, outer.sheets, "face", "of sheets on it left out")
        faces, turned = outer.faces, outer.turned
    else:
        faces, turned = _oriented(faces)
    _report(mends, turned, "face", "turned like the others")
    if not len(faces):
        raise MeshFault(NO_SOLID)
    loose = loose_walls(vertices, faces, settings.stitch_distance * size)
    _report(mends, int(loose.sum()), "face", "of loose walls within it left out")
    faces = faces[~loose]
    loops = _loops(faces)
    widest = _widest(vertices, loops)
    if widest > settings.max_hole * size:
        what = "crosses itself over" if is_cut else "is open: it has a hole of"
        raise MeshFault(
            f"{what} {1e3 * widest:.3g} mm",
            f", and no more than {settings.max_hole:.0%} of its size, "
            f"{1e3 * settings.max_hole * size:.3g} mm, can be closed by guess; "
            "close it in a mesh editor",
        )
    what = "crossing" if is_cut else "hole"
    _report(mends, len(loops), what, f"of up to {1e3 * widest:.2g} mm closed")
    patches = [faces]
    for loop in loops:
        patch, middle = _patch(vertices, loop)
        vertices = np.concatenate([vertices, middle])
        patches.append(patch)
    return vertices, np.concatenate(patches).astype(np.int32)


def _has_crowded_edges(faces: Ints) -> bool:
    return bool((face_edges(faces).counts > 2).any())


def _oriented(faces: Ints) -> tuple[Ints, int]:
    """Faces with consistent orientation, as few as possible reversed, and their number.

    Each face has two nodes in a graph, one for each orientation, which belong to opposite sides.
    """
    count, start, edge = len(faces), faces.ravel(), face_edges(faces).numbers.ravel()
    order = np.argsort(edge, kind="stable")
    pairs = np.flatnonzero(edge[order[1:]] == edge[order[:-1]])
    first, second = order[pairs], order[pairs + 1]
    against = count * (start[first] == start[second])  # both pass the edge in the same direction
    nodes, neighbours = np.concatenate([first // 3, first // 3 + count]), second // 3
    neighbours = np.concatenate([neighbours + against, neighbours + count - against])
    group = linked_groups(2 * count, nodes, neighbours)
    kept, turned = group[:count], group[count:]
    if (kept == turned).any():
        raise MeshFault("has one side only, like a Moebius strip: it bounds no solid")
    number = np.bincount(kept, minlength=2 * count)
    flip = (number[turned] > number[kept]) | ((number[turned] == number[kept]) & (turned < kept))
    return np.where(flip[:, None], faces[:, ::-1], faces), int(flip.sum())


def _loops(faces: Ints) -> list[Ints]:
    """Distinct corners around each hole, in the order of the face that would close it."""
    onwards: dict[int, list[int]] = {}
    for other, begin in _open_edges(faces).tolist():
        onwards.setdefault(begin, []).append(other)
    loops = []
    while onwards:
        path = [next(iter(onwards))]
        place = {path[0]: 0}
        while path[-1] in onwards:
            corner = onwards[path[-1]].pop()
            if not onwards[path[-1]]:
                del onwards[path[-1]]
            at = place.get(corner, len(path))
            if path[at : at + 1] == [corner]:  # still on this path
                loops.append(np.array(path[at:], np.int32))
                del path[at + 1 :]
            else:
                place[corner] = len(path)
                path.append(corner)
    return loops


def _open_edges(faces: Ints) -> Ints:
    """Edges (n, 2), directed as in their faces, without a face in the opposite direction."""
    start, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    count = int(faces.max(initial=0)) + 1
    opened = ~np.isin(start * count + end, end * count + start)
    return np.stack([start[opened], end[opened]], axis=1)


def _widest(vertices: Floats, loops: list[Ints]) -> float:
    """Width [m] of the widest hole: twice the distance from its middle to its farthest corner."""
    rims = [vertices[loop] - vertices[loop].mean(axis=0) for loop in loops]
    return max((2.0 * float(np.linalg.norm(rim, axis=1).max()) for rim in rims), default=0.0)


def _patch(vertices: Floats, loop: Ints) -> tuple[Ints, Floats]:
    """Faces that close a hole, and a new corner (0 or 1, 3) in its middle if needed."""
    places = vertices[loop]
    middle = places.mean(axis=0)
    normal = np.cross(places - middle, np.roll(places, -1, axis=0) - middle).sum(axis=0)
    length = float(np.linalg.norm(normal))
    try:
        if length > 0.0:
            return loop[by_ears(places, normal / length, 0)], np.zeros((0, 3))
    except ValueError:  # its projected border crosses itself
        pass
    hub = np.full_like(loop, len(vertices))
    return np.column_stack([loop, np.roll(loop, -1), hub]), middle[None]


def _united(
    pieces: list[Manifold], size: float, mends: list[str], settings: MendSettings
) -> Manifold:
    """One outward solid from pieces that touch or contain each other, without closed hollows."""
    from manifold3d import Manifold, OpType

    if not pieces:
        raise MeshFault(NO_SOLID)
    if max(pieces, key=lambda piece: abs(piece.volume())).volume() < 0.0:
        mends.append("turned outwards")
        pieces = [_turned(piece) for piece in pieces]
    inner = [_turned(piece) for piece in pieces if piece.volume() < 0.0]
    outer = [piece for piece in pieces if piece.volume() > 0.0]
    whole = Manifold.batch_boolean(outer, OpType.Add)
    limit = settings.max_outside
    loose = [part for part in inner if (part - whole).volume() > limit * part.volume()]
    _report(mends, len(loose), "piece", "turned outwards")
    whole = Manifold.batch_boolean([whole, *loose], OpType.Add)
    if len(outer) + len(loose) > 1:
        mends.append(f"{len(outer) + len(loose)} pieces united")
    parts = _without_specks(whole, size, mends, settings)
    solids = [part for part in parts if part.volume() > 0.0]
    hollows = [_turned(part) for part in parts if part.volume() < 0.0]
    hollows += [part for part in inner if part not in loose]
    volume = 1e6 * sum(hollow.volume() for hollow in hollows)
    _report(mends, len(hollows), "closed hollow", f"of {volume:.2g} cm3 in all filled")
    if len(solids) != 1:
        raise MeshFault(
            f"is made of {len(solids)} pieces that do not touch",
            "; an object is one solid: join them, or leave all but one out",
        )
    return solids[0]


def _without_specks(
    solid: Manifold, size: float, mends: list[str], settings: MendSettings
) -> list[Manifold]:
    """Pieces of a solid, without those much smaller than the largest."""
    boxes = {piece: np.reshape(piece.bounding_box(), (2, 3)) for piece in solid.decompose()}
    extents = {piece: float(np.ptp(box, axis=0).max()) for piece, box in boxes.items()}
    min_extent = settings.min_piece * min(size, max(extents.values()))
    specks = [extent for extent in extents.values() if extent < min_extent]
    largest = 1e3 * max(specks, default=0.0)
    _report(mends, len(specks), "speck", f"of up to {largest:.2g} mm left out")
    return [piece for piece in extents if extents[piece] >= min_extent and piece.volume() != 0.0]


def _turned(solid: Manifold) -> Manifold:
    vertices, faces = arrays_of(solid)
    turned = as_manifold(vertices, faces[:, ::-1])
    assert turned is not None  # a closed mesh stays closed
    return turned


def _separated(crossings: Crossings, settings: MendSettings, n_cuts: int) -> list[Manifold]:
    """A piece that crosses itself, cut by planes away from crossings into parts that do not.

    It stays whole if no plane reduces the crossings.
    """
    solid = as_manifold(crossings.vertices, crossings.faces)
    assert solid is not None  # crossings are those of a solid
    low, high = crossings.vertices.min(axis=0), crossings.vertices.max(axis=0)
    margin = settings.stitch_distance * float((high - low).max())
    best, fewest = [crossings], len(crossings.through)
    can_cut = n_cuts and len(crossings.faces) <= settings.max_cut_faces
    tried = settings.n_planes if can_cut else 0
    for axis, normal in enumerate(np.eye(3)):
        for level in np.linspace(low[axis], high[axis], tried + 2)[1:-1]:
            if not fewest or np.abs(crossings.places[:, axis] - level).min() < margin:
                continue
            halves = solid.split_by_plane(tuple(normal), float(level))
            parts = [_crossings(part) for half in halves for part in half.decompose()]
            left = sum(len(part.through) for part in parts)
            best, fewest = (parts, left) if left < fewest else (best, fewest)
    if len(best) == 1:
        return [solid]
    return [piece for part in best for piece in _separated(part, settings, n_cuts - 1)]


def _report(mends: list[str], number: int, noun: str, what: str) -> None:
    """Append a phrase with a number of repairs, unless it is 0."""
    if number:
        mends.append(f"{number} {noun}{'s' * (number != 1)} {what}")
