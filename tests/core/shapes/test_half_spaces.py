import math

import numpy as np
import pytest
from scipy.optimize import linprog

from palpate.core.shapes.half_spaces import HalfSpace, are_concurrent, deepest_point, polytope_box

SLANTED = HalfSpace(np.array([0.0, 3.0, 4.0]), 0.1)


def test_the_function_is_the_distance_from_the_plane():
    points, ways = (
        np.array([[9.0, 0.06, 0.08], [0.0, 0.0, 0.0]]),
        np.array([[1.0, 0, 0], [0, 1, 1]]),
    )
    value, slope = SLANTED.inside_out(points, ways)
    assert np.allclose(value, [0.0, -0.1], rtol=0, atol=1e-16)
    assert np.allclose(slope, [0.0, 1.4], rtol=0, atol=1e-15)


def test_rays_enter_leave_stay_in_and_stay_out():
    origins = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    inwards = SLANTED.spans(origins, np.array([0.0, 0.0, -1.0]))
    assert np.allclose(inwards[:, 0], [[0.875, np.inf], [-np.inf, np.inf]])
    outwards = SLANTED.spans(origins, np.array([0.0, 0.0, 1.0]))
    assert np.allclose(outwards[:, 0], [[np.inf, np.inf], [-np.inf, 1.125]])
    along = SLANTED.spans(origins, np.array([1.0, 0.0, 0.0]))
    assert np.array_equal(along[:, 0], [[np.inf, np.inf], [-np.inf, np.inf]])


def test_the_complement_is_the_other_side():
    points = np.random.default_rng(0).normal(size=(20, 3))
    one, other = (s.inside_out(points, points)[0] for s in (SLANTED, SLANTED.complement()))
    assert np.allclose(one, -other, rtol=0, atol=1e-15)


def test_a_level_one_is_bounded_on_one_side():
    box = HalfSpace(np.array([0.0, 0.0, -2.0]), 0.3).enclosure()
    assert box[0, 2] == pytest.approx(-0.3)
    assert np.isinf(box).sum() == 5


@pytest.mark.parametrize(
    ("normal", "offset", "sentence"),
    [
        ([0.0, 0.0, 0.0], 0.0, "normal must have a length"),
        ([0.0, 1.0], 0.0, r"normal must have shape \(3\)"),
        ([0.0, 0.0, np.nan], 0.0, "normal must be finite"),
        ([0.0, 0.0, 1.0], np.inf, "offset must be finite"),
    ],
)
def test_what_is_no_half_space_is_refused(normal, offset, sentence):
    with pytest.raises(ValueError, match=sentence):
        HalfSpace(np.array(normal), offset)


@pytest.mark.parametrize("length", [5e-324, 1e-300, 1e300])
def test_a_normal_of_any_length_is_one(length):
    normal = HalfSpace(np.array([length, 0.0, -length]), 0.0).normal
    assert np.allclose(normal, [math.sqrt(0.5), 0.0, -math.sqrt(0.5)], rtol=1e-15)


def test_the_box_of_a_cube_is_the_cube():
    normals = np.concatenate([np.eye(3), -2.0 * np.eye(3)])
    found = polytope_box(normals, np.array([1.0, 2, 3, 8, 10, 12]))
    assert np.allclose(found, [[-4, -5, -6], [1, 2, 3]], rtol=0, atol=1e-15)


def test_boxes_agree_with_linear_programming():
    rng = np.random.default_rng(4)
    for count in (4, 5, 7, 9):
        for _ in range(6):
            normals = rng.normal(size=(count, 3)) * 10 ** rng.uniform(-2, 2, (count, 1))
            offsets = rng.uniform(0.1, 2.0, count) * np.linalg.norm(normals, axis=1)
            found = polytope_box(normals, offsets)
            for axis in range(3):
                for row, sign in ((0, 1.0), (1, -1.0)):
                    wanted = linprog(sign * np.eye(3)[axis], normals, offsets, bounds=(None, None))
                    if wanted.status == 3:  # unbounded
                        assert found[row, axis] == -sign * np.inf
                    else:
                        assert np.isclose(found[row, axis], sign * wanted.fun, rtol=1e-7)


def test_what_is_not_bounded_is_infinite():
    found = polytope_box(np.array([[0.0, 0, 2]]), np.array([3.0]))
    assert found[1, 2] == 1.5
    assert np.isinf(found).sum() == 5
    slanted = polytope_box(np.array([[0.0, 1, 1]]), np.array([1.0]))
    assert np.isinf(slanted).all()


def test_half_spaces_without_a_common_point_give_a_box_turned_over():
    found = polytope_box(np.array([[0.0, 0, 1], [0, 0, -1]]), np.array([-1.0, -1.0]))
    assert found[0, 2] > found[1, 2]


PLANES = np.array([[20.0, 0, 0, 0.1], [0, 30.0, 0, -0.2], [0, 5.0, 10.0, 0.3], [10.0, 10, 10, 0]])
BOX = np.array([[-0.1, -0.1, -0.1], [0.1, 0.1, 0.1]])


def test_the_deepest_point_of_a_tilted_bowl_is_found():
    middle = np.array([0.03, -0.02, 0.071])

    def level(points):
        away = points - middle
        return np.asarray((away @ [5.0, 1.0, 0.0]) ** 2 + (away**2).sum(axis=1) - 1.0)

    place, least = deepest_point(level, BOX, PLANES)
    assert np.abs(place - middle).max() < 1e-4
    assert abs(least + 1.0) < 1e-8


def test_a_corner_of_planes_that_no_grid_meets_is_looked_at():
    corner = np.linalg.solve(PLANES[:3, :3], -PLANES[:3, 3])

    def level(points):
        forms = points @ PLANES[:3, :3].T + PLANES[:3, 3]
        return np.asarray((np.abs(forms) ** 0.1).sum(axis=1))

    place, least = deepest_point(level, BOX, PLANES)
    assert np.allclose(place, corner, rtol=0, atol=1e-15)
    assert least < 0.1


def test_planes_through_one_point_are_known():
    assert are_concurrent(PLANES[:3])
    assert not are_concurrent(PLANES)
    point = np.linalg.solve(PLANES[:3, :3], -PLANES[:3, 3])
    fourth = np.append(PLANES[3, :3], -PLANES[3, :3] @ point)
    assert are_concurrent(np.vstack([PLANES[:3], fourth]))
