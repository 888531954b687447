"""Mesh files: read in metres and checked whole; written for other programs."""

import re
from dataclasses import fields, replace

import numpy as np
import pytest
import trimesh

import palpate
from palpate.core.archive import tree_to_bytes
from palpate.core.geometry import solidity
from palpate.launch.files import mesh_file
from palpate.launch.files.source_map import InputError
from palpate.launch.files.units import METRES_PER_UNIT
from palpate.messages import decode, encode
from palpate.messages.types import ShapeModel

CORNERS = np.array([(0, 0, 0), (10, 0, 0), (0, 10, 0), (0, 0, 10)])
SKEW = np.array([(0, 0, 0), (1, 0.1, 0.2), (0.1, 0.8, 0.3), (0.2, 0.3, 0.9)])
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def off(corners=CORNERS, faces=FACES):
    points = [" ".join(map(str, corner)) for corner in corners]
    triangles = ["3 " + " ".join(map(str, face)) for face in faces]
    return "\n".join(["OFF", f"{len(points)} {len(triangles)} 0", *points, *triangles, ""])


def changed(*first):
    return [first, *CORNERS[1:]]


UNUSED = np.array([*CORNERS, (99, 99, 99)])


@pytest.mark.parametrize(("unit", "metres"), METRES_PER_UNIT.items())
def test_closed_mesh_is_read_in_metres_with_each_corner_once(write, unit, metres):
    file = write("x.off", off(UNUSED * 1e-3 / metres))
    vertices, faces, notes = mesh_file.read_mesh(file, unit)
    assert (notes, vertices.shape, faces.shape, faces.dtype) == ("", (4, 3), (4, 3), np.int32)
    assert vertices.max() == pytest.approx(0.01)
    by_size, same, notes = mesh_file.read_mesh(file, size=0.01)
    assert by_size == pytest.approx(vertices) and np.array_equal(same, faces)
    assert notes.endswith("to 10 x 10 x 10 mm")
    text = trimesh.Trimesh(CORNERS, FACES, process=False).export(file_type="stl_ascii")
    facets, _, _ = mesh_file.read_mesh(write("x.stl", text), "mm")
    assert np.unique(facets, axis=0) == pytest.approx(np.unique(vertices, axis=0))


@pytest.mark.parametrize(("name", "text", "words"), [
    ("x.ply", "", "the mesh file is empty"),
    ("x.txt", "hello", "'txt' is no mesh format; known: ply"),
    ("x", "hello", "'no suffix' is no mesh format"),
    ("x.ply", "hello", "is no mesh in PLY"),
    ("x.off", off(faces=[]), "x.off: "),
    ("x.off", off(faces=FACES[:2]), "x.off: bounds no solid: "),
    ("x.off", off(changed("nan", 0, 0)), "vertex 0 is not finite"),
    ("x.off", off(changed("inf", 0, 0)), "vertex 0 is not finite"),
    ("x.off", off(faces=[(0, 2, 9), *FACES[1:]]), "x.off: "),
    ("x.off", off(CORNERS * [1e4, 1, 1]), "is the unit right?"),
    ("x.off", off(CORNERS * [1, 1, 1e-3]), "is the unit right?"),
    ("x.stl", "solid x\nendsolid x\n", "x.stl: "),
    ("x.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "x.obj: "),
    ("x.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
     "property float z\nend_header\n0 0 0\n", "holds points without triangles"),
])  # fmt: skip
def test_bad_mesh_is_refused_in_one_sentence(write, name, text, words):
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        mesh_file.read_mesh(write(name, text), "mm")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("limit", "words"), [
    ("MAX_MESH_BYTES", "is larger than"), ("MAX_FACES", "has 4 triangles; at most 3 are taken"),
])  # fmt: skip
def test_mesh_too_large_missing_or_too_fine_is_refused(write, tmp_path, monkeypatch, limit, words):
    monkeypatch.setattr(f"palpate.launch.files.mesh_file.{limit}", 3)
    with pytest.raises(InputError, match=words):
        mesh_file.read_mesh(write("x.off", off()), "mm")
    with pytest.raises(InputError, match="the mesh cannot be read: No such file"):
        mesh_file.read_mesh(tmp_path / "none.ply", "mm")


@pytest.mark.parametrize(("faces", "words"), [
    ([*FACES, FACES[0]], "x.off: 1 face that stood twice left out"),
    ([f[::-1] for f in FACES], "x.off: turned outwards"),
    ([FACES[0][::-1], *FACES[1:]], "x.off: 1 face turned like the others"),
])  # fmt: skip
def test_mended_mesh_is_sound_and_said_to_be_mended(write, faces, words):
    vertices, mended, notes = mesh_file.read_mesh(write("x.off", off(faces=faces)), "mm")
    assert notes == words
    assert solidity(vertices, mended).volume == pytest.approx(1e-6 / 6)


@pytest.mark.parametrize(("scale", "unit"), [
    (10.0, "mm"), (0.01, "m"), (0.2, ""), (1.0, ""), (1e-4, ""), (1e3, ""),
])  # fmt: skip
def test_unit_is_guessed_where_one_alone_is_likely(write, scale, unit):
    file = write("x.off", off(scale * CORNERS))
    if unit:
        vertices, _, notes = mesh_file.read_mesh(file)
        assert notes == f"x.off: taken to be in {unit}, 100 x 100 x 100 mm"
        assert vertices.max() == pytest.approx(0.1)
    else:
        with pytest.raises(InputError, match="cannot be guessed; give the unit: m, cm, mm, um"):
            mesh_file.read_mesh(file)


