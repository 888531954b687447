"""Meshes with every fault that is mended, and those that are refused."""

from typing import Any

import numpy as np
import pytest
import trimesh

from palpate.core.arrays import Floats, Ints
from palpate.core.geometry import join_rings, solidity
from palpate.core.shapes import Mesh, mend_mesh
from tests.core.geometry.bodies import SPHERE, TORUS, arrays, ball, joined, moved

RADIUS = 0.04


BALL, RING = SPHERE, moved(TORUS, 0.0, 0.01)


def shifted(mesh: Mesh, x: float, scale: float = 1.0) -> Mesh:
    return moved(mesh, [x, 0.0, 0.0], scale)


def turned(mesh: Mesh) -> Mesh:
    return Mesh(mesh[0], mesh[1][:, ::-1])


def volume_of(mesh: Mesh) -> float:
    return float(solidity(*mesh).volume)


def mends_of(mesh: Mesh, volume: float, genus: int = 0, rtol: float = 1e-9) -> str:
    """What was mended, if the result is one solid in which nothing is left to mend."""
    result = mend_mesh(*mesh)
    body = solidity(result.vertices, result.faces)
    assert (body.watertight, body.components, body.genus) == (True, 1, genus)
    assert body.volume == pytest.approx(volume, rel=rtol)
    again = mend_mesh(result.vertices, result.faces)
    assert again.mends == () and again.vertices is result.vertices
    return "; ".join(result.mends)


def test_sound_meshes_are_unchanged():
    # The last one's base folds within its own plane.
    turns = np.arange(16) * np.pi / 8
    rim = 0.04 * np.column_stack([np.cos(turns), np.sin(turns), 0.0 * turns])
    cup = [[[0.0401, 0.008, 0.0]], rim, 1.1 * rim + [0.0, 0.0, 0.03], [[0.0, 0.0, 0.05]]]
    for vertices, faces in (BALL, RING, (np.concatenate(cup), join_rings(np.array([16, 16])))):
        result = mend_mesh(vertices, faces)
        assert result.vertices is vertices and result.faces is faces and result.mends == ()


def fine_pole() -> tuple[Floats, Ints, Ints]:
    """A ball that is finer towards its pole, and its vertices from there."""
    polar = np.arccos(np.clip(BALL[0][:, 2] / RADIUS, -1.0, 1.0))
    nearer = np.pi * (polar / np.pi) ** 3
    across = BALL[0][:, :2] * (np.sin(nearer) / np.maximum(np.sin(polar), 1e-9))[:, None]
    vertices = np.column_stack([across, RADIUS * np.cos(nearer)])
    distance = np.linalg.norm(vertices - vertices[nearer.argmin()], axis=1)
    return vertices, BALL[1], distance.argsort().astype(np.int32)


def test_small_holes_and_small_crossings_are_closed():
    vertices, faces = BALL
    lone = np.delete(faces, [7, 400], axis=0)
    assert mends_of((vertices, lone), volume_of(BALL)) == "2 holes of up to 7.2 mm closed"
    vertices, faces, order = fine_pole()
    whole, pair = volume_of((vertices, faces)), order[[0, 8]]  # the second is two edges away
    vertices[pair] = vertices[pair[::-1]]
    words = mends_of((vertices, faces), whole, rtol=1e-3)
    assert "crossing of up to" in words
    assert words.endswith("faces that crossed others cut where they did")
    # A hole whose rim, a quadrilateral, crosses itself seen from above.
    vertices, faces, order = fine_pole()
    near = np.flatnonzero((faces == order[20]).any(axis=1))
    two = [n for n in near if len({*faces[near[0]], *faces[n]}) in (3, 4)][:2]
    corners, other = (set(faces[n].tolist()) for n in two)
    swapped = [*(corners - other), *((corners & other) - {int(order[20])})]
    vertices[swapped] = vertices[swapped[::-1]]
    open_ones = np.delete(faces, two, axis=0)
    assert "closed" in mends_of((vertices, open_ones), whole, rtol=1e-3)


