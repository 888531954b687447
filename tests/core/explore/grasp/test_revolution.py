from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.revolution import LEAST, revolution

NO_AXES = np.zeros((0, 3))


def turned(count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Points and normals of a vase about the z axis."""
    z, angle = rng.uniform(-1.0, 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    radius, slope = 0.5 + 0.2 * np.sin(4.0 * z), 0.8 * np.cos(4.0 * z)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    normals = np.column_stack([rim, -slope]) / np.hypot(1.0, slope)[:, None]
    return np.column_stack([radius[:, None] * rim, z]), normals


def test_the_axis_of_a_vase_is_exact_from_few_contacts(rotations: Callable[[int], Floats]) -> None:
    points, normals = turned(12, np.random.default_rng(1))
    for turn in rotations(5):
        found = revolution(points @ turn.T + [3.0, 1.0, 2.0], normals @ turn.T, NO_AXES)
        assert np.linalg.norm(np.cross(found.axis, turn[:, 2])) < 1e-6
        away = np.cross(found.point - [3.0, 1.0, 2.0], turn[:, 2])
        assert np.linalg.norm(away) < 1e-6
        assert found.share == 1.0


def test_only_one_side_is_enough() -> None:
    points, normals = turned(80, np.random.default_rng(2))
    side = points[:, 0] > 0.2
    found = revolution(points[side], normals[side], NO_AXES)

    assert np.linalg.norm(found.axis[:2]) < 1e-6


def test_wrong_normals_are_left_out() -> None:
    rng = np.random.default_rng(3)
    points, normals = turned(50, rng)
    normals[:12] = np.linalg.qr(rng.normal(size=(12, 3, 3)))[0][:, 0]
    found = revolution(points, normals, NO_AXES)

    assert np.linalg.norm(found.axis[:2]) < 1e-3
    assert 0.7 < found.share < 0.9


def test_the_error_is_as_large_as_it_says() -> None:
    rng, errors, said = np.random.default_rng(4), [], []
    for _ in range(60):
        points, normals = turned(40, rng)
        normals += 3e-3 * rng.normal(size=normals.shape)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        found = revolution(points, normals, NO_AXES)
        errors.append(np.linalg.norm(found.axis[:2]))
        said.append(found.error)

    # Each of two directions has at most the standard deviation that is said.
    assert np.sqrt(np.mean(np.square(errors))) < 2.0 * np.mean(said)
    assert np.sqrt(np.mean(np.square(errors))) > 0.4 * np.mean(said)


def test_a_ball_has_no_axis() -> None:
    normals = np.random.default_rng(5).normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]

    assert revolution(0.03 * normals, normals, NO_AXES).lift < 1e-3


def test_millimetres_and_metres_give_the_same() -> None:
    points, normals = turned(40, np.random.default_rng(6))
    one, other = (revolution(scale * points, normals, NO_AXES) for scale in (1e-3, 1.0))

    assert (one.rms, one.share) == pytest.approx((other.rms, other.share), rel=1e-6)
    assert np.abs(one.axis @ other.axis) == pytest.approx(1.0, abs=1e-12)


def test_too_few_contacts_are_refused() -> None:
    points, normals = turned(LEAST - 1, np.random.default_rng(7))

    with pytest.raises(ValueError, match=f"points must be at least {LEAST}, got {LEAST - 1}"):
        revolution(points, normals, NO_AXES)
