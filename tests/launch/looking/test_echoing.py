from __future__ import annotations

from typing import Any

import pytest

from palpate.launch.bench_toy import frame
from palpate.launch.looking.echoing import Form, Losses, message_text
from palpate.launch.looking.field_path import read_path
from palpate.launch.looking.filtering import read_filter
from palpate.launch.looking.hearing import Heard
from palpate.launch.looking.showing import Style
from palpate.launch.looking.topics import Topic
from palpate.messages.codec import encode, schema_hash
from palpate.messages.header import Header
from palpate.messages.types import TactileFrame

TOPIC = Topic("/t", "TactileFrame", ("talker",), ())


def heard(touch: int, **more: Any) -> Heard:
    schema = more.get("schema", schema_hash(TactileFrame))
    return Heard("/t", "talker", Header(1, 0, touch, 0, 0.0, schema), encode(frame(touch)), 0, 0)


def paths(*texts: str) -> tuple[Any, ...]:
    return tuple(read_path(text, TactileFrame) for text in texts)


def test_a_message_is_shown_in_yaml_with_a_line_after_it() -> None:
    text = message_text(TOPIC, heard(3), Form())
    assert text is not None
    assert text.splitlines()[:2] == ["goal: 0", "touch: 3"]
    assert 'array: "16 x 16 float64: 2.0e-06, 2.0e-06, 2.0e-06, ..."' in text
    assert text.endswith("\n---")


@pytest.mark.parametrize(
    ("form", "text"),
    [
        (Form(paths("touch")), "3\n---"),
        (Form(paths("touch", "pose[6]", "pose.x")), "touch: 3\npose[6]: 1.0\npose.x: null\n---"),
        (Form(paths("touch", "direction"), csv=True), "3,0.0,0.0,1.0"),
        (Form(wanted=read_filter("touch > 3", TactileFrame)), None),
        (Form(paths("touch"), wanted=read_filter("touch > 2", TactileFrame)), "3\n---"),
        (Form(raw=True), f"{encode(frame(3))!r}\n---"),
        (Form(raw=True, wanted=read_filter("touch > 3", TactileFrame)), None),
    ],
)
def test_what_is_asked_for_is_shown(form: Form, text: str | None) -> None:
    assert message_text(TOPIC, heard(3), form) == text


def test_a_row_has_the_same_columns_for_every_message() -> None:
    form = Form(csv=True, style=Style(full=True))
    rows = [message_text(TOPIC, heard(touch), form) for touch in (3, 4)]
    counts = {row.count(",") for row in rows if row is not None}
    assert counts == {3 + 3 + 7 + 1 + 256 + 5 + 1 - 1}


def test_a_message_of_another_version_is_refused() -> None:
    with pytest.raises(ValueError, match="the graph was started by another version"):
        message_text(TOPIC, heard(3, schema=1), Form())
    assert message_text(TOPIC, heard(3, schema=1), Form(raw=True)) is not None


def test_losses_are_told_once_a_second_and_never_twice() -> None:
    told: list[str] = []
    losses = Losses("/t", told.append)
    for lost, now in ((0, 10.0), (2, 10.5), (3, 10.9), (0, 11.1), (0, 13.0), (1, 13.5)):
        losses.add(lost, now)
    losses.tell()
    losses.tell()
    assert told == [f"/t: {lost} messages lost on the way here so far" for lost in (5, 6)]
