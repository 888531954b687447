"""Damaged messages, frames, control words and recordings, and readers that check validity.

Messages of all types are random within the constraints of the type; recordings are damaged in
bytes, records or chunks.
"""

from __future__ import annotations

import dataclasses
import random
import struct
import tempfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import lz4.frame
import msgpack
import numpy as np

from dev.fuzz.mutations import BOUNDARY_NUMBERS, InputFile, mutate_body, mutate_bytes
from palpate.messages import (
    Array,
    Header,
    bus,
    decode,
    encode,
    pack_frame,
    schema_hash,
    split_frame,
)
from palpate.messages.recording import RecordingWriter, open_recording
from palpate.messages.types import TYPES

# Control words: what nodes report to the launcher, and what it asks of them.
_NODE_WORDS: tuple[dict[str, Any], ...] = (
    {"kind": "ready"},
    {"kind": "finished", "reason": "all touched"},
    {"kind": "failed", "text": "on /touch/raw 3: ValueError", "trace": "Traceback\n" * 20},
    {"kind": "exiting", "status": bytes(40)},
    {
        "kind": "count",
        "round": 3,
        "sent": {"/touch/raw": 17, "/finger/goal": 18},
        "consumed": [["simulator", "/touch/raw", 17], ["tracer", "/finger/goal", 18]],
        "waits": ["/world"],
        "can_publish": False,
    },
)
_LAUNCHER_WORDS: tuple[dict[str, Any], ...] = (
    *({"kind": "go"}, {"kind": "count", "round": 3}, {"kind": "stop"}),
)
# Values of fields without structure.
_PLAIN: dict[type, Callable[[np.random.Generator], Any]] = {
    bool: lambda rng: bool(rng.integers(2)),
    int: lambda rng: int(rng.integers(-(1 << 62), 1 << 62)),
    float: lambda rng: float(rng.normal()),
    str: lambda rng: "a reason, µm"[: int(rng.integers(1, 13))],
}
WORD_KINDS = {"node": bus.FROM_NODES, "launcher": bus.TO_NODES}
RECORDING_NAME = "topics.mcap"
MAGIC = b"\x89MCAP0\r\n"
CHUNK, MESSAGE, FOOTER = 6, 5, 2  # Codes of records
_HEAD = struct.Struct("<BQ")


class Packet(NamedTuple):
    """Bytes for one of the readers."""

    # Name of a message type, or ``frame``, ``answer``, ``request``, ``node``, ``launcher``.
    reader: str
    data: bytes


def mutated_packet(rng: random.Random, body_share: float = 0.7) -> Packet:
    """A damaged packet: a message body in `body_share` of the draws, else a frame or a word."""
    kinds = _examples()
    is_body = rng.random() < body_share
    reader = rng.choice([name for name in kinds if (name in TYPES) == is_body])
    packet = rng.choice(kinds[reader])
    if (is_body or reader in ("node", "launcher")) and rng.random() < 0.6:
        return Packet(reader, mutate_body(rng, msgpack.unpackb(packet.data)))
    other = rng.choice(kinds[rng.choice(list(kinds))])
    return Packet(reader, mutate_bytes(rng, packet.data, other.data))


def read_packet(packet: Packet) -> None:
    """Read bytes with their reader.

    Raises ValueError if they are refused, and AssertionError if they are accepted but invalid.
    """
    reader, data = packet
    if reader in TYPES:
        _read_body(TYPES[reader], data)
    elif reader == "frame":
        assert pack_frame(*split_frame(data)) == data, "a frame differs from its source"
    elif reader == "answer":
        answer = bus.read_reply(data)
        if answer.kind == bus.GREETING:
            bus.read_epoch(answer.rest)
    elif reader == "request":
        request = bus.read_request(data)
        if request is None:
            raise ValueError("no request")
        largest = max(request.wanted, request.epoch or 0)
        assert largest < 1 << 64, "a number of a request is too large"
    else:
        WORD_KINDS[reader].read(data)


def _read_body(cls: type, data: bytes) -> None:
    message: Any = decode(cls, data)
    for field in dataclasses.fields(cls):
        value = getattr(message, field.name)
        if type(value) is float or (isinstance(value, np.ndarray) and value.dtype.kind == "f"):
            assert np.isfinite(value).all(), f"{field.name} is not finite"
    body = encode(message)
    assert encode(decode(cls, body)) == body, "a message differs from its source"


