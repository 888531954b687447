from __future__ import annotations

from palpate.launch.bench_shapes_models import model_rows

CLOCKLESS = ("error of", "rays that pass")


def test_every_demand_on_models_that_needs_no_clock_is_met() -> None:
    rows = list(model_rows(True))
    assert len({row.name for row in rows}) == len(rows)
    judged = [row for row in rows if row.name.startswith(CLOCKLESS)]
    assert len(judged) == 12
    assert [row.name for row in judged if not row.holds] == []
