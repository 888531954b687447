"""Solids rebuilt from measured contours, clouds and recordings by the verb rebuild."""

import json
import re

import numpy as np
import pytest
import trimesh

import palpate
from palpate.core.archive import tree_to_bytes
from palpate.core.poses import Pose
from palpate.launch.files.file_access import write_atomically
from palpate.launch.files.point_clouds import MeasuredContours
from palpate.launch.files.points_file import read_oriented
from palpate.launch.files.solid_file import load, save
from palpate.launch.files.source_map import InputError
from palpate.tools.scoring import read_mesh_or_points

pytestmark = pytest.mark.usefixtures("here")
TURN = 2 * np.pi * np.arange(30) / 30
HEIGHTS = np.linspace(-45.0, 45.0, 10)
CIRCLE = np.column_stack([np.cos(TURN), np.sin(TURN)])


def ellipsoid(z, scale=1.0):
    """A section of an ellipsoid of 60 by 48 by 100 mm at a height in mm."""
    r = 30.0 * np.sqrt(1.0 - (z / 50.0) ** 2)
    return scale * np.column_stack([r * CIRCLE * [1.0, 0.8], np.full(30, z)])


def write_contours(path, contours):
    rows = [(*point, number) for number, ring in contours.items() for point in ring]
    lines = [f"{x:.6f},{y:.6f},{z:.6f},{number}" for x, y, z, number in rows]
    path.write_text("\n".join(["x,y,z,contour", *lines, ""]), encoding="utf-8")
    return path


@pytest.fixture
def table(here):
    """The ellipsoid without its ends, in mm."""
    return write_contours(here / "points.csv", dict(enumerate(map(ellipsoid, HEIGHTS))))


@pytest.fixture
def printed(call):
    """What the verb prints, in one line."""

    def do(*words):
        code, out, _ = call("rebuild", *words)
        assert code == 0
        return " ".join(out.split())

    return do


@pytest.fixture
def figures(call):
    """What it prints as JSON."""
    return lambda *words: json.loads(call("rebuild --json", *words).out)


MM = ("--unit", "mm")
TOUCHED = (*MM, "--top", 50, "--bottom", -50)


def test_every_file_is_written_in_its_unit(table, here, printed):
    names = ["a.ply", "a.stl", "a.glb", "a.obj", "a.3mf", "a.npz"]
    text = printed(table, *TOUCHED, *(part for name in names for part in ("-o", name)))
    assert all(f"wrote {name}" in text for name in names)
    assert sorted(path.name for path in here.iterdir()) == sorted([*names, "points.csv"])
    shapes = [read_mesh_or_points(here / name, None) for name in names if name != "a.3mf"]
    shapes.append(trimesh.load(here / "a.3mf").convert_units("meters").to_mesh())
    for shape in shapes:
        mesh = trimesh.Trimesh(shape.vertices, shape.faces)
        assert mesh.extents == pytest.approx([0.06, 0.048, 0.1], rel=0.01)
        assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.03 * 0.024 * 0.05, rel=0.01)


def test_bad_points_and_contours_are_reported(table, here, printed):
    lines = table.read_text().splitlines()
    lines[5] = "nan," + lines[5].split(",", 1)[1]
    table.write_text("\n".join([*lines, "1,1,90,77", "2,2,90,77"]))
    text = printed(table, *MM)
    for words in (
        "11 contours, 301 points, unit mm",
        "left out 1 point not finite, line 6",
        "dropped contour 77 (lines 302 to 303): too few points",
        "watertight yes, holes through it 0",
        "root mean square",
    ):
        assert words in text
    star = (1.0 + 0.9 * np.cos(5 * TURN))[:, None]  # odd, but used
    rings = {n + 17: np.column_stack([CIRCLE, np.full(30, n / 3)]) for n in range(4)}
    rings[19][:, :2] = star * CIRCLE + [0.8, 0.0]
    assert "warning contour 19 (lines 62 to 91)" in printed(write_contours(here / "odd.csv", rings))