class Record(NamedTuple):
    """One record of a file."""

    code: int
    content: bytes


def mutated_recordings(rng: random.Random) -> InputFile:
    """A valid recording with damage."""
    data = valid_recording()
    change = rng.random()
    if change < 0.4:
        return InputFile(RECORDING_NAME, mutate_bytes(rng, data, data))
    records = records_of(data)
    if change < 0.7:
        return InputFile(RECORDING_NAME, file_of(_damaged_records(rng, records)))
    return InputFile(RECORDING_NAME, file_of([_damaged_chunk(rng, record) for record in records]))


@cache
def hostile_recordings(unpacked_size: int = 63 << 20) -> list[InputFile]:
    """Hand-made files, some of which unpack to a large size [bytes]."""
    footer = Record(FOOTER, bytes(20))
    empty = _HEAD.pack(MESSAGE, 22) + bytes(22)
    unknown = _HEAD.pack(0x80, 0)
    large = bytes(unpacked_size)
    first = records_of(valid_recording())[:2]
    contents = [
        *([chunk(large, unpacked_size), footer], [chunk(large, 1000), footer]),
        *([chunk(bytes(1000), unpacked_size), footer], [chunk(bytes(1000), 2**64 - 1), footer]),
        [chunk(empty * 100_000, 100_000 * len(empty)), footer],
        [chunk(unknown * 1_000_000, 1_000_000 * len(unknown)), footer],
        *([*first, chunk(b"", 0), footer], [Record(CHUNK, bytes(10)), footer]),
        *([Record(12, struct.pack("<I", 2**32 - 1)), footer], [Record(0x80, b"")] * 100_000),
    ]
    files = [file_of(records) for records in contents]
    valid = valid_recording()
    files += [MAGIC, b"", MAGIC + _HEAD.pack(CHUNK, 2**63), valid + valid, valid[:-8]]
    return [InputFile(RECORDING_NAME, data) for data in files]


def records_of(data: bytes) -> list[Record]:
    """Records of a valid file, with the footer."""
    records, at = [], len(MAGIC)
    while at < len(data) - len(MAGIC):
        code, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        records.append(Record(code, data[at : at + length]))
        at += length
    return records


def valid_recordings() -> list[InputFile]:
    """The recording that is damaged."""
    return [InputFile(RECORDING_NAME, valid_recording())]


@cache
def valid_recording() -> bytes:
    """A closed recording of some kB with messages of all types."""
    packets = [packet for packet in valid_packets() if packet.reader in TYPES]
    types = {f"/topic/{name}": name for name in TYPES}
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        path = Path(folder) / RECORDING_NAME
        writer = RecordingWriter(path, types, {}, {"version": "1", "graph": "[]"})
        counts = dict.fromkeys(types, 0)
        for i, (name, body) in enumerate(packets):
            topic = f"/topic/{name}"
            header = Header(7, 0, counts[topic], (i + 1) * 4_000_000, 0.0, schema_hash(TYPES[name]))
            writer.write(topic, header, body)
            counts[topic] += 1
        writer.close()
        return path.read_bytes()


def valid_packets() -> list[Packet]:
    """Valid packets of all kinds."""
    return [packet for packets in _examples().values() for packet in packets]


@cache
def _examples(n_examples: int = 3) -> dict[str, tuple[Packet, ...]]:
    """Valid packets by reader; several of each type."""
    rng = np.random.default_rng(1)
    bodies = {
        name: tuple(Packet(name, encode(any_message(cls, rng))) for _ in range(n_examples))
        for name, cls in TYPES.items()
    }
    header = Header(7, 1, 17, 10**15, 1.5, schema_hash(TYPES["TactileFrame"]))
    frame = pack_frame("/touch/raw", header, bodies["TactileFrame"][0].data)
    call = bus.join_call("finger_1/filter", 2, "simulator")
    words: dict[str, list[bytes]] = {
        "frame": [frame],
        "answer": [
            bus.greeting(call, 4),
            bus.resent_frame(call, frame),
            bus.in_step_notice(call, "/touch/raw"),
        ],
        "request": [b"\x01" + call, b"\x01" + bus.join_cursor(call, 3, "/touch/raw", 17)],
        "node": [msgpack.packb(word) for word in _NODE_WORDS],
        "launcher": [msgpack.packb(word) for word in _LAUNCHER_WORDS],
    }
    return bodies | {name: tuple(Packet(name, d) for d in data) for name, data in words.items()}


