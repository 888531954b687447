"""Solids compared with references: distances, units, alignment, files that cannot be compared."""

import json

import numpy as np
import pytest
import trimesh

from palpate.launch.files.mesh_file import export_model
from palpate.launch.files.source_map import InputError
from palpate.tools.scoring import read_mesh_or_points, score, score_text

BALL = trimesh.creation.icosphere(3)
SIZE = np.array([0.05, 0.04, 0.03])


@pytest.fixture
def saved(tmp_path):
    """Writes a lopsided ball, scaled, turned, or of some of its faces."""

    def save(name, scale=1.0, turn=0.0, faces=BALL.faces):
        vertices = scale * BALL.vertices * SIZE
        vertices[:, 0] *= 1.0 + 6.0 * vertices[:, 2] / scale
        vertices[:, 1] += 4.0 * vertices[:, 0] ** 2 / scale
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, [1, 2, 3]))
        mesh.export(tmp_path / name)
        return tmp_path / name

    return save


def test_distances_are_none_from_itself_and_grow_with_the_difference(saved, tmp_path, tetrahedron):
    record = score(saved("a.ply"), saved("b.ply"))
    assert record["chamfer_m"] < 1e-15 and record["hausdorff_m"] < 1e-14
    assert record["volume_error"] == pytest.approx(0.0, abs=1e-12)
    assert (record["watertight"], record["genus"], record["self_intersections"]) == (True, 0, 0)
    assert (record["one_sided"], record["aligned"], record["pose"]) == (False, False, None)
    files = export_model(tetrahedron, tmp_path)
    assert len(files) == 4
    for name in files:
        record = score(tmp_path / name, tmp_path / files[0])
        assert record["hausdorff_m"] < 1e-8 and record["same_order_of_size"]
    record = score(saved("a.ply", 1.02), saved("b.ply"))
    assert 0.0004 < record["chamfer_m"] < record["rms_m"] < record["p95_m"] < record["hausdorff_m"]
    assert record["hausdorff_m"] < 0.002 and record["chamfer_m"] < 0.001
    assert record["volume_error"] == pytest.approx(1.02**3 - 1.0, rel=1e-6)
    assert 0.0 < record["sampling_floor_m"] < record["chamfer_m"]
    assert record["size_m"] == pytest.approx(0.06)


@pytest.mark.slow
def test_reference_is_read_in_its_unit_and_aligned_may_lie_anywhere(saved, tmp_path):
    record = score(saved("a.ply"), saved("b.ply", 100.0), reference_unit="cm")
    assert record["hausdorff_m"] < 1e-7 and record["reference_unit"] == "cm"
    wrong = score(saved("a.ply"), saved("b.stl"), reference_unit="mm")  # written in m
    assert not wrong["same_order_of_size"]
    assert "warning    their sizes differ widely: see --unit" in score_text(wrong)
    record = score(saved("a.ply", 1.0, 0.7), saved("b.ply"), aligned=True)
    assert record["hausdorff_m"] < 1e-7 and record["alignment_rms_m"] < 1e-7
    assert not record["alignment_ambiguous"]
    axis = -np.array([1, 2, 3]) / np.sqrt(14) * np.sin(0.35)
    assert record["pose"] == pytest.approx([0, 0, 0, *axis, np.cos(0.35)], abs=1e-6)
    assert "turned by 40.11 deg" in score_text(record)
    trimesh.Trimesh(BALL.vertices * SIZE, BALL.faces).export(tmp_path / "c.ply")  # symmetric
    record = score(tmp_path / "c.ply", tmp_path / "c.ply", aligned=True)
    assert record["alignment_ambiguous"]
    assert record["pose"] == pytest.approx([0, 0, 0, 0, 0, 0, 1], abs=1e-9)
    assert "warning    another pose fits as well" in score_text(record)


@pytest.mark.parametrize("aligned", [False, True])
def test_distances_from_points_are_one_sided(saved, tmp_path, aligned):
    path = saved("b.ply", 1.02, 0.3 if aligned else 0.0)
    points = np.asarray(trimesh.load(path, process=False).vertices)[::3]
    np.savetxt(tmp_path / "p.csv", 1000 * points, delimiter=",", header="x,y,z", comments="")
    record = score(saved("a.ply", 1.02), tmp_path / "p.csv", reference_unit="mm", aligned=aligned)
    assert record["one_sided"] and record["points"] == len(points)
    assert record["chamfer_m"] is record["volume_error"] is record["sampling_floor_m"] is None
    assert record["mean_m"] <= record["rms_m"] <= record["hausdorff_m"] < 1e-7
    assert "one-sided  from 214 points to the model, not back" in score_text(record)
    if aligned:  # the model's pose in the points' frame
        assert (
            record["pose"][6] == pytest.approx(np.cos(0.15), abs=1e-6) and record["pose"][3] > 0.0
        )
    trimesh.PointCloud(points).export(tmp_path / "p.ply")
    cloud = score(saved("a.ply", 1.02), tmp_path / "p.ply", aligned=aligned)
    assert cloud["points"] == len(points) and cloud["hausdorff_m"] < 1e-7


