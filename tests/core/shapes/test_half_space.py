from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.shapes.half_space import HalfSpace

SLANTED = HalfSpace(np.array([0.0, 3.0, 4.0]), 0.1)


def test_the_function_is_the_distance_from_the_plane() -> None:
    points, ways = (
        np.array([[9.0, 0.06, 0.08], [0.0, 0.0, 0.0]]),
        np.array([[1.0, 0, 0], [0, 1, 1]]),
    )
    value, slope = SLANTED.inside_out(points, ways)
    assert np.allclose(value, [0.0, -0.1], rtol=0, atol=1e-16)
    assert np.allclose(slope, [0.0, 1.4], rtol=0, atol=1e-15)


def test_rays_enter_leave_stay_in_and_stay_out() -> None:
    origins = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    inwards = SLANTED.spans(origins, np.array([0.0, 0.0, -1.0]))
    assert np.allclose(inwards[:, 0], [[0.875, np.inf], [-np.inf, np.inf]])
    outwards = SLANTED.spans(origins, np.array([0.0, 0.0, 1.0]))
    assert np.allclose(outwards[:, 0], [[np.inf, np.inf], [-np.inf, 1.125]])
    along = SLANTED.spans(origins, np.array([1.0, 0.0, 0.0]))
    assert np.array_equal(along[:, 0], [[np.inf, np.inf], [-np.inf, np.inf]])


def test_the_complement_is_the_other_side() -> None:
    points = np.random.default_rng(0).normal(size=(20, 3))
    one, other = (s.inside_out(points, points)[0] for s in (SLANTED, SLANTED.complement()))
    assert np.allclose(one, -other, rtol=0, atol=1e-15)


def test_a_level_one_is_bounded_on_one_side() -> None:
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
def test_what_is_no_half_space_is_refused(
    normal: list[float], offset: float, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        HalfSpace(np.array(normal), offset)


@pytest.mark.parametrize("length", [5e-324, 1e-300, 1e300])
def test_a_normal_of_any_length_is_one(length: float) -> None:
    normal = HalfSpace(np.array([length, 0.0, -length]), 0.0).normal
    assert np.allclose(normal, [math.sqrt(0.5), 0.0, -math.sqrt(0.5)], rtol=1e-15)
