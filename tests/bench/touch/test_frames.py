from __future__ import annotations

import numpy as np
import pytest

from palpate.bench.touch import frames
from palpate.bench.touch.frames import (
    WORN,
    exactness_rows,
    frame_costs,
    speed_rows,
    trace_contour,
)
from palpate.core.arrays import Floats
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.touch.effects.catalogue import EFFECT_NAMES
from tests.studies.curvature import estimator_demands, estimator_rows, partial_rows


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


def test_curvatures_are_as_good_as_is_demanded():
    errors = list(estimator_demands(estimator_rows(5), partial_rows(5)))
    assert [row.target for row in errors] == [
        "<= 0.5e-3 /pitch",
        "<= 1.6e-3 /pitch",
        ">= 20",
        "< 5 %",
    ]
    assert all(row.holds for row in errors)


def test_each_speed_has_its_demand():
    rows = list(speed_rows(frames=3, rounds=1))
    assert [row.target for row in rows] == [
        ">= 2000 /s",
        ">= 3000 /s",
        "<= 1.25",
        "<= 600 us",
        "<= 600 us",
        "<= 2000 us",
    ]
    assert all(row.value for row in rows)


def test_the_oracle_tells_inside_from_outside():
    shape = Superquadric(np.array([0.03, 0.02, 0.04]), np.array([0.5, 0.7]))
    start, along = np.zeros((2, 3)), np.array([0.0, 0.0, 1.0])
    way = np.array([0.0399999, 0.0400001])
    assert (frames._outside(shape, start, along, way) > 0.0).tolist() == [False, True]


def test_the_table_has_a_row_for_each_effect_and_the_worn_sensor(monkeypatch):
    closed = frames.TracedContour("closed", 20, 1e-6, 2e-6)
    monkeypatch.setattr(frames, "trace_contour", lambda body, effects: closed)
    monkeypatch.setattr(frames, "EFFECT_FRAMES", 2)
    lines = list(frames.effect_rows(quick=True))
    assert [str(line).split()[0] for line in lines[1:-1]] == ["(ideal)", *EFFECT_NAMES, WORN]


@pytest.mark.parametrize(("body", "most"), [("ball", 4.3e-6), ("box", 1e-7)])
def test_without_effects_a_contour_is_as_good_as_a_straight_line_between_rows(body, most):
    traced = trace_contour(body, {})
    assert traced.status == "closed"
    # Rows are 1 mm apart: a chord of the ball is pitch^2 / 8 R = 4.2 um off.
    assert traced.rms < most


def test_an_effect_is_seen_in_the_contour():
    ideal = trace_contour("ball", {})
    offset = trace_contour("ball", {"arm_compliance": {"stiffness": 50e3}})
    assert offset.rms > 10 * ideal.rms


def test_costs_are_told_for_each_set():
    found = frame_costs({"none": {}, "aperture": {"aperture": {}}}, frames=20, repeats=5)
    assert set(found) == {"none", "aperture"}
    _, added, ratio = found["aperture"]
    assert min(ideal for ideal, _, _ in found.values()) > 0.0
    assert added > 0.0  # nine casts for one
    assert ratio > 1.0
