"""Messages to bytes and back; limits, headers, schemas, differences."""

from __future__ import annotations

import dataclasses
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

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
from palpate.messages.fields import MAX_FIELDS, MAX_ITEMS, MAX_TEXT, CodecError
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
        (array_of([1, 1], b"\0" * 4, "<f4"), "must have dtype <f8"),
        (array_of([1, 1], b"\0" * 8, "|O"), "must have dtype <f8"),
        (array_of([1, 1], b"\0" * 8, ["<f8"]), "must have dtype <f8"),
        ([1.0], "must be object, got array"),
        ({"dtype": "<f8", "shape": [0, 0]}, "missing field data"),
        (array_of([1, 1], b"\0" * 8) | {"more": 1}, "unknown field more"),
        (array_of([1], b"\0" * 8), r"must have shape \(any, any\)"),
        (array_of([1, 1, 1], b"\0" * 8), r"must have shape \(any, any\)"),
        (array_of("11", b"\0" * 8), r"must have shape \(any, any\)"),
        (array_of([1, 1], "\0" * 8), "must be bytes, got str"),
        (array_of([1, 2], b"\0" * 8), r"has 8 bytes, which do not fill shape \(1, 2\)"),
        (array_of([1, 1], b"\0" * 16), r"has 16 bytes, which do not fill shape \(1, 1\)"),
        (array_of([-1, -1], b"\0" * 8), r"must have shape \(any, any\)"),
        (array_of([True, 1], b"\0" * 8), r"must have shape \(any, any\)"),
        (array_of([1.0, 1], b"\0" * 8), r"must have shape \(any, any\)"),
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
        (World, "platform", "1.0", "must be float, got str"),
        (World, "platform", True, "must be float, got bool"),
        (World, "platform", float("nan"), "must be finite"),
        (World, "platform", float("inf"), "must be finite"),
        (World, "platform", [1.0], "must be float, got array"),
        (World, "platform", None, "must be float, got None"),
        (World, "seed", 1.0, "must be int, got float"),
        (World, "seed", True, "must be int, got bool"),
        (World, "seed", (1 << 64) - 1, "must be int <= 9223372036854775807"),
        (World, "seed", "x" * 100, "must be int, got str$"),
        (LogRecord, "level", "loud", r"must be one of \[.*'error'.*\], got 'loud'$"),
        (LogRecord, "level", ["info"], "must be str, got array"),
        (LogRecord, "text", b"bytes", "must be str, got bytes"),
        (LogRecord, "text", 7, "must be str, got int"),
        (ModelGoal, "contours", {"1": 1}, "must be array, got object"),
        (ModelGoal, "contours", "123", "must be array, got str"),
        (ModelGoal, r"contours\[1\]", [1, 2.5], "must be int, got float"),
        (ModelGoal, r"contours\[0\]", [[1]], "must be int, got array"),
        (ShapeModel, "health", [["a", 1.0]], "must be object, got array"),
        (ShapeModel, "health", {"a": float("nan")}, "must be finite"),
        (ShapeModel, "health", {"a": {"b": 1.0}}, "must be float, got object"),
    ],
)
def test_a_received_value_is_checked(cls, name, value, words, example: Make):
    fields = unpacked(example(cls)) | {name.partition("\\")[0]: value}
    refused(cls, msgpack.packb(fields), f"^not a {cls.__name__}: {name} {words}")


def test_whole_numbers_and_numpy_numbers_are_packed_as_what_the_field_is(example: Make):
    world = World(platform=0, reach=np.float32(0.5), fingers=np.int16(1), seed=np.uint8(3))
    back = decode(World, encode(world))
    assert (back.platform, back.reach, back.fingers, back.seed) == (0.0, 0.5, 1, 3)
    assert type(back.platform) is float


def refused_at_both_ends(message: Any, name: str, value: Any, words: str) -> None:
    """What is refused of others is not sent."""
    fields = unpacked(message) | {name: value}
    refused(type(message), msgpack.packb(fields), words)
    object.__setattr__(message, name, value)
    with pytest.raises(CodecError, match=words):
        encode(message)


def test_a_long_text_is_refused_at_both_ends(example: Make):
    words = f"^not a LogRecord: text must be str of length <= {MAX_TEXT}$"
    refused_at_both_ends(example(LogRecord), "text", "µ" * (MAX_TEXT + 1), words)


def test_text_that_is_no_unicode_is_refused_at_both_ends(example: Make):
    fields = unpacked(example(LogRecord))
    with pytest.raises(CodecError, match=r"^not a LogRecord: text cannot be written: 'utf-8'"):
        encode(LogRecord(**{**fields, "text": "\ud800"}))
    body = msgpack.packb(fields | {"text": "xyz"}).replace(b"xyz", b"\xff\xfe\xfd")
    refused(LogRecord, body, "^not a LogRecord: 'utf-8' codec can't decode")