def test_glb_has_its_own_unit_and_y_up(tmp_path):
    upright = trimesh.creation.box([1.0, 3.0, 2.0])
    upright.apply_translation([0.0, 10.0, 0.0])
    upright.export(tmp_path / "x.glb")
    for unit, scale in (("mm", 1e-3), (None, 1.0)):
        vertices, *_ = mesh_file.read_mesh(tmp_path / "x.glb", unit)
        assert vertices.min(axis=0) == pytest.approx(np.array([-0.5, -1.0, 8.5]) * scale)
        assert vertices.max(axis=0) == pytest.approx(np.array([0.5, 1.0, 11.5]) * scale)


@pytest.mark.parametrize(
    ("up", "axis", "sign"),
    [("z", 2, 1), ("-z", 2, -1), ("y", 1, 1), ("-y", 1, -1), ("x", 0, 1), ("-x", 0, -1)],
)
def test_named_axis_points_up_and_nothing_is_mirrored(write, up, axis, sign):
    plain, faces, _ = mesh_file.read_mesh(write("x.off", off(SKEW)), "m")
    turned, same, _ = mesh_file.read_mesh(write("x.off", off(SKEW)), "m", up)
    np.testing.assert_array_equal(faces, same)
    np.testing.assert_allclose(turned[:, 2], sign * plain[:, axis])
    volumes = [np.linalg.det(one[faces]).sum() for one in (plain, turned)]
    assert volumes[0] == pytest.approx(volumes[1]) and volumes[0] > 0.0


def test_uncertainty_is_stated_by_height_or_vertex_and_written(tetrahedron, tmp_path):
    nothing = np.zeros(0)
    silent = replace(tetrahedron, uncertainty=nothing, uncertainty_height=nothing)
    upside_down = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    heights, errors = np.array([-0.01, 0.0]), np.array([0.001, 0.003])
    sliced = replace(tetrahedron, frame=upside_down, uncertainty_height=heights, uncertainty=errors)
    general = replace(sliced, vertex_errors=np.array([0.001, 0.002, 0.003, 0.004]))
    assert mesh_file.uncertainties(silent).tolist() == [0.0] * 4
    assert mesh_file.uncertainties(sliced).tolist() == [0.003, 0.003, 0.003, 0.001]
    assert mesh_file.uncertainties(general).tolist() == [0.001, 0.002, 0.003, 0.004]
    mesh_file.export_model(general, tmp_path)
    raw = trimesh.load(tmp_path / "mesh.ply", process=False).metadata["_ply_raw"]
    written = raw["vertex"]["data"]["uncertainty"]
    assert written == pytest.approx(mesh_file.uncertainties(general))
    vertices, *_ = mesh_file.read_mesh(tmp_path / "mesh.ply", "m")
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.01, 0.02, 0.03], rtol=1e-6)
    mesh_file.export_model(silent, tmp_path)
    assert b"uncertainty" not in (tmp_path / "mesh.ply").read_bytes()


def test_arrays_of_model_are_read_without_pickle_beside_the_solid_itself(tetrahedron, tmp_path):
    mesh_file.export_model(tetrahedron, tmp_path)
    with np.load(tmp_path / "model.npz", allow_pickle=False) as stored:
        arrays = dict(stored)
    np.testing.assert_array_equal(arrays["vertices"], tetrahedron.vertices)
    np.testing.assert_array_equal(arrays["faces"], tetrahedron.faces)
    lists = {name: arrays[name].tolist() for name in ("contours", "probes", "dropped_reasons")}
    assert lists == {"contours": [0, 1], "probes": [], "dropped_reasons": ["too short"]}
    health = dict(zip(arrays["health_names"], arrays["health_values"], strict=True))
    assert health == {"condition": 3.5, "fallbacks": 0.0}
    assert bool(arrays["final"]) is True
    tables = {f"{one}_{part}" for one in ("health", "predicted") for part in ("names", "values")}
    names = {field.name for field in fields(ShapeModel)} - {"health", "predicted", "archive"}
    unknown = {"closed", "genus", "self_crossings"}  # nothing has judged this one
    assert names - unknown | tables == set(arrays)
    assert palpate.load(tmp_path / "model.npz").volume == pytest.approx(1e-6)
    assert repr(palpate.load(tmp_path)) == "<MeshSolid 0.01 x 0.02 x 0.03 m, of 4 triangles>"
    turn = 2 * np.pi * np.arange(24) / 24
    rings = [np.column_stack([np.cos(turn), np.sin(turn), 0 * turn + z]) for z in range(5)]
    solid = palpate.reconstruct(rings, method="skin")
    sent = replace(tetrahedron, archive=tree_to_bytes(solid))
    mesh_file.export_model(decode(ShapeModel, encode(sent)), tmp_path)
    again = palpate.load(tmp_path / "model.npz")
    np.testing.assert_array_equal(tree_to_bytes(again), tree_to_bytes(solid))
    with np.load(tmp_path / "model.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["vertices"], tetrahedron.vertices)


def test_fingerprint_sees_the_surface_alone_and_without_one_there_is_no_mesh(tetrahedron, tmp_path):
    empty = replace(tetrahedron, vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), np.int32))
    assert mesh_file.export_model(empty, tmp_path) == ("model.npz",)
    assert [path.name for path in tmp_path.iterdir()] == ["model.npz"]
    moved = tetrahedron.vertices.copy()
    moved[0, 0] = np.nextafter(moved[0, 0], 1.0)
    others = [{"vertices": moved}, {"faces": tetrahedron.faces[::-1].copy()}]
    prints = {mesh_file.mesh_sha256(replace(tetrahedron, **one)) for one in ({}, *others)}
    assert len(prints) == 3
    assert mesh_file.mesh_sha256(replace(tetrahedron, number=9)) in prints
