from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.messages import codec
from palpate.messages.codec import CodecError, decode, encode
from palpate.messages.fields import MAX_NESTED
from palpate.messages.types import ModelGoal, ShapeModel, TactileFrame, World

Make = Callable[..., Any]


def unpacked(message: object) -> dict[str, Any]:
    """The map on the wire."""
    fields: dict[str, Any] = msgpack.unpackb(encode(message))
    return fields


def refused(cls: type, body: bytes, words: str) -> None:
    with pytest.raises(CodecError, match=words):
        decode(cls, body)


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
def test_bytes_that_are_no_map_of_fields_are_refused(body: bytes, words: str) -> None:
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
def test_a_length_that_was_never_sent_is_refused(prefix: bytes) -> None:
    refused(World, prefix, "^not a World: ValueError")
    refused(World, b"\x81\xa4seed" + prefix, "^not a World: ValueError")


@pytest.mark.parametrize("code", [-128, -1, 0, 5, 127])
@pytest.mark.parametrize("size", [0, 1, 4, 8, 12, 16, 100])
def test_an_extension_is_refused(code: int, size: int, example: Make) -> None:
    head = {1: b"\xd4", 4: b"\xd6", 8: b"\xd7", 16: b"\xd8"}.get(size, b"\xc7" + bytes([size]))
    extension = head + code.to_bytes(1, "little", signed=True) + b"\0" * size
    packed = msgpack.packb(unpacked(example(World)) | {"seed": 77})
    assert packed.count(b"\xa4seed\x4d") == 1

    refused(World, packed.replace(b"\xa4seed\x4d", b"\xa4seed" + extension), "^not a World: ")


@pytest.mark.parametrize("depth", [3, 9, 500, 1024, 100_000])
def test_deep_nesting_is_refused(depth: int, example: Make) -> None:
    deep = b"\x91" * depth + b"\xc0"
    fields = unpacked(example(ModelGoal))
    del fields["probes"]
    body = msgpack.packb(fields | {"probes": None})  # last, so that it can be exchanged
    assert body.endswith(b"\xc0")

    refused(ModelGoal, body[:-1] + deep, "^not a ModelGoal: ")


def test_a_million_empty_lists_are_refused_before_they_exist() -> None:
    body = b"\x81\xa4seed\xdd\x00\x0f\x00\x00" + b"\x90" * 0xF0000

    refused(World, body, "exceeds max_array_len")


def test_empty_lists_within_lists_are_refused_before_they_take_seventy_times_their_bytes() -> None:
    lists = 255 * (b"\xdc\x10\x00" + b"\x90" * 4096)
    body = b"\x81\xa4seed\xdc\x00\xff" + lists

    refused(World, body, "not a World: ValueError: more than 129 lists and maps")


def test_no_message_comes_near_the_most_lists_and_maps(example: Make) -> None:
    for cls in (ShapeModel, ModelGoal):
        assert encode(example(cls)).count(b"shape") * 2 + 20 < MAX_NESTED


@pytest.mark.parametrize(
    "shape", [["x" * 4000], [{}], [[1]], [-1], [1.0], [True], [2**64 - 1, 2**64 - 1]]
)
def test_a_shape_that_is_none_is_refused_in_few_words(shape: list[Any], example: Make) -> None:
    fields = unpacked(example(TactileFrame))
    fields["direction"] = {"dtype": "<f8", "shape": shape, "data": bytes(24)}

    with pytest.raises(CodecError, match="not a TactileFrame: direction must have") as caught:
        decode(TactileFrame, msgpack.packb(fields))
    assert len(str(caught.value)) < 120


def test_unknown_fields_are_told_in_few_words() -> None:
    body = msgpack.packb({f"{i} " + "x" * 4000: i for i in range(60)})

    with pytest.raises(CodecError, match=r"unknown fields .*, \.\.\.$") as caught:
        decode(World, body)
    assert len(str(caught.value)) < 600


def test_a_body_is_measured_before_it_is_unpacked() -> None:
    refused(
        World,
        b"\0" * (codec.MAX_BYTES + 1),
        f"^not a World: {codec.MAX_BYTES + 1} bytes, at most {codec.MAX_BYTES} are allowed$",
    )


def test_a_type_may_allow_larger_bodies(example: Make) -> None:
    model = example(ShapeModel)
    object.__setattr__(model, "vertices", np.zeros((100_000, 3)))

    assert decode(ShapeModel, encode(model)).vertices.shape == (100_000, 3)
    object.__setattr__(model, "vertices", np.zeros((1_500_000, 3)))
    with pytest.raises(CodecError, match=r"not a ShapeModel: 3600\d+ bytes, at most 33554432"):
        encode(model)


@given(st.binary(max_size=300))
@settings(max_examples=300, deadline=None)
def test_random_bytes_are_refused_in_one_way(body: bytes) -> None:
    with pytest.raises(CodecError, match="not a World"):
        decode(World, body)


@given(st.integers(0, 10_000), st.integers(0, 255))
@settings(max_examples=500, deadline=None)
def test_a_changed_byte_gives_a_checked_message_or_a_refusal(place: int, value: int) -> None:
    pose = np.array([0, 0, 0, 0, 0, 0, 1.0])
    frame = TactileFrame(
        goal=1, touch=2, finger=1, direction=pose[4:], pose=pose, outcome="hit",
        array=np.ones((3, 4)), robot_time=0.5,
    )  # fmt: skip
    body = bytearray(encode(frame))
    body[place % len(body)] = value

    try:
        found = decode(TactileFrame, bytes(body))
    except CodecError as error:
        assert len(str(error)) < 300
    else:
        assert np.isfinite(found.array).all()
        assert found.array.ndim == 2
