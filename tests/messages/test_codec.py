"""Bytes of messages and frames: what is refused, at what cost, and where two bodies differ."""

import tracemalloc
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest

from palpate import messages
from palpate.messages import HEADER_SIZE, CodecError, decode, encode, first_difference, split_frame
from palpate.messages.types import TYPES, LogRecord, ModelGoal, ShapeModel, TactileFrame, World
from tests.messages.cases import cases, drawn

NAN, INF = float("nan"), float("inf")
FRAME = replace(drawn(TactileFrame), touch=2, outcome="hit", robot_time=0.5, array=np.ones((3, 4)))
MANY = {str(number): 0.0 for number in range(65)}
LINE = LogRecord(node="a", level="info", text="b", robot_time=0.0)


def unpacked(message: object) -> dict[str, Any]:
    """The map on the wire."""
    fields: dict[str, Any] = msgpack.unpackb(encode(message))
    return fields


def refused(cls: type, body: bytes, words: str = "^not a ") -> str:
    with pytest.raises(CodecError, match=words) as caught:
        decode(cls, body)
    assert len(str(caught.value)) < 300 and str(caught.value).startswith(f"not a {cls.__name__}: ")
    return str(caught.value)


def array_of(shape: object, data: object, dtype: object = "<f8") -> dict[str, object]:
    return {"dtype": dtype, "shape": shape, "data": data}


@cases(
    "entry, words",
    (array_of([1, 1], b"\0" * 4, "<f4"), "must have dtype <f8"),
    (array_of([1, 1], b"\0" * 8, "|O"), "must have dtype <f8"),
    (array_of([1, 1], b"\0" * 8, ["<f8"]), "must have dtype <f8"),
    ([1.0], "must be object, got array"),
    ({"dtype": "<f8", "shape": [0, 0]}, "missing field data"),
    (array_of([1, 1], b"\0" * 8) | {"more": 1}, "unknown field more"),
    (array_of([1, 1], "\0" * 8), "must be bytes, got str"),
    (array_of([1, 2], b"\0" * 8), r"has 8 bytes, which do not fill shape \(1, 2\)"),
    (array_of([1, 1], b"\0" * 16), r"has 16 bytes, which do not fill shape \(1, 1\)"),
    *(
        (array_of(shape, b"\0" * 8), r"must have shape \(any, any\)")
        for shape in ([1], [1, 1, 1], "11", [-1, -1], [True, 1], [1.0, 1], [{}, 1], ["x", 1])
    ),
    (array_of([1 << 40, 1 << 40], b"\0" * 8), "do not fill shape"),
    (array_of([0, 1 << 62], b""), "do not fill shape|must have shape"),
    (array_of([0, (1 << 64) - 1], b""), "do not fill shape|must have shape"),
    (array_of([1, 1], np.float64(NAN).tobytes()), "must be finite"),
    (array_of([1, 1], np.float64(-INF).tobytes()), "must be finite"),
)
def test_received_array_of_another_form_is_refused(entry: object, words: str):
    body = msgpack.packb(unpacked(FRAME) | {"array": entry})
    refused(TactileFrame, body, f"^not a TactileFrame: array .*({words})")


def test_mask_holds_only_zero_and_one_and_unknown_fields_are_named():
    image = unpacked(drawn(TYPES["TactileImage"]))
    wrong = image | {"mask": array_of([1, 3], b"\0\1\2", "|b1")}
    refused(TYPES["TactileImage"], msgpack.packb(wrong), "mask must hold 0 or 1 only")
    empty = msgpack.packb(unpacked(FRAME) | {"array": array_of([0, 7], b"")})
    assert decode(TactileFrame, empty).array.shape == (0, 7)
    fields = unpacked(drawn(World))
    fields["colour"] = fields.pop("seed")
    refused(World, msgpack.packb(fields), "^not a World: unknown field colour$")
    del fields["colour"]
    refused(World, msgpack.packb(fields), "^not a World: missing field seed$")
    refused(World, msgpack.packb({"x" * 4000: 1}), "unknown field xx")


@cases(
    "cls, name, value, words",
    (World, "platform", "1.0", "must be float, got str"),
    (World, "platform", True, "must be float, got bool"),
    (World, "platform", NAN, "must be finite"),
    (World, "platform", None, "must be float, got None"),
    (World, "seed", 1.0, "must be int, got float"),
    (World, "seed", (1 << 64) - 1, "must be int <= 9223372036854775807"),
    (World, "seed", "x" * 100, "must be int, got str$"),
    (LogRecord, "level", "loud", r"must be one of \[.*'error'.*\], got 'loud'$"),
    (LogRecord, "level", ["info"], "must be str, got array"),
    (LogRecord, "text", b"bytes", "must be str, got bytes"),
    (ModelGoal, "contours", {"1": 1}, "must be array, got object"),
    (ModelGoal, r"contours\[1\]", [1, 2.5], "must be int, got float"),
    (ModelGoal, r"contours\[0\]", [[1]], "must be int, got array"),
    (ShapeModel, "health", [["a", 1.0]], "must be object, got array"),
    (ShapeModel, "health", {"a": NAN}, "must be finite"),
    (ShapeModel, "health", {"a": {"b": 1.0}}, "must be float, got object"),
)
def test_received_value_of_another_kind_is_refused(cls, name, value, words):
    fields = unpacked(drawn(cls)) | {name.partition("\\")[0]: value}
    refused(cls, msgpack.packb(fields), f"^not a {cls.__name__}: {name} {words}")


