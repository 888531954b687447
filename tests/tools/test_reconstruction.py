import json
import os
import re

import numpy as np
import pytest
import trimesh

import palpate
from palpate.core.archive import tree_to_bytes
from palpate.core.poses import inverse_pose, transform_points
from palpate.launch.files.file_access import write_atomically
from palpate.launch.files.point_clouds import MeasuredContours
from palpate.launch.files.solid_file import load, save
from palpate.launch.files.source_map import InputError
from palpate.tools.cli import command_line as cli
from palpate.tools.scoring import read_mesh_or_points

TURN = 2 * np.pi * np.arange(30) / 30
HEIGHTS = np.linspace(-45.0, 45.0, 10)


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def table(home):
    """An ellipsoid of 100 mm, without its ends, in mm."""
    lines = ["x,y,z,contour"]
    for number, z in enumerate(HEIGHTS):
        r = 30.0 * np.sqrt(1.0 - (z / 50.0) ** 2)
        for t in TURN:
            lines.append(f"{r * np.cos(t):.6f},{0.8 * r * np.sin(t):.6f},{z:.6f},{number}")
    path = home / "points.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def run(*arguments):
    return cli.run(["rebuild", *map(str, arguments)])


def sentence(output):
    """The one line on standard error, which is all that there may be."""
    out, err = output.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "Traceback" not in err
    return err


def test_every_file_that_is_asked_for_is_written_in_its_unit(table, home, capsys):
    names = ["a.ply", "a.stl", "a.glb", "a.obj", "a.3mf", "a.npz"]
    asked = [part for name in names for part in ("-o", name)]
    assert run(table, "--unit", "mm", "--top", 50, "--bottom", -50, *asked) == 0
    published = capsys.readouterr().out
    assert all(f"wrote      {name}" in published for name in names)
    assert sorted(path.name for path in home.iterdir()) == sorted([*names, "points.csv"])
    shapes = [read_mesh_or_points(home / name, None) for name in names if name != "a.3mf"]
    shapes.append(trimesh.load(home / "a.3mf").convert_units("meters").to_mesh())
    for shape in shapes:
        assert np.ptp(shape.vertices, axis=0) == pytest.approx([0.06, 0.048, 0.1], rel=0.01)
        assert trimesh.Trimesh(shape.vertices, shape.faces).volume == pytest.approx(
            4 / 3 * np.pi * 0.03 * 0.024 * 0.05, rel=0.01
        )


def test_what_was_read_left_out_and_doubted_is_told(table, capsys):
    lines = table.read_text().splitlines()
    lines[5] = "nan," + lines[5].split(",", 1)[1]
    lines += ["1,1,90,77", "2,2,90,77"]
    table.write_text("\n".join(lines))
    assert run(table, "--unit", "mm") == 0
    published = " ".join(capsys.readouterr().out.split())
    assert "11 contours, 301 points, unit mm" in published
    assert "left out 1 point not finite, line 6" in published
    assert "dropped contour 77 (lines 302 to 303): too few points" in published
    assert "watertight yes, holes through it 0" in published
    assert "root mean square" in published


def test_ends_that_nobody_touched_are_doubted_and_touched_ones_not(home, capsys):
    square = np.column_stack([np.cos(TURN), np.sin(TURN)])
    parts = {f"contour_{i}": np.column_stack([square, np.full(30, z)]) for i, z in enumerate("")}
    for i, z in enumerate(np.linspace(0.1, 0.9, 9)):
        parts[f"contour_{i}"] = np.column_stack([square, np.full(30, z)])
    np.savez(home / "tin.npz", **parts)
    assert run("tin.npz") == 0
    published = " ".join(capsys.readouterr().out.split())
    assert "unit m (assumed; if not, give --unit)" in published
    assert "--bottom or --tops says where" in published
    assert "--top or --tops says where" in published
    (home / "tops.csv").write_text("0 0 0\n0 0 1\n")
    assert run("tin.npz", "--tops", "tops.csv") == 0
    assert "says where" not in capsys.readouterr().out


def test_figures_are_printed_as_json(table, capsys):
    assert run(table, "--unit", "cm", "--json", "--method", "coarse") == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["method"] == "coarse"
    assert figures["contours"] == 10
    assert figures["watertight"] is True
    assert figures["error_rms_m"] is None
    assert figures["unit_assumed"] is False
    assert figures["written"] == []
    assert figures["size_m"] == pytest.approx([0.6, 0.48, 1.0], rel=0.05)


