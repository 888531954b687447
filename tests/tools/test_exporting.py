"""Each format is opened by a library that is not palpate's."""

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
from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.world import Truth
from palpate.tools.cli import command_line as cli
from palpate.tools.exporting import export, export_text

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # Rows are turned by it
SHIFT = np.array([0.001, 0.002, -0.001])  # Of the truth
NOTHING = {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int32)}


def truth_of(model):
    moved = model.vertices + SHIFT
    return Truth(
        vertices=moved,
        faces=model.faces,
        floor_vertices=moved,
        floor_faces=model.faces,
        height=0.03,
    )


@pytest.fixture
def record(tmp_path):
    """Writes a run directory with a recording of some messages."""

    def write(*messages):
        (tmp_path / "run").mkdir()
        topics = [f"/{type(one).__name__.lower()}" for one in messages]
        types = {topic: type(one).__name__ for topic, one in zip(topics, messages, strict=True)}
        writer = RecordingWriter(tmp_path / "run" / "topics.mcap", types, {}, {})
        for seq, (topic, one) in enumerate(zip(topics, messages, strict=True)):
            writer.write(topic, Header(0, 0, seq, 0, 0.0, schema_hash(type(one))), encode(one))
        writer.close()
        return tmp_path / "run"

    return write


@pytest.fixture
def run(record, tetrahedron):
    """A run that knows the truth, and whose first model was another."""
    early = replace(tetrahedron, vertices=2.0 * tetrahedron.vertices, final=False)
    return record(truth_of(tetrahedron), early, tetrahedron)


@pytest.mark.parametrize(
    ("kind", "scale", "turn"),
    [
        ("ply", 1.0, np.eye(3)),
        ("stl", 1000.0, np.eye(3)),
        ("3mf", 1000.0, np.eye(3)),
        ("glb", 1.0, Y_UP),
        ("obj", 1.0, np.eye(3)),
    ],
)
def test_another_library_reads_the_geometry_of_the_model(
    run, tmp_path, tetrahedron, kind, scale, turn
):
    path = tmp_path / f"solid.{kind}"
    export(run, [path])
    mesh = trimesh.load(path, force="mesh", process=False)
    wanted = scale * tetrahedron.vertices @ turn
    np.testing.assert_allclose(mesh.triangles, wanted[tetrahedron.faces], atol=1e-6 * scale)
    assert mesh.volume == pytest.approx(scale**3 * 1e-6, rel=1e-5)  # Outwards
    height = 1 if kind == "glb" else 2
    assert mesh.extents[height] == pytest.approx(0.03 * scale)


def test_3mf_says_that_it_is_in_mm_and_is_the_same_every_time(run, tmp_path):
    paths = [tmp_path / "a.3mf", tmp_path / "b.3mf"]
    export(run, paths)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    scene = trimesh.load(paths[0])
    assert scene.units == "millimeter"
    assert scene.convert_units("meters").extents == pytest.approx([0.01, 0.02, 0.03])
    with zipfile.ZipFile(paths[0]) as package:
        parts = {name: etree.fromstring(package.read(name)) for name in package.namelist()}
    assert list(parts) == ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]
    (relation,) = parts["_rels/.rels"]
    assert relation.get("Target") == "/3D/3dmodel.model"
    assert {one.get("Extension") for one in parts["[Content_Types].xml"]} == {"rels", "model"}


def vertices_of(path):
    return trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]


def test_ply_has_deviation_and_uncertainty_of_each_vertex_and_their_colours(
    run, tmp_path, tetrahedron
):
    told = export(run, [tmp_path / "solid.ply"])
    found = vertices_of(tmp_path / "solid.ply")
    corners = (tetrahedron.vertices + SHIFT)[tetrahedron.faces]
    nearest = [
        trimesh.triangles.closest_point(corners, np.tile(one, (len(corners), 1))) - one
        for one in tetrahedron.vertices
    ]
    deviations = np.linalg.norm(nearest, axis=2).min(axis=1)
    assert deviations.min() > 1e-5
    assert found["deviation"] == pytest.approx(deviations, rel=1e-5)
    assert found["uncertainty"] == pytest.approx([0.001] * 4)
    shares = deviations / told["colours_end_m"]
    viridis = 255.0 * mpl.colormaps["viridis_r"](shares)[:, :3]
    colours = np.column_stack([found[name] for name in ("red", "green", "blue")]).astype(float)
    assert np.abs(colours - viridis).max() < 4.0
    assert told["coloured_by"] == "deviation"
    assert told["rms_m"]["deviation"] == pytest.approx(np.sqrt(np.mean(deviations**2)))


