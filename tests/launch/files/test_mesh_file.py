import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

import palpate
from palpate.core.archive import tree_to_bytes
from palpate.core.geometry import solidity
from palpate.launch.files import mesh_file
from palpate.launch.files.mesh_file import (
    export_model,
    mesh_sha256,
    read_mesh,
    uncertainties,
    write_mesh,
)
from palpate.launch.files.source_map import InputError
from palpate.launch.files.units import METRES_PER_UNIT
from palpate.launch.scene import SHIPPED_SCENES
from palpate.messages.codec import decode, encode
from palpate.messages.types.model import ShapeModel

CORNERS = [(0, 0, 0), (10, 0, 0), (0, 10, 0), (0, 0, 10)]
SKEW = [(0, 0, 0), (1, 0.1, 0.2), (0.1, 0.8, 0.3), (0.2, 0.3, 0.9)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def off(corners=CORNERS, faces=FACES):
    points = [" ".join(map(str, corner)) for corner in corners]  # type: ignore[attr-defined]
    triangles = ["3 " + " ".join(map(str, face)) for face in faces]  # type: ignore[attr-defined]
    return "\n".join(["OFF", f"{len(points)} {len(triangles)} 0", *points, *triangles, ""])


def stl(faces=FACES):
    lines = ["solid x"]
    for face in faces:  # type: ignore[attr-defined]
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {} {} {}".format(*CORNERS[corner]) for corner in face]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid x", ""])


@pytest.mark.parametrize(("name", "text"), [("x.off", off()), ("x.stl", stl())])
@pytest.mark.parametrize(("unit", "side"), [("m", 10.0), ("cm", 0.1), ("mm", 0.01)])
def test_a_closed_mesh_is_read_in_metres_with_each_corner_once(write, name, text, unit, side):
    vertices, faces, told = read_mesh(write(name, text), unit)
    assert told == ""
    assert vertices.shape == (4, 3)
    assert faces.shape == (4, 3)
    assert faces.dtype == np.int32
    assert vertices.max() == pytest.approx(side)


def test_corners_that_no_triangle_uses_are_left_out(write):
    vertices, *_ = read_mesh(write("x.off", off([*CORNERS, (99, 99, 99)])), "mm")
    assert vertices.shape == (4, 3)


@pytest.mark.parametrize(("name", "text", "words"), [
    ("x.ply", "", "the mesh file is empty"),
    ("x.txt", "hello", "'txt' is no mesh format; known: ply"),
    ("x", "hello", "'no suffix' is no mesh format"),
    ("x.ply", "hello", "is no mesh in PLY"),
    ("x.off", off(faces=[]), "x.off: "),
    ("x.off", off(faces=FACES[:3]), "x.off: is open: it has a hole of "),
    ("x.off", off(corners=[("nan", 0, 0), *CORNERS[1:]]), "vertex 0 is not finite"),
    ("x.off", off(corners=[("inf", 0, 0), *CORNERS[1:]]), "vertex 0 is not finite"),
    ("x.off", off(faces=[(0, 2, 9), *FACES[1:]]), "x.off: "),
    ("x.off", off(corners=[(x * 1e4, y, z) for x, y, z in CORNERS]), "is the unit right?"),
    ("x.off", off(corners=[(x, y, z * 1e-3) for x, y, z in CORNERS]), "is the unit right?"),
    ("x.stl", "solid x\nendsolid x\n", "x.stl: "),
    ("x.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "x.obj: "),
])  # fmt: skip
def test_a_bad_mesh_is_refused_in_one_sentence(write, name, text, words):
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        read_mesh(write(name, text), "mm")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("faces", "words"), [
    ([*FACES, FACES[0]], "x.off: 1 face that stood twice left out"),
    ([f[::-1] for f in FACES], "x.off: turned outwards"),
    ([FACES[0][::-1], *FACES[1:]], "x.off: 1 face turned like the others"),
])  # fmt: skip
def test_what_is_mended_is_told(write, faces, words):
    vertices, mended, told = read_mesh(write("x.off", off(faces=faces)), "mm")
    assert told == words
    assert solidity(vertices, mended).volume == pytest.approx(1e-6 / 6)


