from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from palpate.core.archive import tree_from_arrays, tree_to_arrays, tree_to_bytes
from palpate.core.arrays import Floats
from palpate.core.poses import (
    IDENTITY_POSE,
    compose_poses,
    inverse_pose,
    pose_of,
    rotations_from_vectors,
    split_pose,
    transform_points,
)
from palpate.core.rebuild.contours.contacts import (
    ContactPoints,
    into_frame,
    slicing_pose,
    stack_points,
)
from palpate.core.rebuild.reconstruction import reconstruct
from palpate.core.rebuild.recovery.report import Recovery
from palpate.core.rebuild.solid import LatticeSolid, Method
from palpate.core.splines.spline_volumes import SplineVolume

METHODS: tuple[Method, ...] = ("lattice", "skin", "thesis", "coarse")
TURN = np.array([0.1, -0.4, 0.3, 0.86])


# Leaning by some 50 degrees.
POSE = np.concatenate([[0.03, -0.2, 0.05], TURN / np.linalg.norm(TURN)])
SIZE = 0.1
HEIGHTS = np.linspace(-0.047, 0.045, 11)
TOPS = np.array([[0.0, 0.0, -0.05], [0.002, 0.0, 0.05]])
V, TURNS = np.linspace(0.0, 1.0, 41)[:, None], np.arange(31)[None] / 31
Make = Callable[..., Any]


def ring(z: float, count: int = 60) -> Floats:
    """Of a lobed egg that wanders sideways."""
    turn = 2 * np.pi * np.arange(count) / count
    r = 0.03 * np.sqrt(1.001 - (z / 0.05) ** 2) * (1 + 0.08 * np.cos(3 * turn + 20 * z))
    return np.column_stack([r * np.cos(turn) + 0.1 * z, 0.8 * r * np.sin(turn), np.full(count, z)])


CONTOURS = [ring(z, 50 + i) for i, z in enumerate(HEIGHTS)]


def moved(points: Floats) -> Floats:
    return transform_points(POSE, points)


def turned(normals: Floats) -> Floats:
    return normals @ split_pose(POSE)[1].T


@cache
def upright(method: Method = "lattice") -> LatticeSolid:
    return reconstruct(CONTOURS, tops=TOPS, method=method)


@cache
def tilted(method: Method = "lattice") -> LatticeSolid:
    contours = [moved(one) for one in CONTOURS]
    return reconstruct(contours, tops=moved(TOPS), method=method, frame=POSE)


def places(solid: LatticeSolid) -> Floats:
    return solid.surface.at(V, TURNS).reshape(-1, 3)


def apart(one: LatticeSolid, other: LatticeSolid) -> float:
    """How far the first, moved, is from the second, over the size."""
    return float(np.abs(moved(places(one)) - places(other)).max()) / SIZE


@pytest.mark.parametrize("method", METHODS)
def test_a_solid_of_all_that_was_moved_is_the_moved_solid(method):
    one, other = upright(method), tilted(method)
    # A superquadric is found by iterations, which end where residuals and slopes have a cosine of
    # 1e-9.
    assert apart(one, other) < (1e-10 if method == "coarse" else 1e-12)
    assert other.uncovered == pytest.approx(one.uncovered, abs=1e-12)
    assert one.frame is None and np.array_equal(np.array(other.frame), POSE)


def test_its_measures_move_with_it():
    before, after = upright("skin").measures(), tilted("skin").measures()
    assert after.area_m2 == pytest.approx(before.area_m2, rel=1e-12)
    assert after.volume_m3 == pytest.approx(before.volume_m3, rel=1e-12)
    centroid = moved(before.centroid_m[None])[0]
    # What is summed are fields along the world's axes: the rule of quadrature errs differently.
    assert after.centroid_m == pytest.approx(centroid, abs=1e-6 * SIZE)


@pytest.mark.parametrize("method", METHODS)
def test_its_normals_and_curvatures_turn_with_it(method):
    v, turns = np.random.default_rng(0).uniform(0.1, 0.9, (2, 50))
    one, other = upright(method).surface, tilted(method).surface
    before, after = one.curvatures(v, turns), other.curvatures(v, turns)
    assert other.normals(v, turns) == pytest.approx(turned(one.normals(v, turns)), abs=1e-9)
    assert after.k1 == pytest.approx(before.k1, rel=1e-6, abs=1e-6 / SIZE)
    assert after.k2 == pytest.approx(before.k2, rel=1e-6, abs=1e-6 / SIZE)


