"""Points of users: tables, arrays, clouds and recordings become contours."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.poses import IDENTITY_POSE, Pose
from palpate.launch.files.points_file import read_points, read_tops
from palpate.launch.files.source_map import InputError
from palpate.messages.types import Contour, PlanDone, Probe, SurfacePatch, World
from palpate.nodes.reconstructor import NODE
from palpate.nodes.specs.sensors import SensorSpec, info_of
from palpate.testing import example
from tests.launch.files.samples import MESHES, ply_head
from tests.tools.recordings import write_recording

TURN = 2 * np.pi * np.arange(24) / 24


def ring(z, radius=3.0):
    return np.column_stack([radius * np.cos(TURN), radius * np.sin(TURN), np.full(24, z)])


@pytest.mark.parametrize("mark", [",", ";", "\t", " "], ids=["comma", "semicolon", "tab", "blank"])
def test_table_gives_its_contours_in_order(write, mark):
    rows = [[1, 2, 3, 7], [4, 5, 6, 7], [7, 8, 9, 2], [1, 1, 1, 7]]
    lines = [mark.join(map(str, row)) for row in [["z", "y", "X", "contour"], *rows]]
    text = "\n".join(["# a comment", *lines])
    table = read_points(write("a.csv", f"{text}  # the last\n\n"))
    expected = [[[3, 2, 1], [6, 5, 4], [1, 1, 1]], [[9, 8, 7]]]
    assert [one.tolist() for one in table.contours] == expected
    assert table.places == ("contour 7 (lines 3 to 6)", "contour 2 (lines 5 to 5)")
    assert table.normals is None and table.taxels is None


def test_normals_and_touches_are_read_and_points_not_finite_left_out(write):
    text = "x,y,z,contour,colour,nx,ny,nz,touch\n0,1,2,0,red,1,0,0,4\n3,4,5,0,blue,0,1,0,5\n"
    table = read_points(write("a.csv", text))
    assert table.normals is not None and table.taxels is not None
    assert table.normals[0].tolist() == [[1, 0, 0], [0, 1, 0]]
    assert table.taxels.touch.tolist() == [0, 1]
    assert table.taxels.points.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert table.scaled(0.1).taxels.points.max() == pytest.approx(0.5)  # type: ignore[union-attr]
    lines = ["x,y,z,contour"] + [f"{i},nan,0,0" if i % 3 else f"{i},1,0,0" for i in range(12)]
    table = read_points(write("a.csv", "\n".join(lines)))
    assert len(table.contours[0]) == 4
    assert table.notes == ("left out 8 points not finite, lines 3, 4, 6, 7, 9, 10 and 2 more",)


@pytest.mark.parametrize(("text", "words"), [
    ("", "a.csv: holds no points"),
    ("# nothing\n", "a.csv: holds no points"),
    ("x,y,z\n", "a.csv:1: holds no points under its header"),
    ("x,y\n1,2\n", "a.csv:1: lacks the column z"),
    ("x,y,z,x\n1,2,3,4\n", "a.csv:1: has the column x more than once"),
    ("x,y,z,nx\n1,2,3,4\n", "a.csv:1: has nx alone; nx, ny and nz belong together"),
    ("1,2,3,4\n", "a.csv:1: has 4 columns and no header; name them, as in x,y,z,contour"),
    ("x,y,z\n1,2,3\n\n1,2\n", "a.csv:4: has 2 columns where 3 are named"),
    ("x,y,z\n1,two,3\n", "a.csv:2: y must be a number, got 'two'"),
    ("x,y,z,contour\n1,2,3,1.5\n", "a.csv:2: contour must be a whole number, got 1.5"),
    ("x,y,z,touch\n1,2,3,1e20\n", "a.csv:2: touch must be at most 2147483647, got 1e+20"),
    ("x,y,z,contour\nnan,2,3,1\n", "a.csv: holds no points"),
    ("x,y,z\n1,2,3\n", "a.csv: holds 1 points; at least 6 are needed"),
])  # fmt: skip
def test_bad_table_is_refused_with_its_line(write, text, words):
    with pytest.raises(InputError, match=re.escape(words)):
        read_points(write("a.csv", text))


def test_file_without_text_or_points_is_refused_and_tops_are_a_table(tmp_path, write):
    (tmp_path / "a.csv").write_bytes(b"x,y,z\n1,2,3\n\xff\xfe\n")
    with pytest.raises(InputError, match=r"a\.csv:3: is no text in UTF-8"):
        read_points(tmp_path / "a.csv")
    (tmp_path / "a.stl").touch()
    with pytest.raises(InputError, match=r"'.stl' is no format of points; known: .npz"):
        read_points(tmp_path / "a.stl")
    (tmp_path / "a.ply").write_bytes(MESHES["text.ply"])
    with pytest.raises(InputError, match="holds a surface; palpate score measures it"):
        read_points(tmp_path / "a.ply")
    with pytest.raises(InputError, match=r"b.csv: cannot be read: No such file"):
        read_points(tmp_path / "b.csv")
    with pytest.raises(InputError, match=r"topics.mcap"):
        read_points(tmp_path)
    tops = read_tops(write("t.csv", "0 0 5\n0 0 -1\n"))
    assert tops.tolist() == [[0, 0, 5], [0, 0, -1]]
    with pytest.raises(InputError, match="holds no points that are finite"):
        read_tops(write("u.csv", "0 0 nan\n"))


def test_arrays_give_contours_in_each_of_three_forms(tmp_path):
    rings = [ring(0.0), ring(1.0), ring(2.0)]
    np.savez(tmp_path / "a.npz", contour_10=rings[2], contour_2=rings[1], contour_0=rings[0])
    np.savez(tmp_path / "b.npz", contours=np.array(rings), tops=[[0, 0, 3.0]])
    numbers = np.repeat([5, 1, 9], 24)
    points = np.concatenate(rings)
    more = {"normals": points, "touch": numbers}
    np.savez(tmp_path / "c.npz", contours=points, contour=numbers, **more)
    for name in "abc":
        read = read_points(tmp_path / f"{name}.npz")
        assert np.array_equal(np.array(read.contours), np.array(rings))
        assert (read.tops is not None) == (name == "b")
        assert (read.normals is not None) == (name == "c")
    assert read_points(tmp_path / "c.npz").places == ("contour 5", "contour 1", "contour 9")


@pytest.mark.parametrize(("arrays", "words"), [
    ({"points": ring(0.0)}, "must hold contours and contour, or contour_0"),
    ({}, "it holds nothing"),
    ({"contours": ring(0.0)}, "contour must number them"),
    ({"contours": ring(0.0), "contour": np.zeros(3)}, "contour must have 24 rows"),
    ({"contour_0": np.zeros((3, 2))}, r"contour_0 must be (n, 3), got float64 (3, 2)"),
    ({"contour_0": ring(0.0), "normals_1": ring(0.0)}, "lacks normals_0"),
    ({"contour_0": ring(0.0), "normals_0": np.ones((2, 3))}, "normals_0 must have 24 rows"),
    ({"contours": np.array(["a"])}, "contours must be (n, 3)"),
    ({"contours": np.array([None])}, "a.npz: is no NPZ file of numbers"),
    ({"contour_0": ring(0.0), "tops": np.ones(3)}, "tops must be (n, 3)"),
])  # fmt: skip
def test_bad_arrays_are_refused(tmp_path, arrays, words):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=re.escape(words)):
        read_points(tmp_path / "a.npz")


@pytest.mark.parametrize("wrong", [np.nan, 0.5, 1e20])
@pytest.mark.parametrize("name", ["contour", "touch"])
def test_numbers_of_contours_and_touches_are_whole(tmp_path, name, wrong):
    numbers = np.repeat([0.0, 1.0], 24)
    arrays: dict[str, Any] = {"contour": numbers, "touch": numbers}
    arrays[name] = np.where(np.arange(48) == 7, wrong, numbers)
    np.savez(tmp_path / "a.npz", contours=np.concatenate([ring(0.0), ring(1.0)]), **arrays)
    with pytest.raises(InputError, match=f"{name} must hold whole numbers up to .* in row 7"):
        read_points(tmp_path / "a.npz")


def read_cloud(folder, points):
    how = {"fmt": "%.17g", "delimiter": ",", "header": "x,y,z", "comments": ""}
    np.savetxt(folder / "cloud.csv", points, **how)
    return read_points(folder / "cloud.csv")


def test_ply_without_faces_is_a_cloud(tmp_path):
    rings = np.concatenate([ring(z) for z in (0.0, 1.0, 2.0)])
    header = ply_head("binary_little_endian", 0).replace("vertex 162", f"vertex {len(rings)}")
    (tmp_path / "a.ply").write_bytes(header.encode() + rings.astype("<f4").tobytes())
    found = read_points(tmp_path / "a.ply")
    assert [len(one) for one in found.contours] == [24] * 3
    assert [one[0, 2] for one in found.contours] == [0.0, 1.0, 2.0]


def tour(loop):
    return np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)


def test_cloud_is_cut_at_its_heights_and_ordered(tmp_path):
    rng = np.random.default_rng(0)
    rings = [ring(z, 3.0 + z) for z in (0.0, 0.7, 2.0, 3.1)]
    noisy = np.concatenate(rings) + 0.01 * rng.normal(size=(96, 3))
    cloud = read_cloud(tmp_path, noisy[rng.permutation(96)])
    assert [len(contour) for contour in cloud.contours] == [24] * 4
    for contour, true in zip(cloud.contours, rings, strict=True):
        assert tour(contour).max() < 1.3 * tour(true).max()
    assert "96 points lie at 4 heights" in cloud.notes[0]
    assert cloud.places[0].startswith("slice 0 (z = ")
    exact = np.concatenate([ring(z)[:10] * [1.0, 0.4, 1.0] for z in (0.0, 1e-3, 5.0, 5.5)])
    cloud = read_cloud(tmp_path, rng.permutation(exact))
    assert [len(contour) for contour in cloud.contours] == [10] * 4
    for contour in cloud.contours:  # by azimuth about the middle
        offsets = (contour - contour.mean(axis=0))[:, :2]
        steps = np.diff(np.unwrap(np.arctan2(offsets[:, 1], offsets[:, 0])))
        assert (steps > 0.0).all() or (steps < 0.0).all()


def test_horseshoe_is_ordered_by_the_shortest_tour(tmp_path):
    turn = np.linspace(-2.4, 2.4, 30)
    outer = 3.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    true = np.concatenate([outer, 0.6 * outer[::-1]])
    cloud = np.column_stack([np.tile(true, (3, 1)), np.repeat([0.0, 1.0, 2.0], len(true))])
    cut = read_cloud(tmp_path, np.random.default_rng(1).permutation(cloud))
    assert "3 of 3 slices are not star-shaped" in cut.notes[1]
    for contour in cut.contours:
        assert sorted(map(tuple, contour[:, :2])) == sorted(map(tuple, true))
        assert tour(contour).sum() <= tour(true).sum() * (1 + 1e-9)


@pytest.mark.parametrize(
    "z",
    [np.linspace(0.0, 1.0, 60), np.zeros(60), np.random.default_rng(0).random(200)],
    ids=["ramp", "one height", "anywhere"],
)
def test_cloud_without_repeated_heights_is_refused(z, tmp_path):
    places = np.random.default_rng(1).random((len(z), 2))
    with pytest.raises(ValueError, match="do not lie at repeated heights"):
        read_cloud(tmp_path, np.column_stack([places, z]))


OTHERS = ("/model/goal", "/hand/contacts")  # of which points are no part
TOPICS = {kind: topic for topic, (kind, _) in NODE.inputs.items() if topic not in OTHERS}
WORLD = World(platform=-0.3, reach=0.15, fingers=1, seed=0)
TILTED = np.array([0.01, 0.0, 0.05, 0.6, 0.0, 0.0, 0.8])  # leaning by 73.7 degrees


def recorded(folder, *messages):
    """Points of a recording of what the reconstructor receives."""
    types = {topic: kind.__name__ for kind, topic in TOPICS.items()}
    sent = [(TOPICS[type(message)], message) for message in messages]
    return read_points(write_recording(folder / "topics.mcap", sent, types=types))


def contour(number, status="closed", frame=IDENTITY_POSE):
    places, heights = np.full((4, 3), 0.1 * number), np.full(4, 0.1 * number)
    normals, height = np.tile([1.0, 0.0, 0.0], (4, 1)), 0.1 * number
    ends = {"contact_low": heights, "contact_high": heights, "curvature": np.zeros(4)}
    fields = {"id": number, "frame": frame, "height": height, "points": places, "status": status}
    return example(Contour, normals=normals, finger=1, touches=4, **fields, **ends)


def probe(number, outcome="hit"):
    point, normal = np.array([0.0, 0.0, float(number)]), np.array([0.0, 0.0, 1.0])
    return example(Probe, id=number, outcome=outcome, point=point, normal=normal)


def patch(goal, touch, points):
    """What a touch met, of normals upwards."""
    normals, mask = np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.ones((1, len(points)), bool)
    about = {"mask": mask, "height": np.zeros(mask.shape), "points": points, "normals": normals}
    return example(SurfacePatch, goal=goal, touch=touch, **about)


def test_recording_gives_the_contours_of_its_plan_and_none_that_was_not_closed(tmp_path):
    traced = [contour(1), contour(2), contour(3)]
    probes = [probe(4), probe(5, "miss"), probe(6)]
    read = recorded(tmp_path, *traced, *probes, example(PlanDone, contours=(1, 3), probes=(4, 5)))
    assert read.places == ("contour 1", "contour 3")
    assert [one[0, 0] for one in read.contours] == pytest.approx([0.1, 0.3])
    assert read.tops is not None and read.tops.tolist() == [[0.0, 0.0, 4.0]]
    assert read.normals is not None and len(read.normals) == 2
    read = recorded(tmp_path, contour(1), contour(2, "stuck"))
    assert (read.places, read.tops) == (("contour 1",), None)
    assert "left out 1 contours that were not closed" in read.notes
    with pytest.raises(InputError, match="holds no closed contour, of 1 that were traced"):
        recorded(tmp_path, contour(1, "stuck"))
    with pytest.raises(InputError, match=r"topics\.mcap: contours must be traced in one slicing"):
        recorded(tmp_path, contour(1), contour(2, frame=TILTED))


@pytest.mark.parametrize("frame", [IDENTITY_POSE, TILTED], ids=["upright", "tilted"])
def test_platform_is_a_touch_of_an_upright_object_alone(frame, tmp_path):
    upright = frame is IDENTITY_POSE
    read = recorded(tmp_path, contour(1, frame=frame), contour(2, frame=frame), WORLD)
    assert read.frame is not None and np.array_equal(read.frame, frame)
    tops = None if read.tops is None else read.tops.tolist()
    assert tops == ([[0.0, 0.0, -0.3]] if upright else None)
    notes = " ".join(read.notes)
    assert ("stands on its platform" in notes) == upright
    assert ("sliced along an axis that leans by 73.7 deg" in notes) == (not upright)


def test_probes_touch_the_ends_and_taxels_are_those_of_contours(tmp_path):
    traced = [contour(1, frame=TILTED), contour(2, frame=TILTED)]
    up, down = (Pose.from_array(TILTED).to_outer(np.array([[0.0, 0.0, z]]))[0] for z in (0.4, -0.2))
    probes = [replace(probe(i), point=one) for i, one in enumerate((up, down), 4)]
    read = recorded(tmp_path, *traced, *probes)
    assert read.tops is not None and read.tops == pytest.approx(np.array([up, down]))
    assert read.scaled(1000.0).frame == pytest.approx([10.0, 0.0, 50.0, 0.6, 0.0, 0.0, 0.8])
    points = np.random.default_rng(0).normal(size=(3, 5, 3))
    patches = [patch(1, 4, points[0]), patch(2, 0, points[2]), patch(1, 7, points[1])]
    sensor = info_of(SensorSpec(), 1e-5)
    read = recorded(tmp_path, contour(1), contour(2, "stuck"), sensor, *patches)
    assert read.taxels.touch.tolist() == [0] * 5 + [1] * 5
    assert np.array_equal(read.taxels.points, points[:2].reshape(-1, 3))
    assert np.array_equal(read.taxels.normals, np.tile([0.0, 0.0, 1.0], (10, 1)))
    assert "10 taxels of 2 touches" in read.notes