def test_faces_are_turned_like_their_neighbours_and_outwards():
    vertices, faces = BALL
    some = faces.copy()
    some[::17] = some[::17, ::-1]
    assert mends_of((vertices, some), volume_of(BALL)) == "76 faces turned like the others"
    assert mends_of(turned(BALL), volume_of(BALL)) == "turned outwards"
    both = joined(BALL, turned(shifted(BALL, 0.02)))
    lens = np.pi * (4 * RADIUS + 0.02) * (2 * RADIUS - 0.02) ** 2 / 12
    words = mends_of(both, 2 * volume_of(BALL) - lens, rtol=5e-3)  # of facets
    assert words.startswith("1 piece turned outwards; 2 pieces united; ")
    assert words.endswith(" faces that crossed others cut where they did")


def test_doubled_faces_fins_and_inner_faces_are_left_out():
    vertices, faces = BALL
    twice = np.concatenate([faces, faces[:40], faces[3:5, ::-1]])
    assert mends_of((vertices, twice), volume_of(BALL)) == "42 faces that stood twice left out"
    more = np.concatenate([vertices, vertices[:1] * 1.1])
    for corner, words in ((len(vertices), "sheets on it"), (faces[900, 0], "walls within it")):
        fin = np.concatenate([faces, [[faces[0, 0], faces[0, 1], corner]]])
        assert mends_of((more, fin), volume_of(BALL)) == f"1 face of {words} left out"


def test_pieces_that_overlap_are_united():
    half = joined(BALL, shifted(BALL, 0.0, 0.5))
    assert mends_of(half, volume_of(BALL)) == "2 pieces united"
    words = mends_of(joined(RING, shifted(RING, 0.03)), 2 * volume_of(RING), 3, rtol=0.2)
    assert words.startswith("2 pieces united; ") and words.endswith("; 3 handles kept")


def test_hollows_are_filled_and_specks_left_out():
    hollow, volume = joined(BALL, turned(shifted(BALL, 0.0, 0.5))), volume_of(BALL)
    filled = "1 closed hollow of 33 cm3 in all filled"
    assert mends_of(hollow, volume) == filled
    assert mends_of(turned(hollow), volume).startswith("turned outwards; 1 closed hollow of 33")
    dusty = joined(BALL, *(shifted(BALL, 0.041 + 1e-3 * i, 0.005) for i in range(3)))
    assert mends_of(dusty, volume) == "3 specks of up to 0.4 mm left out"
    # A hollow that a lid closes over a bowl.
    room, lid = trimesh.creation.box([0.07, 0.07, 0.05]), trimesh.creation.box([0.09, 0.09, 0.01])
    parts = [trimesh.creation.box([0.08, 0.08, 0.04]), room.apply_translation([0.0, 0.0, 0.01])]
    bowl = arrays(trimesh.boolean.difference(parts, engine="manifold"))
    closed = joined(bowl, arrays(lid.apply_translation([0.0, 0.0, 0.02])))
    words = mends_of(closed, 0.08**2 * 0.035 + 0.09**2 * 0.01, rtol=1e-6)
    assert words.startswith("2 pieces united; 1 closed hollow of 1.5e+02 cm3 in all filled; ")


def test_piece_that_crosses_itself_is_cut_where_planes_part_it():
    """A tube whose ends cross; without its crossing of genus 1."""
    t = np.linspace(-2.2, 2.2, 60)
    line = np.column_stack([0.0125 * (t**3 - 3.0 * t), 0.02 * t**2, 0.0 * t])
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    up, turn = np.array([0.0, 0.0, 1.0]), 2.0 * np.pi * np.arange(12)[None, :, None] / 12
    rings = line[:, None] + 0.01 * (np.cos(turn) * np.cross(up, along)[:, None] + np.sin(turn) * up)
    vertices = np.concatenate([line[:1], rings.reshape(-1, 3), line[-1:]])
    tube = vertices, join_rings(np.full(60, 12))
    words = mends_of(tube, 0.94 * volume_of(tube), 1, rtol=0.02)
    assert words.endswith(" faces that crossed others cut where they did; 1 handle kept")


def sheet(start: Floats, along: Floats, across: Floats, rows: int, columns: int) -> Floats:
    """A rectangle of squares, as triangles (m, 3, 3)."""
    i, j = (grid.ravel()[:, None] for grid in np.mgrid[:rows, :columns])
    a = start + i * along / rows + j * across / columns
    b, c, d = a + along / rows, a + along / rows + across / columns, a + across / columns
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def block_with(walls: list[Floats], counts: Any) -> Mesh:
    """A cube of 40 mm whose sides have these rows and columns, and walls."""
    none = 0 * X
    sides = [(none, Y, X), (Z, X, Y), (none, X, Z), (Y, Z, X), (none, Z, Y), (X, Y, Z)]
    parts = [sheet(*side, *count) for side, count in zip(sides, counts, strict=True)]
    corners = np.concatenate([*parts, *walls]).reshape(-1, 3).round(9)
    vertices, names = np.unique(corners, axis=0, return_inverse=True)
    return Mesh(vertices, names.reshape(-1, 3).astype(np.int32))


