from __future__ import annotations

import pytest

from palpate.bench.shapes import models as bench_shapes_recovery
from palpate.bench.shapes.models import (
    BENT,
    BOTH,
    OUTLIERS,
    RIGID,
    TAPERED,
    RecoveryKind,
    RecoveryOutcome,
    model_rows,
    recover_many,
    recovery_rows,
    share_both_ways,
    share_one_way,
)

TRIALS = 30


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "least"),
    [(RIGID, 0.97), (OUTLIERS, 0.95), (TAPERED, 0.98), (BENT, 0.98), (BOTH, 0.98)],
)
def test_random_solids_are_recovered(kind: RecoveryKind, least: float):
    found = recover_many(kind, TRIALS)
    # One in thirty may fail by chance; two are too many.
    assert share_one_way(found) >= min(least, 1 - 1.5 / TRIALS)
    assert share_both_ways(found) >= min(least, 1 - 1.5 / TRIALS)


def test_the_table_names_each_figure_once_and_says_what_was_missed(
    monkeypatch: pytest.MonkeyPatch,
):
    bad = RecoveryOutcome(one_sided=0.5, chamfer=0.5, floor=1e-4, doubted=True, seconds=9.0)
    monkeypatch.setattr(bench_shapes_recovery, "recover_many", lambda kind, trials: [bad] * 3)
    rows = list(recovery_rows(quick=True))
    assert len({row.name for row in rows}) == len(rows) >= 25
    recovered = [row for row in rows if row.name.startswith("recovery")]
    assert not any(row.holds for row in recovered)
    assert all("MISSED" in str(row) for row in recovered)
    (logarithm,) = (row for row in rows if row.name.startswith("log F"))
    assert logarithm.holds


CLOCKLESS = ("error of", "rays that pass")


def test_every_demand_on_models_that_needs_no_clock_is_met():
    rows = list(model_rows(True))
    assert len({row.name for row in rows}) == len(rows)
    judged = [row for row in rows if row.name.startswith(CLOCKLESS)]
    assert len(judged) == 12
    assert [row.name for row in judged if not row.holds] == []
