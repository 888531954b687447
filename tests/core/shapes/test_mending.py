"""Meshes with every fault that is mended, and those that are refused."""

import numpy as np
import pytest
import trimesh

from palpate.core.geometry import join_rings, solidity
from palpate.core.shapes import mending
from palpate.core.shapes.mending import mend_mesh

RADIUS = 0.04


def arrays(mesh):
    return np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int32)


def joined(*parts):
    """Meshes in one, by numbers only: nothing is united."""
    begin = np.cumsum([0, *(len(one[0]) for one in parts[:-1])])
    faces = [one[1] + at for one, at in zip(parts, begin, strict=True)]
    return np.concatenate([one[0] for one in parts]), np.concatenate(faces).astype(np.int32)


def moved(mesh, x, scale=1.0):
    return scale * mesh[0] + [x, 0.0, 0.0], mesh[1]


def turned(mesh):
    return mesh[0], mesh[1][:, ::-1]


@pytest.fixture(scope="module")
def ball():
    return arrays(trimesh.creation.icosphere(3, RADIUS))


@pytest.fixture(scope="module")
def ring():
    return arrays(trimesh.creation.torus(0.03, 0.01, 32, 16))


def told(mesh, volume, genus=0, within=1e-9):
    """What is told of the mended mesh, which is one solid in which nothing is left to mend."""
    found = mend_mesh(*mesh)
    seen = solidity(found.vertices, found.faces)
    assert (seen.watertight, seen.components, seen.genus) == (True, 1, genus)
    assert seen.volume == pytest.approx(volume, rel=within)
    again = mend_mesh(found.vertices, found.faces)
    assert again.mends == ()
    assert again.vertices is found.vertices
    return "; ".join(found.mends)


def volume_of(mesh):
    return solidity(*mesh).volume


@pytest.mark.parametrize("name", ["ball", "ring"])
def test_a_mesh_that_is_one_solid_stays_as_it_is(name, request):
    vertices, faces = request.getfixturevalue(name)
    found = mend_mesh(vertices, faces)
    assert (found.vertices is vertices, found.faces is faces, found.mends) == (True, True, ())


def test_small_holes_are_closed_and_wide_ones_refused(ball):
    vertices, faces = ball
    lone = np.delete(faces, [7, 400], axis=0)
    assert told((vertices, lone), volume_of(ball)) == "2 holes of up to 7.2 mm closed"
    near = (vertices @ vertices[0]) > RADIUS**2 * np.cos(0.15)
    cap = faces[~near[faces].any(axis=1)]
    with pytest.raises(
        ValueError, match=r"is open: it has a hole of 2\d.* mm, and no more than 10%"
    ):
        mend_mesh(vertices, cap)


@pytest.mark.parametrize("third", [(1.0, 0.0, 0.0), (3.0, 0.0, 0.0)])
def test_a_hole_whose_border_crosses_itself_is_closed_from_its_middle(third):
    rim = np.array([(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), third, (0.0, 1.0, 0.0)])
    faces, middle = mending._patch(rim, np.arange(4, dtype=np.int32))
    assert middle.shape == (1, 3)
    assert faces.tolist() == [[i, (i + 1) % 4, 4] for i in range(4)]


def test_faces_are_turned_like_their_neighbours_and_outwards(ball):
    vertices, faces = ball
    some = faces.copy()
    some[::17] = some[::17, ::-1]
    assert told((vertices, some), volume_of(ball)) == "76 faces turned like the others"
    assert told(turned(ball), volume_of(ball)) == "turned outwards"
    both = joined(ball, turned(moved(ball, 0.02)))
    lens = np.pi * (4 * RADIUS + 0.02) * (2 * RADIUS - 0.02) ** 2 / 12
    words = told(both, 2 * volume_of(ball) - lens, within=5e-3)
    assert words.startswith("1 piece turned outwards; 2 pieces united; ")
    assert words.endswith(" faces that crossed others cut where they did")


def test_faces_that_stand_twice_and_fins_are_left_out(ball):
    vertices, faces = ball
    twice = np.concatenate([faces, faces[:40], faces[3:5, ::-1]])
    assert told((vertices, twice), volume_of(ball)) == "42 faces that stood twice left out"
    fin = np.concatenate([faces, [[faces[0, 0], faces[0, 1], len(vertices)]]])
    words = told((np.concatenate([vertices, vertices[:1] * 1.1]), fin), volume_of(ball))
    assert words == "1 face of sheets on it left out"
    within = np.concatenate([faces, [[faces[0, 0], faces[0, 1], faces[900, 0]]]])
    words = told((vertices, within), volume_of(ball))
    assert words == "1 face of walls within it left out"


