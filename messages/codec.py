"""Messages to bytes and back, with the same checks at both ends.

A body is one msgpack map by field name; an array is a map of dtype, shape and bytes. A body is
measured before it is unpacked, and each value must be what its field is before the next is looked
at, so that no input can ask for more memory than it brings. What is sent is read back first: there
is one set of checks. No extension type, no pickle. On the wire: topic, zero byte, fixed header,
body, in one part, since each further part of a multipart message costs as much as the message.
msgpack writes it, as any other msgpack can read it; msgspec reads it and checks types in the same
pass. Neither knows arrays or units: these are ours.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import struct
from collections.abc import Callable
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar, get_type_hints

import msgpack
import msgspec
import numpy as np

from palpate.messages.fields import (
    LARGEST,
    MAX_MESSAGE_BYTES,
    CodecError,
    Convert,
    field_rule,
    shape_text,
)

MAX_BYTES = 1 << 20  # Largest body of a type that does not set its own ``MAX_BYTES``
# How msgspec puts it, and how we do
_WORDS = (
    *(("Expected", "must be"), ("`", "")),
    *(("Object missing required", "missing"), ("Object contains unknown", "unknown")),
)
MAX_REASON_CHARS = 200  # Of what is wrong with bytes that are no message
Message = TypeVar("Message")
_CODECS: dict[type, Codec] = {}
_LAYOUT = struct.Struct("<QIQqdI?")
HEADER_SIZE = _LAYOUT.size
MAX_SHOWN_CHARS = 60  # Characters of a value that are shown


@dataclasses.dataclass(frozen=True, slots=True)
class Codec:
    """Everything needed to write and read one message type."""

    cls: type
    names: tuple[str, ...]
    values: Callable[[Any], tuple[Any, ...]]
    read: Callable[[bytes], msgspec.Struct]  # Checks bytes, and all that is not in an array
    pack: tuple[tuple[int, Convert], ...]  # Of the fields that are arrays, by their places
    unpack: tuple[tuple[str, Convert], ...]
    max_bytes: int
    schema: dict[str, Any]
    hash: int


def encode(message: object) -> bytes:
    """Bytes of a message.

    Raises CodecError if a field has the wrong type, shape or dtype, or is not finite, or the body
    is larger than its type allows.
    """
    codec = codec_of(type(message))
    values = [*codec.values(message)]
    try:
        for place, pack in codec.pack:
            values[place] = pack(values[place])
    except CodecError as error:
        raise CodecError(f"not a {codec.cls.__name__}: {codec.names[place]} {error}") from None
    try:
        body = _write(dict(zip(codec.names, values, strict=True)))
    except (TypeError, ValueError, OverflowError):
        raise CodecError(f"not a {codec.cls.__name__}: {_unwritable(codec, values)}") from None
    _read(codec, body)
    return body


def decode(cls: type[Message], body: bytes) -> Message:
    """Message of type `cls` from its bytes; its arrays are read-only.

    Raises CodecError if the bytes are not exactly one message of this type.
    """
    codec = codec_of(cls)
    fields = msgspec.structs.asdict(_read(codec, body))
    try:
        for name, unpack in codec.unpack:
            fields[name] = unpack(fields[name])
    except CodecError as error:
        raise CodecError(f"not a {cls.__name__}: {name} {error}") from None
    return cls(**fields)


def _read(codec: Codec, body: bytes) -> msgspec.Struct:
    if len(body) > codec.max_bytes:
        raise CodecError(
            f"not a {codec.cls.__name__}: {len(body)} bytes, at most {codec.max_bytes} are allowed"
        )
    try:
        return codec.read(body)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise CodecError(f"not a {codec.cls.__name__}: {_reason(codec, error)}") from None


def _reason(codec: Codec, error: Exception) -> str:
    """What is wrong, with the field before it."""
    what, _, path = str(error).partition(" - at `$.")
    name, _, part = path.rstrip("`").replace("[...]", "").partition(".")
    for theirs, ours in _WORDS:
        what = what.replace(theirs, ours)
    if LARGEST in what:
        what = "must be finite"
    described = codec.schema["properties"].get(name, {})
    if "enum" in described:
        what = what.replace("Invalid enum value", f"must be one of {described['enum']}, got")
    if part[:5] in ("dtype", "shape"):
        array = next(one for one in described.get("anyOf", [described]) if "shape" in one)
        dtype, shape = array["dtype"], shape_text(array["shape"])
        what = f"must have {part[:5]} {dtype if part[:5] == 'dtype' else shape}"
    return printable(f"{name} {what}" if name else what)


def printable(text: str) -> str:
    """Text of others in one line, cut off after `MAX_REASON_CHARS` characters."""
    return "".join(one if one.isprintable() else "?" for one in text[:MAX_REASON_CHARS])


def _unwritable(codec: Codec, values: list[Any]) -> str:
    """The field that cannot be written, and why."""
    for name, value in zip(codec.names, values, strict=True):
        try:
            _write(value)
        except (TypeError, ValueError, OverflowError) as error:
            return f"{name} cannot be written: {printable(str(error))}"
    return "it cannot be written"


def _write_number(value: Any) -> Any:
    """A number of numpy's as Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__}")


def _write(value: Any) -> bytes:
    body: bytes = msgpack.packb(value, default=_write_number)
    return body


def schema(cls: type) -> dict[str, Any]:
    """JSON schema of a message type, with units and shapes."""
    return codec_of(cls).schema


def schema_hash(cls: type) -> int:
    """32 bits that change whenever the schema does."""
    return codec_of(cls).hash


