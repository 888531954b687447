import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest

from palpate.core.poses import IDENTITY_POSE, transform_points
from palpate.launch.files.point_clouds import order_points, slice_cloud, slices_by_height
from palpate.launch.files.points_file import MESSAGE_TYPES, contours_of, read_points, read_tops
from palpate.launch.files.source_map import InputError
from palpate.messages.types.model import PlanDone
from palpate.messages.types.motion import Contour, ContourStatus, Probe
from palpate.messages.types.touch import SurfacePatch
from palpate.messages.types.world import World
from palpate.nodes.reconstructor import NODE
from palpate.nodes.specs.sensors import SensorSpec, info_of, pad_of_info

TURN = 2 * np.pi * np.arange(24) / 24


def ring(z, radius=3.0):
    return np.column_stack([radius * np.cos(TURN), radius * np.sin(TURN), np.full(24, z)])


def kidney(count=60):
    """A horseshoe, whose middle lies outside of it."""
    turn = np.linspace(-2.4, 2.4, count // 2)
    outer = 3.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    inner = 1.8 * np.column_stack([np.cos(turn[::-1]), np.sin(turn[::-1])])
    return np.concatenate([outer, inner])


def write(folder, name, text):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


@pytest.mark.parametrize("mark", [",", ";", "\t", " "], ids=["comma", "semicolon", "tab", "blank"])
def test_a_table_gives_its_contours_in_the_order_of_its_lines(tmp_path, mark):
    rows = [[1, 2, 3, 7], [4, 5, 6, 7], [7, 8, 9, 2], [1, 1, 1, 7]]
    text = "# a comment\n" + "\n".join(
        mark.join(map(str, row)) for row in [["z", "y", "X", "contour"], *rows]
    )
    found = read_points(write(tmp_path, "a.csv", f"{text}  # the last\n\n"))
    assert [one.tolist() for one in found.contours] == [
        [[3, 2, 1], [6, 5, 4], [1, 1, 1]],
        [[9, 8, 7]],
    ]
    assert found.places == ("contour 7 (lines 3 to 6)", "contour 2 (lines 5 to 5)")
    assert found.normals is None
    assert found.taxels is None


def test_normals_and_touches_are_read_and_other_columns_passed_over(tmp_path):
    text = "x,y,z,contour,colour,nx,ny,nz,touch\n0,1,2,0,red,1,0,0,4\n3,4,5,0,blue,0,1,0,5\n"
    found = read_points(write(tmp_path, "a.csv", text))
    assert found.normals is not None and found.taxels is not None
    assert found.normals[0].tolist() == [[1, 0, 0], [0, 1, 0]]
    assert found.taxels.touch.tolist() == [0, 1]
    assert found.taxels.points.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert found.scaled(0.1).taxels.points.max() == pytest.approx(0.5)  # type: ignore[union-attr]


def test_points_that_are_not_finite_are_left_out_and_their_lines_told(tmp_path):
    lines = ["x,y,z,contour"] + [f"{i},nan,0,0" if i % 3 else f"{i},1,0,0" for i in range(12)]
    found = read_points(write(tmp_path, "a.csv", "\n".join(lines)))
    assert len(found.contours[0]) == 4
    assert found.notes == ("left out 8 points not finite, lines 3, 4, 6, 7, 9, 10 and 2 more",)


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
def test_a_table_that_cannot_be_used_is_refused_with_its_line(tmp_path, text, words):
    with pytest.raises(InputError, match=re.escape(words)):
        read_points(write(tmp_path, "a.csv", text))


def test_what_is_no_text_no_points_or_not_there_is_refused(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"x,y,z\n1,2,3\n\xff\xfe\n")
    with pytest.raises(InputError, match=r"a\.csv:3: is no text in UTF-8"):
        read_points(tmp_path / "a.csv")
    (tmp_path / "a.stl").touch()
    with pytest.raises(InputError, match=r"'.stl' is no format of points; known: .npz"):
        read_points(tmp_path / "a.stl")
    with pytest.raises(InputError, match=r"b.csv: cannot be read: No such file"):
        read_points(tmp_path / "b.csv")
    with pytest.raises(InputError, match=r"topics.mcap"):
        read_points(tmp_path)


def test_contours_come_out_of_arrays_in_each_of_three_forms(tmp_path):
    rings = [ring(0.0), ring(1.0), ring(2.0)]
    np.savez(tmp_path / "a.npz", contour_10=rings[2], contour_2=rings[1], contour_0=rings[0])
    np.savez(tmp_path / "b.npz", contours=np.array(rings), tops=[[0, 0, 3.0]])
    numbers = np.repeat([5, 1, 9], 24)
    np.savez(
        tmp_path / "c.npz",
        contours=np.concatenate(rings),
        contour=numbers,
        normals=np.concatenate(rings),
        touch=numbers,
    )
    for name in "abc":
        found = read_points(tmp_path / f"{name}.npz")
        assert np.array_equal(np.array(found.contours), np.array(rings))
        assert (found.tops is not None) == (name == "b")
        assert (found.normals is not None) == (name == "c")
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
    ({"contour_0": ring(0.0), "tops": np.ones(3)}, "tops must be (n, 3)"),
])  # fmt: skip
def test_arrays_that_cannot_be_used_are_refused(tmp_path, arrays, words):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=re.escape(words)):
        read_points(tmp_path / "a.npz")


