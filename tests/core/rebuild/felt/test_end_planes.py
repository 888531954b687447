from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.end_planes import end_plane, only_given, slant_between
from palpate.core.rebuild.felt.feet import feet_of
from palpate.core.rebuild.felt.felt_points import FeltPoints, stack_points
from palpate.core.rebuild.slant import Slant

PLACES = [(0.0, 0.0), (0.012, 0.0), (-0.012, 0.0), (0.0, 0.012), (0.0, -0.012)]
TOP = np.array([0.1, -0.05])
NOISE = 1e-5


def touch(
    place: tuple[float, float], height: float, slopes: Floats, way: float = 1.0
) -> FeltPoints:
    """A touch of 49 taxels of a plane; its height is that on the axis."""
    x, y = np.meshgrid(*2 * (1e-3 * np.arange(-3, 4),), indexing="ij")
    at = np.column_stack([x.ravel(), y.ravel()]) + place
    normal = way * np.array([-slopes[0], -slopes[1], 1.0])
    normals = np.tile(normal / np.linalg.norm(normal), (49, 1))
    points = np.column_stack([at, height + at @ slopes])
    return FeltPoints(points, normals, np.zeros(49, np.int32))


def sides(slant: Slant | None = None) -> FeltPoints:
    """A ring of an upright column of 20 mm, from 0 to 80 mm."""
    turns = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    out = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(400)])
    heights = np.linspace(0.0, 0.08, 400)
    points = 0.02 * out + np.column_stack([np.zeros((400, 2)), heights])
    return FeltPoints(points, out, np.zeros(400, np.int32))


def felt_top(slopes: Floats, *, pose: float = 0.0, noise: float = 0.0) -> FeltPoints:
    rng = np.random.default_rng(0)
    parts = [touch(place, 0.08 + rng.normal(0.0, pose), slopes) for place in PLACES]
    parts = [one._replace(points=one.points + rng.normal(0.0, noise, (49, 3))) for one in parts]
    return stack_points([sides(), *parts])


@pytest.mark.parametrize("pose", [0.0, 1e-4])
def test_a_plane_leans_as_its_touches_do_whatever_the_error_of_their_places(pose: float) -> None:
    found = end_plane(felt_top(TOP, pose=pose), 1.0)
    assert found is not None
    assert found.slopes == pytest.approx(TOP, abs=1e-12)
    assert found.height == pytest.approx(0.08, abs=2.0 * pose + 1e-12)


def test_noise_of_taxels_leaves_a_slope_that_it_is_sure_of() -> None:
    found = end_plane(felt_top(TOP, noise=NOISE), 1.0)
    assert found is not None
    assert np.abs(found.slopes - TOP).max() < 4.0 * found.error < 4e-3


def test_a_touch_across_an_edge_has_no_say() -> None:
    bent = touch((0.016, 0.0), 0.08, TOP)
    beyond = bent.points[:, 0] > 0.017
    bent.points[beyond, 2] -= 3e-4
    felt = stack_points([felt_top(TOP, noise=1e-6), bent])
    assert [one.kind == "flat" for one in feet_of(felt, 1.0)] == [True] * 5 + [False]
    found = end_plane(felt, 1.0)
    assert found is not None
    assert found.slopes == pytest.approx(TOP, abs=1e-3)


def test_taxels_in_a_line_say_nothing_of_a_slope() -> None:
    row = touch((0.0, 0.0), 0.08, TOP)
    at = np.column_stack([np.linspace(-0.005, 0.005, 49), np.zeros(49)])
    row.points[:] = np.column_stack([at, 0.08 + at @ TOP])
    felt = stack_points([felt_top(TOP), row])
    assert [one.kind for one in feet_of(felt, 1.0)] == ["flat"] * 5 + ["edge"]


def test_a_dome_that_one_touch_finds_flat_is_no_plane() -> None:
    parts = [touch(PLACES[0], 0.08, TOP)]
    for place in PLACES[1:]:
        one = touch(place, 0.08, TOP)
        one.points[:, 2] -= (one.points[:, :2] ** 2).sum(axis=1) / 0.3
        parts.append(one)
    felt = stack_points([sides(), *parts])
    assert [one.kind for one in feet_of(felt, 1.0)] == ["flat"] + ["bent"] * 4
    assert end_plane(felt, 1.0) is None


def test_a_ledge_below_the_top_has_no_say() -> None:
    ledge = touch((0.01, 0.01), 0.04, np.zeros(2))
    found = end_plane(stack_points([felt_top(TOP), ledge]), 1.0)
    assert found is not None
    assert found.slopes == pytest.approx(TOP, abs=1e-12)


def test_a_dome_is_no_plane() -> None:
    parts = []
    for place in PLACES:
        one = touch(place, 0.08, np.zeros(2))
        one.points[:, 2] -= (one.points[:, :2] ** 2).sum(axis=1) / 0.08
        parts.append(one)
    felt = stack_points([sides(), *parts])
    assert {one.kind for one in feet_of(felt, 1.0)} == {"bent"}
    assert end_plane(felt, 1.0) is None
    assert slant_between(felt, np.zeros(2), (0.0, None)) is None


