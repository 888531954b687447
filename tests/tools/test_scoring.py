import json

import numpy as np
import pytest
import trimesh

from palpate.core.shapes.tessellations import icosphere
from palpate.launch.files.mesh_file import export_model
from palpate.launch.files.source_map import InputError
from palpate.tools.cli import command_line as cli
from palpate.tools.scoring import read_mesh_or_points, score, score_text

DIRECTIONS, FACES = icosphere(3)
SIZE = np.array([0.05, 0.04, 0.03])


@pytest.fixture
def saved(tmp_path):
    """Writes a lopsided ball, so many times as large, turned and moved."""

    def save(name, scale=1.0, turn=0.0, faces=FACES):
        vertices = scale * DIRECTIONS * SIZE
        vertices[:, 0] *= 1.0 + 6.0 * vertices[:, 2] / scale
        vertices[:, 1] += 4.0 * vertices[:, 0] ** 2 / scale
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, [1, 2, 3]))
        mesh.export(tmp_path / name)
        return tmp_path / name

    return save


def points_of(path):
    return np.asarray(trimesh.load(path, process=False).vertices)


def test_a_file_is_at_no_distance_from_itself(saved):
    found = score(saved("a.ply"), saved("b.ply"))
    assert found["chamfer_m"] < 1e-15
    assert found["hausdorff_m"] < 1e-14
    assert found["volume_error"] == pytest.approx(0.0, abs=1e-12)
    assert (found["watertight"], found["genus"], found["self_intersections"]) == (True, 0, 0)
    assert (found["one_sided"], found["aligned"], found["pose"]) == (False, False, None)


def test_a_larger_solid_is_as_far_away_as_it_is_larger(saved):
    found = score(saved("a.ply", 1.02), saved("b.ply"))
    assert 0.0004 < found["chamfer_m"] < 0.001
    assert found["chamfer_m"] < found["rms_m"] < found["p95_m"] < found["hausdorff_m"] < 0.002
    assert found["volume_error"] == pytest.approx(1.02**3 - 1.0, rel=1e-6)
    assert 0.0 < found["sampling_floor_m"] < found["chamfer_m"]
    assert found["size_m"] == pytest.approx(0.06)


def test_what_a_run_exports_is_the_same_in_every_format(tmp_path, tetrahedron):
    files = export_model(tetrahedron, tmp_path)
    assert len(files) == 4
    for name in files:
        for other in files:
            found = score(tmp_path / name, tmp_path / other)
            assert found["hausdorff_m"] < 1e-8
            assert found["same_order_of_size"]


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_the_unit_can_be_said(saved, unit, scale):
    found = score(saved("a.ply"), saved("b.ply", scale), reference_unit=unit)
    assert found["hausdorff_m"] < 1e-7
    assert found["reference_unit"] == unit


def test_a_wrong_unit_is_doubted(saved):
    found = score(saved("a.ply"), saved("b.stl"), reference_unit="mm")  # written in m
    assert not found["same_order_of_size"]
    assert "warning    their sizes differ widely: see --unit" in score_text(found)


def test_aligned_files_may_lie_anywhere(saved):
    found = score(saved("a.ply", 1.0, 0.7), saved("b.ply"), aligned=True)
    assert found["hausdorff_m"] < 1e-7
    assert found["alignment_rms_m"] < 1e-7
    assert not found["alignment_ambiguous"]
    position, quaternion = np.array(found["pose"][:3]), np.array(found["pose"][3:])
    np.testing.assert_allclose(position, 0.0, atol=1e-7)
    axis = -np.array([1, 2, 3]) / np.sqrt(14) * np.sin(0.35)
    np.testing.assert_allclose(quaternion, [*axis, np.cos(0.35)], atol=1e-6)
    assert "turned by 40.11 deg" in score_text(found)


@pytest.mark.parametrize("aligned", [False, True])
def test_against_points_the_distances_are_one_sided_and_reported_to_be(saved, tmp_path, aligned):
    points = points_of(saved("b.ply", 1.02, 0.3 if aligned else 0.0))[::3]
    np.savetxt(tmp_path / "p.csv", 1000 * points, delimiter=",", header="x,y,z", comments="")
    found = score(saved("a.ply", 1.02), tmp_path / "p.csv", reference_unit="mm", aligned=aligned)
    assert found["one_sided"]
    assert found["points"] == len(points)
    assert found["chamfer_m"] is found["volume_error"] is found["sampling_floor_m"] is None
    assert found["hausdorff_m"] < 1e-7
    assert found["mean_m"] <= found["rms_m"] <= found["hausdorff_m"]
    assert "one-sided  from 214 points to the model, not back" in score_text(found)
    if aligned:  # the model's pose in the points' frame: as they were turned
        assert found["pose"][6] == pytest.approx(np.cos(0.15), abs=1e-6)
        assert found["pose"][3] > 0.0