def test_open_turned_and_crossing_surfaces_are_compared(saved, tmp_path):
    record = score(saved("a.ply"), saved("b.ply", faces=BALL.faces[:-40]))
    assert record["volume_error"] is None and 0.0 < record["chamfer_m"] < 0.001
    assert "volume unknown" in score_text(record)
    record = score(saved("a.ply", faces=BALL.faces[:, ::-1]), saved("b.ply"))  # inside out
    assert record["normal_deg"] < 1e-3
    assert record["volume_error"] == pytest.approx(0.0, abs=1e-9)
    other = BALL.copy().apply_scale(0.03)
    two = trimesh.util.concatenate([other, other.copy().apply_translation([0.04, 0.002, 0.001])])
    two.export(tmp_path / "two.ply")
    assert score(tmp_path / "two.ply", saved("b.ply"))["self_intersections"] > 0


def test_score_command_prints_table_or_json(saved, call, refusal):
    code, out, err = call("score", saved("a.ply", 1.02), saved("b.ply"))
    assert (code, err) == (0, "") and "distance   chamfer 0." in out
    assert "sampling floor" in out and "watertight yes" in out
    record = json.loads(call("score", saved("a.ply"), saved("b.ply"), "--json").out)
    assert record["chamfer_m"] < 1e-15 and record["mean_m"] is None
    for words, fragment in (
        ("", "Missing argument 'MODEL'"),
        ("a.ply", "Missing argument 'REFERENCE'"),
        ("none.ply b.ply", "none.ply: does not exist; it must be a run"),
        ("none.ply b.ply --unit km", "'km' is not one of 'm', 'cm', 'mm'"),
    ):
        assert fragment in refusal(f"score {words}")


TABLE = "x;y;z\n0;0;0\n1;0;0\n0;1;0\n0;0;1\n1;1;0\n1;0;1\n"
SIX = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1]])


@pytest.mark.parametrize(
    "text",
    [
        TABLE,
        TABLE.replace(";", "\t").partition("\n")[2],
        "# felt on Monday\n" + TABLE,
        "\ufeffid;Z;X;Y\n0;0;0;0\n1;0;1;0\n2;0;0;1\n3;1;0;0\n4;0;1;1\n5;1;1;0\n",
        "Id;Z_cm;Y_cm;X [cm]\n0;0;0;0\n1;0;0;1\n2;0;1;0\n3;1;0;0\n4;0;1;1\n5;1;0;1\n",
    ],
)
def test_points_are_read_however_the_table_is_written(write, text):
    read = read_mesh_or_points(write("p.csv", text), "cm")
    np.testing.assert_allclose(read.vertices, SIX / 100)
    assert read.faces.shape == (0, 3)


BAD = (
    ("p.csv", "1,2,3\n4,5\n", "p.csv:2: has 2 columns where 3 are named"),
    ("p.csv", "1,2,3\n4,5,6\n", "p.csv: holds 2 points; at least 6 are needed"),
    ("p.csv", "1,2,3\n" * 6 + "nan,0,0\n", "p.csv: holds 1 point not finite, line 7"),
    ("p.csv", "1,2,3\n" * 6, "p.csv: all 6 points are in one place"),
    ("p.csv", "0,0,0\n" + "1,2,3e200\n" * 6, "p.csv: reaches 3e.200 m from the origin"),
    ("m.obj", "v 0 0 0\nv 1e99 0 0\nv 0 1 0\nf 1 2 3\n", "m.obj: reaches 1e.99 m from"),
    ("m.npz", "hello", "m.npz: is no NPZ file"),
    ("m.doc", "hello", "m.doc: 'doc' is no mesh format"),
    ("m.npz", {"vertices": np.eye(3)}, "is no model: it lacks faces$"),
    ("m.npz", {"vertices": np.eye(3), "faces": np.zeros((0, 3), int)}, "has no surface; noth"),
    ("m.npz", {"vertices": np.eye(3), "faces": [[0, 1, 3]]}, "vertices from 0 to 2, got 3"),
    ("m.npz", {"vertices": ["a"], "faces": [[0, 1, 2]]}, "is no model: "),
)


@pytest.mark.parametrize(("name", "content", "words"), BAD)
def test_files_without_points_or_a_model_are_refused(write, name, content, words):
    path = write(name, content if isinstance(content, str) else "")
    if isinstance(content, dict):
        np.savez_compressed(path, **content)
    with pytest.raises(InputError, match=words):
        read_mesh_or_points(path, None)
