from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.launch.looking.filtering import read_filter
from palpate.messages.types import ShapeModel, TactileFrame

FIELDS: dict[str, Any] = {
    "goal": 2,
    "touch": 7,
    "outcome": "hit",
    "pose": np.array([0.0, 0.5, -1.0, 0.0, 0.0, 0.0, 1.0]),
    "robot_time": 1.5,
}


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("touch > 3", True),
        ("touch>=8", False),
        ("m.touch == 7", True),
        ("touch == 7.0", True),
        ("touch != 7", False),
        ("pose[1] <= 5e-1", True),
        ("pose[2] < -.5", True),
        ("outcome == 'hit'", True),
        ('outcome != "and"', True),
        ("outcome < 'i'", True),
        ("goal == 2 and touch == 0 or outcome == 'hit'", True),
        ("goal == 2 and (touch == 0 or outcome == 'miss')", False),
        ("goal == 0 or goal == 1 or goal == 2", True),
        ("  ( ( touch == 7 ) )  ", True),
        ("outcome == 3", False),
        ("goal != null", True),
        ("goal < None", False),
        ("robot_time[0] > 0", False),
        ("pose[9] == 0", False),
        ("pose.x != 0", False),
        ("goal == true", False),
    ],
)
def test_a_filter_wants_what_it_says(text: str, wanted: bool) -> None:
    assert read_filter(text, TactileFrame)(FIELDS) is wanted


def test_entries_of_a_table_can_be_compared() -> None:
    wanted = read_filter("health.condition > 2", ShapeModel)
    assert wanted({"health": {"condition": 3.0}})
    assert not wanted({"health": {}})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected a field; it ends there"),
        ("touch", "expected one of == != <= >= < >; it ends there"),
        ("touch >", "expected a number, 'text', true, false or null; it ends there"),
        ("touch > goal", "expected a number, 'text', true, false or null; got 'goal'"),
        ("touch > 3 4", "'4' is one too many"),
        ("touch > 3)", "')' is one too many"),
        ("(touch > 3", "a bracket is not closed"),
        ("touch > 3 and", "expected a field; it ends there"),
        ("not touch > 3", "TactileFrame has no field 'not'"),
        ("tuch > 3", "TactileFrame has no field 'tuch'; did you mean 'touch'?"),
        ("touch + 1 > 3", "cannot read '+ 1 > 3'"),
        ("touch > 3x", "cannot read '3x'"),
        ("__import__('os').system('ls')", "cannot read"),
        ("touch.__class__()", "expected one of =="),
        ("touch = 3", "cannot read '= 3'"),
        ("outcome == 'hit", 'cannot read "\'hit"'),
        ("lambda: 0", "cannot read ': 0'"),
        ("3 > touch", "expected a field; got '3'"),
        ("(" * 21 + "touch > 3" + ")" * 21, "more than 20 brackets within brackets"),
        ("touch > 3 or " * 100 + "touch > 3", "at most 1000 characters, got 1309"),
    ],
)
def test_anything_else_is_refused_in_one_sentence(text: str, words: str) -> None:
    with pytest.raises(ValueError) as caught:
        read_filter(text, TactileFrame)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("pose > 3", "pose holds several values; name one, as pose[0]"),
        ("outcome > 3", "outcome is 'hit'; 3 is of another kind"),
        ("touch < 'a'", "touch is 7; 'a' is of another kind"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_the_message(text: str, words: str) -> None:
    wanted = read_filter(text, TactileFrame)
    with pytest.raises(ValueError) as caught:
        wanted(FIELDS)
    assert words in str(caught.value)