def any_message(cls: type, rng: np.random.Generator) -> Any:
    """A random message of a type."""
    hints = get_type_hints(cls, include_extras=True)
    return cls(**{field.name: _value(hints[field.name], rng) for field in dataclasses.fields(cls)})


def _value(hint: Any, rng: np.random.Generator) -> Any:
    for mark in getattr(hint, "__metadata__", ()):
        if isinstance(mark, Array):
            shape = [int(rng.integers(1, 5)) if n is None else n for n in mark.shape]
            return (3.0 * rng.normal(size=shape)).astype(mark.dtype)
    plain = get_args(hint)[0] if hasattr(hint, "__metadata__") else hint
    origin, args = get_origin(plain), get_args(plain)
    if NoneType in args:
        return _value(args[0], rng) if rng.integers(4) else None
    if origin is Literal:
        return args[int(rng.integers(len(args)))]
    if origin is tuple:
        return tuple(_value(args[0], rng) for _ in range(int(rng.integers(0, 4))))
    if origin is dict:
        return {f"figure {i}": float(rng.normal()) for i in range(3)}
    return _PLAIN[plain](rng)


def file_of(records: list[Record]) -> bytes:
    """A file of records."""
    packed = (_HEAD.pack(code, len(content)) + content for code, content in records)
    return MAGIC + b"".join(packed) + MAGIC


def _damaged_records(rng: random.Random, records: list[Record]) -> list[Record]:
    damaged = list(records)
    at, other = rng.randrange(len(damaged)), rng.randrange(len(damaged))
    match rng.randrange(6):
        case 0:
            del damaged[at]
        case 1:
            damaged.insert(other, damaged[at])
        case 2:
            damaged[at], damaged[other] = damaged[other], damaged[at]
        case 3:
            damaged[at] = damaged[at]._replace(code=rng.randrange(256))
        case 4:
            damaged[at] = damaged[at]._replace(code=rng.choice((1, 3, 4, 5, 6, 12, 15)))
        case _:
            content = mutate_bytes(rng, damaged[at].content, damaged[other].content)
            damaged[at] = damaged[at]._replace(content=content)
    return damaged


def _damaged_chunk(rng: random.Random, record: Record) -> Record:
    """A chunk with damaged content and a correct checksum; other records unchanged."""
    if record.code != CHUNK or rng.random() < 0.5:
        return record
    head, packed = record.content[:16], record.content[43:]
    content = lz4.frame.decompress(packed)
    inner = mutate_bytes(rng, content, content) if rng.random() < 0.5 else _reheaded(rng, content)
    size = len(inner) if rng.random() < 0.9 else rng.choice(BOUNDARY_NUMBERS) % 2**64
    return chunk(inner, size, head)


def chunk(content: bytes, size: int, head: bytes = bytes(16)) -> Record:
    """A chunk packed by lz4, with a stated size."""
    packed = lz4.frame.compress(content)
    middle = struct.pack("<QII3sQ", size, zlib.crc32(content), 3, b"lz4", len(packed))
    return Record(CHUNK, head + middle + packed)


def _reheaded(rng: random.Random, content: bytes) -> bytes:
    """Records of a chunk, one of them with another code or length."""
    places, at = [], 0
    while at < len(content):
        places.append(at)
        at += _HEAD.size + _HEAD.unpack_from(content, at)[1]
    at = rng.choice(places)
    code, length = _HEAD.unpack_from(content, at)
    if rng.random() < 0.5:
        code = rng.randrange(16)
    else:
        length = rng.choice((length - 1, length + 1, *BOUNDARY_NUMBERS)) % 2**64
    return content[:at] + _HEAD.pack(code, length) + content[at + _HEAD.size :]


def read_recordings(path: Path) -> None:
    """Read a recording from its start to its end.

    Raises ValueError if it is refused, and AssertionError if its messages differ from its counts.
    """
    recording = open_recording(path)
    counts = dict.fromkeys(recording.counts, 0)
    for kept in recording.messages():
        counts[kept.topic] += 1
    assert counts == recording.counts, "its messages differ from its counts"
