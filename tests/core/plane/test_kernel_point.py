from __future__ import annotations

import numpy as np
import pytest

from palpate.core.plane.kernel_point import kernel_point

CORNER = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4.0]])
MOUTH = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [4, 3], [4, 4], [0, 4.0]])


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_an_angle_is_seen_whole_from_its_corner(scale: float) -> None:
    place = kernel_point(scale * (CORNER + 7.0))

    assert place is not None
    np.testing.assert_allclose(place / scale - 7.0, [0.5, 0.5], atol=1e-7)


def test_a_convex_polygon_is_seen_best_from_the_middle_of_its_largest_disc() -> None:
    box = np.array([[0, 0], [2, 0], [2, 2], [2, 2], [0, 2.0]])

    np.testing.assert_allclose(kernel_point(box), [1.0, 1.0], atol=1e-9)


def test_nothing_sees_both_arms_of_a_clamp_nor_a_single_place() -> None:
    assert kernel_point(MOUTH) is None
    assert kernel_point(np.ones((4, 2))) is None
