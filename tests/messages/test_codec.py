from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np
import pytest

from palpate.messages.codec import CodecError, decode, encode
from palpate.messages.fields import MAX_FIELDS, MAX_ITEMS, MAX_TEXT
from palpate.messages.types import LogRecord, ModelGoal, ShapeModel, TactileFrame, World

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
def test_an_array_that_is_none_is_refused(entry: object, words: str, example: Make) -> None:
    fields = unpacked(example(TactileFrame)) | {"array": entry}

    refused(TactileFrame, msgpack.packb(fields), f"^not a TactileFrame: array .*({words})")


def test_a_mask_holds_only_zero_and_one(example: Make) -> None:
    from palpate.messages.types import TactileImage

    fields = unpacked(example(TactileImage)) | {"mask": array_of([1, 3], b"\0\1\2", "|b1")}

    refused(TactileImage, msgpack.packb(fields), "mask must hold 0 or 1 only")


def test_an_empty_array_is_an_array(example: Make) -> None:
    fields = unpacked(example(TactileFrame)) | {"array": array_of([0, 7], b"")}

    assert decode(TactileFrame, msgpack.packb(fields)).array.shape == (0, 7)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("platform", 1, "must be a float, got 1"),
        ("platform", "1.0", "must be a float, got '1.0'"),
        ("platform", float("nan"), "must be finite, got nan"),
        ("platform", [1.0], "must be a float, got a list"),
        ("platform", None, "must be a float, got a NoneType"),
        ("seed", 1.0, "must be an integer, got 1.0"),
        ("seed", True, "must be an integer, got True"),
        ("seed", (1 << 64) - 1, "must fit into 64 bits"),
        ("seed", "x" * 100, r"must be an integer, got 'x{36}\.\.\.$"),
    ],
)
def test_a_received_number_is_checked(name: str, value: object, words: str, example: Make) -> None:
    fields = unpacked(example(World)) | {name: value}

    refused(World, msgpack.packb(fields), f"^not a World: {name} {words}")


def test_whole_numbers_and_numpy_numbers_are_packed_as_what_the_field_is(example: Make) -> None:
    world = World(platform=0, reach=np.float32(0.5), fingers=np.int16(1), seed=np.uint8(3))

    back = decode(World, encode(world))

    assert (back.platform, back.reach, back.fingers, back.seed) == (0.0, 0.5, 1, 3)
    assert type(back.platform) is float


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("level", "loud", "level must be one of .*, got 'loud'"),
        ("level", ["info"], "level must be one of .*, got a list"),
        ("text", b"bytes", "text must be text, got a bytes"),
        ("text", 7, "text must be text, got 7"),
    ],
)
def test_a_received_text_is_checked(name: str, value: object, words: str, example: Make) -> None:
    fields = unpacked(example(LogRecord)) | {name: value}

    refused(LogRecord, msgpack.packb(fields), words)


def test_a_long_text_is_refused_at_both_ends(example: Make) -> None:
    record = example(LogRecord)
    long = "µ" * (MAX_TEXT // 2 + 1)

    with pytest.raises(CodecError, match=f"text must be at most {MAX_TEXT} bytes long"):
        encode(LogRecord(**{**unpacked(record), "text": long}))
    refused(LogRecord, msgpack.packb(unpacked(record) | {"text": long}), "exceeds max_str_len")


def test_text_that_is_no_unicode_is_refused_at_both_ends(example: Make) -> None:
    fields = unpacked(example(LogRecord))

    with pytest.raises(CodecError, match=r"^not a LogRecord: text must be Unicode"):
        encode(LogRecord(**{**fields, "text": "\ud800"}))
    body = msgpack.packb(fields | {"text": "xyz"}).replace(b"xyz", b"\xff\xfe\xfd")
    refused(LogRecord, body, "^not a LogRecord: UnicodeDecodeError")


@pytest.mark.parametrize("value", [10**400, -(10**400)])
def test_an_integer_beyond_all_floats_is_refused(value: int, example: Make) -> None:
    world = World(platform=value, reach=1.0, fingers=1, seed=0)

    with pytest.raises(CodecError, match=r"^not a World: platform must be finite"):
        encode(world)


def test_a_huge_integer_is_refused_without_being_printed(example: Make) -> None:
    world = World(platform=0.0, reach=1.0, fingers=1, seed=10**5000)

    with pytest.raises(CodecError, match=r"^not a World: seed must fit into 64 bits$"):
        encode(world)
    record = example(LogRecord)
    with pytest.raises(CodecError, match=r"^not a LogRecord: text must be text, got an integer"):
        encode(LogRecord(**{**unpacked(record), "text": 10**5000}))


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"1": 1}, "must be a list of at most"),
        ("123", "must be a list of at most"),
        ([1, 2.5], "must be an integer, got 2.5"),
        ([[1]], "must be an integer, got a list"),
    ],
)
def test_a_received_list_is_checked(entry: object, words: str, example: Make) -> None:
    fields = unpacked(example(ModelGoal)) | {"contours": entry}

    refused(ModelGoal, msgpack.packb(fields), f"^not a ModelGoal: contours {words}")


