"""Messages to bytes and back; limits, headers, schemas, differences."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.messages import codec
from palpate.messages.codec import (
    HEADER_SIZE,
    Header,
    decode,
    encode,
    first_difference,
    pack_frame,
    split_frame,
)
from palpate.messages.fields import MAX_FIELDS, MAX_ITEMS, MAX_NESTED, MAX_TEXT, CodecError
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.model import ModelGoal, ShapeModel
from palpate.messages.types.touch import TactileFrame
from palpate.messages.types.world import World

Make = Callable[..., Any]


def unpacked(message: object) -> dict[str, Any]:
    """The map on the wire."""
    fields: dict[str, Any] = msgpack.unpackb(encode(message))
    return fields


def refused(cls: type, body: bytes, words: str) -> None:
    with pytest.raises(CodecError, match=words):
        decode(cls, body)


def array_of(shape: object, data: object, dtype: object = "<f8") -> dict[str, object]:
    return {"dtype": dtype, "shape": shape, "data": data}


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        (array_of([1, 1], b"\0" * 4, "<f4"), "must be a map of dtype <f8, shape and data"),
        (array_of([1, 1], b"\0" * 8, "|O"), "must be a map of dtype <f8"),
        (array_of([1, 1], b"\0" * 8, ["<f8"]), "must be a map of dtype <f8"),
        ([1.0], "must be a map of dtype <f8"),
        ({"dtype": "<f8", "shape": [0, 0]}, "must be a map of dtype <f8"),
        (array_of([1, 1], b"\0" * 8) | {"more": 1}, "must be a map of dtype <f8"),
        (array_of([1], b"\0" * 8), r"must have shape \(any, any\) and bytes as data"),
        (array_of([1, 1, 1], b"\0" * 8), r"must have shape \(any, any\)"),
        (array_of("11", b"\0" * 8), r"must have shape \(any, any\)"),
        (array_of([1, 1], "\0" * 8), "and bytes as data"),
        (array_of([1, 2], b"\0" * 8), r"has 8 bytes, which do not fill shape \[1, 2\]"),
        (array_of([-1, -1], b"\0" * 8), "must have a shape of whole numbers, none below 0"),
        (array_of([True, 1], b"\0" * 8), "must have a shape of whole numbers"),
        (array_of([1.0, 1], b"\0" * 8), "must have a shape of whole numbers"),
        (array_of([1 << 40, 1 << 40], b"\0" * 8), "do not fill shape"),
        (array_of([0, 1 << 62], b""), "do not fill shape|must have shape"),
        (array_of([0, (1 << 64) - 1], b""), "do not fill shape|must have shape"),
        (array_of([1, 1], np.float64(np.nan).tobytes()), "must be finite"),
        (array_of([1, 1], np.float64(-np.inf).tobytes()), "must be finite"),
    ],
)
def test_an_array_that_is_none_is_refused(entry: object, words: str, example: Make):
    fields = unpacked(example(TactileFrame)) | {"array": entry}
    refused(TactileFrame, msgpack.packb(fields), f"^not a TactileFrame: array .*({words})")


def test_a_mask_holds_only_zero_and_one(example: Make):
    from palpate.messages.types.touch import TactileImage

    fields = unpacked(example(TactileImage)) | {"mask": array_of([1, 3], b"\0\1\2", "|b1")}
    refused(TactileImage, msgpack.packb(fields), "mask must hold 0 or 1 only")


def test_an_empty_array_is_an_array(example: Make):
    fields = unpacked(example(TactileFrame)) | {"array": array_of([0, 7], b"")}
    assert decode(TactileFrame, msgpack.packb(fields)).array.shape == (0, 7)


@pytest.mark.parametrize(
    ("cls", "name", "value", "words"),
    [
        (World, "platform", 1, "must be a float, got 1"),
        (World, "platform", "1.0", "must be a float, got '1.0'"),
        (World, "platform", float("nan"), "must be finite, got nan"),
        (World, "platform", [1.0], "must be a float, got a list"),
        (World, "platform", None, "must be a float, got a NoneType"),
        (World, "seed", 1.0, "must be an integer, got 1.0"),
        (World, "seed", True, "must be an integer, got True"),
        (World, "seed", (1 << 64) - 1, "must fit into 64 bits"),
        (World, "seed", "x" * 100, r"must be an integer, got 'x{36}\.\.\.$"),
        (LogRecord, "level", "loud", "must be one of .*, got 'loud'"),
        (LogRecord, "level", ["info"], "must be one of .*, got a list"),
        (LogRecord, "text", b"bytes", "must be text, got a bytes"),
        (LogRecord, "text", 7, "must be text, got 7"),
        (ModelGoal, "contours", {"1": 1}, "must be a list of at most"),
        (ModelGoal, "contours", "123", "must be a list of at most"),
        (ModelGoal, "contours", [1, 2.5], "must be an integer, got 2.5"),
        (ModelGoal, "contours", [[1]], "must be an integer, got a list"),
        (
            ShapeModel,
            "health",
            [["a", 1.0]],
            f"must be a table of at most {MAX_FIELDS}, got a list",
        ),
        (ShapeModel, "health", {"a": 1}, "must be a float, got 1"),
        (ShapeModel, "health", {"a": float("nan")}, "must be finite"),
        (ShapeModel, "health", {"a": {"b": 1.0}}, "must be a float, got a dict"),
    ],
)
def test_a_received_value_is_checked(cls, name, value, words, example: Make):
    fields = unpacked(example(cls)) | {name: value}
    refused(cls, msgpack.packb(fields), f"^not a {cls.__name__}: {name} {words}")


def test_whole_numbers_and_numpy_numbers_are_packed_as_what_the_field_is(example: Make):
    world = World(platform=0, reach=np.float32(0.5), fingers=np.int16(1), seed=np.uint8(3))
    back = decode(World, encode(world))
    assert (back.platform, back.reach, back.fingers, back.seed) == (0.0, 0.5, 1, 3)
    assert type(back.platform) is float


def test_a_long_text_is_refused_at_both_ends(example: Make):
    record = example(LogRecord)
    long = "µ" * (MAX_TEXT // 2 + 1)
    with pytest.raises(CodecError, match=f"text must be at most {MAX_TEXT} bytes long"):
        encode(LogRecord(**{**unpacked(record), "text": long}))
    refused(LogRecord, msgpack.packb(unpacked(record) | {"text": long}), "exceeds max_str_len")


def test_text_that_is_no_unicode_is_refused_at_both_ends(example: Make):
    fields = unpacked(example(LogRecord))
    with pytest.raises(CodecError, match=r"^not a LogRecord: text must be Unicode"):
        encode(LogRecord(**{**fields, "text": "\ud800"}))
    body = msgpack.packb(fields | {"text": "xyz"}).replace(b"xyz", b"\xff\xfe\xfd")
    refused(LogRecord, body, "^not a LogRecord: UnicodeDecodeError")


@pytest.mark.parametrize("value", [10**400, -(10**400)])
def test_an_integer_beyond_all_floats_is_refused(value: int, example: Make):
    world = World(platform=value, reach=1.0, fingers=1, seed=0)
    with pytest.raises(CodecError, match=r"^not a World: platform must be finite"):
        encode(world)


def test_a_huge_integer_is_refused_without_being_printed(example: Make):
    world = World(platform=0.0, reach=1.0, fingers=1, seed=10**5000)
    with pytest.raises(CodecError, match=r"^not a World: seed must fit into 64 bits$"):
        encode(world)
    record = example(LogRecord)
    with pytest.raises(CodecError, match=r"^not a LogRecord: text must be text, got an integer"):
        encode(LogRecord(**{**unpacked(record), "text": 10**5000}))


def test_a_long_list_is_refused_at_both_ends(example: Make):
    ids = tuple(range(MAX_ITEMS + 1))
    goal = example(ModelGoal)
    fields = unpacked(goal) | {"contours": list(ids)}
    with pytest.raises(CodecError, match=f"contours must be a list of at most {MAX_ITEMS}"):
        encode(dataclasses.replace(goal, contours=ids))
    refused(ModelGoal, msgpack.packb(fields), "exceeds max_array_len")


def test_a_large_table_is_refused_at_both_ends(example: Make):
    fields = unpacked(example(ShapeModel))
    table = {str(i): 0.0 for i in range(MAX_FIELDS + 1)}
    model = example(ShapeModel)
    object.__setattr__(model, "health", table)
    with pytest.raises(CodecError, match=f"health must be a table of at most {MAX_FIELDS}"):
        encode(model)
    refused(ShapeModel, msgpack.packb(fields | {"health": table}), "exceeds max_map_len")


def test_missing_and_unknown_fields_are_named(example: Make):
    fields = unpacked(example(World))
    fields["colour"] = fields.pop("seed")
    refused(
        World,
        msgpack.packb(fields),
        r"^not a World: missing fields \['seed'\], unknown fields \['colour'\]$",
    )


def test_an_array_that_is_not_contiguous_comes_back_in_order(example: Make):
    frame = example(TactileFrame)
    object.__setattr__(frame, "array", np.arange(24.0).reshape(4, 6)[::2, ::-3].T)
    np.testing.assert_array_equal(decode(TactileFrame, encode(frame)).array, frame.array)


def test_changing_an_array_after_encoding_changes_nothing(example: Make):
    frame = example(TactileFrame)
    body = encode(frame)
    before = frame.array.copy()
    frame.array[...] = 7.0
    np.testing.assert_array_equal(decode(TactileFrame, body).array, before)


@pytest.mark.parametrize("shape", [(1, 1), (4, 4), (16, 16)])
def test_finite_values_pass_though_their_sum_would_not_be(shape: tuple[int, int], example: Make):
    huge = np.full(shape, 1.7e308)
    body = encode(dataclasses.replace(example(TactileFrame), array=huge))
    assert decode(TactileFrame, body).array.tobytes() == huge.tobytes()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("shape", [(4, 4), (16, 16)])
def test_one_value_that_is_not_finite_is_found_wherever_it_is(
    shape: tuple[int, int], bad: float, example: Make
):
    message = example(TactileFrame)
    for place in np.ndindex(shape):
        array = np.full(shape, 1.7e308)
        array[place] = bad
        with pytest.raises(CodecError, match="array must be finite"):
            encode(dataclasses.replace(message, array=array))


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"", "not a World: ValueError"),
        (b"\xc1", "not a World: FormatError"),
        (msgpack.packb([1, 2, 3]), "not a World: a list, not a map"),
        (msgpack.packb(None), "not a World: a NoneType, not a map"),
        (msgpack.packb({}) + b"\0", "not a World: ExtraData"),
        (msgpack.packb({1: 2}), "not a World: ValueError: int is not allowed for map key"),
        (b"\x81\xc4\x01a\x01", r"missing fields .* unknown fields"),
    ],
)
def test_bytes_that_are_no_map_of_fields_are_refused(body: bytes, words: str):
    refused(World, body, words)


@pytest.mark.parametrize(
    "prefix",
    [
        b"\xdd\xff\xff\xff\xff",  # list
        b"\xdf\xff\xff\xff\xff",  # map
        b"\xc6\xff\xff\xff\xff",  # bytes
        b"\xdb\xff\xff\xff\xff",  # text
        b"\xc9\xff\xff\xff\xff\x01",  # extension
        b"\xdc\xff\xff",
        b"\xde\xff\xff",
        b"\xda\xff\xff",
    ],
)
def test_a_length_that_was_never_sent_is_refused(prefix: bytes):
    refused(World, prefix, "^not a World: ValueError")
    refused(World, b"\x81\xa4seed" + prefix, "^not a World: ValueError")


@pytest.mark.parametrize("code", [-128, -1, 0, 5, 127])
@pytest.mark.parametrize("size", [0, 1, 4, 8, 12, 16, 100])
def test_an_extension_is_refused(code: int, size: int, example: Make):
    head = {1: b"\xd4", 4: b"\xd6", 8: b"\xd7", 16: b"\xd8"}.get(size, b"\xc7" + bytes([size]))
    extension = head + code.to_bytes(1, "little", signed=True) + b"\0" * size
    packed = msgpack.packb(unpacked(example(World)) | {"seed": 77})
    assert packed.count(b"\xa4seed\x4d") == 1
    refused(World, packed.replace(b"\xa4seed\x4d", b"\xa4seed" + extension), "^not a World: ")


@pytest.mark.parametrize("depth", [3, 9, 500, 1024, 100_000])
def test_deep_nesting_is_refused(depth: int, example: Make):
    deep = b"\x91" * depth + b"\xc0"
    fields = unpacked(example(ModelGoal))
    del fields["probes"]
    body = msgpack.packb(fields | {"probes": None})  # last, so that it can be exchanged
    assert body.endswith(b"\xc0")
    refused(ModelGoal, body[:-1] + deep, "^not a ModelGoal: ")


def test_a_million_empty_lists_are_refused_before_they_exist():
    body = b"\x81\xa4seed\xdd\x00\x0f\x00\x00" + b"\x90" * 0xF0000
    refused(World, body, "exceeds max_array_len")


def test_empty_lists_within_lists_are_refused_before_they_take_seventy_times_their_bytes():
    lists = 255 * (b"\xdc\x10\x00" + b"\x90" * 4096)
    body = b"\x81\xa4seed\xdc\x00\xff" + lists
    refused(World, body, "not a World: ValueError: more than 129 lists and maps")


def test_no_message_comes_near_the_most_lists_and_maps(example: Make):
    for cls in (ShapeModel, ModelGoal):
        assert encode(example(cls)).count(b"shape") * 2 + 20 < MAX_NESTED


@pytest.mark.parametrize(
    "shape", [["x" * 4000], [{}], [[1]], [-1], [1.0], [True], [2**64 - 1, 2**64 - 1]]
)
def test_a_shape_that_is_none_is_refused_in_few_words(shape: list[Any], example: Make):
    fields = unpacked(example(TactileFrame))
    fields["direction"] = {"dtype": "<f8", "shape": shape, "data": bytes(24)}
    with pytest.raises(CodecError, match="not a TactileFrame: direction must have") as caught:
        decode(TactileFrame, msgpack.packb(fields))
    assert len(str(caught.value)) < 120


def test_unknown_fields_are_told_in_few_words():
    body = msgpack.packb({f"{i} " + "x" * 4000: i for i in range(60)})
    with pytest.raises(CodecError, match=r"unknown fields .*, \.\.\.$") as caught:
        decode(World, body)
    assert len(str(caught.value)) < 600


def test_a_body_is_measured_before_it_is_unpacked():
    refused(
        World,
        b"\0" * (codec.MAX_BYTES + 1),
        f"^not a World: {codec.MAX_BYTES + 1} bytes, at most {codec.MAX_BYTES} are allowed$",
    )


def test_a_type_may_allow_larger_bodies(example: Make):
    model = example(ShapeModel)
    object.__setattr__(model, "vertices", np.zeros((100_000, 3)))
    assert decode(ShapeModel, encode(model)).vertices.shape == (100_000, 3)
    most = ShapeModel.MAX_BYTES
    with pytest.raises(CodecError, match=rf"not a ShapeModel: {most + 1} bytes, at most {most} "):
        decode(ShapeModel, bytes(most + 1))


@given(st.binary(max_size=300))
@settings(max_examples=300, deadline=None)
def test_random_bytes_are_refused_in_one_way(body: bytes):
    with pytest.raises(CodecError, match="not a World"):
        decode(World, body)


@given(st.integers(0, 10_000), st.integers(0, 255))
@settings(max_examples=500, deadline=None)
def test_a_changed_byte_gives_a_checked_message_or_a_refusal(place: int, value: int):
    body = bytearray(encode(FRAME))
    body[place % len(body)] = value
    try:
        found = decode(TactileFrame, bytes(body))
    except CodecError as error:
        assert len(str(error)) < 300
    else:
        assert np.isfinite(found.array).all()
        assert found.array.ndim == 2


HEADER = Header(run=1 << 63, epoch=3, seq=1 << 40, sent_ns=-5, robot_time=0.25, schema=0xFFFFFFFF)


def test_a_frame_comes_back_as_it_was():
    frame = pack_frame("/touch/raw", HEADER, b"\0body\0")
    assert split_frame(frame) == ("/touch/raw", HEADER, b"\0body\0")


def test_a_frame_begins_with_its_topic_and_a_zero():
    # Subscriptions match the beginning: without the zero /touch would also hear /touch/raw.
    assert pack_frame("/touch", HEADER, b"").startswith(b"/touch\0")


def test_an_empty_body_is_a_body():
    assert split_frame(pack_frame("/a", HEADER, b""))[2] == b""


@pytest.mark.parametrize(
    "frame",
    [
        b"",
        b"/touch/raw",
        b"\0",
        b"/touch/raw\0" + b"\1" * (HEADER_SIZE - 1),
    ],
)
def test_a_frame_that_is_cut_off_is_refused(frame: bytes):
    with pytest.raises(ValueError, match=f"not a frame: {len(frame)} bytes without a topic"):
        split_frame(frame)


def test_a_topic_that_is_no_text_is_refused():
    with pytest.raises(ValueError, match="not a frame: its topic is not Unicode"):
        split_frame(b"\xff\xfe\0" + b"\1" * HEADER_SIZE)


@given(st.binary(max_size=200))
def test_random_bytes_are_split_or_refused(frame: bytes):
    try:
        topic, header, body = split_frame(frame)
    except ValueError as error:
        assert str(error).startswith("not a frame: ")
    else:
        assert len(topic.encode()) + 1 + HEADER_SIZE + len(body) == len(frame)
        assert isinstance(header, Header)


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


def test_identical_bodies_do_not_differ():
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
def test_the_first_field_that_differs_is_named(other: TactileFrame, found: tuple[str, str, str]):
    assert first_difference(TactileFrame, encode(FRAME), encode(other)) == found


def test_a_zero_that_changed_its_sign_is_a_difference():
    here, there = (encode(changed(zero)) for zero in (0.0, -0.0))
    assert first_difference(TactileFrame, here, there) == ("array[1, 2]", "0.0", "-0.0")


def test_long_values_are_shortened():
    here, there = (
        encode(LogRecord(node="a", level="info", text=letter * 1000, robot_time=0.0))
        for letter in "xy"
    )
    assert first_difference(LogRecord, here, there) == (
        "text",
        "'" + "x" * 56 + "...",
        "'" + "y" * 56 + "...",
    )


def test_one_entry_of_a_table_is_named():
    from palpate.messages.codec import _difference

    assert _difference({"a": 1.0, "b": 2.0}, {"a": 1.0, "b": 3.0}) == ("['b']", "2.0", "3.0")
    assert _difference({"a": 1.0}, {"a": 1.0}) is None


def test_equal_values_in_other_bytes_are_a_difference():
    body = encode(LogRecord(node="a", level="info", text="b", robot_time=0.0))
    longer = body.replace(b"\xa1b", b"\xd9\x01b")  # the same text with a longer prefix
    place = body.index(b"\xa1b")
    assert first_difference(LogRecord, body, longer) == (f"bytes[{place}]", "0xa1", "0xd9")


def test_a_body_that_is_no_message_is_a_difference():
    body = encode(LogRecord(node="a", level="info", text="b", robot_time=0.0))
    found = first_difference(LogRecord, body, b"\x80")
    assert found is not None
    assert found[0] == "bytes"
    assert "missing fields" in found[2]