@cases(
    "message, name, value, words",
    (LINE, "text", "µ" * 4097, "text must be str of length <= 4096$"),
    (drawn(ModelGoal), "contours", (1,) * 4097, "contours must be array of length <= 4096"),
    (drawn(ShapeModel), "health", MANY, "health must be object of length <= 64"),
)
def test_length_beyond_limit_is_refused_at_both_ends(message, name, value, words):
    cls = type(message)
    shorter = dict([*value.items()][1:]) if isinstance(value, dict) else value[1:]
    words = f"^not a {cls.__name__}: {words}"
    refused(cls, msgpack.packb(unpacked(message) | {name: value}), words)
    with pytest.raises(CodecError, match=words):
        encode(replace(message, **{name: value}))
    assert getattr(decode(cls, encode(replace(message, **{name: shorter}))), name) == shorter


@cases(
    "message, changes, words",
    (FRAME, {"pose": [0.0] * 7}, "pose must be an array of float64, got a list$"),
    (LINE, {"text": "\ud800"}, "text cannot be written: 'utf-8'"),
    (LINE, {"text": 1j}, "text .*a complex"),
    (LINE, {"text": {1}}, "text cannot be written: a set"),
    (LINE, {"text": [1]}, "text must be str, got array"),
    *((LINE, {"robot_time": n}, "robot_time cannot be") for n in (10**400, -(10**400))),
    (drawn(World), {"seed": 1 << 16000}, "seed cannot be written: "),
)
def test_value_that_cannot_be_sent_is_refused_in_few_words(message, changes, words):
    with pytest.raises(CodecError, match=f"^not a {type(message).__name__}: {words}") as caught:
        encode(replace(message, **changes))
    assert len(str(caught.value)) < 200


def test_numpy_numbers_are_sent_as_numbers_and_arrays_in_order_of_rows():
    world = World(platform=0, reach=np.float32(0.5), fingers=np.int16(1), seed=np.uint8(3))
    back = decode(World, encode(world))
    assert [back.platform, back.reach, back.fingers, back.seed] == [0.0, 0.5, 1, 3]
    assert type(back.platform) is float
    array = np.arange(24.0).reshape(4, 6)[::2, ::-3].T
    before = array.copy()
    body = encode(replace(FRAME, array=array))
    array[...] = 7.0
    assert np.array_equal(decode(TactileFrame, body).array, before)


@pytest.mark.parametrize("shape", [(1, 1), (4, 4), (16, 16)])
def test_one_value_that_is_not_finite_is_found_in_any_place(shape: tuple[int, int]):
    huge = np.full(shape, 1.7e308)  # finite, though neither their sum nor their squares are
    back = decode(TactileFrame, encode(replace(FRAME, array=huge)))
    assert back.array.tobytes() == huge.tobytes()
    for number, place in enumerate(np.ndindex(shape)):
        array = huge.copy()
        array[place] = (NAN, INF, -INF)[number % 3]
        with pytest.raises(CodecError, match="array must be finite"):
            encode(replace(FRAME, array=array))


EXTENSIONS = [
    head + code.to_bytes(1, "little", signed=True) + b"\0" * size
    for code in (-128, -1, 0, 127)
    for size, head in ((1, b"\xd4"), (8, b"\xd7"), (16, b"\xd8"), (12, b"\xc7\x0c"), (0, b"\xc7\0"))
]
# Lengths that were never sent: of a list, map, bytes, text, extension.
LENGTHS = [one + b"\xff" * 4 for one in (b"\xdd", b"\xdf", b"\xc6", b"\xdb", b"\xc9")]
LENGTHS += [one + b"\xff" * 2 for one in (b"\xdc", b"\xde", b"\xda")]


@cases(
    "body, words",
    (b"", "Input data was truncated"),
    (b"\xc1", r".* invalid opcode '\\xc1'"),
    (msgpack.packb([1, 2, 3]), "must be object, got array"),
    (msgpack.packb(None), "must be object, got None"),
    (msgpack.packb({1: 2}), "must be str, got int"),
    (b"\x81\xc4\x01a\x01", "must be str, got bytes"),
    (encode(LINE).replace(b"\xa1b", b"\xa3\xff\xfe\xfd"), "'utf-8' codec can't decode"),
    *((before + one, "") for one in LENGTHS + EXTENSIONS for before in (b"", b"\x81\xa4text")),
    *((b"\x81\xa4text" + b"\x91" * depth + b"\xc0", "") for depth in (3, 500, 1024, 100_000)),
    ids=lambda one: one.hex()[:40] if isinstance(one, bytes) else "",
)
def test_bytes_that_are_no_message_are_refused(body: bytes, words: str):
    refused(LogRecord, body, f"^not a LogRecord: {words}")
    contours = body.replace(b"\x81\xa4text", b"\x81\xa8contours")
    refused(ModelGoal, contours, "^not a ModelGoal: ")