def test_without_the_truth_the_uncertainty_gives_the_colours(record, tmp_path, tetrahedron):
    heights, errors = np.array([0.0, 0.03]), np.array([0.001, 0.002])
    run = record(replace(tetrahedron, uncertainty_height=heights, uncertainty=errors))
    told = export(run, [tmp_path / "solid.ply"])
    found = vertices_of(tmp_path / "solid.ply")
    assert "deviation" not in found.dtype.names
    assert found["uncertainty"] == pytest.approx([0.001, 0.001, 0.001, 0.002])
    assert (told["coloured_by"], told["colours_end_m"]) == ("uncertainty", pytest.approx(0.002))
    assert [found[name][3] for name in ("red", "green", "blue")] == [0x44, 0x01, 0x54]


def test_a_model_of_which_nothing_is_known_has_neither(record, tmp_path, tetrahedron):
    run = record(replace(tetrahedron, uncertainty=np.zeros(0), uncertainty_height=np.zeros(0)))
    told = export(run, [tmp_path / "solid.ply"])
    assert vertices_of(tmp_path / "solid.ply").dtype.names == ("x", "y", "z")
    assert (told["rms_m"], told["coloured_by"], told["colours_end_m"]) == ({}, None, None)
    assert "colours" not in export_text(told)


def test_the_mesh_of_a_run_without_a_recording_is_taken(tmp_path, tetrahedron):
    export_model(tetrahedron, tmp_path)
    told = export(tmp_path, [tmp_path / "solid.obj"])
    assert (told["final"], told["faces"]) == (None, 4)
    found = trimesh.load(tmp_path / "solid.obj")
    assert found.volume == pytest.approx(1e-6)


def test_what_was_written_is_told_with_its_unit(run, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["export", "run", "-o", "a.stl", "-o", "a.glb"]
    assert cli.run(words) == 0
    out = capsys.readouterr().out
    assert "4 triangles, 4 vertices" in out and "not come to its end" not in out
    assert "a.stl (mm)" in out and "a.glb (m, y up)" in out
    assert cli.run([*words, "--json"]) == 0  # What is there is replaced
    told = json.loads(capsys.readouterr().out)
    assert told["faces"] == 4
    assert told["written"][0] == {"file": "a.stl", "holds": "mm"}
    assert cli.run(["export", "run/topics.mcap", "-o", "b.stl"]) == 0
    assert (tmp_path / "a.stl").read_bytes() == (tmp_path / "b.stl").read_bytes()


def test_a_model_on_the_way_is_told_to_be_one(record, tmp_path, tetrahedron):
    told = export(record(replace(tetrahedron, final=False)), [tmp_path / "a.ply"])
    assert "the run had not come to its end" in export_text(told)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["a.ply", "b.foo"], r"-o .*b.foo: must end in one of .ply, .stl, .glb, .obj, .3mf"),
        (["a.ply", "a"], r"-o .*a: must end in one of"),
        (["a.ply", "none/b.stl"], r"b.stl: cannot be written: there is no folder .*none"),
        (["a.ply", "a.ply"], "each file that is written must have a name of its own"),
        (["a.ply", "folder.stl"], r"folder.stl: cannot be written: it is a folder"),
    ],
)
def test_files_that_cannot_be_written_leave_none_behind(run, tmp_path, names, words):
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(InputError, match=words):
        export(run, [tmp_path / name for name in names])
    assert sorted(one.name for one in tmp_path.iterdir()) == ["folder.stl", "run"]


def test_a_run_without_a_solid_is_refused(record, tmp_path, tetrahedron):
    (tmp_path / "empty").mkdir()
    for path, words in (
        (tmp_path / "none", "none: the recording does not exist"),
        (tmp_path / "empty", r"empty: holds no rebuilt solid: there is no mesh\.ply in it"),
        (record(tetrahedron, replace(tetrahedron, **NOTHING)), "no model in it has a surface"),
    ):
        with pytest.raises(InputError, match=words):
            export(path, [tmp_path / "a.ply"])
    assert not (tmp_path / "a.ply").exists()


def test_a_recording_without_models_is_refused(record, tmp_path, tetrahedron):
    run = record(truth_of(tetrahedron))
    with pytest.raises(InputError, match="run: holds no rebuilt solid"):
        export(run, [tmp_path / "a.ply"])