def test_a_long_list_is_refused_at_both_ends(example: Make) -> None:
    ids = tuple(range(MAX_ITEMS + 1))
    goal = example(ModelGoal)
    fields = unpacked(goal) | {"contours": list(ids)}

    with pytest.raises(CodecError, match=f"contours must be a list of at most {MAX_ITEMS}"):
        encode(dataclasses.replace(goal, contours=ids))
    refused(ModelGoal, msgpack.packb(fields), "exceeds max_array_len")


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ([["a", 1.0]], f"must be a table of at most {MAX_FIELDS}, got a list"),
        ({"a": 1}, "must be a float, got 1"),
        ({"a": float("nan")}, "must be finite"),
        ({"a": {"b": 1.0}}, "must be a float, got a dict"),
    ],
)
def test_a_received_table_is_checked(entry: object, words: str, example: Make) -> None:
    fields = unpacked(example(ShapeModel)) | {"health": entry}

    refused(ShapeModel, msgpack.packb(fields), f"^not a ShapeModel: health {words}")


def test_a_large_table_is_refused_at_both_ends(example: Make) -> None:
    fields = unpacked(example(ShapeModel))
    table = {str(i): 0.0 for i in range(MAX_FIELDS + 1)}
    model = example(ShapeModel)
    object.__setattr__(model, "health", table)

    with pytest.raises(CodecError, match=f"health must be a table of at most {MAX_FIELDS}"):
        encode(model)
    refused(ShapeModel, msgpack.packb(fields | {"health": table}), "exceeds max_map_len")


def test_missing_and_unknown_fields_are_named(example: Make) -> None:
    fields = unpacked(example(World))
    fields["colour"] = fields.pop("seed")

    refused(
        World,
        msgpack.packb(fields),
        r"^not a World: missing fields \['seed'\], unknown fields \['colour'\]$",
    )


def test_an_array_that_is_not_contiguous_comes_back_in_order(example: Make) -> None:
    frame = example(TactileFrame)
    object.__setattr__(frame, "array", np.arange(24.0).reshape(4, 6)[::2, ::-3].T)

    np.testing.assert_array_equal(decode(TactileFrame, encode(frame)).array, frame.array)


def test_changing_an_array_after_encoding_changes_nothing(example: Make) -> None:
    frame = example(TactileFrame)
    body = encode(frame)
    before = frame.array.copy()
    frame.array[...] = 7.0

    np.testing.assert_array_equal(decode(TactileFrame, body).array, before)


@pytest.mark.parametrize("shape", [(1, 1), (4, 4), (16, 16)])
def test_finite_values_pass_though_their_sum_would_not_be(
    shape: tuple[int, int], example: Make
) -> None:
    huge = np.full(shape, 1.7e308)
    body = encode(dataclasses.replace(example(TactileFrame), array=huge))
    assert decode(TactileFrame, body).array.tobytes() == huge.tobytes()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("shape", [(4, 4), (16, 16)])
def test_one_value_that_is_not_finite_is_found_wherever_it_is(
    shape: tuple[int, int], bad: float, example: Make
) -> None:
    message = example(TactileFrame)
    for place in np.ndindex(shape):
        array = np.full(shape, 1.7e308)
        array[place] = bad
        with pytest.raises(CodecError, match="array must be finite"):
            encode(dataclasses.replace(message, array=array))
