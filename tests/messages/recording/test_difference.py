from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.messages.codec import encode
from palpate.messages.recording.difference import first_difference
from palpate.messages.types import LogRecord, TactileFrame

FRAME = TactileFrame(
    goal=1,
    touch=2,
    finger=1,
    direction=np.array([0.0, 0.0, 1.0]),
    pose=np.array([0, 0, 0, 0, 0, 0, 1.0]),
    outcome="hit",
    array=np.ones((3, 4)),
    robot_time=0.5,
)


def changed(value: float) -> TactileFrame:
    array = np.ones((3, 4))
    array[1, 2] = value
    return replace(FRAME, array=array)


def test_identical_bodies_do_not_differ() -> None:
    assert first_difference(TactileFrame, encode(FRAME), encode(FRAME)) is None


@pytest.mark.parametrize(
    ("other", "found"),
    [
        (replace(FRAME, touch=3), ("touch", "2", "3")),
        (replace(FRAME, outcome="miss"), ("outcome", "'hit'", "'miss'")),
        (replace(FRAME, robot_time=0.75), ("robot_time", "0.5", "0.75")),
        (replace(FRAME, array=np.ones((3, 5))), ("array.shape", "(3, 4)", "(3, 5)")),
        (changed(1.0 + 2**-52), ("array[1, 2]", "1.0", "1.0000000000000002")),
        (replace(FRAME, touch=3, outcome="miss"), ("touch", "2", "3")),
    ],
)
def test_the_first_field_that_differs_is_named(
    other: TactileFrame, found: tuple[str, str, str]
) -> None:
    assert first_difference(TactileFrame, encode(FRAME), encode(other)) == found


def test_a_zero_that_changed_its_sign_is_a_difference() -> None:
    here, there = (encode(changed(zero)) for zero in (0.0, -0.0))

    assert first_difference(TactileFrame, here, there) == ("array[1, 2]", "0.0", "-0.0")


def test_long_values_are_shortened() -> None:
    here, there = (
        encode(LogRecord(node="a", level="info", text=letter * 1000, robot_time=0.0))
        for letter in "xy"
    )

    assert first_difference(LogRecord, here, there) == (
        "text",
        "'" + "x" * 56 + "...",
        "'" + "y" * 56 + "...",
    )


def test_one_entry_of_a_table_is_named() -> None:
    from palpate.messages.recording.difference import _difference

    assert _difference({"a": 1.0, "b": 2.0}, {"a": 1.0, "b": 3.0}) == ("['b']", "2.0", "3.0")
    assert _difference({"a": 1.0}, {"a": 1.0}) is None


def test_equal_values_in_other_bytes_are_a_difference() -> None:
    body = encode(LogRecord(node="a", level="info", text="b", robot_time=0.0))
    longer = body.replace(b"\xa1b", b"\xd9\x01b")  # the same text with a longer prefix

    place = body.index(b"\xa1b")
    assert first_difference(LogRecord, body, longer) == (f"bytes[{place}]", "0xa1", "0xd9")


def test_a_body_that_is_no_message_is_a_difference() -> None:
    body = encode(LogRecord(node="a", level="info", text="b", robot_time=0.0))

    found = first_difference(LogRecord, body, b"\x80")

    assert found is not None
    assert found[0] == "bytes"
    assert "missing fields" in found[2]
