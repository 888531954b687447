"""Paths to fields, filters of messages, and values in YAML."""

import math
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from palpate.messages.types import ShapeModel, TactileFrame
from palpate.tools.introspection.echo import TextStyle, read_filter, read_path, yaml_lines

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
        ("touch >= 7", True),
        ("touch < 7", False),
        ("touch <= 7", True),
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
        ("goal == true", False),
    ],
)
def test_filter_selects_as_python_compares(text, wanted):
    assert read_filter(text, TactileFrame)(FIELDS) is wanted


def test_filter_compares_entries_of_tables():
    wanted = read_filter("health.condition > 2", ShapeModel)
    assert wanted({"health": {"condition": 3.0}}) and not wanted({"health": {}})


NO_VALUE = "expected a number, 'text', true, false or null; got "


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "cannot read ''"),
        ("touch", "'touch' is no comparison; a filter looks like touch > 3 and"),
        ("touch >", "cannot read 'touch >'"),
        ("touch > goal", f"{NO_VALUE}'goal'"),
        ("touch > -goal", f"{NO_VALUE}'-goal'"),
        ("outcome == b'hit'", f"{NO_VALUE}\"b'hit'\""),
        ("touch > 3 4", "cannot read 'touch > 3 4'"),
        ("touch > 3)", "cannot read 'touch > 3)'"),
        ("(touch > 3", "cannot read '(touch > 3'"),
        ("touch > 3 and", "cannot read"),
        ("touch > 3 and goal", "'goal' is no comparison"),
        ("not touch > 3", "'not touch > 3' is no comparison"),
        ("1 < touch < 3", "'1 < touch < 3' is no comparison"),
        ("outcome in 'hit'", "is no comparison"),
        ("tuch > 3", "TactileFrame has no field 'tuch'; did you mean 'touch'?"),
        ("touch + 1 > 3", "'touch + 1' is no field"),
        ("touch > 3x", "cannot read"),
        ("__import__('os').system('ls')", "is no comparison"),
        ("touch.__class__() == 1", "'touch.__class__()' is no field"),
        ("touch = 3", "cannot read 'touch = 3'"),
        ("outcome == 'hit", "cannot read"),
        ("touch > 3\0", "cannot read"),
        ("lambda: 0", "'lambda: 0' is no comparison"),
        ("3 > touch", "'3' is no field"),
        ("(" * 400 + "touch > 3" + ")" * 400, "cannot read"),
        ("touch > " + "-" * 900 + "3", "--filter: "),
        ("+".join(["touch"] * 160) + " > 3", "is no field"),
        ("pose[9] == 0", "pose has 7 elements, from pose[0] to pose[6]"),
        ("pose.x != 0", "pose holds several values by their indices: it has no field 'x'"),
        ("touch > 3 or " * 100 + "touch > 3", "at most 1000 characters, got 1309"),
    ],
)
def test_other_filters_are_refused_in_one_sentence(text, words):
    with pytest.raises(ValueError) as caught:
        read_filter(text, TactileFrame)
    assert words in str(caught.value)


def test_path_leads_to_a_value_within_the_message():
    fields = {"pose": np.arange(7.0), "array": np.eye(2), "touch": 3}
    for text, value in (("touch", 3), ("m.pose[2]", 2.0), ("array[1][1]", 1.0)):
        assert read_path(text, TactileFrame).of(fields) == value
    assert type(read_path("pose[2]", TactileFrame).of(fields)) is float
    assert read_path("health.fallbacks", ShapeModel).of({"health": {"fallbacks": 1.0}}) == 1.0


NO_PATH = "is no field; expected something like"
SEVEN = "pose has 7 elements, from pose[0] to pose[6]"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *((text, NO_PATH) for text in ("", ".", "pose[]", "pose[-1]", "pose[0:3]", "pose[x]")),
        *((text, NO_PATH) for text in ("pose..x", "3", "a b")),
        ("pose[7]", f"'pose[7]': {SEVEN}"),
        ("pose[1000000000]", SEVEN),
        (f"pose[{'9' * 5000}]", SEVEN),
        ("pose.x", "pose holds several values by their indices: it has no field 'x'"),
        ("pose[0][0]", "pose[0] holds one value: it has no element [0]"),
        ("touch[0]", "touch holds one value: it has no element [0]"),
        ("touch.real", "touch holds one value: it has no field 'real'"),
        ("array[0][0][0]", "array[0][0] holds one value: it has no element [0]"),
        ("robot_tim", "has no field 'robot_tim'; did you mean 'robot_time'?"),
    ],
)
def test_path_that_no_message_has_is_refused(text, words):
    with pytest.raises(ValueError) as caught:
        read_path(text, TactileFrame)
    assert words in str(caught.value)


def read_back(value: Any, style: TextStyle) -> Any:
    """A value written in YAML and read again."""
    return YAML(typ="safe", pure=True).load("\n".join(yaml_lines({"x": value}, style)))["x"]


VALUES = [
    *(0, -(1 << 62), 0.1, 1e-6, 1e22, -2.5e-300, -math.inf, True, None),
    *("hit", "", "yes", "null", "3", "a: b", "- a", "# no comment", "two\nlines", " spaced ", "~"),
    *('with "quotes" and \\', "naïve \x85\u2028", "{a}", "..."),
    *({}, {"condition": 1.5, "12": 2.0}, {"deep": {"deeper": [1, 2]}}),
    *([], [{"a": 1}, {"b": "c, d"}]),
]


@pytest.mark.parametrize("flow", [False, True])
def test_every_value_is_read_back_as_it_was_written(flow):
    style = TextStyle(full=True, flow=flow)
    for value in VALUES:
        found = read_back(value, style)
        assert found == value and type(found) is type(value)
    assert math.isnan(read_back(math.nan, style))
    array = np.linspace(-1e-7, 1.0, 30).reshape(5, 3, 2)
    assert np.array_equal(np.array(read_back(array, style)), array)
    assert read_back(np.zeros((0, 3)), style) == []
    assert read_back(np.array([True, False]), style) == [True, False]


def test_long_arrays_are_shortened():
    short, shapes = TextStyle(), TextStyle(arrays=False)
    values = np.full((16, 16), 2e-6)
    assert read_back(values, short) == "16 x 16 float64: 2.0e-06, 2.0e-06, 2.0e-06, ..."
    assert read_back(tuple(range(17)), short) == "17 int: 0, 1, 2, ..."
    assert read_back(np.arange(16.0), short) == list(range(16))
    assert read_back(np.zeros(3), shapes) == "3 float64" and read_back((), shapes) == "0 values"
