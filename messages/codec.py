"""Messages to bytes and back, with the same checks at both ends.

A body is one msgpack map by field name; an array is a map of dtype, shape and bytes. A body
is measured before it is unpacked, and unpacked within fixed limits, so that no input can ask
for more memory than it brings. There is no extension type and no pickle.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable
from operator import attrgetter
from typing import Any, TypeVar, get_type_hints

import msgpack

from palpate.messages.fields import (
    MAX_FIELDS,
    MAX_ITEMS,
    MAX_NESTED,
    MAX_TEXT,
    CodecError,
    Convert,
    rule_of,
)
from palpate.messages.nested import at_most

SMALL = 1 << 14
"""Bodies up to so many bytes are unpacked without counting their lists: a MB at the most."""
MAX_BYTES = 1 << 20
"""Largest body of a type that does not set its own ``MAX_BYTES``."""

SHOWN = 8
"""Most unknown fields that are named."""

Message = TypeVar("Message")


@dataclasses.dataclass(frozen=True, slots=True)
class Codec:
    """Everything needed to write and read one message type."""

    cls: type
    names: tuple[str, ...]
    known: frozenset[str]
    values: Callable[[Any], tuple[Any, ...]]
    pack: tuple[Convert, ...]
    unpack: tuple[tuple[str, Convert], ...]
    max_bytes: int
    schema: dict[str, Any]
    hash: int


_CODECS: dict[type, Codec] = {}


def encode(message: object) -> bytes:
    """Bytes of a message.

    Raises
    ------
    CodecError
        If a field has the wrong type, shape or dtype, or is not finite, or the body is
        larger than its type allows.
    """
    codec = codec_of(type(message))
    body: dict[str, Any] = {}
    try:
        for name, pack, value in zip(codec.names, codec.pack, codec.values(message), strict=True):
            body[name] = pack(value)
    except CodecError as error:
        raise CodecError(f"not a {codec.cls.__name__}: {name} {error}") from None
    data: bytes = msgpack.packb(body)
    if len(data) > codec.max_bytes:
        raise CodecError(_too_large(codec, len(data)))
    return data


def decode(cls: type[Message], body: bytes) -> Message:
    """Message of type `cls` from its bytes; its arrays are read-only.

    Raises
    ------
    CodecError
        If the bytes are not exactly one message of this type.
    """
    codec = codec_of(cls)
    fields = _unpack_map(codec, body)
    if fields.keys() != codec.known:
        raise CodecError(_wrong_fields(codec, fields))
    try:
        for name, unpack in codec.unpack:
            fields[name] = unpack(fields[name])
    except CodecError as error:
        raise CodecError(f"not a {cls.__name__}: {name} {error}") from None
    return cls(**fields)


def schema(cls: type) -> dict[str, Any]:
    """JSON schema of a message type, with units and shapes."""
    return codec_of(cls).schema


def schema_hash(cls: type) -> int:
    """32 bits that change whenever the schema does."""
    return codec_of(cls).hash


def codec_of(cls: type) -> Codec:
    """Checks of a message type, compiled at its first use."""
    if cls not in _CODECS:
        _CODECS[cls] = _compile(cls)
    return _CODECS[cls]


def _compile(cls: type) -> Codec:
    if not dataclasses.is_dataclass(cls):
        raise CodecError(f"{cls.__name__} is not a message type")
    hints = get_type_hints(cls, include_extras=True)
    names = tuple(field.name for field in dataclasses.fields(cls))
    rules = [rule_of(hints[name]) for name in names]
    described = {
        "title": cls.__name__,
        "type": "object",
        "required": list(names),
        "additionalProperties": False,
        "properties": {name: rule.schema for name, rule in zip(names, rules, strict=True)},
    }
    digest = hashlib.sha256(json.dumps(described, sort_keys=True).encode()).digest()
    return Codec(
        cls=cls,
        names=names,
        known=frozenset(names),
        values=attrgetter(*names) if len(names) > 1 else _only(names[0]),
        pack=tuple(rule.pack for rule in rules),
        unpack=tuple((name, rule.unpack) for name, rule in zip(names, rules, strict=True)),
        max_bytes=getattr(cls, "MAX_BYTES", MAX_BYTES),
        schema={"$schema": "https://json-schema.org/draft/2020-12/schema", **described},
        hash=int.from_bytes(digest[:4], "little"),
    )


def _only(name: str) -> Callable[[Any], tuple[Any, ...]]:
    value = attrgetter(name)
    return lambda message: (value(message),)


def _unpack_map(codec: Codec, body: bytes) -> dict[str, Any]:
    if len(body) > codec.max_bytes:
        raise CodecError(_too_large(codec, len(body)))
    # In what is small, lists cannot grow to much before their fields are looked at.
    count = at_most(MAX_NESTED) if len(body) > SMALL else None
    try:
        fields = msgpack.unpackb(
            body,
            list_hook=count,
            object_hook=count,
            raw=False,
            strict_map_key=True,
            max_str_len=MAX_TEXT,
            max_bin_len=codec.max_bytes,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_FIELDS,
            max_ext_len=0,
            ext_hook=_refuse_extension,
        )
    except (ValueError, RecursionError) as error:
        raise CodecError(f"not a {codec.cls.__name__}: {type(error).__name__}: {error}") from None
    if type(fields) is not dict:
        raise CodecError(f"not a {codec.cls.__name__}: a {type(fields).__name__}, not a map")
    return fields


def _refuse_extension(code: int, _: bytes) -> None:
    raise ValueError(f"extension type {code} is not allowed")


def _too_large(codec: Codec, size: int) -> str:
    return f"not a {codec.cls.__name__}: {size} bytes, at most {codec.max_bytes} are allowed"


def _wrong_fields(codec: Codec, fields: dict[str, Any]) -> str:
    missing = sorted(set(codec.names) - fields.keys())
    unknown = sorted(f"{name!s:.40}" for name in fields.keys() - set(codec.names))
    more = ", ..." if len(unknown) > SHOWN else ""
    return (
        f"not a {codec.cls.__name__}: missing fields {missing}, "
        f"unknown fields {unknown[:SHOWN]}{more}"
    )