@pytest.mark.slow
def test_untouched_and_missed_ends_are_doubted(table, here, printed):
    heights = np.linspace(0.1, 0.9, 9)
    rings = [np.column_stack([CIRCLE, np.full(30, height)]) for height in heights]
    np.savez(here / "tin.npz", **{f"contour_{i}": ring for i, ring in enumerate(rings)})
    text = printed("tin.npz")
    assert "unit m (assumed; if not, give --unit)" in text
    assert "--bottom or --tops says where" in text and "--top or --tops says where" in text
    (here / "tops.csv").write_text("0 0 0\n0 0 1\n")
    assert "says where" not in printed("tin.npz", "--tops", "tops.csv")
    text = printed(table, *MM, "--top", 100, "--bottom", -50)
    assert "the top lies 55 mm above the highest contour, where contours are at most 10 mm" in text
    assert "the bottom lies" not in text
    text = printed(table, *TOUCHED, "--method", "thesis")
    assert "the top was touched at z = 50 mm, and the solid ends at 4" in text
    assert "the bottom was touched at z = -50 mm, and the solid ends at -4" in text


@pytest.mark.slow
def test_coarse_figures_are_printed_as_json(table, figures, printed):
    record = figures(table, "--unit", "cm", "--method", "coarse")
    known = {"method": "coarse", "contours": 10, "watertight": True, "error_rms_m": None}
    assert known.items() <= record.items()
    assert (record["unit_assumed"], record["written"]) == (False, [])
    assert record["size_m"] == pytest.approx([0.6, 0.48, 1.0], rel=0.05)
    assert "m in size when read in m: is the unit right?" in printed(table)
    lines = [line for line in table.read_text().splitlines() if not line.endswith((*"56789",))]
    table.write_text("\n".join(lines))  # the lower half
    assert "the superquadric's fit is" in printed(table, *MM, "--method", "coarse")


def test_control_lattice_is_written(table, here, printed):
    printed(table, *MM, "--lattice", "a.npz", "-o", "solid.npz")
    printed(table, *MM, "--lattice", "a.vtk")
    control = palpate.load(here / "solid.npz").lattice.lattice.control
    with np.load(here / "a.npz") as arrays:
        assert np.array_equal(arrays["control"], control)
        assert arrays["undeformed"].shape == control.shape
        assert len(arrays["knots_u"]) == control.shape[2] + arrays["degree_u"] + 1
    lines, number = (here / "a.vtk").read_text().splitlines(), control[..., 0].size
    assert lines[3:6] == [
        "DATASET STRUCTURED_GRID",
        "DIMENSIONS {} {} {}".format(*control.shape[:3]),
        f"POINTS {number} double",
    ]
    rows = np.array([line.split() for line in lines[6 : 6 + number]], float)
    assert np.array_equal(rows, control.transpose(2, 1, 0, 3).reshape(-1, 3))
    start = lines.index("VECTORS undeformed double") + 1
    undeformed = np.array([line.split() for line in lines[start : start + number]], float)
    assert np.isfinite(undeformed).all() and "VECTORS displacement double" in lines


@pytest.mark.parametrize(
    ("words", "fragment"),
    [
        ("-o a.step", "-o a.step: must end in one of .ply, .stl, .glb, .obj, .3mf, .npz"),
        ("-o a.ply -o a.ply", "each file that is written must have a name of its own"),
        ("-o points.npz", "is the file that is read; write to another"),
        ("--lattice a.txt", "--lattice a.txt: must end in one of .npz, .vtk"),
        ("--lattice a.vtk --method skin", "the method skin has no control lattice"),
        ("--top 3", "--top 3: must lie beyond the contours, which go from -45 to 45"),
        ("--bottom -44", "--bottom -44: must lie beyond the contours"),
        ("--noise -1", "--noise"),
        ("--unit furlong", "--unit"),
        ("--tolerance 1e-9 --unit mm", "--tolerance 1e-09: 1e-09 mm would take more"),
        ("--tolerance nan", "--tolerance nan: must be a finite number"),
        ("--noise inf", "--noise inf: must be a finite number"),
        ("--noise 1e6 --unit cm", "--noise 1e+06: must be less than the size of the object, 90 cm"),
        ("--top inf", "--top inf: must be a finite number"),
    ],
)
def test_impossible_demands_are_refused(here, refusal, words, fragment):
    rings = {f"contour_{i}": ellipsoid(z) for i, z in enumerate(HEIGHTS)}
    np.savez(here / "points.npz", **rings)
    assert fragment in refusal("rebuild points.npz", *words.split())
    assert [path.name for path in here.iterdir()] == ["points.npz"]