@pytest.mark.parametrize(("scale", "words"), [
    (10.0, "x.off: taken to be in mm, 100 x 100 x 100 mm"),
    (0.01, "x.off: taken to be in m, 100 x 100 x 100 mm"),
])  # fmt: skip
def test_a_unit_is_guessed_where_one_alone_is_likely(write, scale, words):
    corners = [tuple(scale * x for x in corner) for corner in CORNERS]
    vertices, _, told = read_mesh(write("x.off", off(corners=corners)))
    assert told == words
    assert vertices.max() == pytest.approx(0.1)


@pytest.mark.parametrize("scale", [0.2, 1.0, 1e-4, 1e3])
def test_a_unit_that_cannot_be_guessed_is_asked_for(write, scale):
    corners = [tuple(scale * x for x in corner) for corner in CORNERS]
    with pytest.raises(InputError, match="cannot be guessed; give the unit: m, cm, mm, um"):
        read_mesh(write("x.off", off(corners=corners)))


def test_a_file_whose_format_has_a_unit_is_asked_for_none(tmp_path):
    trimesh.creation.box([2.0, 2.0, 2.0]).export(tmp_path / "x.glb")
    assert read_mesh(tmp_path / "x.glb")[0].max() == pytest.approx(1.0)


def test_what_is_missing_too_large_or_too_fine_is_refused(tmp_path, write, monkeypatch):
    with pytest.raises(InputError, match="the mesh cannot be read: No such file"):
        read_mesh(tmp_path / "none.ply", "mm")
    path = write("x.off", off())
    monkeypatch.setattr(mesh_file, "MAX_MESH_BYTES", 10)
    with pytest.raises(InputError, match="is larger than"):
        read_mesh(path, "mm")
    path = write("x.off", off())
    monkeypatch.undo()
    monkeypatch.setattr(mesh_file, "MAX_FACES", 3)
    with pytest.raises(InputError, match="has 4 triangles; at most 3 are taken"):
        read_mesh(path, "mm")


def test_a_file_with_y_up_is_turned(tmp_path):
    import trimesh

    upright = trimesh.creation.box([1.0, 3.0, 2.0])
    upright.apply_translation([0.0, 10.0, 0.0])
    upright.export(tmp_path / "x.glb")
    vertices, *_ = read_mesh(tmp_path / "x.glb", "mm")
    assert vertices.min(axis=0) == pytest.approx([-0.0005, -0.001, 0.0085])
    assert vertices.max(axis=0) == pytest.approx([0.0005, 0.001, 0.0115])


def test_no_cut_or_damage_to_a_file_shows_more_than_a_sentence(tmp_path):
    data = (SHIPPED_SCENES / "pear.ply").read_bytes()
    rng = np.random.default_rng(5)
    refused = 0
    for number in range(40):
        hurt = bytearray(data[: rng.integers(len(data))] if number % 2 else data)
        for place in rng.integers(0, min(len(hurt), 2000) or 1, 3):
            if hurt:
                hurt[place % len(hurt)] = int(rng.integers(256))
        path = tmp_path / "x.ply"
        path.write_bytes(hurt)
        try:
            vertices, faces, _ = read_mesh(path, "mm")
        except InputError:
            refused += 1
        else:
            assert np.isfinite(vertices).all()
            assert faces.max() < len(vertices)
    assert refused >= 20


def test_the_shipped_mesh_is_what_its_script_writes(tmp_path):
    import runpy

    script = runpy.run_path(str(Path(__file__).with_name("make_pear.py")))
    script["write"](tmp_path / "pear.ply")
    assert (tmp_path / "pear.ply").stat().st_size == (SHIPPED_SCENES / "pear.ply").stat().st_size
    again, *_ = read_mesh(tmp_path / "pear.ply", "mm")
    shipped, *_ = read_mesh(SHIPPED_SCENES / "pear.ply", "mm")
    np.testing.assert_allclose(np.ptp(again, axis=0), np.ptp(shipped, axis=0), rtol=1e-6)


