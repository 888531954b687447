from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.figures import draw_estimators, draw_filters, filtered
from tests.studies.curvature import (
    ESTIMATORS,
    HEADS,
    OURS,
    PAD,
    PAD_SURFACES,
    THESIS,
    VERDICTS,
    EstimatorErrors,
    PartialContact,
    curvature_rows,
    estimator_demands,
    estimator_rows,
    fusion_demands,
    partial_rows,
    verdict_demands,
)
from tests.studies.surfaces import SURFACES, FusionScore, draw_touch

ROOT = Path(__file__).parents[2]
IN_THE_DOCS = (ROOT / "docs" / "touch.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def printed():
    return [line for line in curvature_rows(quick=True) if isinstance(line, str)]


def first_words(lines: list[str]) -> list[str]:
    """Names of rows, without the figures behind them."""
    return [line[:34].strip() for line in lines if line.strip()]


def test_the_tables_have_the_rows_of_the_documentation_in_its_order(printed):
    table = IN_THE_DOCS.split("```")[1].strip().splitlines()
    names = [name for name in first_words(table) if name in ESTIMATORS]
    assert names == list(ESTIMATORS)
    assert [name for name in first_words(printed) if name in ESTIMATORS] == names


@pytest.fixture(scope="module")
def estimators():
    return estimator_rows(trials=10)


def test_the_order_of_the_estimators_is_that_of_the_documentation(estimators):
    rows = {row.name: row.errors for row in estimators}
    thesis, ours = rows[THESIS], rows[OURS]
    assert len(thesis) == len(HEADS)
    assert all(20.0 * mine < theirs for mine, theirs in zip(ours, thesis, strict=True))
    # Median first wins where there are impulses; without any the order hardly matters.
    first, last = rows["median, Wiener, quadric"], rows["Wiener, median, quadric"]
    assert first[4] < 0.7 * last[4]
    assert first[1] == pytest.approx(last[1], rel=0.2)
    # An interpolating spline turns noise into curvature; a jet does not.
    assert rows["interpolating B-spline"][2] > 50.0 * rows["quartic, full pad"][2]
    # Impulses spoil everything that does not look for them.
    for name in ("smoothing B-spline", "quartic, full pad", "Savitzky-Golay, 8 x 8 cubic"):
        assert rows[name][4] > 5.0 * ours[4]
    assert ours[4] < 1.1 * min(errors[4] for errors in rows.values())


def test_what_palpate_does_meets_its_targets(estimators):
    ours = next(row for row in estimators if row.name == OURS)
    assert ours.errors[1] <= 0.5e-3
    assert ours.errors[4] <= 1.6e-3
    assert ours.lost <= 5  # of 246
    for row in partial_rows(trials=20):
        error = row.errors["palpate"]
        if row.taxels < 8:
            assert error is None
        elif row.taxels >= 32:
            assert error is not None
            assert error < 0.05


def test_curvatures_are_as_good_as_is_demanded():
    errors = list(estimator_demands(estimator_rows(5), partial_rows(5)))
    assert [row.target for row in errors] == [
        "<= 0.5e-3 /pitch",
        "<= 1.6e-3 /pitch",
        ">= 20",
        "< 5 %",
    ]
    assert all(row.holds for row in errors)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_is_right_on_a_clean_tilted_plane(name):
    k1, k2, _ = ESTIMATORS[name](PAD_SURFACES["tilted plane"](*PAD.grid()), 0.0)
    assert (k1, k2) == pytest.approx((0.0, 0.0), abs=1e-2)


GOOD_ROWS = [
    EstimatorErrors(THESIS, (0.035, 0.034, 0.033, 0.04, 0.08), 0, (300.0, 300.0)),
    EstimatorErrors(OURS, (0.0002, 0.0004, 0.001, 0.001, 0.0011), 0, (90.0, 900.0)),
]
GOOD_PARTIAL = [PartialContact(32, {"palpate": 0.04}), PartialContact(4, {"palpate": None})]
GOOD_CALLS = Counter({(kind, kind): 100 for kind in VERDICTS})
GOOD_SCORES = {"sphere": FusionScore(1.0, 0.5, 3.0)}


def missed(rows: Any = GOOD_ROWS, partial: Any = GOOD_PARTIAL) -> list[str]:
    return [row.name for row in estimator_demands(rows, partial) if not row.holds]


def test_a_bench_that_meets_every_demand_misses_none():
    assert missed() == []
    assert all(row.holds for row in (*verdict_demands(GOOD_CALLS), *fusion_demands(GOOD_SCORES)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rows": [GOOD_ROWS[0], GOOD_ROWS[1]._replace(errors=(1e-9,) * 4 + (2e-3,))]}, "8%"),
        ({"rows": [GOOD_ROWS[0]._replace(errors=(0.01,) * 5), GOOD_ROWS[1]]}, "the thesis's chain"),
        ({"partial": [PartialContact(32, {"palpate": None})]}, "32 taxels"),
        ({"partial": [PartialContact(40, {"palpate": 0.06})]}, "32 taxels"),
    ],
)
def test_each_missed_demand_is_named(changes, words):
    [name] = missed(**changes)
    assert words in name


def test_a_kind_that_is_called_otherwise_and_a_worse_fusion_are_missed():
    *_, edge, _, _, _ = verdict_demands(Counter({**GOOD_CALLS, ("edge", "smooth"): 10}))
    assert (edge.value, edge.holds) == ("90.9%", False)
    [row] = fusion_demands({"sphere": FusionScore(1.0, 1.2, 3.0)})
    assert not row.holds


@pytest.mark.parametrize("name", SURFACES)
def test_every_random_surface_can_be_drawn_and_is_the_same_again(name):
    one, other = (
        [draw_touch(np.random.default_rng(seed), name) for seed in range(15)] for _ in range(2)
    )
    drawn = [touch for touch in one if touch is not None]
    assert drawn
    again = [touch for touch in other if touch is not None]
    assert all(np.array_equal(a.height, b.height) for a, b in zip(drawn, again, strict=True))
    assert all(np.isfinite(touch.height).all() for touch in drawn)


def test_the_figures_of_the_filters_show_every_chain_with_its_error(tmp_path):
    x, _ = PAD.grid()
    truth = np.where(x > 0, 1.2e-3, 0.0)
    names = list(filtered(truth))
    assert len(names) == 6
    figure = draw_filters(truth, "a step")
    labels = [axes.get_xlabel() for axes in figure.axes]
    assert sum(label.startswith("rms error") for label in labels) == len(names)
    figure.savefig(tmp_path / "filters.png")
    assert (tmp_path / "filters.png").stat().st_size > 10_000


def test_the_figure_of_the_estimators_has_a_line_for_each():
    rows = [EstimatorErrors(name, (1e-3,) * 5, 0, (1.0, 1.0)) for name in ESTIMATORS]
    (axes,) = draw_estimators(rows).axes
    assert [line.get_label() for line in axes.lines] == list(ESTIMATORS)


def test_the_documentation_shows_figures_that_are_there():
    for name in ("filters_corner.png", "filters_ball.png", "estimators.png"):
        assert f"figures/{name}" in IN_THE_DOCS
        assert (ROOT / "docs" / "figures" / name).is_file()
    assert "python tests/figures.py curvature docs/figures" in IN_THE_DOCS
