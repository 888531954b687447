from __future__ import annotations

import pytest

from palpate.core.touch.effects.catalogue import NAMES
from palpate.launch import bench_effects
from palpate.launch.bench_effects import BODIES, WORN, frame_costs, trace


def test_the_table_has_a_row_for_each_effect_and_the_worn_sensor() -> None:
    lines: list[str] = []
    bench_effects.bench_effects(quick=True, echo=lines.append)
    assert [line.split()[0] for line in lines[1:-1]] == ["(ideal)", *NAMES, WORN]


@pytest.mark.parametrize(("body", "most"), [("ball", 4.3e-6), ("box", 1e-7)])
def test_without_effects_a_contour_is_as_good_as_a_straight_line_between_rows(
    body: str, most: float
) -> None:
    traced = trace(BODIES[body], {})
    assert traced.status == "closed"
    # Rows are 1 mm apart: a chord of the ball is pitch^2 / 8 R = 4.2 um off.
    assert traced.rms < most


def test_an_effect_is_seen_in_the_contour() -> None:
    ideal = trace(BODIES["ball"], {})
    offset = trace(BODIES["ball"], {"arm_compliance": {"stiffness": 50e3}})
    assert offset.rms > 10 * ideal.rms


def test_costs_are_told_for_each_set() -> None:
    found = frame_costs({"none": {}, "aperture": {"aperture": {}}}, frames=20, repeats=5)
    assert set(found) == {"none", "aperture"}
    assert all(cost.ideal > 0.0 for cost in found.values())
    assert found["aperture"].added > 0.0  # nine casts for one
    assert found["aperture"].ratio > 1.0