def test_pieces_and_points_are_refused(write, tmp_path):
    both = [*CORNERS, *((x + 50, y, z) for x, y, z in CORNERS)]
    faces = [*FACES, *((a + 4, b + 4, c + 4) for a, b, c in FACES)]
    with pytest.raises(InputError, match="is made of 2 pieces that do not touch"):
        read_mesh(write("two.off", off(both, faces)), "mm")
    header = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
    path = write("x.ply", header + "property float z\nend_header\n0 0 0\n")
    with pytest.raises(InputError, match="holds points without triangles"):
        read_mesh(path, "mm")


@pytest.mark.parametrize(("unit", "metres"), METRES_PER_UNIT.items())
def test_a_size_does_what_the_unit_would(write, unit, metres):
    file = write("x.off", off(np.array(CORNERS) / (1e3 * metres)))
    by_unit, faces, _ = read_mesh(file, unit)
    by_size, same, told = read_mesh(file, size=0.01)
    np.testing.assert_allclose(by_size, by_unit)
    assert (same == faces).all()
    assert told.endswith("to 10 x 10 x 10 mm")


def test_a_mesh_with_a_hole_through_it_is_taken_as_it_is(write):
    turns = 2 * np.pi * np.arange(12) / 12
    corners = [
        ((30 + 10 * np.cos(b)) * np.cos(a), (30 + 10 * np.cos(b)) * np.sin(a), 10 * np.sin(b))
        for a in turns
        for b in turns
    ]
    faces = []
    for i in range(12):
        for j in range(12):
            a, b = 12 * i + j, 12 * ((i + 1) % 12) + j
            c, d = 12 * i + (j + 1) % 12, 12 * ((i + 1) % 12) + (j + 1) % 12
            faces += [(a, b, d), (a, d, c)]
    vertices, mesh, told = read_mesh(write("ring.off", off(corners, faces)), "mm")
    assert (solidity(vertices, mesh).genus, told) == (1, "")


def test_the_meshes_keep_volume_and_unit_and_gltf_has_y_up(tetrahedron, tmp_path):
    names = export_model(tetrahedron, tmp_path)
    assert sorted(names) == sorted(path.name for path in tmp_path.iterdir())
    volume = 0.01 * 0.02 * 0.03 / 6.0
    write_mesh(tmp_path / "mesh.obj", tetrahedron.vertices, tetrahedron.faces)
    write_mesh(tmp_path / "mesh.3mf", tetrahedron.vertices, tetrahedron.faces)
    scales = {"mesh.ply": 1.0, "mesh.stl": 1000.0, "mesh.glb": 1.0, "mesh.obj": 1.0}
    scales["mesh.3mf"] = 1000.0
    for name, scale in scales.items():
        mesh = trimesh.load(tmp_path / name, force="mesh")
        assert mesh.is_watertight
        np.testing.assert_allclose(mesh.volume, volume * scale**3, rtol=1e-5)
    low, high = trimesh.load(tmp_path / "mesh.glb", force="mesh").bounds
    np.testing.assert_allclose(low, [0, 0, -0.02], atol=1e-9)
    np.testing.assert_allclose(high, [0.01, 0.03, 0], atol=1e-9)


def test_the_stated_uncertainty_goes_into_ply_and_is_passed_over_when_that_is_read(
    tetrahedron, tmp_path
):
    export_model(tetrahedron, tmp_path)
    raw = trimesh.load(tmp_path / "mesh.ply", process=False).metadata["_ply_raw"]
    assert raw["vertex"]["data"]["uncertainty"] == pytest.approx([0.001] * 4)
    vertices, *_ = read_mesh(tmp_path / "mesh.ply", "m")
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.01, 0.02, 0.03], rtol=1e-6)
    silent = dataclasses.replace(
        tetrahedron, uncertainty=np.zeros(0), uncertainty_height=np.zeros(0)
    )
    export_model(silent, tmp_path)
    assert b"uncertainty" not in (tmp_path / "mesh.ply").read_bytes()


def test_uncertainty_is_stated_by_height_in_the_slicing_frame_or_by_vertex(tetrahedron):
    heights, errors = np.array([-0.01, 0.0]), np.array([0.001, 0.003])
    upside_down = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    sliced = dataclasses.replace(
        tetrahedron, frame=upside_down, uncertainty_height=heights, uncertainty=errors
    )
    assert uncertainties(sliced).tolist() == [0.003, 0.003, 0.003, 0.001]
    by_vertex = np.array([0.001, 0.002, 0.003, 0.004])
    general = dataclasses.replace(sliced, vertex_errors=by_vertex)
    assert uncertainties(general).tolist() == by_vertex.tolist()
    silent = dataclasses.replace(
        tetrahedron, uncertainty=np.zeros(0), uncertainty_height=np.zeros(0)
    )
    assert uncertainties(silent).tolist() == [0.0] * 4


