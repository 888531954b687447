from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.rebuild.solid import Method, Solid

TOPS = np.array([[0.0, 0.0, 50.0], [0.0, 0.0, -50.0]])


def contours(count: int = 15, noise: float = 0.2, seed: int = 0) -> list[Floats]:
    """Of a lobed vase: begun anywhere, of many counts, with a few points far off."""
    rng = np.random.default_rng(seed)
    found = []
    for z in np.linspace(-49, 49, count):
        many = int(rng.integers(50, 80))
        turn = 2 * np.pi * (np.arange(many) / many + rng.random())
        radius = (30 + 8 * np.sin(z / 25)) * (1 + 0.1 * np.cos(3 * turn + 0.01 * z))
        one = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(many, z)])
        one += noise * rng.normal(size=one.shape)
        one[rng.integers(many), :2] *= 1.1
        found.append(one[:: rng.choice([-1, 1])])
    return found


def apart(one: Solid, other: Solid) -> float:
    rows, turns = np.linspace(0.0, 1.0, 41)[:, None], np.arange(30)[None] / 30
    return float(np.abs(one.surface.at(rows, turns) - other.surface.at(rows, turns)).max())


@pytest.mark.parametrize("method", ["skin", "lattice"])
def test_one_contour_more_is_a_fit_of_all_at_once(method: Method) -> None:
    given = contours()
    at_once = reconstruct(given, tops=TOPS, method=method)
    updated = reconstruct(given[:-4], tops=TOPS, method=method)
    for one in given[-4:]:
        updated = updated.update(one)
    assert apart(updated, at_once) == 0.0
    assert updated.health() == at_once.health()
    assert updated.slices.rows.tolist() == at_once.slices.rows.tolist()


def test_contours_may_arrive_in_any_order() -> None:
    given = contours()
    given.append(given[4].copy())  # two of them say the same
    at_once = reconstruct(given, tops=TOPS, method="skin")
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(given))
        solid = reconstruct([given[i] for i in order[:3]], tops=TOPS[:0].tolist(), method="skin")
        assert solid.evidence.tops is None
        solid = reconstruct([given[i] for i in order[:10]], tops=TOPS, method="skin")
        for i in order[10:]:
            solid = solid.update(given[i])
        assert apart(solid, at_once) < 1e-12 * 50.0


def test_a_plane_contour_comes_with_its_height() -> None:
    given = contours(9, 0.0)
    at_once = reconstruct([one[:, :2] for one in given], heights=[one[0, 2] for one in given])
    most = reconstruct([one[:, :2] for one in given[1:]], heights=[one[0, 2] for one in given[1:]])
    assert apart(most.update(given[0][:, :2], height=given[0][0, 2]), at_once) < 1e-12 * 50.0


def test_a_contour_that_cannot_be_used_is_listed_and_changes_nothing() -> None:
    solid = reconstruct(contours(), tops=TOPS, method="skin")
    updated = solid.update(np.zeros((2, 3)))
    assert updated.slices.dropped[-1].which == 15
    assert apart(updated, solid) == 0.0


def test_what_is_no_contour_is_refused() -> None:
    solid = reconstruct(contours(5), tops=TOPS, method="skin")
    with pytest.raises(ValueError, match=r"contour 5 must have shape \(any, 3\)"):
        solid.update(np.zeros((4, 2)))
    bare = Solid(surface=solid.surface, method="skin", evidence=solid.evidence)
    with pytest.raises(ValueError, match="solid must be rebuilt by reconstruct to be updated"):
        bare.update(contours(5)[0])