def test_unusable_files_are_refused(here, refusal):
    level = {k: [(i, 0, k) for i in range(9)] for k in (0, 1)}
    few = {k + 17: [(i, 0, k) for i in range(2)] for k in range(9)}
    write_contours(here / "line.csv", level)
    write_contours(here / "few.csv", few)
    (here / "a.mcap").write_bytes(b"nothing")
    (here / "empty").mkdir()
    assert refusal("rebuild few.csv").endswith("; and 3 more\n")
    for words, fragment in (
        ("line.csv -o a.ply", "line.csv: "),
        ("few.csv", "contour 17 (lines 2 to 3): too few points; contour 18"),
        ("a.mcap", "a.mcap"),
        ("a.mcap --unit mm", "recordings are in m"),
        ("empty", "empty: is no folder of a run: it holds no topics.mcap"),
    ):
        assert fragment in refusal("rebuild", *words.split())
    assert not (here / "a.ply").exists()


def test_surface_through_itself_has_no_stated_error(here, printed, figures):
    away = (0.02 + 0.03 * np.cos(TURN))[:, None]  # a limacon, whose inner loop is a second sheet
    rings = {n: np.column_stack([away * CIRCLE, np.full(30, 0.015 * n)]) for n in range(5)}
    path = write_contours(here / "looped.csv", rings)
    text = printed(path, "--unit", "m")
    assert "confidence none: the surface passes through itself" in text
    assert re.search(r"passes through itself: \d+ pairs of triangles cross", text)
    record = figures(path, "--unit", "m")
    assert record["self_intersections"] > 0 and record["error_rms_m"] is None


def test_solid_is_saved_and_loaded_bit_for_bit(table, here, printed):
    printed(table, *MM, "-o", "first.npz")
    solid = palpate.load("first.npz")
    palpate.save(solid, here / "second.npz")
    assert np.array_equal(*map(tree_to_bytes, (solid, load(here / "second.npz"))))
    assert (here / "first.npz").read_bytes() == (here / "second.npz").read_bytes()
    (here / "file").touch()
    for name, words in (
        ("a.ply", r"must end in \.npz"),
        ("nowhere/a.npz", "cannot be written"),
        ("file/a.npz", "there is no folder file"),
    ):
        with pytest.raises(InputError, match=words):
            save(solid, name)
    with pytest.raises(TypeError, match="solid must be a Solid, as reconstruct returns it, got 3"):
        save(3, "a.npz")

    with pytest.raises(InputError, match="cannot be read: No such file"):
        load("a.npz")
    for arrays, words in (
        ({"x": np.ones(3)}, "holds no solid: it was not written by"),
        ({"form": np.array('{"version":1,"tree":[]}')}, "solid of the archive has no meaning"),
        ({"form": np.array('{"version":1,"tree":{"tuple":[]}}')}, "holds a tuple, not a solid"),
    ):
        np.savez("a.npz", **arrays)
        with pytest.raises(InputError, match=words):
            load("a.npz")


def test_several_files_are_written_together_or_not_at_all(here):
    (here / "a").write_text("old")
    (here / "folder").mkdir()

    def fail(path):
        path.write_text("half")
        raise OSError(28, "No space left on device")

    def new(path):
        path.write_text("new")

    for other, write, words in (("b", fail, "No space left"), ("folder", new, "it is a folder")):
        with pytest.raises(InputError, match=f"cannot be written: {words}"):
            write_atomically({here / "a": new, here / other: write})
        assert (here / "a").read_text() == "old"
        assert sorted(path.name for path in here.iterdir()) == ["a", "folder"]
    write_atomically({here / "a": new})
    assert (here / "a").read_text() == "new"


@pytest.fixture
def tilted(monkeypatch):
    """Pose of the tilted frame in which a recorded ellipsoid was sliced."""
    frame = np.array([0.01, 0.0, 0.05, 0.28, 0.0, 0.0, 0.96])
    contours = tuple(Pose.from_array(frame).to_outer(ellipsoid(z, 1e-3)) for z in HEIGHTS)
    places = tuple(f"contour {i}" for i in range(len(contours)))
    found = MeasuredContours(contours, places, frame=frame)
    monkeypatch.setattr("palpate.tools.reconstruction.read_points", lambda path: found)
    return frame