def test_it_is_searched_and_checked_where_it_is():
    points = np.random.default_rng(0).normal(size=(40, 3)) * 0.03
    before, after = upright().search().nearest(points), tilted().search().nearest(moved(points))
    assert after.distances == pytest.approx(before.distances, abs=1e-9)
    assert after.points == pytest.approx(moved(before.points), abs=1e-9)
    low, high = tilted().mesh().vertices.min(axis=0), tilted().mesh().vertices.max(axis=0)
    assert (low < POSE[:3]).all() and (high > POSE[:3]).all()


def test_everything_that_was_touched_is_taken_into_the_frame(oracle):
    contours, contacts, tops = oracle([0.03, 0.025, 0.045], [1.0, 1.0]).evidence(
        np.linspace(-0.9, 0.9, 7)
    )
    there = ContactPoints(moved(contacts.points), turned(contacts.normals), contacts.touch)
    one = reconstruct(contours, patches=contacts, tops=tops, method="skin")
    there = {"patches": there, "tops": moved(tops), "method": "skin", "frame": POSE}
    other = reconstruct([moved(each) for each in contours], **there)
    assert one.health()["radial_unused"] == 0.0
    assert apart(one, other) < 1e-12
    assert other.whole_deviation() == pytest.approx(one.whole_deviation(), rel=1e-6)


def test_normals_at_the_contours_are_taken_into_the_frame(oracle):
    true = oracle([0.03, 0.02, 0.04], [1.0, 1.0])
    contours = [true.section(share) for share in np.linspace(-0.9, 0.9, 5)]
    normals = [true.contacts_at(one).normals for one in contours]
    normals[2][7] = np.nan  # one that nobody could tell
    one = reconstruct(contours, normals, method="skin")
    there = [moved(each) for each in contours], [turned(each) for each in normals]
    other = reconstruct(*there, method="skin", frame=POSE)
    assert one.health()["radial_unused"] == 0.0
    assert apart(one, other) < 1e-12


def test_the_deviation_counts_heights_along_the_frame():
    heights, turns = np.linspace(-0.04, 0.04, 5), np.arange(4) / 4
    before, after = upright().deviation(heights, turns), tilted().deviation(heights, turns)
    assert before is not None and after is not None
    assert after == pytest.approx(before, rel=1e-6)
    assert tilted().slices.heights == pytest.approx(upright().slices.heights, abs=1e-14)


def test_the_frame_of_the_world_changes_no_bit():
    framed = reconstruct(CONTOURS, tops=TOPS, frame=IDENTITY_POSE)
    assert framed.frame is None
    assert np.array_equal(*map(tree_to_bytes, (framed, upright())))


def test_one_contour_more_is_given_in_the_world():
    later = reconstruct([moved(one) for one in CONTOURS[:-1]], tops=moved(TOPS), frame=POSE)
    with pytest.raises(ValueError, match="heights must be left out with a frame"):
        later.update(CONTOURS[3][:, :2], height=0.0)
    updated = later.update(moved(CONTOURS[-1]))
    assert np.array_equal(places(updated), places(tilted()))
    assert np.array_equal(np.array(updated.frame), POSE)


def test_further_points_are_given_in_the_world():
    point = np.array([[0.034, 0.0, 0.004], [0.0, 0.03, 0.02]])
    one, other = upright().refined(point), tilted().refined(moved(point))
    assert apart(one, other) < 1e-9
    assert np.abs(other.search().nearest(moved(point)).distances).max() < 1e-6 * SIZE
    assert np.array_equal(np.array(other.frame), POSE)
    with pytest.raises(ValueError, match="points must be finite"):
        tilted().refined(np.full((1, 3), np.nan))


@pytest.mark.parametrize("method", METHODS)
def test_a_solid_with_a_frame_comes_back_the_same_to_the_last_bit(method):
    back = tree_from_arrays(tree_to_arrays(tilted(method)))
    assert np.array_equal(*map(tree_to_bytes, (back, tilted(method))))
    assert np.array_equal(places(back), places(tilted(method)))
    assert np.array_equal(back.mesh().vertices, tilted(method).mesh().vertices)


def test_a_grasp_is_given_in_the_world():
    found = reconstruct(CONTOURS, method="coarse").model
    assert isinstance(found, Recovery)
    pose = compose_poses(POSE, found.pose)
    one = reconstruct(CONTOURS, tops=TOPS, grasp=found)
    there = {"tops": moved(TOPS), "grasp": replace(found, pose=pose), "frame": POSE}
    other = reconstruct([moved(each) for each in CONTOURS], **there)
    assert apart(one, other) < 1e-9