def test_a_wrong_unit_is_doubted(table, capsys):
    assert run(table) == 0
    assert "m in size when read in m: is the unit right?" in capsys.readouterr().out


def test_a_cloud_is_rebuilt_and_its_order_told(table, home, capsys):
    points = np.loadtxt(table, delimiter=",", skiprows=1)[:, :3]
    cloud = trimesh.PointCloud(np.random.default_rng(0).permutation(points))
    cloud.export(home / "cloud.ply")
    assert run("cloud.ply", "--unit", "mm") == 0
    published = " ".join(capsys.readouterr().out.split())
    assert "300 points lie at 10 heights" in published
    assert "by azimuth about each slice's middle" in published


@pytest.mark.parametrize("suffix", [".npz", ".vtk"])
def test_the_control_lattice_is_written(table, home, suffix):
    name = f"lattice{suffix}"
    assert run(table, "--unit", "mm", "--lattice", name, "-o", "solid.npz") == 0
    fit = palpate.load(home / "solid.npz").lattice
    assert fit is not None
    control = fit.lattice.control
    if suffix == ".npz":
        with np.load(home / name) as arrays:
            assert np.array_equal(arrays["control"], control)
            assert arrays["undeformed"].shape == control.shape
            assert len(arrays["knots_u"]) == control.shape[2] + arrays["degree_u"] + 1
        return
    lines = (home / name).read_text().splitlines()
    assert lines[3:6] == [
        "DATASET STRUCTURED_GRID",
        "DIMENSIONS {} {} {}".format(*control.shape[:3]),
        f"POINTS {control[..., 0].size} double",
    ]
    rows = np.array([line.split() for line in lines[6 : 6 + control[..., 0].size]], float)
    assert np.array_equal(rows[1], control[1, 0, 0])
    assert np.array_equal(rows[control.shape[0]], control[0, 1, 0])
    start = lines.index("VECTORS undeformed double") + 1
    undeformed = np.array([line.split() for line in lines[start : start + len(rows)]], float)
    assert np.isfinite(undeformed).all()
    assert "VECTORS displacement double" in lines


@pytest.mark.parametrize(
    ("arguments", "published"),
    [
        (["-o", "a.step"], "-o a.step: must end in one of .ply, .stl, .glb, .obj, .3mf, .npz"),
        (["-o", "nowhere/a.ply"], "there is no folder nowhere"),
        (["-o", "a.ply", "-o", "a.ply"], "each file that is written must have a name of its own"),
        (["--lattice", "a.txt"], "--lattice a.txt: must end in one of .npz, .vtk"),
        (["--lattice", "a.vtk", "--method", "skin"], "the method skin has no control lattice"),
        (["--top", "3"], "--top 3: must lie beyond the contours, which go from -45 to 45"),
        (["--bottom", "-44"], "--bottom -44: must lie beyond the contours"),
        (["--noise", "-1"], "--noise"),
        (["--unit", "furlong"], "--unit"),
        (["--tops", "no.csv"], "no.csv: cannot be read"),
        (["--tolerance", "1e-9", "--unit", "mm"], "--tolerance 1e-09: 1e-09 mm would take more"),
        (["--tolerance", "nan"], "--tolerance nan: must be a finite number"),
        (["--noise", "inf"], "--noise inf: must be a finite number"),
        (["--noise", "1e6", "--unit", "cm"], "--noise 1e+06: must be less than the object is"),
        (["--top", "inf"], "--top inf: must be a finite number"),
    ],
)
def test_bad_input_is_one_sentence_and_nothing_is_written(
    table, home, capsys, arguments, published
):
    before = sorted(home.iterdir())
    assert run(table, *arguments) == cli.BAD_INPUT
    assert published in sentence(capsys)
    assert sorted(home.iterdir()) == before


def test_contours_of_which_nothing_can_be_made_are_refused_by_file(home, capsys):
    (home / "line.csv").write_text(
        "x,y,z,contour\n" + "".join(f"{i},0,{k},{k}\n" for k in (0, 1) for i in range(9))
    )
    assert run("line.csv", "-o", "a.ply") == cli.BAD_INPUT
    assert "line.csv: " in sentence(capsys)
    assert not (home / "a.ply").exists()


