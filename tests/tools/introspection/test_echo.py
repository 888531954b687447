from typing import Any

import numpy as np
import pytest

from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.types.model import ShapeModel
from palpate.messages.types.touch import TactileFrame
from palpate.tools.introspection.echo import (
    EchoFormat,
    FieldReport,
    LossReport,
    TextStyle,
    message_text,
    read_filter,
    read_path,
)
from palpate.tools.introspection.topics import TapMessage, Topic
from tests.studies.toy_node import frame

TOPIC = Topic("/t", "TactileFrame", ("talker",), ())


def received(touch, **more):
    schema = more.get("schema", schema_hash(TactileFrame))
    return TapMessage(
        "/t", "talker", Header(1, 0, touch, 0, 0.0, schema), encode(frame(touch)), 0, 0
    )


def paths(*texts):
    return tuple(read_path(text, TactileFrame) for text in texts)


def test_a_message_is_shown_in_yaml_with_a_line_after_it():
    text = message_text(TOPIC, received(3), EchoFormat())
    assert text is not None
    assert text.splitlines()[:2] == ["goal: 0", "touch: 3"]
    assert 'array: "16 x 16 float64: 2.0e-06, 2.0e-06, 2.0e-06, ..."' in text
    assert text.endswith("\n---")


@pytest.mark.parametrize(
    ("form", "text"),
    [
        (EchoFormat(paths("touch")), "3\n---"),
        (
            EchoFormat(paths("touch", "pose[6]")),
            "touch: 3\npose[6]: 1.0\n---",
        ),
        (EchoFormat(paths("touch", "direction"), csv=True), "3,0.0,0.0,1.0"),
        (EchoFormat(wanted=read_filter("touch > 3", TactileFrame)), None),
        (EchoFormat(paths("touch"), wanted=read_filter("touch > 2", TactileFrame)), "3\n---"),
        (EchoFormat(raw=True), f"{encode(frame(3))!r}\n---"),
        (EchoFormat(raw=True, wanted=read_filter("touch > 3", TactileFrame)), None),
    ],
)
def test_what_is_asked_for_is_shown(form, text):
    assert message_text(TOPIC, received(3), form) == text


def test_a_row_has_the_same_columns_for_every_message():
    form = EchoFormat(csv=True, style=TextStyle(full=True))
    rows = [message_text(TOPIC, received(touch), form) for touch in (3, 4)]
    counts = {row.count(",") for row in rows if row is not None}
    assert counts == {3 + 3 + 7 + 1 + 256 + 5 + 1 - 1}


def test_a_message_of_another_version_is_refused():
    with pytest.raises(ValueError, match="the graph was started by another version"):
        message_text(TOPIC, received(3, schema=1), EchoFormat())
    assert message_text(TOPIC, received(3, schema=1), EchoFormat(raw=True)) is not None


def test_losses_are_told_once_a_second_and_never_twice():
    told: list[str] = []
    losses = LossReport("/t", told.append)
    for lost, now in ((0, 10.0), (2, 10.5), (3, 10.9), (0, 11.1), (0, 13.0), (1, 13.5)):
        losses.add(lost, now)
    losses.tell()
    losses.tell()
    assert told == [f"/t: {lost} messages lost on the way here so far" for lost in (5, 6)]


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
        ("goal == true", False),
    ],
)
def test_a_filter_wants_what_it_says(text, wanted):
    assert read_filter(text, TactileFrame)(FIELDS) is wanted


def test_entries_of_a_table_can_be_compared():
    wanted = read_filter("health.condition > 2", ShapeModel)
    assert wanted({"health": {"condition": 3.0}})
    assert not wanted({"health": {}})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "cannot read ''"),
        ("touch", "'touch' is no comparison; a filter looks like touch > 3 and"),
        ("touch >", "cannot read 'touch >'"),
        ("touch > goal", "expected a number, 'text', true, false or null; got 'goal'"),
        ("touch > -goal", "expected a number, 'text', true, false or null; got '-goal'"),
        ("outcome == b'hit'", "expected a number, 'text', true, false or null; got \"b'hit'\""),
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
def test_anything_else_is_refused_in_one_sentence(text, words):
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
def test_what_cannot_be_compared_is_refused_with_the_message(text, words):
    wanted = read_filter(text, TactileFrame)
    with pytest.raises(ValueError) as caught:
        wanted(FIELDS)
    assert words in str(caught.value)


def test_a_path_leads_to_a_value_within_the_message():
    fields = {"pose": np.arange(7.0), "array": np.eye(2), "touch": 3}
    assert read_path("touch", TactileFrame).of(fields) == 3
    assert read_path("m.pose[2]", TactileFrame).of(fields) == 2.0
    assert read_path("array[1][1]", TactileFrame).of(fields) == 1.0
    assert type(read_path("pose[2]", TactileFrame).of(fields)) is float
    assert read_path("health.fallbacks", ShapeModel).of({"health": {"fallbacks": 1.0}}) == 1.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("pose[7]", "'pose[7]': pose has 7 elements, from pose[0] to pose[6]"),
        ("pose[1000000000]", "pose has 7 elements, from pose[0] to pose[6]"),
        (f"pose[{'9' * 5000}]", "pose has 7 elements, from pose[0] to pose[6]"),
        ("pose.x", "pose holds several values by their indices: it has no field 'x'"),
        ("pose[0][0]", "pose[0] holds one value: it has no element [0]"),
        ("touch[0]", "touch holds one value: it has no element [0]"),
        ("touch.real", "touch holds one value: it has no field 'real'"),
        ("array[0][0][0]", "array[0][0] holds one value: it has no element [0]"),
    ],
)
def test_a_path_that_no_message_can_have_is_refused(text, words):
    with pytest.raises(ValueError) as caught:
        read_path(text, TactileFrame)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "fields", "words"),
    [
        ("health.fallback", {"health": {"fallbacks": 1.0}}, "did you mean 'fallbacks'?"),
        ("vertices[2]", {"vertices": np.eye(2, 3)}, "from vertices[0] to vertices[1]"),
        ("vertices[0]", {"vertices": np.zeros((0, 3))}, "vertices has 0 elements, none"),
    ],
)
def test_a_value_that_no_message_had_is_refused_in_the_end(text, fields, words):
    told: list[str] = []
    report, path = FieldReport(told.append), read_path(text, ShapeModel)
    form = EchoFormat(lacking=report.note)
    assert form.value(path, fields) is None
    assert form.value(path, fields) is None
    assert len(told) == 1 and words in told[0]
    with pytest.raises(ValueError, match="no message that was shown has it"):
        report.check()
    form.value(path, {"health": {"fallback": 1.0}, "vertices": np.eye(3)})
    report.check()


@pytest.mark.parametrize(
    "text", ["", ".", "pose[]", "pose[-1]", "pose[0:3]", "pose[x]", "pose..x", "3", "a b"]
)
def test_what_is_no_path_is_refused(text):
    with pytest.raises(ValueError, match="is no field; expected something like"):
        read_path(text, TactileFrame)


def test_an_unknown_field_is_refused_with_the_nearest():
    with pytest.raises(ValueError, match=r"has no field 'robot_tim'; did you mean 'robot_time'\?"):
        read_path("robot_tim", TactileFrame)