def test_what_is_inside_the_lattice_is_in_the_world():
    one, other = upright(), tilted()
    assert one.lattice is not None and one.control_lattice is one.lattice.lattice
    there = other.control_lattice
    assert there is not None
    inside = one.lattice.prism.points(np.random.default_rng(1).random((20, 3)))
    deformed = one.lattice.lattice.deform(inside)
    assert there.deform(moved(inside)) == pytest.approx(moved(deformed), abs=1e-12)
    assert upright("skin").control_lattice is None is upright("coarse").control_lattice


def test_the_lattice_of_the_thesis_is_in_the_world():
    one, other = upright("thesis").control_lattice, tilted("thesis").control_lattice
    assert one is not None and other is not None
    control = moved(one.control.reshape(-1, 3)).reshape(one.control.shape)
    assert other.control == pytest.approx(control, abs=1e-12)
    assert isinstance(one.undeformed, SplineVolume) and isinstance(other.undeformed, SplineVolume)
    local = np.random.default_rng(0).random((20, 3))
    before = moved(one.undeformed.at(local))
    assert other.undeformed.at(local) == pytest.approx(before, abs=1e-12)


@pytest.mark.parametrize(
    ("frame", "options", "sentence"),
    [
        (np.zeros(6), {}, r"frame must have shape \(7\), got \(6,\)"),
        (np.full(7, np.nan), {}, "frame must be finite"),
        (np.zeros(7), {}, "a rotation must be a quaternion of length 1, got length 0"),
        (
            POSE,
            {"heights": HEIGHTS},
            "heights must be left out with a frame, for contours are then points of the world",
        ),
    ],
)
def test_what_is_no_frame_is_refused(frame, options, sentence):
    contours = [one[:, :2] for one in CONTOURS] if options else CONTOURS
    with pytest.raises(ValueError, match=sentence):
        reconstruct(contours, frame=frame, **options)


def test_points_are_seen_from_the_frame_as_its_inverse_has_them():
    points = np.random.default_rng(0).normal(size=(5, 3))
    frame = slicing_pose(POSE)
    assert into_frame(frame, points) == pytest.approx(
        transform_points(inverse_pose(POSE), points), abs=1e-14
    )
    assert into_frame(None, points) is points
    assert slicing_pose(pose_of(np.zeros(3), np.eye(3))) is None is slicing_pose(None)


RADIUS, HEIGHT = 0.02, 0.08  # Of the column, m; its height is that of the axis
SLOPES = np.array([0.25, 0.1])


def top_at(places: Floats) -> Floats:
    heights: Floats = HEIGHT + places @ SLOPES
    return heights


def touches() -> ContactPoints:
    """Rings of touches around the side, up to its edge, and five of the top."""
    rng = np.random.default_rng(0)
    parts = []
    for level in np.linspace(0.003, 0.083, 27):
        for turn in np.arange(24) / 24:
            around = 2.0 * math.pi * (turn + rng.uniform(-0.02, 0.02, 12))
            out = np.column_stack([np.cos(around), np.sin(around)])
            heights = level + rng.uniform(-3e-3, 3e-3, 12)
            beside = (heights < top_at(RADIUS * out)) & (heights > 0.0)
            if beside.sum() > 2:
                normals = np.column_stack([out, np.zeros(12)])[beside]
                points = np.column_stack([RADIUS * out, heights])[beside]
                parts.append(ContactPoints(points, normals, np.zeros(len(points), np.int32)))
    upward = np.array([-SLOPES[0], -SLOPES[1], 1.0]) / math.sqrt(1.0 + SLOPES @ SLOPES)
    for place in ((0.0, 0.0), (0.01, 0.0), (-0.01, 0.0), (0.0, 0.01), (0.0, -0.01)):
        at = place + 1e-3 * np.stack(np.meshgrid(*2 * (np.arange(-3, 4),)), axis=-1).reshape(-1, 2)
        points = np.column_stack([at, top_at(at)])
        parts.append(ContactPoints(points, np.tile(upward, (49, 1)), np.zeros(49, np.int32)))
    return stack_points(parts)


def contours() -> list[Floats]:
    turn = 2.0 * math.pi * np.arange(48) / 48
    ring = RADIUS * np.column_stack([np.cos(turn), np.sin(turn)])
    return [np.column_stack([ring, np.full(48, z)]) for z in np.linspace(0.005, 0.07, 8)]


