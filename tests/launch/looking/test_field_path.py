from __future__ import annotations

import numpy as np
import pytest

from palpate.launch.looking.field_path import read_path
from palpate.messages.types import ShapeModel, TactileFrame


def test_a_path_leads_to_a_value_within_the_message() -> None:
    fields = {"pose": np.arange(7.0), "array": np.eye(2), "touch": 3}
    assert read_path("touch", TactileFrame).of(fields) == 3
    assert read_path("m.pose[2]", TactileFrame).of(fields) == 2.0
    assert read_path("array[1][1]", TactileFrame).of(fields) == 1.0
    assert type(read_path("pose[2]", TactileFrame).of(fields)) is float
    assert read_path("health.fallbacks", ShapeModel).of({"health": {"fallbacks": 1.0}}) == 1.0


@pytest.mark.parametrize("text", ["pose[7]", "pose.x", "touch[0]", "touch.real", "array[0][0][0]"])
def test_a_path_that_leads_nowhere_is_no_value(text: str) -> None:
    fields = {"pose": np.arange(7.0), "array": np.eye(2), "touch": 3}
    with pytest.raises(LookupError):
        read_path(text, TactileFrame).of(fields)


@pytest.mark.parametrize("text", ["", ".", "pose[]", "pose[-1]", "pose[x]", "pose..x", "3", "a b"])
def test_what_is_no_path_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is no field; expected something like"):
        read_path(text, TactileFrame)


def test_an_unknown_field_is_refused_with_the_nearest() -> None:
    with pytest.raises(ValueError, match=r"has no field 'robot_tim'; did you mean 'robot_time'\?"):
        read_path("robot_tim", TactileFrame)