def test_a_file_that_only_looks_like_arrays_is_refused(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04 nothing more")
    with pytest.raises(InputError, match=r"a.npz: is no NPZ file"):
        read_points(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", contours=np.array([None]))
    with pytest.raises(InputError, match=r"b.npz: is no NPZ file of numbers"):
        read_points(tmp_path / "b.npz")


def test_a_cloud_is_cut_at_its_heights_and_put_in_order():
    rng = np.random.default_rng(0)
    rings = [ring(z, 3.0 + z) for z in (0.0, 0.7, 2.0, 3.1)]
    noisy = np.concatenate(rings) + 0.01 * rng.normal(size=(96, 3))
    found = slice_cloud(noisy[rng.permutation(96)])
    assert [len(one) for one in found.contours] == [24] * 4
    for one, true in zip(found.contours, rings, strict=True):
        steps = np.linalg.norm(np.roll(one, -1, axis=0) - one, axis=1)
        assert steps.max() < 1.3 * np.linalg.norm(true[1] - true[0])
    assert "96 points lie at 4 heights" in found.notes[0]
    assert found.places[0] == "slice 0 (z = 0.0005471)" or found.places[0].startswith("slice 0")


@pytest.mark.parametrize(
    "z",
    [np.linspace(0.0, 1.0, 60), np.zeros(60), np.random.default_rng(0).random(200)],
    ids=["ramp", "one height", "anywhere"],
)
def test_a_cloud_without_repeated_heights_is_refused(z):
    with pytest.raises(ValueError, match="do not lie at repeated heights"):
        slices_by_height(z)


def test_exact_heights_are_cut_whatever_their_spacing():
    z = np.repeat([0.0, 1e-3, 5.0, 5.5], 10)
    slice_of, spread = slices_by_height(np.random.default_rng(0).permutation(z))
    assert sorted(np.bincount(slice_of)) == [10, 10, 10, 10]
    assert spread == 0.0


def test_points_of_a_star_shaped_section_are_ordered_by_azimuth_and_so_are_few():
    points = np.random.default_rng(0).permutation(ring(0.0)[:, :2] * [1.0, 0.4])
    found = order_points(points)
    assert found.by_azimuth
    assert sorted(found.rows) == list(range(24))
    steps = np.diff(np.unwrap(np.arctan2(*points[found.rows].T[::-1])))
    assert (steps > 0.0).all()
    assert sorted(order_points(np.eye(3)[:, :2]).rows) == [0, 1, 2]


def test_points_of_a_horseshoe_are_ordered_by_the_shortest_way():
    true = kidney()
    mixed = np.random.default_rng(1).permutation(len(true))
    found = order_points(true[mixed])
    assert not found.by_azimuth
    assert sorted(found.rows) == list(range(len(true)))
    loop = true[mixed][found.rows]
    length = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).sum()
    best = np.linalg.norm(np.roll(true, -1, axis=0) - true, axis=1).sum()
    assert length <= best * (1 + 1e-9)
    cloud = np.column_stack([np.tile(true, (3, 1)), np.repeat([0.0, 1.0, 2.0], len(true))])
    assert "3 of 3 slices are not star-shaped" in slice_cloud(cloud).notes[1]


def test_tops_are_read_from_a_table(tmp_path):
    assert read_tops(write(tmp_path, "t.csv", "0 0 5\n0 0 -1\n")).tolist() == [
        [0, 0, 5],
        [0, 0, -1],
    ]
    with pytest.raises(InputError, match="holds no points that are finite"):
        read_tops(write(tmp_path, "u.csv", "0 0 nan\n"))


@pytest.mark.parametrize("wrong", [np.nan, 0.5, 1e20])
@pytest.mark.parametrize("name", ["contour", "touch"])
def test_numbers_of_contours_and_touches_must_be_whole(tmp_path, name, wrong):
    numbers = np.repeat([0.0, 1.0], 24)
    arrays: dict[str, Any] = {"contour": numbers, "touch": numbers}
    arrays[name] = np.where(np.arange(48) == 7, wrong, numbers)
    np.savez(tmp_path / "a.npz", contours=np.concatenate([ring(0.0), ring(1.0)]), **arrays)
    with pytest.raises(InputError, match=f"{name} must hold whole numbers up to .* in row 7"):
        read_points(tmp_path / "a.npz")


PATH = Path("topics.mcap")
WORLD = World(platform=-0.3, reach=0.15, fingers=1, seed=0)
TILTED = np.array([0.01, 0.0, 0.05, 0.6, 0.0, 0.0, 0.8])  # Leaning by 73.7 degrees


def contour(number, status="closed", frame=IDENTITY_POSE):
    return Contour(
        id=number,
        finger=1,
        frame=frame,
        height=0.1 * number,
        points=np.full((4, 3), 0.1 * number),
        normals=np.tile([1.0, 0.0, 0.0], (4, 1)),
        curvature=np.zeros(4),
        status=status,
        contact_low=np.full(4, 0.1 * number),
        contact_high=np.full(4, 0.1 * number),
        gap_starts=np.zeros((0, 3)),
        gap_ends=np.zeros((0, 3)),
        gap_reasons=(),
        touches=4,
        robot_time=1.0,
    )


def probe(number, *, hit):
    return Probe(
        id=number,
        finger=1,
        outcome="hit" if hit else "miss",
        point=np.array([0.0, 0.0, float(number)]),
        normal=np.array([0.0, 0.0, 1.0]),
        touches=1,
        robot_time=2.0,
    )


def done(contours, probes):
    return PlanDone(
        number=1, contours=contours, probes=probes, touches=9, robot_time=3.0,
        reason="enough", reached=None, rms_bound_95=None, largest_untouched=None,
        uncovered=0.0,
    )  # fmt: skip


def recorded(*messages):
    return {kind: [one for one in messages if type(one) is kind] for kind in MESSAGE_TYPES.values()}


def test_a_recording_gives_the_contours_that_the_plan_ended_with():
    traced = [contour(1), contour(2), contour(3)]
    probes = [probe(4, hit=True), probe(5, hit=False), probe(6, hit=True)]
    found = contours_of(PATH, recorded(*traced, *probes, done((1, 3), (4, 5))))
    assert found.places == ("contour 1", "contour 3")
    assert [one[0, 0] for one in found.contours] == pytest.approx([0.1, 0.3])
    assert found.tops is not None and found.tops.tolist() == [[0.0, 0.0, 4.0]]
    assert found.normals is not None and len(found.normals) == 2


def test_contours_that_were_not_closed_are_left_out_or_refused():
    assert "stuck" in get_args(ContourStatus)
    found = contours_of(PATH, recorded(contour(1), contour(2, "stuck")))
    assert found.places == ("contour 1",)
    assert found.tops is None
    assert "left out 1 contours that were not closed" in found.notes
    with pytest.raises(InputError, match="holds no closed contour, of 1 that were traced"):
        contours_of(PATH, recorded(contour(1, "stuck")))
    with pytest.raises(InputError, match=r"topics\.mcap: contours must be traced in one slicing"):
        contours_of(PATH, recorded(contour(1), contour(2, frame=TILTED)))


def test_the_topics_are_those_of_the_reconstructor():
    others = ("/model/goal", "/hand/contacts")
    inputs = {topic: kind for topic, (kind, _) in NODE.inputs.items() if topic not in others}
    assert inputs == MESSAGE_TYPES


def test_the_platform_is_a_touch_of_an_upright_object_alone():
    heights = {}
    for name, frame in (("upright", IDENTITY_POSE), ("tilted", TILTED)):
        found = contours_of(PATH, recorded(contour(1, frame=frame), contour(2, frame=frame), WORLD))
        assert found.frame is not None and np.array_equal(found.frame, frame)
        heights[name] = None if found.tops is None else found.tops.tolist()
        notes = " ".join(found.notes)
        assert ("stands on its platform" in notes) == (name == "upright")
        assert ("sliced along an axis that leans by 73.7 deg" in notes) == (name == "tilted")
    assert heights == {"upright": [[0.0, 0.0, -0.3]], "tilted": None}


def test_probes_touch_the_ends_along_the_axis_and_a_frame_has_its_points_unit():
    traced = [contour(1, frame=TILTED), contour(2, frame=TILTED)]
    up, down = (transform_points(TILTED, np.array([[0.0, 0.0, z]]))[0] for z in (0.4, -0.2))
    probes = [replace(probe(i, hit=True), point=one) for i, one in enumerate((up, down), 4)]
    found = contours_of(PATH, recorded(*traced, *probes))
    assert found.tops is not None and found.tops == pytest.approx(np.array([up, down]))
    found = contours_of(PATH, recorded(contour(1, frame=TILTED))).scaled(1000.0)
    assert found.frame == pytest.approx([10.0, 0.0, 50.0, 0.6, 0.0, 0.0, 0.8])


def test_taxels_have_normals_of_the_jet_or_else_of_the_pad():
    sensor = info_of(SensorSpec(), 1e-5)
    x, _ = pad_of_info(sensor).grid()
    jets = {0: (), 1: (0.0, 1e-4, 0.0, 0.0, 0.0, 0.0)}
    patches = [
        SimpleNamespace(
            goal=1, touch=touch, pose=IDENTITY_POSE, height=0.1 * x, mask=np.ones(x.shape, bool),
            jet=np.array(jet), jet_scale=1e-3,
        )
        for touch, jet in jets.items()
    ]  # fmt: skip
    messages = {**recorded(contour(1), sensor), SurfacePatch: patches}
    found = contours_of(PATH, messages)
    of_pad, of_jet = (found.taxels.normals[found.taxels.touch == touch] for touch in jets)
    assert len(of_pad) == x.size and np.allclose(np.abs(of_pad[:, 2]), 1.0)
    assert np.allclose(np.abs(of_jet[:, 0] / of_jet[:, 2]), 0.1)
    assert f"{2 * x.size} taxels of 2 touches" in found.notes
