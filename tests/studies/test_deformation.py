from __future__ import annotations

import numpy as np
import pytest

from tests.studies import deformation
from tests.studies.deformation import (
    CORNERS,
    DRAWN,
    INVERSIONS,
    NARROW,
    deformation_rows,
    straying,
    zigzag,
    zigzagged,
)

SIZE = (4, 4, 10)


def test_the_zigzag_shifts_above_and_draws_out_below():
    places = np.array([[0.2, 0.1, 0.3], [0.2, 0.1, 0.6], [0.2, 0.1, CORNERS[1]], [0.2, 0.1, -1.1]])
    length = CORNERS[1] - CORNERS[0]
    wanted = [[0.5, 0.1, 0.3], [-0.1 + 0.6, 0.1, 0.6], [0.2, 0.1, CORNERS[1]]]
    wanted[1][0] = 0.5 if deformation.SHIFTS[4] > 0 else -0.1
    wanted[0][0] = 0.2 + deformation.SHIFTS[3]
    bottom = [0.2 * NARROW, 0.1 * NARROW, CORNERS[1] - DRAWN * length]
    assert zigzag(places) == pytest.approx(np.array([*wanted, bottom]))


def test_the_thesiss_ways_and_ours_deform_alike_where_control_points_stand_alike():
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 3))
    one, other = (zigzagged(SIZE, "Bernstein", whose) for whose in ("thesis", "palpate"))
    assert one.points(points) == pytest.approx(other.points(points), abs=1e-12)
    newton = zigzagged(SIZE, "NURBS", "thesis")
    exact = newton._replace(invert=INVERSIONS["NURBS", "palpate"])
    assert newton.points(points) == pytest.approx(exact.points(points), abs=1e-5)


def test_nurbs_follow_a_fine_lattice_and_bernstein_polynomials_do_not():
    assert straying(zigzagged((4, 4, 40), "NURBS", "palpate")) < 0.1
    assert straying(zigzagged((4, 4, 40), "Bernstein", "palpate")) > 0.3


def test_a_row_for_each_way_and_the_ratios(monkeypatch):
    monkeypatch.setattr(deformation, "SIZES", (SIZE,))
    monkeypatch.setattr(deformation, "QUICK_LEVEL", 1)
    monkeypatch.setattr(deformation, "DEFORM_ROUNDS", 1)
    rows = list(deformation_rows(True))
    assert len({row.name for row in rows}) == len(rows) == 9
    ratios = [row for row in rows if "over" in row.name]
    assert [row.figures[0].kind for row in ratios] == ["time", "time"]
