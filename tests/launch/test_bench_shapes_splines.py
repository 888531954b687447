from __future__ import annotations

from palpate.launch.bench_shapes_splines import spline_rows

CLOCKLESS = ("residual", "not inverted", "proved")


def test_every_demand_on_splines_that_needs_no_clock_is_met() -> None:
    rows = list(spline_rows(True))
    assert len({row.name for row in rows}) == len(rows)
    judged = [row for row in rows if any(word in row.name for word in CLOCKLESS)]
    assert len(judged) == 9
    assert [row.name for row in judged if not row.holds] == []
