from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.bench.shapes.splines import curve_rows, spline_rows
from palpate.bench.suite.figures import closed_curves, draw_curves, draw_models

CLOCKLESS = ("residual", "not inverted", "proved")


def test_every_demand_on_splines_that_needs_no_clock_is_met():
    rows = list(spline_rows(True))
    assert len({row.name for row in rows}) == len(rows)
    judged = [row for row in rows if any(word in row.name for word in CLOCKLESS)]
    assert len(judged) == 9
    assert [row.name for row in judged if not row.holds] == []


ROOT = Path(__file__).parents[3]


def test_the_curves_of_the_figure_show_the_gap_that_the_thesis_leaves():
    for points, thesis, ours in closed_curves().values():
        assert thesis.closure_gap > 0.05 * np.ptp(points)
        assert ours.closure_gap == 0.0
        assert len(ours.control) == len(thesis.control)


def test_the_figures_can_be_drawn(tmp_path: Path):
    draw_models(["gem"]).savefig(tmp_path / "models.png", dpi=30)
    draw_curves().savefig(tmp_path / "curves.png", dpi=30)
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("models.png", "curves.png"))


def test_the_documentation_shows_figures_that_are_there():
    page = (ROOT / "docs" / "shapes.md").read_text()
    for name in ("models.png", "closed_curves.png"):
        assert f"figures/{name}" in page
        assert (ROOT / "docs" / "figures" / name).is_file()
    assert "palpate bench shapes --figures docs/figures" in page


def test_curves_are_as_exact_as_is_demanded():
    rows = [row for row in curve_rows(True) if "time" not in row.name]
    assert len(rows) >= 3
    assert all(row.holds for row in rows)
