"""A column with an oblique top, rebuilt from what was felt of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.archive import equal_trees, from_arrays, to_arrays
from palpate.core.arrays import Floats
from palpate.core.frames import pose_of, transform
from palpate.core.rebuild.felt.felt_points import FeltPoints, stack_points
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.rebuild.solid import Solid
from palpate.core.rotation import rotations_of_vectors

RADIUS, HEIGHT = 0.02, 0.08
"""Of the column, m; its height is that of the axis."""
SLOPES = np.array([0.25, 0.1])


def top_at(places: Floats) -> Floats:
    heights: Floats = HEIGHT + places @ SLOPES
    return heights


def touches() -> FeltPoints:
    """Rings of touches around the side, up to its edge, and five of the top."""
    rng = np.random.default_rng(0)
    parts = []
    for level in np.linspace(0.003, 0.083, 27):
        for turn in np.arange(24) / 24:
            around = 2.0 * math.pi * (turn + rng.uniform(-0.02, 0.02, 12))
            out = np.column_stack([np.cos(around), np.sin(around)])
            heights = level + rng.uniform(-3e-3, 3e-3, 12)
            felt = (heights < top_at(RADIUS * out)) & (heights > 0.0)
            if felt.sum() > 2:
                normals = np.column_stack([out, np.zeros(12)])[felt]
                points = np.column_stack([RADIUS * out, heights])[felt]
                parts.append(FeltPoints(points, normals, np.zeros(len(points), np.int32)))
    upward = np.array([-SLOPES[0], -SLOPES[1], 1.0]) / math.sqrt(1.0 + SLOPES @ SLOPES)
    for place in ((0.0, 0.0), (0.01, 0.0), (-0.01, 0.0), (0.0, 0.01), (0.0, -0.01)):
        at = place + 1e-3 * np.stack(np.meshgrid(*2 * (np.arange(-3, 4),)), axis=-1).reshape(-1, 2)
        points = np.column_stack([at, top_at(at)])
        parts.append(FeltPoints(points, np.tile(upward, (49, 1)), np.zeros(49, np.int32)))
    return stack_points(parts)


def contours() -> list[Floats]:
    turn = 2.0 * math.pi * np.arange(48) / 48
    ring = RADIUS * np.column_stack([np.cos(turn), np.sin(turn)])
    return [np.column_stack([ring, np.full(48, z)]) for z in np.linspace(0.005, 0.07, 8)]


@pytest.fixture(scope="module")
def solid() -> Solid:
    return reconstruct(contours(), patches=touches(), tops=np.array([[0.0, 0.0, 0.0]]))


def surface_points() -> Floats:
    """Of the true column: side and top, up to half a millimetre from their edge."""
    rng = np.random.default_rng(1)
    turn = rng.uniform(0.0, 2.0 * math.pi, 600)
    out = np.column_stack([np.cos(turn), np.sin(turn)])
    side = np.column_stack([RADIUS * out, rng.uniform(5e-4, top_at(RADIUS * out) - 5e-4)])
    inside = (RADIUS - 5e-4) * np.sqrt(rng.uniform(size=(600, 1))) * out
    return np.concatenate([side, np.column_stack([inside, top_at(inside)])])


def test_an_oblique_top_is_as_good_as_a_level_one(solid: Solid) -> None:
    distances = solid.search().nearest(surface_points()).distances
    assert np.abs(distances).max() < 2e-5
    steep = float(np.hypot(*SLOPES))
    assert solid.health()["slope_above"] == pytest.approx(steep, rel=1e-3)
    assert solid.health()["slope_below"] == pytest.approx(0.0, abs=1e-3)


def test_its_volume_is_that_below_its_middle(solid: Solid) -> None:
    volume = solid.measures().moments.volume
    assert volume == pytest.approx(math.pi * RADIUS**2 * HEIGHT, rel=1e-3)


def test_it_is_closed_and_crosses_itself_nowhere(solid: Solid) -> None:
    check = solid.check()
    assert (check.watertight, check.genus, check.self_intersections) == (True, 0, 0)


def test_its_control_lattice_and_refinement_know_of_the_slant(solid: Solid) -> None:
    lattice = solid.control_lattice
    assert lattice is not None
    assert lattice.volume.at(np.array([[0.5, 0.5, 1.0], [0.99, 0.5, 1.0]]))[1, 2] > 0.08
    point = np.array([[RADIUS + 1e-3, 0.0, 0.04]])
    assert abs(solid.refined(point).search().nearest(point).distances[0]) < 1e-6


def test_points_where_both_ends_would_have_met_are_refused(solid: Solid) -> None:
    with pytest.raises(ValueError, match="points must lie beside the object"):
        solid.refined([[-0.4, -0.1, 0.04]])


def test_an_end_that_tops_alone_told_stays_where_it_is() -> None:
    felt = touches()
    under = felt._replace(
        points=felt.points * [1.0, 1.0, -1.0], normals=np.asarray(felt.normals) * [1.0, 1.0, -1.0]
    )
    top = 2e-5 - float(felt.points[felt.points[:, 2] < 0.01, 2].min())
    found = reconstruct(
        [one * [1.0, 1.0, -1.0] for one in contours()], patches=under, tops=np.array([[0, 0, top]])
    )
    assert found.closed is not None
    assert (found.closed.top.kind, found.uncovered[1]) == ("flat", 0.0)
    assert found.closed.top.height == pytest.approx(top, abs=1e-9)
    assert found.health()["slope_below"] == pytest.approx(float(np.hypot(*SLOPES)), rel=1e-3)


def test_it_can_be_kept_and_more_can_be_added(solid: Solid) -> None:
    again = from_arrays(to_arrays(solid))
    assert equal_trees(solid, again)
    turns = np.linspace(0.0, 1.0, 7)
    assert np.array_equal(again.surface.at(0.97, turns), solid.surface.at(0.97, turns))
    more = solid.update(contours()[3] + [0.0, 0.0, 1e-3])
    assert np.abs(more.search().nearest(surface_points()).distances).max() < 2e-5


def test_it_moves_with_the_frame_in_which_it_was_felt(solid: Solid) -> None:
    turn = rotations_of_vectors(np.array([[0.3, -0.5, 0.2]]))[0]
    pose = pose_of(np.array([0.1, -0.2, 0.3]), turn)
    felt = touches()
    moved = felt._replace(
        points=transform(pose, felt.points), normals=np.asarray(felt.normals) @ turn.T
    )
    found = reconstruct(
        [transform(pose, one) for one in contours()],
        patches=moved,
        tops=transform(pose, np.zeros((1, 3))),
        frame=pose,
    )
    v, turns = np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, 21)
    expected = transform(pose, solid.surface.at(v, turns))
    assert found.surface.at(v, turns) == pytest.approx(expected, abs=1e-9)