def test_a_ply_without_faces_holds_points(saved, tmp_path):
    trimesh.PointCloud(points_of(saved("a.ply"))).export(tmp_path / "p.ply")
    found = score(saved("a.ply"), tmp_path / "p.ply")
    assert found["points"] == 642
    assert found["hausdorff_m"] < 1e-8


def test_the_reference_need_not_be_closed(saved):
    found = score(saved("a.ply"), saved("b.ply", faces=FACES[:-40]))
    assert found["volume_error"] is None
    assert 0.0 < found["chamfer_m"] < 0.001
    assert "volume not known" in score_text(found)


def test_a_closed_surface_that_is_inside_out_is_turned(saved):
    found = score(saved("a.ply", faces=FACES[:, ::-1]), saved("b.ply"))
    assert found["normal_deg"] < 1e-3
    assert found["volume_error"] == pytest.approx(0.0, abs=1e-9)


def test_crossings_are_counted(tmp_path, saved):
    ball = trimesh.Trimesh(0.03 * DIRECTIONS, FACES, process=False)
    other = ball.copy()
    other.apply_translation([0.04, 0.002, 0.001])
    trimesh.util.concatenate([ball, other]).export(tmp_path / "two.ply")
    found = score(tmp_path / "two.ply", saved("b.ply"))
    assert found["components"] == 2
    assert found["self_intersections"] > 50


def test_points_are_no_model(saved, write):
    with pytest.raises(InputError, match=r"p\.csv: holds points; the model must be a surface"):
        score(write("p.csv", "1,2,3\n4,5,6\n0,0,0\n1,0,0\n0,1,0\n0,0,1\n"), saved("a.ply"))


def test_a_surface_without_area_is_refused(write, saved):
    line = write("x.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n")
    with pytest.raises(InputError, match=r"x\.off: a surface must have an area"):
        score(line, saved("a.ply"))


def test_an_alignment_that_fits_two_ways_is_doubted(tmp_path):
    trimesh.Trimesh(DIRECTIONS * SIZE, FACES, process=False).export(tmp_path / "a.ply")
    found = score(tmp_path / "a.ply", tmp_path / "a.ply", aligned=True)
    assert found["alignment_ambiguous"]
    assert found["pose"] == pytest.approx([0, 0, 0, 0, 0, 0, 1], abs=1e-9)
    assert "warning    another pose fits as well" in score_text(found)


