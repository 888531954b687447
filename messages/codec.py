"""Messages to bytes and back, with the same checks at both ends.

A body is one msgpack map by field name; an array is a map of dtype, shape and bytes. The size of a
body is checked before it is unpacked, and each value before the next one, so that no input can take
more memory than its own size. A message is read back before it is sent, so that there is one set of
checks. There are no extension types and no pickle. A frame on the wire has the topic, a zero byte,
a fixed header and the body, in one part, since each further part costs as much as the message.
msgpack writes bodies, which any msgpack can read; msgspec reads them and checks types in the same
pass. Arrays and units are handled here.
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

MAX_BYTES = 1 << 20  # of a body, unless its type has another ``MAX_BYTES``
# Words of msgspec in errors, and their replacements.
_WORDS = (
    *(("Expected", "must be"), ("`", "")),
    *(("Object missing required", "missing"), ("Object contains unknown", "unknown")),
)
Message = TypeVar("Message")
_CODECS: dict[type, Codec] = {}
_LAYOUT = struct.Struct("<QIQqdI?")
HEADER_SIZE = _LAYOUT.size


@dataclasses.dataclass(frozen=True, slots=True)
class Codec:
    """Functions and facts to write and read one message type."""

    cls: type
    names: tuple[str, ...]
    values: Callable[[Any], tuple[Any, ...]]
    read: Callable[[bytes], msgspec.Struct]  # checks all but the contents of arrays
    pack: tuple[tuple[int, Convert], ...]  # of array fields, by index
    unpack: tuple[tuple[str, Convert], ...]
    max_bytes: int
    schema: dict[str, Any]
    hash: int


def encode(message: object) -> bytes:
    """The bytes of a message.

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
    """The message of type `cls` in bytes; its arrays are read-only.

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
    """The fault in words, with the field before it."""
    fault, _, path = str(error).partition(" - at `$.")
    name, _, part = path.rstrip("`").replace("[...]", "").partition(".")
    for theirs, ours in _WORDS:
        fault = fault.replace(theirs, ours)
    if LARGEST in fault:
        fault = "must be finite"
    described = codec.schema["properties"].get(name, {})
    if "enum" in described:
        fault = fault.replace("Invalid enum value", f"must be one of {described['enum']}, got")
    if part[:5] in ("dtype", "shape"):
        array = next(rule for rule in described.get("anyOf", [described]) if "shape" in rule)
        dtype, shape = array["dtype"], shape_text(array["shape"])
        fault = f"must have {part[:5]} {dtype if part[:5] == 'dtype' else shape}"
    return printable(f"{name} {fault}" if name else fault)


def printable(text: str, max_chars: int = 200) -> str:
    """The first `max_chars` characters of an untrusted text, in one line."""
    return "".join(char if char.isprintable() else "?" for char in text[:max_chars])


def _unwritable(codec: Codec, values: list[Any]) -> str:
    """The field that cannot be written, and why."""
    for name, value in zip(codec.names, values, strict=True):
        try:
            _write(value)
        except (TypeError, ValueError, OverflowError) as error:
            return f"{name} cannot be written: {printable(str(error))}"
    return "it cannot be written"


def _write_number(value: Any) -> Any:
    """A number of numpy as a number of Python."""
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
    """A hash of the schema, of 32 bits."""
    return codec_of(cls).hash


def codec_of(cls: type) -> Codec:
    """The codec of a message type, compiled at its first use."""
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
            values=attrgetter(*names) if len(names) > 1 else lambda m: (getattr(m, names[0]),),
            read=msgspec.msgpack.Decoder(wire).decode,
            pack=tuple((place, pack) for place, pack in packed if pack),
            unpack=tuple((name, unpack) for name, unpack in unpacked if unpack),
            max_bytes=min(getattr(cls, "MAX_BYTES", MAX_BYTES), MAX_MESSAGE_BYTES),
            schema={"$schema": "https://json-schema.org/draft/2020-12/schema", **described},
            hash=int.from_bytes(digest[:4], "little"),
        )
    return _CODECS[cls]


class Header(NamedTuple):
    """The header of a frame, before its body."""

    run: int  # number of the run, 64 bits
    epoch: int  # number of the publisher's earlier starts
    seq: int  # counts up by one per publisher and topic, across restarts
    sent_ns: int  # publisher's monotonic clock at sending [ns]
    robot_time: float  # of the body [s]; 0 if it has none
    schema: int  # hash of the body's schema
    outside: bool = False  # whether a tool requested the message


def pack_frame(topic: str, header: Header, body: bytes) -> bytes:
    """A frame: the topic, a zero byte, the header, the body."""
    return topic.encode() + b"\0" + _LAYOUT.pack(*header) + body


def split_frame(frame: bytes) -> tuple[str, Header, bytes]:
    """Topic, header and body of a frame.

    Raises ValueError if the frame is too short for a topic and a header, the topic is no text, or
    the last byte of the header is neither 0 nor 1.
    """
    end = frame.find(b"\0")
    if end < 0 or len(frame) < end + 1 + HEADER_SIZE:
        raise ValueError(f"not a frame: {len(frame)} bytes without a topic and a header")
    header = Header._make(_LAYOUT.unpack_from(frame, end + 1))
    if (last := frame[end + HEADER_SIZE]) > 1:  # `struct` reads it as true
        raise ValueError(f"not a frame: its header ends in {last}, which is neither 0 nor 1")
    try:
        topic = frame[:end].decode()
    except UnicodeDecodeError:
        raise ValueError("not a frame: its topic is not Unicode") from None
    return topic, header, frame[end + 1 + HEADER_SIZE :]


def first_difference(cls: type, body: bytes, other: bytes) -> tuple[str, str, str] | None:
    """The first difference of two bodies of the same type; None if they are identical.

    Returns the field, with the index in an array, and its value in each body; the field ``bytes``
    if only the bytes differ, or a body is no such message.
    """
    if body == other:
        return None
    try:
        first: Any = decode(cls, body)
        second: Any = decode(cls, other)
    except CodecError as error:
        return "bytes", f"{len(body)} bytes", f"{len(other)} bytes: {error}"
    for field in dataclasses.fields(cls):
        values = getattr(first, field.name), getattr(second, field.name)
        if (difference := _difference(*values)) is not None:
            return field.name + difference[0], *difference[1:]
    index = next(i for i, (a, b) in enumerate(zip(body, other, strict=False)) if a != b)
    return f"bytes[{index}]", f"{body[index]:#04x}", f"{other[index]:#04x}"


def _difference(value: Any, other: Any) -> tuple[str, str, str] | None:
    if isinstance(value, dict) and value.keys() == other.keys():
        entries = ((f"[{key!r}]", value[key], other[key]) for key in value)
        different = (entry for entry in entries if repr(entry[1]) != repr(entry[2]))
        return next(((at, shortened(a), shortened(b)) for at, a, b in different), None)
    if not isinstance(value, np.ndarray):
        return None if repr(value) == repr(other) else ("", shortened(value), shortened(other))
    if value.shape != other.shape:
        return ".shape", str(value.shape), str(other.shape)
    if value.tobytes() == other.tobytes():
        return None
    width = value.dtype.itemsize  # bytes are compared, so that the sign of a zero counts
    bits = [np.frombuffer(a.tobytes(), np.uint8).reshape(-1, width) for a in (value, other)]
    first = int((bits[0] != bits[1]).any(axis=1).argmax())
    place = np.unravel_index(first, value.shape)
    at = "[" + ", ".join(str(int(i)) for i in place) + "]"
    return at, shortened(value[place].item()), shortened(other[place].item())


def shortened(value: Any, max_chars: int = 60) -> str:
    """The representation of a value, cut off after `max_chars` characters."""
    text = repr(value)
    return text if len(text) <= max_chars else text[: max_chars - 3] + "..."
