from __future__ import annotations

import pytest

from palpate.messages.bus import handshake as join

CALL = join.join_call("finger_1/filter", 2, "simulator")


def test_a_call_is_read_as_it_was_published():
    assert join.read_request(b"\x01" + CALL) == join.JoinRequest(
        "finger_1/filter", CALL, "simulator", None, "", 0
    )


def test_a_cursor_is_read_as_it_was_published():
    notice = b"\x01" + join.join_cursor(CALL, 3, "/touch/raw", 17)
    assert join.read_request(notice) == join.JoinRequest(
        "finger_1/filter", CALL, "simulator", 3, "/touch/raw", 17
    )


@pytest.mark.parametrize(
    "notice",
    [
        b"",
        b"\x00" + CALL,
        b"\x01/touch/raw\0",
        b"\x01@a b",
        b"\x01@a x b ",
        b"\x01@a 0 b x /t 1",
        b"\x01@a 0 b 0 /t x",
        b"\x01@\xff\xfe",
        b"\x01@a " + b"9" * 5000 + b" b ",  # more digits than Python takes for a number
        b"\x01@a 0 b 0 /t " + b"9" * 20,
        "\x01@a \u0661 b ".encode(),
        b"\x01@" + b"a" * 5000 + b" 0 b ",
    ],
)
def test_any_other_notice_is_no_request(notice: bytes):
    assert join.read_request(notice) is None


def test_answers_are_read_as_they_were_sent():
    greeting = join.read_reply(join.greeting(CALL, 4))
    assert (greeting.publisher, greeting.kind) == ("simulator", join.GREETING)
    assert join.read_epoch(greeting.rest) == 4
    assert join.read_reply(join.resent_frame(CALL, b"/t\0frame")).rest == b"/t\0frame"
    assert join.read_reply(join.in_step_notice(CALL, "/t")) == join.JoinReply(
        "simulator", join.IN_STEP, b"/t"
    )


@pytest.mark.parametrize("frame", [b"@a 0 b ", b"@a 0\0H", CALL + b"\0X", CALL + b"\0"])
def test_a_frame_that_is_no_answer_is_refused(frame: bytes):
    with pytest.raises(ValueError, match="not an answer"):
        join.read_reply(frame)


def test_an_answer_of_a_publisher_that_is_no_text_is_refused():
    with pytest.raises(ValueError, match="the name of its publisher is not Unicode") as caught:
        join.read_reply(b"@a 0 \xff \0H")
    assert type(caught.value) is ValueError


def test_a_greeting_of_the_wrong_length_is_refused():
    with pytest.raises(ValueError, match="a greeting must hold 4 bytes, got 1"):
        join.read_epoch(b"x")


@pytest.mark.parametrize("name", ["", "a b", "@a", "a\n"])
def test_a_name_that_would_break_a_request_is_refused(name: str):
    with pytest.raises(ValueError, match="a node's name must be printable"):
        join.check_node_name(name)


def test_a_name_may_hold_a_namespace():
    assert join.check_node_name("finger_1/filter") == "finger_1/filter"
