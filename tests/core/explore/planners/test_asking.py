from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pytest

from palpate.core.explore.planners.asking import ask
from palpate.core.explore.planners.catalogue import NAMES, make_planner
from palpate.core.explore.planners.choice import Choice, Height, Stop, Wait
from palpate.core.explore.planners.known import Known, Slice

MakeKnown = Callable[..., Known]


@dataclass(frozen=True)
class Says:
    """A planner that always says the same."""

    choice: Any

    def next(self, known: Known) -> Choice:
        return cast("Choice", self.choice)


@pytest.mark.parametrize("name", NAMES)
def test_what_palpates_own_planners_answer_is_handed_on(name: str, known: MakeKnown) -> None:
    planner = make_planner(name, {})
    assert ask(planner, known()) == planner.next(known())


@pytest.mark.parametrize(
    ("choice", "more"),
    [
        (Height(0.01, "up"), {}),
        (Height(np.float64(0.03), "up"), {"taken": (0.01,), "apart": 0.02}),
        (Wait("busy"), {"taken": (0.01,)}),
        (Stop("end", None), {}),
        (Stop("end", True, 0.0, 0.002), {}),
    ],
)
def test_an_answer_that_can_be_acted_on_is_handed_on(
    choice: Choice, more: dict[str, Any], known: MakeKnown
) -> None:
    assert ask(Says(choice), known(**more)) is choice


@pytest.mark.parametrize(
    ("choice", "more", "words"),
    [
        (None, {}, "must answer with a Height, a Wait or a Stop, got None"),
        (0.045, {}, "must answer with a Height, a Wait or a Stop, got 0.045"),
        (Height(math.nan, ""), {}, "must lie between 0 and 0.09 m, got nan m"),
        (Height(0.09, ""), {}, "must lie between 0 and 0.09 m, got 0.09 m"),
        (Height(-1.0, ""), {}, "must lie between 0 and 0.09 m, got -1 m"),
        (Height(0.02, ""), {"taken": (0.02,)}, "was asked for at 0.02 m before"),
        (
            Height(0.02, ""),
            {"taken": (0.03,), "apart": 0.02},
            "0.02 m is nearer than 0.02 m to a finger at 0.03 m",
        ),
        (Wait(""), {}, "it waits, but no finger is at work"),
        (Stop("", True, -1.0), {}, "bound must be 0 or more and finite, got -1.0 m"),
        (Stop("", True, None, math.nan), {}, "unfelt must be 0 or more and finite, got nan m"),
    ],
)
def test_an_answer_that_nobody_could_act_on_is_refused(
    choice: Any, more: dict[str, Any], words: str, known: MakeKnown
) -> None:
    with pytest.raises(ValueError) as caught:
        ask(Says(choice), known(**more))
    assert str(caught.value).startswith("the planner Says gave no answer to act on: ")
    assert words in str(caught.value)


def test_a_planner_that_asks_for_a_failed_height_again_does_not_go_on_for_ever(
    known: MakeKnown, failed: Callable[[float], Slice]
) -> None:
    with pytest.raises(ValueError, match=r"at 0.045 m before; it must go elsewhere, or stop"):
        ask(Says(Height(0.045, "")), known([failed(0.045)]))