@pytest.mark.parametrize("value", [10**400, -(10**400), 1 << 16000], ids=["more", "less", "huge"])
def test_an_integer_beyond_64_bits_is_refused_without_being_printed(value: int):
    for field in ("platform", "seed"):
        world = replace(World(platform=0.0, reach=1.0, fingers=1, seed=0), **{field: value})
        with pytest.raises(
            CodecError, match=f"^not a World: {field} cannot be written: "
        ) as caught:
            encode(world)
        assert len(str(caught.value)) < 200


def test_what_no_message_holds_is_refused(example: Make):
    record = example(LogRecord)
    for value, words in ((1j, "a complex"), ({1}, "must be str, got array")):
        object.__setattr__(record, "text", value)
        with pytest.raises(CodecError, match=f"^not a LogRecord: text .*{words}"):
            encode(record)


def test_a_long_list_is_refused_at_both_ends(example: Make):
    words = f"contours must be array of length <= {MAX_ITEMS}"
    refused_at_both_ends(example(ModelGoal), "contours", tuple(range(MAX_ITEMS + 1)), words)


def test_a_large_table_is_refused_at_both_ends(example: Make):
    table = {str(i): 0.0 for i in range(MAX_FIELDS + 1)}
    words = f"health must be object of length <= {MAX_FIELDS}"
    refused_at_both_ends(example(ShapeModel), "health", table, words)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.zeros(3), r"pose must have shape \(7\)"),
        (np.zeros((7, 1)), r"pose must have shape \(7\)"),
        (np.zeros(7, np.float32), "pose must have dtype <f8"),
        ([0.0] * 7, "pose must be an array of float64, got a list"),
        (np.full(7, np.nan), "pose must be finite"),
    ],
)
def test_an_array_that_is_not_the_field_s_is_not_sent(value: Any, words: str):
    with pytest.raises(CodecError, match=f"^not a TactileFrame: {words}$"):
        encode(replace(FRAME, pose=value))


def test_missing_and_unknown_fields_are_named(example: Make):
    fields = unpacked(example(World))
    fields["colour"] = fields.pop("seed")
    refused(World, msgpack.packb(fields), "^not a World: unknown field colour$")
    del fields["colour"]
    refused(World, msgpack.packb(fields), "^not a World: missing field seed$")


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
        (b"", "not a World: Input data was truncated"),
        (b"\xc1", r"not a World: .* invalid opcode '\\xc1'"),
        (msgpack.packb([1, 2, 3]), "not a World: must be object, got array"),
        (msgpack.packb(None), "not a World: must be object, got None"),
        (msgpack.packb({1: 2}), "not a World: must be str, got int"),
        (b"\x81\xc4\x01a\x01", "not a World: must be str, got bytes"),
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
    refused(World, prefix, "^not a World: ")
    refused(World, b"\x81\xa4seed" + prefix, "^not a World: ")
    goal = b"\x81\xa8contours" + prefix
    refused(ModelGoal, goal, "^not a ModelGoal: ")


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


@pytest.mark.parametrize("field", [b"\xa4seed", b"\xa8contours"])
@pytest.mark.parametrize(
    "lists",
    [
        b"\xdd\x00\x0f\x00\x00" + b"\x90" * 0xF0000,
        b"\xdc\x00\xff" + 255 * (b"\xdc\x10\x00" + b"\x90" * 4096),
    ],
)
def test_empty_lists_are_refused_before_they_take_seventy_times_their_bytes(field, lists):
    cls = World if field.endswith(b"seed") else ModelGoal
    body = b"\x81" + field + lists
    tracemalloc.start()
    refused(cls, body, f"^not a {cls.__name__}: ")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 17


@pytest.mark.parametrize(
    "shape", [["x" * 4000], [{}], [[1]], [-1], [1.0], [True], [2**64 - 1, 2**64 - 1]]
)
def test_a_shape_that_is_none_is_refused_in_few_words(shape: list[Any], example: Make):
    fields = unpacked(example(TactileFrame))
    fields["direction"] = {"dtype": "<f8", "shape": shape, "data": bytes(24)}
    with pytest.raises(CodecError, match="not a TactileFrame: direction must have") as caught:
        decode(TactileFrame, msgpack.packb(fields))
    assert len(str(caught.value)) < 120


def test_an_unknown_field_is_told_in_few_words():
    with pytest.raises(CodecError, match="unknown field xx") as caught:
        decode(World, msgpack.packb({"x" * 4000: 1}))
    assert len(str(caught.value)) < 300


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
    assert "missing field" in found[2]
