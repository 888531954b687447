"""Solids of runs as files of other programs, each opened by a library that is not palpate's."""

import json
import zipfile
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
import trimesh
from lxml import etree

from palpate.launch.files.mesh_file import export_model
from palpate.launch.files.source_map import InputError
from palpate.messages.types import Truth
from palpate.tools.exporting import export, export_text

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # rows are turned by it
SHIFT = np.array([0.001, 0.002, -0.001])  # of the truth [m]
NOTHING = {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int32)}
UNKNOWN = {"uncertainty": np.zeros(0), "uncertainty_height": np.zeros(0)}


@pytest.fixture
def run_of(record):
    """The directory of a run with these messages."""

    def make(*messages):
        named = [("/truth" if isinstance(one, Truth) else "/model", one) for one in messages]
        return record(named, name="run/topics.mcap").parent

    return make


@pytest.fixture
def truth(tetrahedron):
    moved, faces = tetrahedron.vertices + SHIFT, tetrahedron.faces
    floor = {"floor_vertices": moved, "floor_faces": faces}
    return Truth(vertices=moved, faces=faces, **floor, height=0.03)


@pytest.fixture
def run(run_of, truth, tetrahedron):
    """A run that knows the truth, and whose first model was another."""
    early = replace(tetrahedron, vertices=2.0 * tetrahedron.vertices, final=False)
    return run_of(truth, early, tetrahedron)


@pytest.mark.parametrize(
    ("kind", "scale", "turn"),
    [("ply", 1.0, np.eye(3)), ("stl", 1000.0, np.eye(3)), ("3mf", 1000.0, np.eye(3)),
     ("glb", 1.0, Y_UP), ("obj", 1.0, np.eye(3))],
)  # fmt: skip
def test_another_library_reads_the_geometry(run, tmp_path, tetrahedron, kind, scale, turn):
    path = tmp_path / f"solid.{kind}"
    export(run, [path])
    mesh = trimesh.load(path, force="mesh", process=False)
    wanted = scale * tetrahedron.vertices @ turn
    np.testing.assert_allclose(mesh.triangles, wanted[tetrahedron.faces], atol=1e-6 * scale)
    assert mesh.volume == pytest.approx(scale**3 * 1e-6, rel=1e-5)  # outwards


def test_3mf_is_a_package_in_mm_and_reproducible(run, tmp_path):
    paths = [tmp_path / "a.3mf", tmp_path / "b.3mf"]
    export(run, paths)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert trimesh.load(paths[0]).units == "millimeter"
    with zipfile.ZipFile(paths[0]) as package:
        parts = {name: etree.fromstring(package.read(name)) for name in package.namelist()}
    assert list(parts) == ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]
    assert parts["_rels/.rels"][0].get("Target") == "/3D/3dmodel.model"
    assert {one.get("Extension") for one in parts["[Content_Types].xml"]} == {"rels", "model"}


def vertices_of(path):
    return trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]


def test_ply_has_deviation_uncertainty_and_colours(run, tmp_path, tetrahedron):
    facts = export(run, [tmp_path / "solid.ply"])
    columns = vertices_of(tmp_path / "solid.ply")
    moved = trimesh.Trimesh(tetrahedron.vertices + SHIFT, tetrahedron.faces, process=False)
    _, deviations, _ = trimesh.proximity.closest_point_naive(moved, tetrahedron.vertices)
    assert deviations.min() > 1e-5
    assert columns["deviation"] == pytest.approx(deviations, rel=1e-5)
    assert columns["uncertainty"] == pytest.approx([0.001] * 4)
    viridis = 255.0 * mpl.colormaps["viridis_r"](deviations / facts["colours_end_m"])[:, :3]
    colours = np.column_stack([columns[name] for name in ("red", "green", "blue")]).astype(float)
    assert np.abs(colours - viridis).max() < 4.0
    assert facts["coloured_by"] == "deviation"
    assert facts["rms_m"]["deviation"] == pytest.approx(np.sqrt(np.mean(deviations**2)))


def test_uncertainty_gives_the_colours_without_truth(run_of, tmp_path, tetrahedron):
    heights, errors = np.array([0.0, 0.03]), np.array([0.001, 0.002])
    model = replace(tetrahedron, uncertainty_height=heights, uncertainty=errors, final=False)
    facts = export(run_of(model), [tmp_path / "solid.ply"])
    columns = vertices_of(tmp_path / "solid.ply")
    assert "deviation" not in columns.dtype.names
    assert columns["uncertainty"] == pytest.approx([0.001, 0.001, 0.001, 0.002])
    assert (facts["coloured_by"], facts["colours_end_m"]) == ("uncertainty", pytest.approx(0.002))
    assert [columns[name][3] for name in ("red", "green", "blue")] == [0x44, 0x01, 0x54]
    assert "the run had not come to its end" in export_text(facts)
    facts = export(run_of(replace(tetrahedron, **UNKNOWN)), [tmp_path / "solid.ply"])
    assert vertices_of(tmp_path / "solid.ply").dtype.names == ("x", "y", "z")
    assert (facts["rms_m"], facts["coloured_by"], facts["colours_end_m"]) == ({}, None, None)
    assert "colours" not in export_text(facts)
    export_model(tetrahedron, tmp_path)  # as of a run that was not recorded
    facts = export(tmp_path, [tmp_path / "solid.obj"])
    assert (facts["final"], facts["faces"]) == (None, 4)
    assert trimesh.load(tmp_path / "solid.obj").volume == pytest.approx(1e-6)


def test_export_command_prints_files_with_units(run, tmp_path, call, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = call("export run -o a.stl -o a.glb")
    assert code == 0 and "4 triangles, 4 vertices" in out and "not come to its end" not in out
    assert "a.stl (mm)" in out and "a.glb (m, y up)" in out
    facts = json.loads(call("export run -o a.stl -o a.glb --json").out)  # which it replaces
    assert facts["faces"] == 4 and facts["written"][0] == {"file": "a.stl", "holds": "mm"}
    assert call("export run/topics.mcap -o b.stl").code == 0
    assert (tmp_path / "a.stl").read_bytes() == (tmp_path / "b.stl").read_bytes()


def test_unwritable_files_and_runs_without_a_solid_leave_no_file(run_of, run, truth, tmp_path,
                                                                 tetrahedron):  # fmt: skip
    (tmp_path / "folder.stl").mkdir()
    for name, words in (
        ("b.foo", r"-o .*b.foo: must end in one of .ply, .stl, .glb, .obj, .3mf"),
        ("a", r"-o .*a: must end in one of"),
        ("none/b.stl", r"b.stl: cannot be written: there is no folder .*none"),
        ("a.ply", "each file that is written must have a name of its own"),
        ("folder.stl", r"folder.stl: cannot be written: it is a folder"),
    ):
        with pytest.raises(InputError, match=words):
            export(run, [tmp_path / "a.ply", tmp_path / name])
        assert sorted(one.name for one in tmp_path.iterdir()) == ["folder.stl", "run"]
    (tmp_path / "empty").mkdir()
    for path, words in (
        (tmp_path / "empty", r"empty: holds no rebuilt solid: there is no mesh\.ply in it"),
        (run_of(tetrahedron, replace(tetrahedron, **NOTHING)), "no model in it has a surface"),
        (run_of(truth), "run: holds no rebuilt solid"),
    ):
        with pytest.raises(InputError, match=words):
            export(path, [tmp_path / "a.ply"])
    assert not (tmp_path / "a.ply").exists()