def test_the_points_themselves_are_not_overwritten(home, capsys):
    np.savez(home / "a.npz", contour_0=np.eye(3), contour_1=np.eye(3) + 1.0)
    assert run("a.npz", "-o", home / "a.npz") == cli.BAD_INPUT
    assert "is the file that is read; write to another" in sentence(capsys)


def test_a_recording_that_is_none_is_refused(home, capsys):
    (home / "a.mcap").write_bytes(b"nothing")
    assert run("a.mcap") == cli.BAD_INPUT
    sentence(capsys)
    assert run("a.mcap", "--unit", "mm") == cli.BAD_INPUT
    assert "recordings are in m" in sentence(capsys)
    assert run("missing", "--unit", "mm") == cli.BAD_INPUT
    assert "missing: cannot be read: No such file" in sentence(capsys)
    (home / "empty").mkdir()
    assert run("empty") == cli.BAD_INPUT
    assert "empty: is no folder of a run: it holds no topics.mcap" in sentence(capsys)


def test_an_end_far_beyond_the_contours_is_a_guess(table, capsys):
    assert run(table, "--unit", "mm", "--top", 100, "--bottom", -50) == 0
    published = " ".join(capsys.readouterr().out.split())
    assert (
        "the top lies 55 mm above the highest contour, where contours are at most 10 mm"
        in published
    )
    assert "the bottom lies" not in published


def test_a_touched_end_that_the_method_does_not_reach_is_told(table, capsys):
    assert run(table, "--unit", "mm", "--top", 50, "--bottom", -50, "--method", "thesis") == 0
    published = " ".join(capsys.readouterr().out.split())
    assert "the top was touched at z = 50 mm, and the solid ends at 4" in published
    assert "the bottom was touched at z = -50 mm, and the solid ends at -4" in published


def test_doubts_of_the_superquadric_are_told(table, capsys):
    lines = [line for line in table.read_text().splitlines() if not line.endswith(tuple("56789"))]
    table.write_text("\n".join(lines))
    assert run(table, "--unit", "mm", "--method", "coarse") == 0
    assert "the superquadric's fit is" in capsys.readouterr().out


def test_contours_that_are_odd_but_used_are_named(home, capsys):
    star = 1.0 + 0.9 * np.cos(5 * TURN)
    lines = ["x,y,z,contour"]
    for number, z in enumerate(np.linspace(0.0, 1.0, 4)):
        wide = 1.0 if number != 2 else star
        ring = np.column_stack([wide * np.cos(TURN) + 0.8 * (number == 2), wide * np.sin(TURN)])
        lines += [f"{x:.6f},{y:.6f},{z:.6f},{number + 17}" for x, y in ring]
    (home / "odd.csv").write_text("\n".join(lines))
    assert run("odd.csv") == 0
    published = " ".join(capsys.readouterr().out.split())
    assert "warning contour 19 (lines 62 to 91)" in published