def test_a_plane_over_which_something_stands_out_is_no_end() -> None:
    knob = sides()._replace(points=sides().points * [0.2, 0.2, 1.0] + [0.0, 0.0, 0.01])
    assert end_plane(stack_points([felt_top(TOP), knob]), 1.0) is None


def test_between_a_platform_and_an_oblique_top_the_slant_grows() -> None:
    felt = felt_top(TOP)
    low = np.array([0.0, 0.0, -1e-3])
    found = slant_between(felt, np.zeros(2), (low[2], None))
    assert found is not None
    assert found.steepness(-1e-3) == pytest.approx(0.0, abs=1e-12)
    assert found.slopes + 0.08 * found.change == pytest.approx(TOP)
    top = np.asarray(found.straightened_felt(felt).points)[400:]
    assert np.ptp(top[:, 2]) < 1e-12


def test_two_ends_that_lean_alike_make_the_same_slant_everywhere() -> None:
    bottom = [touch(place, 0.0, TOP, -1.0) for place in PLACES]
    found = slant_between(stack_points([felt_top(TOP), *bottom]), np.zeros(2), (None, None))
    assert found is not None
    assert found.change == pytest.approx(np.zeros(2), abs=1e-12)
    assert found.slopes == pytest.approx(TOP)


def test_level_ends_are_left_as_they_are() -> None:
    assert slant_between(felt_top(np.zeros(2)), np.zeros(2), (0.0, None)) is None
    assert slant_between(felt_top(np.zeros(2), noise=NOISE), np.zeros(2), (0.0, None)) is None


def test_an_object_that_leans_as_a_whole_is_not_slanted_but_turned() -> None:
    lean = np.arctan(0.2)  # more than an axis is ever off
    turn = np.array(
        [[np.cos(lean), 0.0, np.sin(lean)], [0.0, 1.0, 0.0], [-np.sin(lean), 0.0, np.cos(lean)]]
    )
    bottom = [touch(place, 0.0, np.zeros(2), -1.0) for place in PLACES]
    felt = stack_points([felt_top(np.zeros(2)), *bottom])
    leaning = felt._replace(points=felt.points @ turn.T, normals=np.asarray(felt.normals) @ turn.T)
    assert end_plane(leaning, 1.0) is not None
    assert slant_between(leaning, np.zeros(2), (None, None)) is None


def test_an_end_that_no_taxel_faces_is_only_given() -> None:
    level = felt_top(np.zeros(2))
    assert only_given(level, -1.0, 0.0)
    assert only_given(level, 1.0, 0.081)
    assert not only_given(level, 1.0, 0.08)
    assert not only_given(level, -1.0, None)


@pytest.mark.parametrize("low", [0.0, -1e-5])
def test_a_taxel_of_the_side_on_the_platform_or_below_leaves_that_level(low: float) -> None:
    felt = felt_top(TOP)
    one = felt.points[:1] * [1.0, 1.0, 0.0] + [0.0, 0.0, low]
    more = felt._replace(
        points=np.concatenate([felt.points, one]),
        normals=np.concatenate([np.asarray(felt.normals), [[1.0, 0.0, 0.0]]]),
        touch=np.append(felt.touch, 0).astype(np.int32),
    )
    found = slant_between(more, np.zeros(2), (0.0, None))
    assert found is not None
    assert found.steepness(0.0) == pytest.approx(0.0, abs=1e-12)


def test_both_flanks_of_a_gable_are_no_plane() -> None:
    flanks = [np.array([0.3, 0.0]), np.array([-0.3, 0.0])]
    parts = [
        touch((way * away, 0.004 * k), 0.08, flanks[int(way > 0)])
        for way in (1.0, -1.0)
        for k, away in enumerate((0.006, 0.01, 0.014))
    ]
    assert end_plane(stack_points([sides(), *parts]), 1.0) is None


def test_the_slant_moves_and_grows_with_the_object() -> None:
    felt, away = felt_top(TOP), np.array([1.0, -2.0, 0.5])
    one = slant_between(felt, np.zeros(2), (None, None))
    moved = felt._replace(points=1e3 * (felt.points + away))
    other = slant_between(moved, 1e3 * away[:2], (None, None))
    assert one is not None and other is not None
    expected = 1e3 * (one.straightened(felt.points) + away)
    found = other.straightened(moved.points)
    assert np.ptp(found - expected, axis=0) == pytest.approx(np.zeros(3), abs=1e-6)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 1e9])
def test_a_dome_is_bent_in_any_unit(scale: float) -> None:
    one = touch((0.0, 0.0), 0.08, np.zeros(2))
    one.points[:, 2] -= (one.points[:, :2] ** 2).sum(axis=1) / 0.08
    felt = stack_points([one])
    [foot] = feet_of(felt._replace(points=scale * felt.points), 1.0)
    assert foot.kind == "bent"


def test_taxels_of_one_height_are_a_plane() -> None:
    found = end_plane(stack_points([touch(place, 0.0, np.zeros(2)) for place in PLACES]), 1.0)
    assert found is None or found.slopes == pytest.approx(np.zeros(2), abs=1e-12)