def codec_of(cls: type) -> Codec:
    """Checks of a message type, compiled at its first use."""
    if cls not in _CODECS:
        if not dataclasses.is_dataclass(cls):
            raise CodecError(f"{cls.__name__} is not a message type")
        hints = get_type_hints(cls, include_extras=True)
        names = tuple(field.name for field in dataclasses.fields(cls))
        rules = [field_rule(hints[name]) for name in names]
        described = {
            "title": cls.__name__,
            "type": "object",
            "required": list(names),
            "additionalProperties": False,
            "properties": {name: rule.schema for name, rule in zip(names, rules, strict=True)},
        }
        digest = hashlib.sha256(json.dumps(described, sort_keys=True).encode()).digest()
        wire = msgspec.defstruct(
            cls.__name__,
            [(name, rule.wire) for name, rule in zip(names, rules, strict=True)],
            forbid_unknown_fields=True,
            gc=False,
        )
        packed = enumerate(rule.pack for rule in rules)
        unpacked = zip(names, (rule.unpack for rule in rules), strict=True)
        _CODECS[cls] = Codec(
            cls=cls,
            names=names,
            values=attrgetter(*names) if len(names) > 1 else lambda one: (getattr(one, names[0]),),
            read=msgspec.msgpack.Decoder(wire).decode,
            pack=tuple((place, pack) for place, pack in packed if pack),
            unpack=tuple((name, unpack) for name, unpack in unpacked if unpack),
            max_bytes=min(getattr(cls, "MAX_BYTES", MAX_BYTES), MAX_MESSAGE_BYTES),
            schema={"$schema": "https://json-schema.org/draft/2020-12/schema", **described},
            hash=int.from_bytes(digest[:4], "little"),
        )
    return _CODECS[cls]


class Header(NamedTuple):
    """What every frame has before its body."""

    run: int  # Number of the run, 64 bits
    epoch: int  # Counts the publisher's starts
    seq: int  # Counts up by one per publisher and topic, across restarts
    sent_ns: int  # The publisher's monotonic clock when it was sent, ns
    robot_time: float  # Robot time in the body, s; 0 if it has none
    schema: int  # Hash of the body's schema
    outside: bool = False  # Whether a tool had the publisher publish it


def pack_frame(topic: str, header: Header, body: bytes) -> bytes:
    """One frame: topic, a zero byte, the header, the body."""
    return topic.encode() + b"\0" + _LAYOUT.pack(*header) + body


def split_frame(frame: bytes) -> tuple[str, Header, bytes]:
    """Topic, header and body of a frame.

    ValueError if the frame is too short to hold a topic and a header, the topic is no text, or the
    header's last byte is neither 0 nor 1.
    """
    end = frame.find(b"\0")
    if end < 0 or len(frame) < end + 1 + HEADER_SIZE:
        raise ValueError(f"not a frame: {len(frame)} bytes without a topic and a header")
    header = Header._make(_LAYOUT.unpack_from(frame, end + 1))
    if (last := frame[end + HEADER_SIZE]) > 1:  # which `struct` takes for true
        raise ValueError(f"not a frame: its header ends in {last}, which is neither 0 nor 1")
    try:
        topic = frame[:end].decode()
    except UnicodeDecodeError:
        raise ValueError("not a frame: its topic is not Unicode") from None
    return topic, header, frame[end + 1 + HEADER_SIZE :]


def first_difference(cls: type, one: bytes, other: bytes) -> tuple[str, str, str] | None:
    """Where two bodies of the same type differ first; None if they are identical.

    Returns the field, with the place within it if it is an array, and what is there in each body;
    the field ``bytes`` if the bodies differ though the values do not, or one is no such message.
    """
    if one == other:
        return None
    try:
        first: Any = decode(cls, one)
        second: Any = decode(cls, other)
    except CodecError as error:
        return "bytes", f"{len(one)} bytes", f"{len(other)} bytes: {error}"
    for field in dataclasses.fields(cls):
        mine, theirs = getattr(first, field.name), getattr(second, field.name)
        if (found := _difference(mine, theirs)) is not None:
            return field.name + found[0], *found[1:]
    place_of = next(i for i, (a, b) in enumerate(zip(one, other, strict=False)) if a != b)
    return f"bytes[{place_of}]", f"{one[place_of]:#04x}", f"{other[place_of]:#04x}"


def _difference(one: Any, other: Any) -> tuple[str, str, str] | None:
    if isinstance(one, dict) and one.keys() == other.keys():
        entries = ((f"[{key!r}]", one[key], other[key]) for key in one)
        different = (entry for entry in entries if repr(entry[1]) != repr(entry[2]))
        return next(((at, shortened(a), shortened(b)) for at, a, b in different), None)
    if not isinstance(one, np.ndarray):
        return None if repr(one) == repr(other) else ("", shortened(one), shortened(other))
    if one.shape != other.shape:
        return ".shape", str(one.shape), str(other.shape)
    if one.tobytes() == other.tobytes():
        return None
    width = one.dtype.itemsize  # Bytes, not values: a zero of another sign is a difference
    bits = [np.frombuffer(a.tobytes(), np.uint8).reshape(-1, width) for a in (one, other)]
    first = int((bits[0] != bits[1]).any(axis=1).argmax())
    place = np.unravel_index(first, one.shape)
    at = "[" + ", ".join(str(int(i)) for i in place) + "]"
    return at, shortened(one[place].item()), shortened(other[place].item())


def shortened(value: Any) -> str:
    """A value as it is written, cut off after `MAX_SHOWN_CHARS` characters."""
    text = repr(value)
    return text if len(text) <= MAX_SHOWN_CHARS else text[: MAX_SHOWN_CHARS - 3] + "..."