@pytest.mark.parametrize("field", [b"\xa4seed", b"\xa8contours"])
@cases(
    "lists",
    b"\xdd\x00\x0f\x00\x00" + b"\x90" * 0xF0000,
    b"\xdc\x00\xff" + 255 * (b"\xdc\x10\x00" + b"\x90" * 4096),
)
def test_empty_lists_are_refused_before_they_take_seventy_times_their_bytes(field, lists):
    body = b"\x81" + field + lists
    tracemalloc.start()
    refused(World if field.endswith(b"seed") else ModelGoal, body)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 17


def test_body_is_measured_before_it_is_unpacked():
    sizes = f"{(1 << 20) + 1} bytes, at most {1 << 20} are allowed"
    refused(World, b"\0" * ((1 << 20) + 1), f"^not a World: {sizes}$")
    assert "at most" not in refused(World, b"\0" * (1 << 20))
    model = replace(drawn(ShapeModel), vertices=np.zeros((100_000, 3)))
    assert decode(ShapeModel, encode(model)).vertices.shape == (100_000, 3)
    most = ShapeModel.MAX_BYTES
    refused(ShapeModel, bytes(most + 1), f"{most + 1} bytes, at most {most} ")


HEADER = messages.Header(
    run=1 << 63, epoch=3, seq=1 << 40, sent_ns=-5, robot_time=0.25, schema=0xFFFFFFFF
)


@pytest.mark.parametrize("outside", [False, True])
@pytest.mark.parametrize("body", [b"", b"\0body\0"])
def test_frame_comes_back_behind_its_topic_and_a_zero(outside: bool, body: bytes):
    header = HEADER._replace(outside=outside)
    frame = messages.pack_frame("/touch/raw", header, body)
    assert split_frame(frame) == ("/touch/raw", header, body)
    # Subscriptions match the beginning: without the zero /touch would also hear /touch/raw.
    assert frame.startswith(b"/touch/raw\0") and len(frame) == 11 + HEADER_SIZE + len(body)


@cases(
    "frame, words",
    (b"", "0 bytes without a topic and a header"),
    (b"/touch/raw", "10 bytes without a topic"),
    (b"\0", "1 bytes without a topic"),
    (b"/a\0" + b"\1" * (HEADER_SIZE - 1), r"\d+ bytes without a topic"),
    (b"\xff\xfe\0" + b"\1" * HEADER_SIZE, "its topic is not Unicode"),
    (b"/a\0" + b"\2" * HEADER_SIZE, "its header ends in 2, which is neither 0 nor 1"),
)
def test_bytes_that_are_no_frame_are_refused(frame: bytes, words: str):
    with pytest.raises(ValueError, match=f"^not a frame: {words}"):
        split_frame(frame)


MODELS = [replace(drawn(ShapeModel), health={"a": 1.0, "b": value}) for value in (2.0, 3.0)]


def changed(value: float) -> TactileFrame:
    array = np.ones((3, 4))
    array[1, 2] = value
    return replace(FRAME, array=array)


@cases(
    "first, second, difference",
    (FRAME, FRAME, None),
    (FRAME, replace(FRAME, outcome="miss"), ("outcome", "'hit'", "'miss'")),
    (FRAME, replace(FRAME, robot_time=0.75), ("robot_time", "0.5", "0.75")),
    (FRAME, replace(FRAME, array=np.ones((3, 5))), ("array.shape", "(3, 4)", "(3, 5)")),
    (FRAME, changed(1.0 + 2**-52), ("array[1, 2]", "1.0", "1.0000000000000002")),
    (FRAME, replace(FRAME, touch=3, outcome="miss"), ("touch", "2", "3")),
    (changed(0.0), changed(-0.0), ("array[1, 2]", "0.0", "-0.0")),
    (*MODELS, ("health['b']", "2.0", "3.0")),
    (
        replace(LINE, text="x" * 1000),
        replace(LINE, text="y" * 58),
        ("text", "'" + "x" * 56 + "...", "'" + "y" * 58 + "'"),
    ),
)
def test_first_field_that_differs_is_named_with_both_values(first, second, difference):
    assert first_difference(type(first), encode(first), encode(second)) == difference


def test_bodies_that_differ_in_bytes_alone_differ():
    body = encode(LINE)
    longer = body.replace(b"\xa1b", b"\xd9\x01b")  # the same text with a longer prefix
    place = body.index(b"\xa1b")
    assert first_difference(LogRecord, body, longer) == (f"bytes[{place}]", "0xa1", "0xd9")
    where, first, second = first_difference(LogRecord, body, b"\x80") or ("", "", "")
    assert (where, first) == ("bytes", f"{len(body)} bytes")
    assert second.startswith("1 bytes: ") and "missing field" in second