def test_triangles_without_common_corners_are_stitched(ball):
    vertices, faces = ball
    soup = vertices[faces].reshape(-1, 3)
    soup = soup + np.random.default_rng(1).uniform(-1e-6, 1e-6, soup.shape)
    alone = np.arange(len(soup), dtype=np.int32).reshape(-1, 3)
    words = told((soup, alone), volume_of(ball), within=1e-3)
    assert words == f"{len(soup) - len(vertices)} corners on open edges stitched to others"


def test_pieces_that_overlap_are_united_and_those_apart_refused(ball, ring):
    assert told(joined(ball, moved(ball, 0.0, 0.5)), volume_of(ball)) == "2 pieces united"
    words = told(joined(ring, moved(ring, 0.03)), 2 * volume_of(ring), 3, within=0.2)
    assert words.startswith("2 pieces united; ")
    assert words.endswith("; 3 handles kept")
    with pytest.raises(ValueError, match="is made of 2 pieces that do not touch; an object is one"):
        mend_mesh(*joined(ball, moved(ball, 0.1)))


def test_hollows_are_filled_and_specks_left_out(ball):
    hollow = joined(ball, turned(moved(ball, 0.0, 0.5)))
    assert told(hollow, volume_of(ball)) == "1 closed hollow of 33 cm3 in all filled"
    assert told(turned(hollow), volume_of(ball)).startswith(
        "turned outwards; 1 closed hollow of 33"
    )
    dusty = joined(ball, *(moved(ball, 0.041 + 1e-3 * i, 0.005) for i in range(3)))
    assert told(dusty, volume_of(ball)) == "3 specks of up to 0.4 mm left out"


def test_a_hollow_that_pieces_close_between_them_is_filled():
    lid = trimesh.creation.box([0.09, 0.09, 0.01]).apply_translation([0.0, 0.0, 0.02])
    room = trimesh.creation.box([0.07, 0.07, 0.05]).apply_translation([0.0, 0.0, 0.01])
    block = trimesh.creation.box([0.08, 0.08, 0.04])
    bowl = trimesh.boolean.difference([block, room], engine="manifold")
    words = told(joined(arrays(bowl), arrays(lid)), 0.08**2 * 0.035 + 0.09**2 * 0.01, within=1e-6)
    assert words.startswith("2 pieces united; 1 closed hollow of 1.5e+02 cm3 in all filled; ")


def looped_tube():
    """A tube whose ends cross; without its crossing of genus 1."""
    t = np.linspace(-2.2, 2.2, 60)
    line = np.column_stack([0.0125 * (t**3 - 3.0 * t), 0.02 * t**2, 0.0 * t])
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    up = np.array([0.0, 0.0, 1.0])
    turn = 2.0 * np.pi * np.arange(12)[None, :, None] / 12
    spokes = np.cos(turn) * np.cross(up, along)[:, None] + np.sin(turn) * up
    rings = line[:, None] + 0.01 * spokes
    vertices = np.concatenate([line[:1], rings.reshape(-1, 3), line[-1:]])
    return vertices, join_rings(np.full(60, 12))


def test_a_piece_that_crosses_itself_is_cut_where_it_does(monkeypatch):
    tube = looped_tube()
    words = told(tube, 0.94 * volume_of(tube), 1, within=0.02)
    assert words.endswith(" faces that crossed others cut where they did; 1 handle kept")
    monkeypatch.setattr(mending, "MOST_PARTED", 0)
    with pytest.raises(ValueError, match=r"crosses itself over \d+.* mm, and no more than 10%"):
        mend_mesh(*tube)


def test_a_small_patch_that_crosses_itself_is_cut_out_and_closed(ball):
    polar = np.arccos(np.clip(ball[0][:, 2] / RADIUS, -1.0, 1.0))
    nearer = np.pi * (polar / np.pi) ** 3  # finer towards the pole
    across = ball[0][:, :2] * (np.sin(nearer) / np.maximum(np.sin(polar), 1e-9))[:, None]
    fine = np.column_stack([across, RADIUS * np.cos(nearer)]), ball[1]
    vertices, pole = fine[0].copy(), int(nearer.argmin())
    there = np.linalg.norm(vertices - vertices[pole], axis=1).argsort()[8]  # two edges away
    vertices[[pole, there]] = vertices[[there, pole]]
    words = told((vertices, fine[1]), volume_of(fine), within=1e-3)
    assert "crossing of up to" in words
    assert words.endswith("faces that crossed others cut where they did")


