from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.superquadrics import Superquadric
from tests.studies import casts
from tests.studies.casts import exactness_rows


def test_casts_are_as_exact_as_is_demanded():
    rows = list(exactness_rows(frames=4))
    assert [row.name.partition(" of ")[0] for row in rows] == ["error", "error"]
    assert all(row.holds for row in rows)


def test_a_cast_that_is_a_nanometre_off_is_found_out(monkeypatch):
    cast = Superquadric.cast

    def off(self: Superquadric, origins: Floats, direction: Floats, reach: float) -> Floats:
        return cast(self, origins, direction, reach) + 2e-9

    monkeypatch.setattr(Superquadric, "cast", off)
    assert not next(iter(exactness_rows(frames=2))).holds


def test_the_oracle_tells_inside_from_outside():
    shape = Superquadric(np.array([0.03, 0.02, 0.04]), np.array([0.5, 0.7]))
    start, along = np.zeros((2, 3)), np.array([0.0, 0.0, 1.0])
    way = np.array([0.0399999, 0.0400001])
    assert (casts._outside(shape, start, along, way) > 0.0).tolist() == [False, True]
