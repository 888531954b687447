from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.figures import closed_curves, draw_curves, draw_models
from tests.studies import shapes
from tests.studies.shapes import (
    KINDS,
    RecoveryOutcome,
    curve_rows,
    good_shares,
    model_rows,
    recover_many,
    recovery_rows,
    spline_rows,
)

ROOT = Path(__file__).parents[2]
TRIALS = 30


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "least"),
    [("rigid", 0.97), ("outliers", 0.95), ("tapered", 0.98), ("bent", 0.98), ("both", 0.98)],
)
def test_random_solids_are_recovered(kind, least):
    one_way, both_ways = good_shares(recover_many(KINDS[kind], TRIALS))
    # One in thirty may fail by chance; two are too many.
    assert min(one_way, both_ways) >= min(least, 1 - 1.5 / TRIALS)


def test_the_table_names_each_figure_once_and_says_what_was_missed(monkeypatch):
    bad = RecoveryOutcome(one_sided=0.5, chamfer=0.5, floor=1e-4, seconds=9.0)
    monkeypatch.setattr(shapes, "recover_many", lambda kind, trials: [bad] * 3)
    rows = list(recovery_rows(quick=True))
    assert len({row.name for row in rows}) == len(rows) >= 25
    recovered = [row for row in rows if row.name.startswith("recovery")]
    assert not any(row.holds for row in recovered)
    assert all("MISSED" in str(row) for row in recovered)
    (logarithm,) = (row for row in rows if row.name.startswith("log F"))
    assert logarithm.holds


@pytest.mark.parametrize(
    ("measured", "words", "count"),
    [
        (model_rows, ("error of a cast", "rays that pass"), 12),
        (spline_rows, ("residual", "not inverted", "proved"), 9),
    ],
)
def test_every_demand_that_needs_no_clock_is_met(measured, words, count, monkeypatch):
    for name, value in {"POINTS": 1000, "QUICK_LOOPED": 4, "INVERSION_ROUNDS": 1}.items():
        monkeypatch.setattr(shapes, name, value)
    rows = list(measured(True))
    assert len({row.name for row in rows}) == len(rows)
    judged = [row for row in rows if any(word in row.name for word in words)]
    assert len(judged) == count
    assert [row.name for row in judged if not row.holds] == []


def test_curves_are_as_exact_as_is_demanded():
    rows = [row for row in curve_rows(True) if "time" not in row.name]
    assert len(rows) >= 3
    assert all(row.holds for row in rows)


def test_the_curves_of_the_figure_show_the_gap_that_the_thesis_leaves():
    for points, thesis, ours in closed_curves().values():
        assert thesis.closure_gap > 0.05 * np.ptp(points)
        assert ours.closure_gap == 0.0
        assert len(ours.control) == len(thesis.control)


def test_the_figures_can_be_drawn(tmp_path):
    draw_models(["gem"]).savefig(tmp_path / "models.png", dpi=30)
    draw_curves().savefig(tmp_path / "curves.png", dpi=30)
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("models.png", "curves.png"))


def test_the_documentation_shows_figures_that_are_there():
    page = (ROOT / "docs" / "shapes.md").read_text()
    for name in ("models.png", "closed_curves.png"):
        assert f"figures/{name}" in page
        assert (ROOT / "docs" / "figures" / name).is_file()
    assert "python tests/figures.py shapes docs/figures" in page
