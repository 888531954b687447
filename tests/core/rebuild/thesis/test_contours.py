from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.thesis.contours import stack_contours

Vase = Callable[..., Floats]


def test_contours_come_out_upwards_in_the_cube_from_minus_1_to_1(vase: Vase) -> None:
    given = vase() * [0.02, 0.03, 0.05] + [0.4, -0.2, 0.1]
    mixed = given[[3, 0, *range(4, 13), 2, 1]]
    stack = stack_contours(mixed)

    assert stack.order.tolist() == [1, 12, 11, 0, *range(2, 11)]
    assert np.allclose(stack.heights, np.linspace(-1, 1, 13), rtol=0, atol=1e-12)
    assert np.allclose(stack.points.min(axis=(0, 1)), -1.0, rtol=0, atol=1e-12)
    assert np.allclose(stack.points.max(axis=(0, 1)), 1.0, rtol=0, atol=1e-12)
    level = np.broadcast_to(stack.heights[:, None, None], (13, 40, 1))
    back = stack.box.points(0.5 * (np.concatenate([stack.points, level], axis=-1) + 1.0))
    assert np.allclose(back, given[:, :-1], rtol=0, atol=1e-15)


def test_a_first_point_that_comes_again_is_one_point(vase: Vase) -> None:
    closed = stack_contours(vase())
    assert np.array_equal(closed.points, stack_contours(vase()[:, :-1]).points)
    assert closed.points.shape == (13, 40, 2)


def test_a_contour_lies_at_the_mean_of_its_heights(vase: Vase) -> None:
    tilted = vase()[:, :-1]
    tilted[..., 2] += 0.01 * tilted[..., 0]
    expected = tilted[..., 2].mean(axis=1)
    span = np.ptp(expected)
    assert np.allclose(
        stack_contours(tilted).heights, 2 * (expected - expected[0]) / span - 1, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda x: x[:1], "contours must be at least 2, got 1"),
        (lambda x: [x[0], x[1][:-3]], "contours must have as many points each, got 38 to 41"),
        (lambda x: [x[0], np.float64(3.0)], "contours must have as many points each, got 0 to 41"),
        (lambda x: x[..., :2], r"contours must have shape \(any, any, 3\), got \(13, 41, 2\)"),
        (lambda x: np.where(x > 0.69, np.nan, x), "contours must be finite"),
        (lambda x: x * [1, 1, 0], "contours must extend along x, y and z"),
        (lambda x: x * [1, 0, 1], "contours must extend along x, y and z"),
        (lambda x: x[:, [0, 10, 20, 0]], "at least 4 different points, got 3"),
    ],
)
def test_contours_that_cannot_be_used_are_refused(
    vase: Vase, spoil: Callable[[Floats], Floats], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        stack_contours(spoil(vase()))
