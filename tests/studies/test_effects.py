from __future__ import annotations

import pytest

from palpate.core.touch.effects.catalogue import EFFECT_NAMES
from tests.studies import effects as frames
from tests.studies.effects import WORN, frame_costs, trace_contour


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
