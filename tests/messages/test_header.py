from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.messages.header import SIZE, Header, pack_frame, split_frame

HEADER = Header(run=1 << 63, epoch=3, seq=1 << 40, sent_ns=-5, robot_time=0.25, schema=0xFFFFFFFF)


def test_a_frame_comes_back_as_it_was() -> None:
    frame = pack_frame("/touch/raw", HEADER, b"\0body\0")

    assert split_frame(frame) == ("/touch/raw", HEADER, b"\0body\0")


def test_a_frame_begins_with_its_topic_and_a_zero() -> None:
    # Subscriptions match the beginning: without the zero /touch would also hear /touch/raw.
    assert pack_frame("/touch", HEADER, b"").startswith(b"/touch\0")


def test_an_empty_body_is_a_body() -> None:
    assert split_frame(pack_frame("/a", HEADER, b""))[2] == b""


@pytest.mark.parametrize(
    "frame",
    [
        b"",
        b"/touch/raw",
        b"\0",
        b"/touch/raw\0" + b"\1" * (SIZE - 1),
    ],
)
def test_a_frame_that_is_cut_off_is_refused(frame: bytes) -> None:
    with pytest.raises(ValueError, match=f"not a frame: {len(frame)} bytes without a topic"):
        split_frame(frame)


def test_a_topic_that_is_no_text_is_refused() -> None:
    with pytest.raises(ValueError, match="not a frame: its topic is not Unicode"):
        split_frame(b"\xff\xfe\0" + b"\1" * SIZE)


@given(st.binary(max_size=200))
def test_random_bytes_are_split_or_refused(frame: bytes) -> None:
    try:
        topic, header, body = split_frame(frame)
    except ValueError as error:
        assert str(error).startswith("not a frame: ")
    else:
        assert len(topic.encode()) + 1 + SIZE + len(body) == len(frame)
        assert isinstance(header, Header)
