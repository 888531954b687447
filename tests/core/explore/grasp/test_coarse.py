from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import pose_of
from palpate.core.rebuild.coarse import fit_coarse
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.warped import WarpedSuperquadric

Grasped = Callable[..., tuple[Floats, Floats]]
NOISE = 1e-4


def test_a_box_is_recovered_as_a_box(box: Superquadric, grasped: Grasped) -> None:
    points, _ = grasped(PosedShape(box, pose_of(np.array([0.0, 0.0, 0.04]), np.eye(3))), 60)
    found = fit_coarse(points, NOISE)

    assert sorted(found.size) == pytest.approx([0.02, 0.03, 0.04], abs=2e-4)
    assert len(found.names) == 11 and found.exponents.max() < 0.2


def test_a_bend_is_taken_where_it_pays(grasped: Grasped) -> None:
    base = Superquadric(np.array([0.02, 0.018, 0.045]), np.array([0.5, 0.7]))
    bent = WarpedSuperquadric(base, np.array([0.3, 0.3]), Bend(6.0))
    points, _ = grasped(PosedShape(bent, pose_of(np.array([0.0, 0.0, 0.045]), np.eye(3))), 60)
    found = fit_coarse(points, NOISE)

    assert abs(found.bend.curvature) == pytest.approx(6.0, rel=0.05)
    assert found.rms < NOISE


def test_contacts_that_are_too_few_give_an_ellipsoid_and_say_so() -> None:
    found = fit_coarse(np.random.default_rng(0).normal(size=(8, 3)), NOISE)

    assert not found.fitted
    assert found.doubts == ("too few points",)


@pytest.mark.parametrize(
    ("points", "noise", "words"),
    [
        (np.zeros((3, 2)), NOISE, r"points must have shape \(any, 3\), got \(3, 2\)"),
        (np.full((20, 3), np.nan), NOISE, "points must be finite"),
        (np.zeros((20, 3)), 0.0, "noise must be positive and finite, got 0.0 in the unit"),
    ],
)
def test_what_are_no_contacts_is_refused(points: Floats, noise: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        fit_coarse(points, noise)