def test_a_surface_that_passes_through_itself_is_told_and_nothing_is_promised_of_it(home, capsys):
    away = 0.02 + 0.03 * np.cos(TURN)  # a limacon, whose inner loop is a second sheet
    rows = [
        f"{x:.6f},{y:.6f},{z:.6f},{number}"
        for number, z in enumerate(np.linspace(0.0, 0.06, 5))
        for x, y in zip(away * np.cos(TURN), away * np.sin(TURN), strict=True)
    ]
    (home / "looped.csv").write_text("\n".join(["x,y,z,contour", *rows]))
    assert run("looped.csv", "--unit", "m") == 0
    published = " ".join(capsys.readouterr().out.split())
    assert "confidence none: the surface passes through itself" in published
    assert re.search(r"passes through itself: \d+ pairs of triangles cross", published)
    assert run("looped.csv", "--unit", "m", "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["self_intersections"] > 0
    assert figures["error_rms_m"] is None


def test_contours_that_cannot_be_used_are_called_as_in_the_file(home, capsys):
    rows = [f"{i},0,{k},{k + 17}" for k in range(9) for i in range(2)]
    (home / "few.csv").write_text("\n".join(["x,y,z,contour", *rows]))
    assert run("few.csv") == cli.BAD_INPUT
    published = sentence(capsys)
    assert "contour 17 (lines 2 to 3): too few points; contour 18" in published
    assert published.endswith("; and 3 more\n")


def test_a_solid_is_saved_and_loaded_whole(table, home, capsys):
    assert run(table, "--unit", "mm", "-o", "first.npz") == 0
    solid = palpate.load("first.npz")
    palpate.save(solid, home / "second.npz")
    assert np.array_equal(*map(tree_to_bytes, (solid, load(home / "second.npz"))))
    assert (home / "first.npz").read_bytes() == (home / "second.npz").read_bytes()
    with pytest.raises(InputError, match=r"must end in \.npz"):
        save(solid, "a.ply")
    with pytest.raises(InputError, match="cannot be written"):
        save(solid, "nowhere/a.npz")
    (home / "file").touch()
    with pytest.raises(InputError, match="there is no folder file"):
        save(solid, "file/a.npz")
    with pytest.raises(TypeError, match="solid must be a Solid, as reconstruct returns it, got 3"):
        save(3, "a.npz")


def test_what_holds_no_solid_is_not_loaded(home):
    with pytest.raises(InputError, match="cannot be read: No such file"):
        load("a.npz")
    np.savez(home / "a.npz", x=np.ones(3))
    with pytest.raises(InputError, match="holds no solid: it was not written by"):
        load("a.npz")
    np.savez(home / "b.npz", form=np.array('{"version":1,"tree":[]}'))
    with pytest.raises(InputError, match=r"b.npz: solid of the archive has no meaning"):
        load("b.npz")
    np.savez(home / "c.npz", form=np.array('{"version":1,"tree":{"tuple":[]}}'))
    with pytest.raises(InputError, match=r"c.npz: holds a tuple, not a solid"):
        load("c.npz")


def test_several_files_are_written_together_or_not_at_all(home):
    (home / "a").write_text("old")
    (home / "folder").mkdir()

    def fail(path):
        path.write_text("half")
        raise OSError(28, os.strerror(28))

    for files in (
        {home / "a": lambda path: path.write_text("new"), home / "b": fail},
        {home / "a": lambda path: path.write_text("new"), home / "c": fail},
    ):
        with pytest.raises(InputError, match="cannot be written: No space left"):
            write_atomically(files)
        assert (home / "a").read_text() == "old"
        assert sorted(path.name for path in home.iterdir()) == ["a", "folder"]
    with pytest.raises(InputError, match="folder: cannot be written: it is a folder"):
        write_atomically(
            {home / name: lambda path: path.write_text("new") for name in ("a", "folder")}
        )
    assert (home / "a").read_text() == "old"
    write_atomically({home / "a": lambda path: path.write_text("new")})
    assert (home / "a").read_text() == "new"


REBUILD_FRAMED_HEIGHTS = np.linspace(-0.045, 0.045, 10)


def rebuild_framed_run(*arguments):
    return cli.run(["rebuild", *arguments])


@pytest.fixture
def recorded(monkeypatch):
    """Pose of the tilted frame in which a recorded ellipsoid of 100 mm was sliced."""
    frame = np.array([0.01, 0.0, 0.05, 0.28, 0.0, 0.0, 0.96])
    contours = []
    for z in REBUILD_FRAMED_HEIGHTS:
        r = 0.03 * np.sqrt(1.0 - (z / 0.05) ** 2)
        ring = np.column_stack([r * np.cos(TURN), 0.8 * r * np.sin(TURN), np.full(len(TURN), z)])
        contours.append(transform_points(frame, ring))
    places = tuple(f"contour {i}" for i in range(len(contours)))
    found = MeasuredContours(tuple(contours), places, frame=frame)
    monkeypatch.setattr("palpate.launch.files.read_points", lambda path: found)
    return frame


def test_a_recording_in_a_tilted_frame_gives_a_solid_in_the_world(recorded, home, capsys):
    heights = ("--bottom", "-0.05", "--top", "0.05")  # along the slicing axis
    outs = ("-o", "a.ply", "-o", "a.npz", "--lattice", "a.vtk", "--json")
    assert rebuild_framed_run("a.mcap", *heights, *outs) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["uncovered_m"] == [0.0, 0.0]
    assert not any("touched at" in text for text in record["warnings"])
    solid = load(home / "a.npz")
    shape = read_mesh_or_points(home / "a.ply", "m")
    for points in (solid.mesh().vertices, shape.vertices):
        local = transform_points(inverse_pose(recorded), points) / [0.03, 0.024, 0.05]
        assert np.linalg.norm(local, axis=1) == pytest.approx(1.0, abs=1e-3)
    assert solid.control_lattice is not None
    first = repr(float(solid.control_lattice.control[0, 0, 0, 0]))
    assert f"\n{first} " in (home / "a.vtk").read_text()


def test_ends_along_a_tilted_axis_are_doubted_by_their_height(recorded, capsys):
    assert rebuild_framed_run("a.mcap", "--top", "0.08", "--method", "coarse") == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "the top was touched at height 80 mm, and the solid ends at" in text
    assert rebuild_framed_run("a.mcap", "--top", "0.01") == cli.BAD_INPUT
    assert (
        "--top 0.01: must lie beyond the contours, which go from -0.045" in capsys.readouterr().err
    )


@pytest.fixture
def ring():
    """Points of a torus in no order, in mm, with normals."""
    u, v = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, (2, 700))
    normals = np.column_stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)])
    middle = 30.0 * np.column_stack([np.cos(u), np.sin(u), np.zeros(700)])
    return middle + 12.0 * normals, normals