def test_the_command_prints_a_table(saved, capsys):
    assert cli.run(["score", str(saved("a.ply", 1.02)), str(saved("b.ply"))]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "distance   chamfer 0." in out
    assert "sampling floor" in out
    assert "watertight yes" in out
    assert max(map(len, out.splitlines()[2:])) <= 100


def test_the_command_prints_json(saved, capsys):
    arguments = ["score", str(saved("a.ply")), str(saved("b.ply")), "--json"]
    assert cli.run(arguments) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["chamfer_m"] < 1e-15
    assert found["mean_m"] is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["score"], "Missing argument 'MODEL'"),
        (["score", "a.ply"], "Missing argument 'REFERENCE'"),
        (["score", "a.ply", "b.ply"], "a.ply: does not exist; it must be a run"),
        (["score", "a.ply", "b.ply", "--unit", "km"], "'km' is not one of 'm', 'cm', 'mm'"),
    ],
)
def test_the_command_refuses_in_one_sentence(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.run(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert words in err


def test_the_help_says_what_is_measured(capsys):
    assert cli.run(["score", "--help"]) == 0
    out = capsys.readouterr().out.replace("-\n  ", "-")
    for word in ("MODEL", "REFERENCE", "one-sided", "--align", "--reference-unit", "--json"):
        assert word in out


TABLE = "x;y;z\n0;0;0\n1;0;0\n0;1;0\n0;0;1\n1;1;0\n1;0;1\n"


@pytest.mark.parametrize(
    "text",
    [
        TABLE,
        TABLE.replace(";", ","),
        TABLE.replace(";", " "),
        TABLE.replace(";", "\t").partition("\n")[2],
        "# felt on Monday\n" + TABLE,
        "\ufeffid;Z;X;Y\n0;0;0;0\n1;0;1;0\n2;0;0;1\n3;1;0;0\n4;0;1;1\n5;1;1;0\n",
    ],
)
def test_points_are_read_however_the_table_is_written(write, text):
    found = read_mesh_or_points(write("p.csv", text), "cm")
    expected = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1]]
    np.testing.assert_allclose(found.vertices, np.array(expected) / 100)
    assert found.faces.shape == (0, 3)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("p.csv", "", "p.csv: holds no points"),
        ("p.csv", "x,y,z\n", "p.csv:1: holds no points under its header"),
        ("p.csv", "1,2\n3,4\n", "p.csv:1: has 2 columns and no header"),
        ("p.csv", "1,2,3\n4,5,six\n", "p.csv:2: z must be a number, got 'six'"),
        ("p.csv", "1,2,3\n4,5\n", "p.csv:2: has 2 columns where 3 are named"),
        ("p.csv", "7,1,2,3\n" * 6, "p.csv:1: has 4 columns and no header; name them"),
        ("p.csv", "1,2,3\n4,5,6\n", "p.csv: holds 2 points; at least 6 are needed"),
        ("p.csv", "1,2,3\n" * 6 + "nan,0,0\n", "p.csv: holds 1 point not finite, line 7"),
        ("p.csv", "1,2,3\n" * 6, "p.csv: all 6 points are in one place"),
        ("p.csv", "0,0,0\n" + "1,2,3e200\n" * 6, "p.csv: reaches 3e.200 m from the origin"),
        ("m.obj", "v 0 0 0\nv 1e99 0 0\nv 0 1 0\nf 1 2 3\n", "m.obj: reaches 1e.99 m from"),
        ("m.npz", "hello", "m.npz: is no NPZ file"),
        ("m.ply", "hello", "m.ply: is no mesh in PLY"),
        ("m.doc", "hello", "m.doc: 'doc' is no mesh format"),
    ],
)
def test_files_that_hold_nothing_are_refused(write, name, text, words):
    with pytest.raises(InputError, match=words):
        read_mesh_or_points(write(name, text), None)


@pytest.mark.parametrize(
    ("header", "order"),
    [("Id,X [mm],Y [mm],Z [mm]", (0, 1, 2)), ("Id;Z_mm;Y_mm;X_mm", (2, 1, 0))],
)
def test_columns_are_taken_by_their_names(write, header, order):
    points = np.random.default_rng(3).normal(size=(8, 3))
    mark, placed = header[2], points[:, list(order)].tolist()
    rows = [mark.join(map(repr, [i, *row])) for i, row in enumerate(placed)]
    found = read_mesh_or_points(write("p.csv", "\n".join([header, *rows])), "m")
    np.testing.assert_array_equal(found.vertices, points)


def test_a_file_that_is_not_there_or_no_text_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.csv: cannot be read: No such file"):
        read_mesh_or_points(tmp_path / "none.csv", None)
    (tmp_path / "p.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"p\.csv:1: is no text in UTF-8"):
        read_mesh_or_points(tmp_path / "p.csv", None)


def test_a_file_that_is_too_large_is_refused(write, monkeypatch, tmp_path):
    np.savez_compressed(tmp_path / "m.npz", vertices=np.zeros((2_000_000, 3)))
    with pytest.raises(InputError, match="unpacks to 45 MiB, more than is read"):
        read_mesh_or_points(tmp_path / "m.npz", None)
    monkeypatch.setattr("palpate.launch.files.points_file.MAX_TABLE_BYTES", 1000)
    with pytest.raises(InputError, match="is larger than 0 kB, the most that is read"):
        read_mesh_or_points(write("p.csv", "1,2,3\n" * 200), None)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"vertices": np.eye(3)}, "is no model: it lacks faces$"),
        (
            {"vertices": np.eye(3), "faces": np.zeros((0, 3), int)},
            "the model has no surface; nothing could be rebuilt",
        ),
        (
            {"vertices": np.eye(3), "faces": np.array([[0, 1, 3]])},
            "is no model: faces must name vertices from 0 to 2, got 3",
        ),
        ({"vertices": np.array(["a"]), "faces": np.array([[0, 1, 2]])}, "is no model: "),
        ({"vertices": np.array([{}]), "faces": np.eye(3)}, "'vertices.npy': an array of objects"),
    ],
)
def test_an_archive_that_is_no_model_is_refused(tmp_path, arrays, words):
    np.savez(tmp_path / "m.npz", **arrays)
    with pytest.raises(InputError, match=words):
        read_mesh_or_points(tmp_path / "m.npz", None)
