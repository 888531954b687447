from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.planners.known import Outcome
from palpate.core.explore.planners.measured import Traced, axis_of, measured_slices, widened

COUNT = 240
TURN = 2.0 * np.pi * np.arange(COUNT) / COUNT
OUT = np.column_stack([np.cos(TURN), np.sin(TURN)])


def cone(height: float, lean: Floats | None = None, **changes: object) -> Traced:
    """A slice of a cone of radius 30 - 0.2 z mm whose axis leans."""
    lean = np.zeros(2) if lean is None else lean
    radius = 0.03 - 0.2 * height
    # At constant azimuth: n . (r' e_r + lean + e_z) = 0.
    normals = np.column_stack([OUT, -(-0.2 + OUT @ lean)])
    fields = {
        "height": height,
        "status": "closed",
        "points": np.column_stack([height * lean + radius * OUT, np.full(COUNT, height)]),
        "normals": normals / np.linalg.norm(normals, axis=1, keepdims=True),
        "across": np.full(COUNT, 3.0),
        "felt_low": np.full(COUNT, height - 4e-3),
        "felt_high": np.full(COUNT, height + 3e-3),
        "missing": 0.0,
        "touches": 20,
        "seconds": 25.0,
    }
    return Traced(**(fields | changes))


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.2, -0.1)])
def test_radii_and_slopes_are_told_about_the_axis_even_if_it_leans(
    lean: tuple[float, float],
) -> None:
    traced = [cone(height, np.array(lean)) for height in (0.02, 0.05, 0.08)]
    slices = measured_slices(traced, [0.0, 1e-5, 0.0])
    for one, made in zip(slices, traced, strict=True):
        np.testing.assert_allclose(one.radii, 0.03 - 0.2 * made.height, rtol=1e-3)
        np.testing.assert_allclose(one.slopes, -0.2, atol=2e-3)
        np.testing.assert_allclose(one.curvatures, 3.0)
    assert [one.deviation for one in slices] == [0.0, 1e-5, 0.0]


def test_an_axis_that_leaves_a_contour_is_bent_from_middle_to_middle() -> None:
    away = [0.0, 0.05, 0.0]
    bent = []
    for height, x in zip((0.02, 0.05, 0.08), away, strict=True):
        one = cone(height)
        bent.append(one._replace(points=one.points + [x, 0.0, 0.0]))
    axis = axis_of(bent)
    np.testing.assert_allclose(axis.places[:, 0], away, atol=1e-6)
    np.testing.assert_allclose(axis.leans[:, 0], np.gradient(away, [0.02, 0.05, 0.08]), atol=1e-4)


def test_a_band_reaches_half_a_feature_aside_and_no_farther() -> None:
    low = np.full(COUNT, 0.05)
    low[60] = 0.04  # felt deep on one azimuth alone
    one = cone(0.05, felt_low=low)
    step = 2.0 * math.pi * 0.02 / COUNT
    narrow, wide = widened(one, 0.9 * step), widened(one, 4.1 * step)
    assert np.flatnonzero(narrow.felt_low < 0.05).tolist() == [60]
    assert np.flatnonzero(wide.felt_low < 0.05).tolist() == [58, 59, 60, 61, 62]
    assert (wide.felt_high == one.felt_high).all()


@pytest.mark.parametrize(
    ("changes", "outcome"),
    [
        ({}, Outcome.CLOSED),
        ({"status": "occluded", "missing": 0.01}, Outcome.OCCLUDED),
        ({"status": "occluded", "missing": 0.06}, Outcome.FAILED),
        ({"status": "stuck"}, Outcome.FAILED),
        ({"status": "budget"}, Outcome.FAILED),
        ({"status": "pole"}, Outcome.LOST),
        ({"status": "no_contact", "points": np.zeros((0, 3))}, Outcome.LOST),
        ({"status": "occluded", "points": np.zeros((0, 3))}, Outcome.FAILED),
        ({"dropped": True}, Outcome.FAILED),
    ],
)
def test_what_came_of_a_slice_is_what_a_planner_is_told(changes: object, outcome: Outcome) -> None:
    one = cone(0.05, **changes)  # type: ignore[arg-type]
    assert one.outcome == outcome
    [told] = measured_slices([one], [0.0])
    assert told.usable == one.usable == (outcome in (Outcome.CLOSED, Outcome.OCCLUDED))
    assert (told.touches, told.seconds) == (20, 25.0)