def test_recording_in_tilted_frame_gives_solid_in_world_frame(tilted, here, figures, printed,
                                                              refusal):  # fmt: skip
    outs = ("-o", "a.ply", "-o", "a.npz", "--lattice", "a.vtk")
    record = figures("a.mcap", "--bottom", "-0.05", "--top", "0.05", *outs)  # along the axis
    assert record["uncovered_m"] == [0.0, 0.0]
    assert not any("touched at" in text for text in record["warnings"])
    solid = load(here / "a.npz")
    for points in (solid.mesh().vertices, read_mesh_or_points(here / "a.ply", "m").vertices):
        local = Pose.from_array(tilted).to_local(points) / [0.03, 0.024, 0.05]
        assert np.linalg.norm(local, axis=1) == pytest.approx(1.0, abs=1e-3)
    first = repr(float(solid.control_lattice.control[0, 0, 0, 0]))
    assert f"\n{first} " in (here / "a.vtk").read_text()
    # Its ends are doubted by their height along the axis.
    text = printed("a.mcap", "--top", "0.08", "--method", "coarse")
    assert "the top was touched at height 80 mm, and the solid ends at" in text
    beyond = "--top 0.01: must lie beyond the contours, which go from -0.045"
    assert beyond in refusal("rebuild a.mcap --top 0.01")


GENERAL = ("--method", "general", "--unit", "mm")


def torus(number):
    """Points of a torus in no order, in mm, with normals (n, 6)."""
    u, v = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, (2, number))
    normals = np.column_stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)])
    middle = 30.0 * np.column_stack([np.cos(u), np.sin(u), np.zeros(number)])
    return np.hstack([middle + 12.0 * normals, normals])


NAMES = ("x", "y", "z", "nx", "ny", "nz")


def test_points_with_normals_are_read_from_every_format(here):
    rows = torus(50)
    properties = "\n".join(f"property float {name}" for name in NAMES)
    head = f"ply\nformat ascii 1.0\nelement vertex 50\n{properties}\nend_header"
    np.savetxt("ring.ply", rows, header=head, comments="")
    np.savetxt("ring.csv", rows, delimiter=",", header=",".join(NAMES), comments="")
    np.savez("ring.npz", points=rows[:, :3], normals=rows[:, 3:])
    wanted, *others = (read_oriented(here / f"ring.{kind}")[0] for kind in ("csv", "npz", "ply"))
    for found in others:
        np.testing.assert_allclose(found.points, wanted.points, atol=1e-5)
        np.testing.assert_allclose(found.normals, wanted.normals, atol=1e-6)


@pytest.mark.slow
def test_points_in_no_order_become_a_solid_with_a_hole(here, figures, printed):
    rows = torus(700)
    np.savetxt("ring.csv", rows, delimiter=",", header=",".join(NAMES), comments="")
    record = figures("ring.csv", *GENERAL, "-o", "a.npz", "-o", "a.stl")
    assert record["genus"] == 1 and record["watertight"] and record["far_share"] < 0.08
    assert record["volume_m3"] == pytest.approx(2.0 * np.pi**2 * 0.03 * 0.012**2, rel=0.01)
    off = np.abs(load("a.npz").distance([[0.042, 0.0, 0.0], [0.0, 0.03, 0.012]]))
    assert off.max() < record["error_bound_95_m"] < 5e-4
    half = rows[rows[:, 0] > -10.0]
    np.savez("half.npz", points=half[:, :3], normals=half[:, 3:])
    assert "of the surface lies over 5 mm from any point" in printed("half.npz", *GENERAL)


@pytest.mark.parametrize(
    ("header", "options", "words"),
    [
        ("x,y,z,a,b,c", (), "has no columns nx, ny, nz; points in no order need normals"),
        ("x,y,z,nx,ny,nz", ("--top", "3"), "--top is of no use with --method general"),
        ("x,y,z,nx,ny,nz", (), "must not all lie in one plane"),
    ],
)
def test_points_without_a_general_solid_are_refused(here, refusal, header, options, words):
    level = np.random.default_rng(1).uniform(size=(9, 2))
    rows = np.column_stack([level, np.zeros((9, 3)), np.ones(9)])
    np.savetxt("flat.csv", rows, delimiter=",", header=header, comments="")
    assert words in refusal("rebuild flat.csv -o a.stl --method general", *options)
    assert not (here / "a.stl").exists()


@pytest.mark.slow
def test_run_gives_all_its_touches_to_the_general_method(run_folder, figures, refusal):
    record = figures(run_folder, "--method", "general")
    assert record["watertight"] and not record["unit_assumed"]
    assert record["volume_m3"] == pytest.approx(4.0 / 3.0 * np.pi * 0.03**3, rel=0.05)
    assert "recordings are in m" in refusal("rebuild", run_folder, *GENERAL)
