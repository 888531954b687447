"""Meshes as people have them, made one closed surface that does not cross itself; mends are told.

A mesh that is one already stays as it is, to the last bit. Of the others open edges are stitched
and small holes closed, faces turned alike, pieces united and crossings cut apart by the manifold
library, whose booleans are closed whatever they are given (Julian Smith, *Towards robust inexact
geometric computation*, 2009). A patch of crossings that no plane parts is cut out and closed like a
hole (Attene, *A lightweight approach to repairing digitized polygon meshes*, 2010).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.geometry import face_edges, linked_groups, self_intersection, solidity
from palpate.core.shapes.face_cutting import by_ears
from palpate.core.shapes.junctions import split_at_junctions
from palpate.core.shapes.walls import loose_walls, outer_surface

if TYPE_CHECKING:
    from manifold3d import Manifold

HOLE_SHARE = 0.1  # Of the largest extent: what lies behind a wider hole cannot be told
SPECK_SHARE = 0.01  # Of the largest extent: what is loose and smaller is no part of the object
STITCH_SHARE = 1e-4  # Of the largest extent: corners of open edges so near to one another are one
EDGE_SHARE = 0.1  # Of the median edge: so near at most, that no face is stitched to itself
CONTAINED = 1e-6  # Of its volume: what of a hollow may stand out of the object around it
MOST_ROUNDS = 4  # Times that a patch of crossings is cut out, each time a ring wider
MOST_CUTS = 6  # Planes one after the other that part a piece which crosses itself
PLANES = 6  # Places along each axis at which a plane is tried
MOST_PARTED = 20_000  # Faces of a piece for which planes are tried: more take many seconds
NO_SOLID = "bounds no solid: its faces enclose nothing, or meet as those of no solid do"


class MeshFault(ValueError):
    """What of a mesh cannot be mended, and, in the whole message, why not."""

    def __init__(self, fault: str, why: str = ""):
        super().__init__(fault + why)
        self.fault = fault


class MendedMesh(NamedTuple):
    """One closed, outward surface that does not cross itself, and what was done to make it one."""

    vertices: Floats  # (n, 3), m
    faces: Ints  # (m, 3)
    mends: tuple[str, ...]  # In words, each a part of a sentence; empty if the mesh is as given


def mend_mesh(vertices: Floats, faces: Ints) -> MendedMesh:
    """Make a mesh one closed solid, of any genus.

    `vertices` (n, 3): m, each in a place of its own. `faces` (m, 3): corners, by number. Raises
    ValueError, which goes on from the mesh's name, if a hole or a crossing is wider than
    `HOLE_SHARE` of the size, pieces do not touch, or the surface has one side only.
    """
    if _is_sound(vertices, faces):
        return MendedMesh(vertices, faces, ())
    size = float(np.ptp(vertices, axis=0).max())
    mends: list[str] = []
    faces = _stitched(vertices, faces, size, mends)
    crossed = 0
    for _ in range(MOST_ROUNDS):
        solid = as_manifold(vertices, faces)
        if solid is None:
            solid = as_manifold(*_closed(vertices, faces, size, mends, own=crossed > 0))
        if solid is None:
            raise MeshFault(NO_SOLID)
        crossed = crossed or len(np.unique(_crossings(solid).through))
        found = _crossings(_united(_without_specks(solid, size, mends), size, mends))
        if _widest(found.vertices, _loops(found.without_them())) > HOLE_SHARE * size:
            found = _crossings(_united(_parted(found), size, []))
        vertices, faces = found.vertices, found.without_them()
        if not len(found.through):
            _tell(mends, crossed, "face", "that crossed others cut where they did")
            _tell(mends, solidity(vertices, faces).genus or 0, "handle", "kept")
            return MendedMesh(vertices, faces, tuple(mends))
    raise MeshFault("crosses itself in ways that cannot be mended", "; mend it in a mesh editor")


def _is_sound(vertices: Floats, faces: Ints) -> bool:
    found = solidity(vertices, faces)
    one = found.watertight and found.components == 1 and found.volume > 0.0
    solid = as_manifold(vertices, faces) if one else None
    return solid is not None and not self_intersection(vertices, faces).count


def as_manifold(vertices: Floats, faces: Ints) -> Manifold | None:
    """The mesh as the library has it; None if it is not closed, or neighbours differ in side."""
    from manifold3d import Error, Manifold, Mesh64

    rows = np.ascontiguousarray(faces, np.uint64)
    solid = Manifold(Mesh64(np.ascontiguousarray(vertices, np.float64), rows))
    return solid if solid.status() == Error.NoError and not solid.is_empty() else None


def arrays_of(solid: Manifold) -> tuple[Floats, Ints]:
    """The vertices (n, 3), m, and faces (m, 3) of what the library has."""
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties[:, :3], np.float64), np.array(mesh.tri_verts, np.int32)


class Crossings(NamedTuple):
    """Where faces go through each other, and the mesh in which they do."""

    places: Floats  # (n, 3), m
    through: Ints  # (n, 2), the faces that cross
    vertices: Floats  # (v, 3), m
    faces: Ints  # (m, 3)

    def without_them(self) -> Ints:
        """The faces that neither cross one nor touch one that does."""
        return self.faces[~np.isin(self.faces, self.faces[self.through]).any(axis=1)]


def _crossings(solid: Manifold) -> Crossings:
    vertices, faces = arrays_of(solid)
    found = self_intersection(vertices, faces)
    return Crossings(found.places, found.faces, vertices, faces)


def _stitched(vertices: Floats, faces: Ints, size: float, mends: list[str]) -> Ints:
    """Faces once each, corners of open edges that are one place made one."""
    ends, _, counts = face_edges(faces)
    opened = np.unique(ends[counts == 1])
    from scipy.spatial import cKDTree

    lengths = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)
    least = min(STITCH_SHARE * size, EDGE_SHARE * float(np.median(lengths)))
    near = cKDTree(vertices[opened]).query_pairs(least, output_type="ndarray")
    if len(near):
        group = linked_groups(len(vertices), *opened[near].T)
        _, first = np.unique(group, return_index=True)
        faces = first[group][faces].astype(np.int32)
        a, b, c = faces.T
        faces = faces[(a != b) & (b != c) & (c != a)]
        _tell(mends, len(vertices) - len(first), "corner", "on open edges stitched to others")
    faces, parted = split_at_junctions(vertices, faces, least)
    _tell(mends, parted, "corner", "on open edges set into edges that passed them")
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    _tell(mends, len(faces) - len(kept), "face", "that stood twice left out")
    return faces[np.sort(kept)]


def _closed(
    vertices: Floats, faces: Ints, size: float, mends: list[str], own: bool
) -> tuple[Floats, Ints]:
    """The mesh without walls and sheets, turned alike, its holes closed.

    `own`: the holes are where crossings were cut out.
    """
    if _has_crowded_edges(faces):
        outer = outer_surface(vertices, faces)
        _tell(mends, outer.walls, "face", "of walls within it left out")
        _tell(mends, outer.sheets, "face", "of sheets on it left out")
        faces, turned = outer.faces, outer.turned
    else:
        faces, turned = _turned_alike(faces)
    _tell(mends, turned, "face", "turned like the others")
    if not len(faces):
        raise MeshFault(NO_SOLID)
    loose = loose_walls(vertices, faces, STITCH_SHARE * size)
    _tell(mends, int(loose.sum()), "face", "of loose walls within it left out")
    faces = faces[~loose]
    loops = _loops(faces)
    widest = _widest(vertices, loops)
    if widest > HOLE_SHARE * size:
        what = "crosses itself over" if own else "is open: it has a hole of"
        raise MeshFault(
            f"{what} {1e3 * widest:.3g} mm",
            f", and no more than {HOLE_SHARE:.0%} of its size, {1e3 * HOLE_SHARE * size:.3g} mm, "
            "can be closed by guess; close it in a mesh editor",
        )
    what = "crossing" if own else "hole"
    _tell(mends, len(loops), what, f"of up to {1e3 * widest:.2g} mm closed")
    patches = [faces]
    for loop in loops:
        patch, middle = _patch(vertices, loop)
        vertices = np.concatenate([vertices, middle])
        patches.append(patch)
    return vertices, np.concatenate(patches).astype(np.int32)


def _has_crowded_edges(faces: Ints) -> bool:
    return bool((face_edges(faces).counts > 2).any())


def _turned_alike(faces: Ints) -> tuple[Ints, int]:
    """The faces turned so that neighbours agree, as few as may be; and how many were turned.

    Each face stands for two, as it is and turned, of which one belongs to either side.
    """
    count, start, edge = len(faces), faces.ravel(), face_edges(faces).numbers.ravel()
    order = np.argsort(edge, kind="stable")
    pairs = np.flatnonzero(edge[order[1:]] == edge[order[:-1]])
    first, second = order[pairs], order[pairs + 1]
    against = count * (start[first] == start[second])  # both walk the edge the same way
    one, other = np.concatenate([first // 3, first // 3 + count]), second // 3
    other = np.concatenate([other + against, other + count - against])
    group = linked_groups(2 * count, one, other)
    kept, turned = group[:count], group[count:]
    if (kept == turned).any():
        raise MeshFault("has one side only, like a Moebius strip: it bounds no solid")
    number = np.bincount(kept, minlength=2 * count)
    flip = (number[turned] > number[kept]) | ((number[turned] == number[kept]) & (turned < kept))
    return np.where(flip[:, None], faces[:, ::-1], faces), int(flip.sum())


def _loops(faces: Ints) -> list[Ints]:
    """Corners around each hole, in the order of the face that would close it; each its own."""
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
            if path[at : at + 1] == [corner]:  # on this path still
                loops.append(np.array(path[at:], np.int32))
                del path[at + 1 :]
            else:
                place[corner] = len(path)
                path.append(corner)
    return loops


def _open_edges(faces: Ints) -> Ints:
    """Edges (n, 2), as their faces walk them, that no other face walks back."""
    start, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    count = int(faces.max(initial=0)) + 1
    opened = ~np.isin(start * count + end, end * count + start)
    return np.stack([start[opened], end[opened]], axis=1)


def _widest(vertices: Floats, loops: list[Ints]) -> float:
    """How wide holes are, m: twice the way from the middle of one to its farthest corner."""
    rims = [vertices[loop] - vertices[loop].mean(axis=0) for loop in loops]
    return max((2.0 * float(np.linalg.norm(rim, axis=1).max()) for rim in rims), default=0.0)


def _patch(vertices: Floats, loop: Ints) -> tuple[Ints, Floats]:
    """Faces that close a hole, and the corner (0 or 1, 3) that they need in its middle."""
    places = vertices[loop]
    middle = places.mean(axis=0)
    normal = np.cross(places - middle, np.roll(places, -1, axis=0) - middle).sum(axis=0)
    length = float(np.linalg.norm(normal))
    try:
        if length > 0.0:
            return loop[by_ears(places, normal / length, 0)], np.zeros((0, 3))
    except ValueError:  # seen from above, its border crosses itself
        pass
    hub = np.full_like(loop, len(vertices))
    return np.column_stack([loop, np.roll(loop, -1), hub]), middle[None]


def _united(pieces: list[Manifold], size: float, mends: list[str]) -> Manifold:
    """One outward solid from pieces that touch or contain one another, without closed hollows."""
    from manifold3d import Manifold, OpType

    if not pieces:
        raise MeshFault(NO_SOLID)
    if max(pieces, key=lambda one: abs(one.volume())).volume() < 0.0:
        mends.append("turned outwards")
        pieces = [_turned(one) for one in pieces]
    within = [_turned(one) for one in pieces if one.volume() < 0.0]
    outer = [one for one in pieces if one.volume() > 0.0]
    whole = Manifold.batch_boolean(outer, OpType.Add)
    loose = [one for one in within if (one - whole).volume() > CONTAINED * one.volume()]
    _tell(mends, len(loose), "piece", "turned outwards")
    whole = Manifold.batch_boolean([whole, *loose], OpType.Add)
    if len(outer) + len(loose) > 1:
        mends.append(f"{len(outer) + len(loose)} pieces united")
    parts = _without_specks(whole, size, mends)
    solids = [one for one in parts if one.volume() > 0.0]
    hollows = [_turned(one) for one in parts if one.volume() < 0.0]
    hollows += [one for one in within if one not in loose]
    volume = 1e6 * sum(one.volume() for one in hollows)
    _tell(mends, len(hollows), "closed hollow", f"of {volume:.2g} cm3 in all filled")
    if len(solids) != 1:
        raise MeshFault(
            f"is made of {len(solids)} pieces that do not touch",
            "; an object is one solid: join them, or leave all but one out",
        )
    return solids[0]


def _without_specks(solid: Manifold, size: float, mends: list[str]) -> list[Manifold]:
    boxes = {one: np.reshape(one.bounding_box(), (2, 3)) for one in solid.decompose()}
    extents = {one: float(np.ptp(box, axis=0).max()) for one, box in boxes.items()}
    size = min(size, max(extents.values()))  # of dust alone none is left out
    specks = [extent for extent in extents.values() if extent < SPECK_SHARE * size]
    most = 1e3 * max(specks, default=0.0)
    _tell(mends, len(specks), "speck", f"of up to {most:.2g} mm left out")
    return [one for one in extents if extents[one] >= SPECK_SHARE * size and one.volume() != 0.0]


def _turned(solid: Manifold) -> Manifold:
    vertices, faces = arrays_of(solid)
    found = as_manifold(vertices, faces[:, ::-1])
    assert found is not None  # closed one way, closed the other
    return found


def _parted(found: Crossings, cuts: int = MOST_CUTS) -> list[Manifold]:
    """A piece that crosses itself, cut by planes where nothing crosses, so that its parts do not.

    What no plane parts stays as it is.
    """
    solid = as_manifold(found.vertices, found.faces)
    assert solid is not None  # crossings are looked for in solids
    low, high = found.vertices.min(axis=0), found.vertices.max(axis=0)
    margin = STITCH_SHARE * float((high - low).max())
    best, least = [found], len(found.through)
    tried = PLANES if cuts and len(found.faces) <= MOST_PARTED else 0
    for axis, normal in enumerate(np.eye(3)):
        for level in np.linspace(low[axis], high[axis], tried + 2)[1:-1]:
            if not least or np.abs(found.places[:, axis] - level).min() < margin:
                continue
            halves = solid.split_by_plane(tuple(normal), float(level))
            parts = [_crossings(part) for half in halves for part in half.decompose()]
            left = sum(len(part.through) for part in parts)
            best, least = (parts, left) if left < least else (best, least)
    return [solid] if len(best) == 1 else [one for part in best for one in _parted(part, cuts - 1)]


def _tell(mends: list[str], number: int, noun: str, what: str) -> None:
    """Say how many of something there were; nothing if there were none."""
    if number:
        mends.append(f"{number} {noun}{'s' * (number != 1)} {what}")