def test_the_arrays_can_be_read_without_pickle_and_are_no_solid(tetrahedron, tmp_path):
    export_model(tetrahedron, tmp_path)
    with np.load(tmp_path / "model.npz", allow_pickle=False) as found:
        arrays = dict(found)
    np.testing.assert_array_equal(arrays["vertices"], tetrahedron.vertices)
    np.testing.assert_array_equal(arrays["faces"], tetrahedron.faces)
    assert arrays["contours"].tolist() == [0, 1]
    assert arrays["probes"].tolist() == []
    assert arrays["dropped_reasons"].tolist() == ["too short"]
    health = dict(zip(arrays["health_names"], arrays["health_values"], strict=True))
    assert health == {"condition": 3.5, "fallbacks": 0.0}
    assert bool(arrays["final"]) is True
    tables = {
        f"{table}_{part}" for table in ("health", "predicted") for part in ("names", "values")
    }
    names = {field.name for field in dataclasses.fields(ShapeModel)}
    names -= {"closed", "genus", "self_crossings"}  # nobody has looked at this one
    assert names - {"health", "predicted", "archive"} | tables == set(arrays)
    with pytest.raises(InputError, match="holds no solid"):
        palpate.load(tmp_path / "model.npz")


def test_the_solid_itself_lies_beside_the_arrays(tetrahedron, tmp_path):
    turn = 2 * np.pi * np.arange(24) / 24
    rings = [np.column_stack([np.cos(turn), np.sin(turn), 0 * turn + z]) for z in range(5)]
    solid = palpate.reconstruct(rings, method="skin")
    sent = decode(
        ShapeModel, encode(dataclasses.replace(tetrahedron, archive=tree_to_bytes(solid)))
    )
    export_model(sent, tmp_path)
    again = palpate.load(tmp_path / "model.npz")
    np.testing.assert_array_equal(tree_to_bytes(again), tree_to_bytes(solid))
    with np.load(tmp_path / "model.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["vertices"], tetrahedron.vertices)


def test_a_model_without_a_surface_leaves_no_mesh(tetrahedron, tmp_path):
    empty = dataclasses.replace(
        tetrahedron, vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), np.int32)
    )
    assert export_model(empty, tmp_path) == ("model.npz",)
    assert [path.name for path in tmp_path.iterdir()] == ["model.npz"]


def test_the_fingerprint_sees_every_bit_of_the_surface(tetrahedron):
    moved = tetrahedron.vertices.copy()
    moved[0, 0] = np.nextafter(moved[0, 0], 1.0)
    turned = tetrahedron.faces[::-1].copy()
    prints = {
        mesh_sha256(model)
        for model in (
            tetrahedron,
            dataclasses.replace(tetrahedron, vertices=moved),
            dataclasses.replace(tetrahedron, faces=turned),
        )
    }
    assert len(prints) == 3
    assert mesh_sha256(dataclasses.replace(tetrahedron, number=9)) in prints


@pytest.mark.parametrize(
    ("up", "axis", "sign"),
    [("z", 2, 1), ("-z", 2, -1), ("y", 1, 1), ("-y", 1, -1), ("x", 0, 1), ("-x", 0, -1)],
)
def test_the_axis_that_is_named_points_up_and_nothing_is_mirrored(write, up, axis, sign):
    plain, faces, _ = read_mesh(write("x.off", off(SKEW)), "m")
    turned, same, _ = read_mesh(write("x.off", off(SKEW)), "m", up)
    np.testing.assert_array_equal(faces, same)
    np.testing.assert_allclose(turned[:, 2], sign * plain[:, axis])
    volumes = [np.linalg.det(one[faces]).sum() for one in (plain, turned)]
    assert volumes[0] == pytest.approx(volumes[1]) and volumes[0] > 0.0