def write_table(path, rows, header="x,y,z,nx,ny,nz"):
    np.savetxt(path, rows, delimiter=",", header=header, comments="")


def test_points_in_no_order_become_a_solid_with_a_hole(ring, home, capsys):
    write_table(home / "ring.csv", np.hstack(ring))
    np.savez(home / "ring.npz", points=ring[0], normals=ring[1])
    names = "\n".join(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz"))
    head = f"ply\nformat ascii 1.0\nelement vertex 700\n{names}\nend_header"
    np.savetxt(home / "ring.ply", np.hstack(ring), header=head, comments="")
    for name in ("ring.csv", "ring.npz", "ring.ply"):
        out = home / f"{name}.npz"
        asked = ("--method", "general", "--unit", "mm", "-o", out, "-o", home / f"{name}.stl")
        assert run(home / name, *asked, "--json") == 0
        found = json.loads(capsys.readouterr().out)
        assert found["genus"] == 1 and found["watertight"] and found["far_share"] < 0.08
        assert found["volume_m3"] == pytest.approx(2.0 * np.pi**2 * 0.03 * 0.012**2, rel=0.01)
        off = np.abs(load(out).distance([[0.042, 0.0, 0.0], [0.0, 0.03, 0.012]]))
        assert off.max() < found["error_bound_95_m"] < 5e-4


def test_what_no_point_is_near_to_is_told(ring, home, capsys):
    points, normals = (one[ring[0][:, 0] > -10.0] for one in ring)
    np.savez(home / "half.npz", points=points, normals=normals)
    assert run(home / "half.npz", "--method", "general", "--unit", "mm") == 0
    assert "of the surface lies over 5 mm from any point" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("header", "options", "words"),
    [
        ("x,y,z,a,b,c", (), "has no columns nx, ny, nz; points in no order need normals"),
        ("x,y,z,nx,ny,nz", ("--top", "3"), "--top is of no use with --method general"),
        ("x,y,z,nx,ny,nz", (), "must not all lie in one plane"),
    ],
)
def test_points_that_make_no_general_solid_are_one_sentence(home, capsys, header, options, words):
    level = np.random.default_rng(1).uniform(size=(9, 2))
    write_table(home / "flat.csv", np.column_stack([level, np.zeros((9, 3)), np.ones(9)]), header)
    assert run(home / "flat.csv", "--method", "general", "-o", home / "a.stl", *options) == 2
    assert words in sentence(capsys)
    assert not (home / "a.stl").exists()


def test_run_gives_all_its_touches_to_the_general_method(run_folder, capsys):
    assert run(run_folder, "--method", "general", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["watertight"] and not found["unit_assumed"]
    assert found["volume_m3"] == pytest.approx(4.0 / 3.0 * np.pi * 0.03**3, rel=0.05)
    assert run(run_folder, "--method", "general", "--unit", "mm") == 2
    assert "recordings are in m" in sentence(capsys)
