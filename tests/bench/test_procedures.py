"""The table of procedures: a line an object, a cell a procedure."""

from __future__ import annotations

import pytest

from palpate.bench import procedures
from palpate.launch import PROCEDURES


def test_an_object_is_a_line_with_error_touches_and_robot_time(monkeypatch):
    cell = procedures.Cell("0.010 mm; 20; 60 s", 1e-5, 20, 60.0)
    nothing = procedures.Cell("unsuited; 3; 9 s", None, 3, 9.0)
    both = {procedures.SLICES: cell, procedures.COONS: nothing}
    monkeypatch.setattr(procedures, "_explored", lambda scene, out: (dict(both), 2e-6))
    monkeypatch.setattr(procedures, "_performed", lambda scene, name, out: nothing)
    head, rule, *rows = procedures.procedure_rows(quick=True)
    assert str(head).count("|") == str(rule).count("|") == len(PROCEDURES) + 5
    assert [row.name for row in rows] == list(procedures.QUICK_OBJECTS)
    assert str(rows[0]).startswith("| block | 0.002 | 0.010 mm; 20; 60 s | unsuited; 3; 9 s |")
    assert [one.value for one in rows[0].figures][:3] == [0.01, 20, 60.0]


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"status": "unsuited"}, "unsuited"),
        (
            {"status": "done", "axis_error_deg": 0.3, "apex_error_m": 1e-3},
            "axis ±0.30°, apex ±1.0 mm",
        ),
        ({"status": "done", "holes": 1.0, "cavities": 2.0, "open_ends": 0.0}, "1 hole, 2 cavities"),
        ({"status": "done", "holes": 0.0, "cavities": 0.0, "open_ends": 0.0}, "no opening"),
    ],
)
def test_what_has_no_solid_is_told_in_words(told, words):
    assert procedures._without_solid(told) == words


@pytest.mark.graph
def test_a_scene_is_explored_by_a_procedure_with_noise(tmp_path):
    cell = procedures._performed("cone", "fearing", tmp_path / "run")
    assert cell.error is None and cell.touches < 15 and cell.text.startswith("axis ±")