X, Y, Z = 0.04 * np.eye(3)


@pytest.mark.parametrize(("walls", "words"), [
    ([sheet(0.25 * Z, X, Y, 4, 4), sheet(0.5 * Z, Y, X, 4, 4)], "64 faces of walls within it"),
    ([sheet(0.5 * Z, X, Y, 4, 4), sheet(0.5 * X, Y, Z, 4, 4)], "64 faces of walls within it"),
    ([sheet(0.5 * Z, X, 0.5 * Y, 4, 2)], "16 faces of walls within it"),
    ([sheet(0.3 * Z, X, Y, 1, 1)], "2 faces of loose walls within it"),
    ([sheet(0.5 * Z, -X, Y, 4, 4)], "32 faces of sheets on it"),
])  # fmt: skip
def test_walls_and_sheets_of_a_closed_block_are_left_out(walls, words):
    mesh = block_with(walls, [(4, 4)] * 6)
    assert mends_of(mesh, 0.04**3, rtol=1e-6) == f"{words} left out"


def test_faces_without_common_corners_are_stitched():
    for seed in range(3):
        counts = np.random.default_rng(seed).integers(1, 6, (6, 2))
        words = mends_of(block_with([], counts), 0.04**3, rtol=1e-6)
        assert words.endswith("on open edges set into edges that passed them")
    vertices, faces = BALL
    soup = vertices[faces].reshape(-1, 3)
    soup = soup + np.random.default_rng(1).uniform(-1e-6, 1e-6, soup.shape)
    alone = np.arange(len(soup), dtype=np.int32).reshape(-1, 3)
    words = mends_of((soup, alone), volume_of(BALL), rtol=1e-3)
    assert words == f"{len(soup) - len(vertices)} corners on open edges stitched to others"


TURNS = 2.0 * np.pi * np.arange(40) / 40
OUT = np.column_stack([np.cos(TURNS), np.sin(TURNS), 0.0 * TURNS])
HALF = np.cos(TURNS / 2)[:, None] * OUT + np.sin(TURNS / 2)[:, None] * [[0.0, 0.0, 1.0]]
STRIP = np.concatenate([0.04 * OUT - 0.01 * HALF, 0.04 * OUT + 0.01 * HALF])
QUADS = [(i, i + 1, i + 40, i + 41) if i < 39 else (39, 40, 79, 0) for i in range(40)]
MOEBIUS = Mesh(STRIP, np.array([f for a, b, c, d in QUADS for f in ((a, b, c), (b, d, c))]))
FLAWS = np.random.default_rng(0).normal(size=(162, 3)) * 6e-3
CRUMPLED = moved(ball(RADIUS, 2), FLAWS)
NEAR = (BALL[0] @ BALL[0][0]) > RADIUS**2 * np.cos(0.15)
OPEN = BALL[1][~NEAR[BALL[1]].any(axis=1)]
FAN = 0.03 * np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0]], np.float64)
SHEET = np.array([[0, 1, 2], [0, 2, 3], [1, 0, 3], [1, 3, 2]], np.int32)
FLAT = 0.04 * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)


@pytest.mark.parametrize(("mesh", "sentence"), [
    ((BALL[0], OPEN), r"is open: it has a hole of 2\d.* mm, and no more than 10%"),
    ((FAN, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]], np.int32)), "is open: it has a hole of"),
    (joined(BALL, shifted(BALL, 0.1)), "is made of 2 pieces that do not touch; an object"),
    (joined(*(shifted(BALL, 0.1 * i, 1e-3) for i in range(3))), "is made of 3 pieces that do"),
    (CRUMPLED, r"crosses itself over \d+.* mm, and no more than 10%"),
    (MOEBIUS, "has one side only, like a Moebius strip"),
    ((FLAT, SHEET), "bounds no solid: its faces enclose nothing"),
])  # fmt: skip
def test_meshes_without_single_solid_are_refused(mesh, sentence):
    with pytest.raises(ValueError, match=sentence):
        mend_mesh(*mesh)