def test_what_bounds_no_solid_is_refused(ball):
    turns = 2.0 * np.pi * np.arange(40) / 40
    out = np.column_stack([np.cos(turns), np.sin(turns), 0.0 * turns])
    half = np.cos(turns / 2)[:, None] * out + np.sin(turns / 2)[:, None] * [[0.0, 0.0, 1.0]]
    strip = np.concatenate([0.04 * out - 0.01 * half, 0.04 * out + 0.01 * half])
    faces = [
        face
        for i in range(40)
        for a, b, c, d in [(i, i + 1, i + 40, i + 41) if i < 39 else (39, 40, 79, 0)]
        for face in ((a, b, c), (b, d, c))
    ]
    with pytest.raises(ValueError, match="has one side only, like a Moebius strip"):
        mend_mesh(strip, np.array(faces, np.int32))
    corners = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0]], np.float64)
    with pytest.raises(ValueError, match="is open: it has a hole of"):
        mend_mesh(0.03 * corners, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]], np.int32))


def test_dust_and_sheets_are_refused(ball):
    dust = joined(*(moved(ball, 0.1 * i, 1e-3) for i in range(3)))
    with pytest.raises(ValueError, match="is made of 3 pieces that do not touch"):
        mend_mesh(*dust)
    sheet = np.array([[0, 0, 0], [0.04, 0, 0], [0.04, 0.04, 0], [0, 0.04, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 0, 3], [1, 3, 2]], np.int32)
    with pytest.raises(ValueError, match="bounds no solid: its faces enclose nothing"):
        mend_mesh(sheet, faces)


def test_what_no_round_mends_is_refused(ball, monkeypatch):
    monkeypatch.setattr(mending, "MOST_ROUNDS", 0)
    with pytest.raises(ValueError, match="crosses itself in ways that cannot be mended"):
        mend_mesh(*turned(ball))


def test_a_base_that_folds_within_its_plane_stays_as_it_is():
    turns = np.arange(16) * np.pi / 8
    ring = 0.04 * np.column_stack([np.cos(turns), np.sin(turns), 0.0 * turns])
    wider = 1.1 * ring + [0.0, 0.0, 0.03]
    vertices = np.concatenate([[[0.0401, 0.008, 0.0]], ring, wider, [[0.0, 0.0, 0.05]]])
    assert mend_mesh(vertices, join_rings(np.array([16, 16]))).mends == ()


def sheet(start, along, across, rows, columns):
    """A rectangle of so many squares, as triangles (m, 3, 3)."""
    i, j = (grid.ravel()[:, None] for grid in np.mgrid[:rows, :columns])
    a = np.asarray(start) + i * np.asarray(along) / rows + j * np.asarray(across) / columns
    b, d = a + np.asarray(along) / rows, a + np.asarray(across) / columns
    c = b + d - a
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def block(*counts):
    """The sides of a cube of 40 mm, each of so many rows and columns."""
    x, y, z = 0.04 * np.eye(3)
    sides = [(0 * x, y, x), (z, x, y), (0 * x, x, z), (y, z, x), (0 * x, z, y), (x, y, z)]
    return [sheet(*side, *count) for side, count in zip(sides, counts, strict=True)]


def mesh_of(parts):
    triangles = np.concatenate(parts)
    vertices, names = np.unique(triangles.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    return vertices, names.reshape(-1, 3).astype(np.int32)


X, Y, Z = 0.04 * np.eye(3)


@pytest.mark.parametrize(
    ("walls", "words"),
    [
        ([sheet(0.25 * Z, X, Y, 4, 4), sheet(0.5 * Z, Y, X, 4, 4)], "64 faces of walls within it"),
        ([sheet(0.5 * Z, X, Y, 4, 4), sheet(0.5 * X, Y, Z, 4, 4)], "64 faces of walls within it"),
        ([sheet(0.5 * Z, X, 0.5 * Y, 4, 2)], "16 faces of walls within it"),
        ([sheet(0.3 * Z, X, Y, 1, 1)], "2 faces of loose walls within it"),
        ([sheet(0.5 * Z, -X, Y, 4, 4)], "32 faces of sheets on it"),
    ],
)
def test_walls_and_sheets_of_a_closed_block_are_left_out(walls, words):
    mesh = mesh_of([*block(*[(4, 4)] * 6), *walls])
    assert told(mesh, 0.04**3, within=1e-6) == f"{words} left out"


@pytest.mark.parametrize("seed", range(3))
def test_sides_cut_each_in_its_own_squares_are_stitched(seed):
    counts = np.random.default_rng(seed).integers(1, 6, (6, 2))
    words = told(mesh_of(block(*counts)), 0.04**3, within=1e-6)
    assert words.endswith("on open edges set into edges that passed them")
