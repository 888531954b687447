from __future__ import annotations

import numpy as np
import pytest

from palpate.core.shapes.bend import Bend
from palpate.core.shapes.protocol import INSIDE
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.warped import WarpedSuperquadric, most_bend

LONG = Superquadric(np.array([0.01, 0.012, 0.06]), np.array([0.5, 0.8]))
SOLIDS = {
    "tapered": WarpedSuperquadric(LONG, np.array([0.5, -0.4])),
    "bent": WarpedSuperquadric(LONG, np.zeros(2), Bend(30.0, 0.4)),
    "both": WarpedSuperquadric(LONG, np.array([0.3, 0.3]), Bend(-20.0, 2.0)),
    "octahedral": WarpedSuperquadric(
        Superquadric(np.full(3, 0.03), np.full(2, 2.0)), np.array([0.8, 0.1])
    ),
    "nearly a ring": WarpedSuperquadric(
        LONG, np.zeros(2), Bend(most_bend(LONG, np.zeros(2), 0.0), 0.0)
    ),
}
every = pytest.mark.parametrize("name", SOLIDS)


@every
def test_spans_are_where_the_function_is_negative(name: str) -> None:
    solid, rng = SOLIDS[name], np.random.default_rng(3)
    low, high = solid.enclosure()
    ways = np.linspace(0.0, 0.3, 601)
    for direction in (*np.eye(3), *rng.normal(size=(3, 3))):
        towards = direction / np.linalg.norm(direction)
        origins = rng.uniform(low, high, (40, 3)) - rng.choice([0.0, 0.15], (40, 1)) * towards
        spans = solid.spans(origins, towards)
        points = (origins[:, None] + ways[:, None] * towards).reshape(-1, 3)
        level = solid.gauge(points).reshape(40, -1) - 1.0
        within = ((spans[..., :1] <= ways) & (ways <= spans[..., 1:])).any(axis=1)
        clear = np.abs(level) > 1e-6
        assert (within == (level <= 0.0))[clear].all()
        assert np.array_equal(spans[:, 0, 0] == INSIDE, level[:, 0] <= 0.0)


@every
def test_the_first_span_begins_where_a_ray_is_cast(name: str) -> None:
    solid, rng = SOLIDS[name], np.random.default_rng(4)
    low, high = solid.enclosure()
    towards = np.array([0.48, -0.6, 0.64])
    origins = rng.uniform(low, high, (60, 3)) - 0.1 * towards
    spans, ranges = solid.spans(origins, towards)[:, 0, 0], solid.cast(origins, towards, 1.0)
    met = ranges < 1.0
    assert met.any()
    assert np.array_equal(np.isfinite(spans), met)
    assert np.allclose(spans[met], ranges[met], rtol=0, atol=1e-11)


def test_a_ray_through_both_arms_of_a_bent_bar_has_two_spans() -> None:
    spans = SOLIDS["nearly a ring"].spans(np.array([[0.03, 0.0, 0.1]]), np.array([0.0, 0.0, -1.0]))
    assert np.isfinite(spans[0]).all(axis=1).sum() == 2
