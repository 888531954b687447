from __future__ import annotations

import pytest

from palpate.core.explore.planners import Thesis
from palpate.core.explore.planners.trial import MOST_CONTOURS_PLANNED, TUNED, PlannerTrial
from tests.studies import planners
from tests.studies.held_out import HELD_OUT
from tests.studies.planners import (
    KINDS,
    Chosen,
    best_by_form,
    by_kind,
    finding,
    kind_of,
    plan_count,
    rule_sets,
    template_rows,
)


def test_the_kind_of_an_object_follows_from_its_curvature():
    named = {name: kind_of(TUNED[name]) for name in ("sphere", "cylinder", "vase", "stepped")}
    wanted = {"sphere": "plain", "cylinder": "plain", "vase": "featured", "stepped": "sharp"}
    assert named == wanted
    assert kind_of(HELD_OUT["two steps"]) == "sharp"
    found = by_kind(TUNED)
    assert list(found) == list(KINDS)
    assert sum(map(len, found.values())) == len(TUNED)


def test_every_template_is_tried_alone_multiplied_and_of_the_sum():
    sets = rule_sets()
    forms = {(one.template, one.form, bool(one.change_rate)) for one in sets}
    assert len(forms) == 9
    assert len({repr(one) for one in sets}) == len(sets)
    assert {one.power for one in sets if one.template == "exponential"} == {1.0}


def test_the_exponential_of_a_sum_is_the_product():
    for bend, change in ((0.3, 2.0), (4.0, 0.5)):
        one, other = (Thesis(form=form).later(bend, change, 2) for form in ("product", "joint"))
        assert one == pytest.approx(other)


def test_the_best_set_of_each_form_is_chosen_on_some_objects_and_judged_on_others():
    seen, others = {"a": PlannerTrial(TUNED["sphere"])}, {"b": PlannerTrial(TUNED["stepped"])}
    sets = [Thesis(least=0.3, most=0.4), Thesis(least=0.02, most=0.03)]
    found = best_by_form(sets, seen, others)
    assert list(found) == ["exponential, product"]
    one = found["exponential, product"]
    assert one.rule in sets
    assert one.chosen == min(plan_count(rule, seen["a"]) for rule in sets)
    assert one.failed == int(one.judged == MOST_CONTOURS_PLANNED)


def test_the_finding_names_the_best_and_the_worst():
    rule = Thesis(bend_rate=0.4, change_rate=0.8, least=0.05, most=0.15)
    found = {"a": Chosen(rule, 5.0, 7.0, 1), "b": Chosen(rule, 4.0, 9.0, 2)}
    row = finding("sharp", found)
    assert row.name == "sharp: finding"
    assert row.value == "a (0.4, 0.8, 0.05 to 0.15, 1) 7.0; worst: b 9.0"


def test_rows_for_each_kind_and_the_cost_of_a_step(monkeypatch):
    monkeypatch.setattr(planners, "TEMPLATE_DRAWN", 8)
    monkeypatch.setattr(planners, "QUICK", 97)
    monkeypatch.setattr(planners, "SEGMENTS", (4,))
    rows = list(template_rows(True))
    assert len({row.name for row in rows}) == len(rows)
    assert [row.name for row in rows if "finding" in row.name] == [f"{k}: finding" for k in KINDS]
    assert sum(row.name.startswith("one step") for row in rows) == 2