@pytest.fixture(scope="module")
def solid() -> LatticeSolid:
    return reconstruct(contours(), patches=touches(), tops=np.array([[0.0, 0.0, 0.0]]))


def surface_points() -> Floats:
    """Of the true column: side and top, up to half a millimetre from their edge."""
    rng = np.random.default_rng(1)
    turn = rng.uniform(0.0, 2.0 * math.pi, 600)
    out = np.column_stack([np.cos(turn), np.sin(turn)])
    side = np.column_stack([RADIUS * out, rng.uniform(5e-4, top_at(RADIUS * out) - 5e-4)])
    inside = (RADIUS - 5e-4) * np.sqrt(rng.uniform(size=(600, 1))) * out
    return np.concatenate([side, np.column_stack([inside, top_at(inside)])])


def test_an_oblique_top_is_as_good_as_a_level_one(solid):
    distances = solid.search().nearest(surface_points()).distances
    assert np.abs(distances).max() < 2e-5
    steep = float(np.hypot(*SLOPES))
    assert solid.health()["slope_above"] == pytest.approx(steep, rel=1e-3)
    assert solid.health()["slope_below"] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.slow
def test_its_volume_is_that_below_its_middle(solid):
    assert solid.volume == pytest.approx(math.pi * RADIUS**2 * HEIGHT, rel=1e-3)


def test_it_is_closed_and_crosses_itself_nowhere(solid):
    check = solid.check()
    assert (check.closed, check.oriented, check.genus, check.self_crossings) == (True, True, 0, 0)


def test_its_control_lattice_and_refinement_know_of_the_slant(solid):
    lattice = solid.control_lattice
    assert lattice is not None
    assert lattice.volume.at(np.array([[0.5, 0.5, 1.0], [0.99, 0.5, 1.0]]))[1, 2] > 0.08
    point = np.array([[RADIUS + 1e-3, 0.0, 0.04]])
    assert abs(solid.refined(point).search().nearest(point).distances[0]) < 1e-6


def test_points_where_both_ends_would_have_met_are_refused(solid):
    with pytest.raises(ValueError, match="points must lie beside the object"):
        solid.refined([[-0.4, -0.1, 0.04]])


def test_an_end_that_tops_alone_told_stays_where_it_is():
    contacts = touches()
    under = contacts._replace(
        points=contacts.points * [1.0, 1.0, -1.0],
        normals=np.asarray(contacts.normals) * [1.0, 1.0, -1.0],
    )
    top = 2e-5 - float(contacts.points[contacts.points[:, 2] < 0.01, 2].min())
    found = reconstruct(
        [one * [1.0, 1.0, -1.0] for one in contours()], patches=under, tops=np.array([[0, 0, top]])
    )
    assert found.closed is not None
    assert (found.closed.top.kind, found.uncovered[1]) == ("flat", 0.0)
    assert found.closed.top.height == pytest.approx(top, abs=1e-9)
    assert found.health()["slope_below"] == pytest.approx(float(np.hypot(*SLOPES)), rel=1e-3)


def test_it_can_be_kept_and_more_can_be_added(solid):
    again = tree_from_arrays(tree_to_arrays(solid))
    assert np.array_equal(*map(tree_to_bytes, (solid, again)))
    turns = np.linspace(0.0, 1.0, 7)
    assert np.array_equal(again.surface.at(0.97, turns), solid.surface.at(0.97, turns))
    more = solid.update(contours()[3] + [0.0, 0.0, 1e-3])
    assert np.abs(more.search().nearest(surface_points()).distances).max() < 2e-5


def test_it_moves_with_the_frame_in_which_it_was_touched(solid):
    turn = rotations_from_vectors(np.array([[0.3, -0.5, 0.2]]))[0]
    pose = pose_of(np.array([0.1, -0.2, 0.3]), turn)
    contacts = touches()
    moved = contacts._replace(
        points=transform_points(pose, contacts.points),
        normals=np.asarray(contacts.normals) @ turn.T,
    )
    found = reconstruct(
        [transform_points(pose, one) for one in contours()],
        patches=moved,
        tops=transform_points(pose, np.zeros((1, 3))),
        frame=pose,
    )
    v, turns = np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, 21)
    expected = transform_points(pose, solid.surface.at(v, turns))
    assert found.surface.at(v, turns) == pytest.approx(expected, abs=1e-9)
