"""Damaged recordings: bombs, and a sound one, hurt in its bytes, records or chunks."""

from __future__ import annotations

import random
import struct
import tempfile
import zlib
from functools import cache
from pathlib import Path
from typing import NamedTuple

import lz4.frame

from palpate.launch.damage.meshes import File
from palpate.launch.damage.messages import sound_packets
from palpate.launch.damage.spans import NUMBERS, damaged
from palpate.launch.damage.turns import bomb_of
from palpate.messages.codec import schema_hash
from palpate.messages.header import Header
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types import TYPES

NAME = "topics.mcap"
MAGIC = b"\x89MCAP0\r\n"
CHUNK, MESSAGE, FOOTER = 6, 5, 2
"""Codes of records."""
BURST = 63 << 20
"""To which bombs unpack, bytes."""
_HEAD = struct.Struct("<BQ")


class Record(NamedTuple):
    """One record of a file."""

    code: int
    content: bytes


def damaged_recording(rng: random.Random, number: int) -> File:
    """The bomb whose turn it is, or a sound recording with damage."""
    if (bomb := bomb_of(number, recording_bombs())) is not None:
        return File(NAME, bomb)
    data = sound_recording()
    change = rng.random()
    if change < 0.4:
        return File(NAME, damaged(rng, data, data))
    records = records_of(data)
    if change < 0.7:
        return File(NAME, file_of(_hurt_records(rng, records)))
    return File(NAME, file_of([_hurt_chunk(rng, one) for one in records]))


@cache
def sound_recording() -> bytes:
    """A closed recording of some kB with a message of every type, and more of some."""
    packets = [one for one in sound_packets() if one.reader in TYPES]
    types = {f"/topic/{name}": name for name in TYPES}
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        path = Path(folder) / NAME
        writer = RecordingWriter(path, types, {}, {"version": "1", "graph": "[]"})
        counts = dict.fromkeys(types, 0)
        for i, (name, body) in enumerate(packets):
            topic = f"/topic/{name}"
            header = Header(7, 0, counts[topic], (i + 1) * 4_000_000, 0.0, schema_hash(TYPES[name]))
            writer.write(topic, header, body)
            counts[topic] += 1
        writer.close()
        return path.read_bytes()


def records_of(data: bytes) -> list[Record]:
    """Records of a sound file, the footer too."""
    found, at = [], len(MAGIC)
    while at < len(data) - len(MAGIC):
        code, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        found.append(Record(code, data[at : at + length]))
        at += length
    return found


def file_of(records: list[Record]) -> bytes:
    """A file of records."""
    packed = (_HEAD.pack(code, len(content)) + content for code, content in records)
    return MAGIC + b"".join(packed) + MAGIC


def _hurt_records(rng: random.Random, records: list[Record]) -> list[Record]:
    hurt = list(records)
    at, other = rng.randrange(len(hurt)), rng.randrange(len(hurt))
    match rng.randrange(6):
        case 0:
            del hurt[at]
        case 1:
            hurt.insert(other, hurt[at])
        case 2:
            hurt[at], hurt[other] = hurt[other], hurt[at]
        case 3:
            hurt[at] = Record(rng.randrange(256), hurt[at].content)
        case 4:
            hurt[at] = Record(rng.choice((1, 3, 4, 5, 6, 12, 15)), hurt[at].content)
        case _:
            hurt[at] = Record(hurt[at].code, damaged(rng, hurt[at].content, hurt[other].content))
    return hurt


def _hurt_chunk(rng: random.Random, record: Record) -> Record:
    """A chunk whose content is hurt and whose checksum is right; other records as they are."""
    if record.code != CHUNK or rng.random() < 0.5:
        return record
    head, packed = record.content[:16], record.content[43:]
    content = lz4.frame.decompress(packed)
    inner = damaged(rng, content, content) if rng.random() < 0.5 else _reheaded(rng, content)
    size = len(inner) if rng.random() < 0.9 else rng.choice(NUMBERS) % 2**64
    return chunk(inner, size, head)


def _reheaded(rng: random.Random, content: bytes) -> bytes:
    """Records of a chunk, one of which has another code or length."""
    places, at = [], 0
    while at < len(content):
        places.append(at)
        at += _HEAD.size + _HEAD.unpack_from(content, at)[1]
    at = rng.choice(places)
    code, length = _HEAD.unpack_from(content, at)
    if rng.random() < 0.5:
        code = rng.randrange(16)
    else:
        length = rng.choice((length - 1, length + 1, *NUMBERS)) % 2**64
    return content[:at] + _HEAD.pack(code, length) + content[at + _HEAD.size :]


def chunk(content: bytes, size: int, head: bytes = bytes(16)) -> Record:
    """A chunk packed by lz4 that states a size."""
    packed = lz4.frame.compress(content)
    middle = struct.pack("<QII3sQ", size, zlib.crc32(content), 3, b"lz4", len(packed))
    return Record(CHUNK, head + middle + packed)


@cache
def recording_bombs() -> list[bytes]:
    """Files that were made to burst."""
    footer = Record(FOOTER, bytes(20))
    empty = _HEAD.pack(MESSAGE, 22) + bytes(22)
    unknown = _HEAD.pack(0x80, 0)
    burst = bytes(BURST)
    first = records_of(sound_recording())[:2]
    found = [
        [chunk(burst, BURST), footer],
        [chunk(burst, 1000), footer],
        [chunk(bytes(1000), BURST), footer],
        [chunk(bytes(1000), 2**64 - 1), footer],
        [chunk(empty * 100_000, 100_000 * len(empty)), footer],
        [chunk(unknown * 1_000_000, 1_000_000 * len(unknown)), footer],
        [*first, chunk(b"", 0), footer],
        [Record(CHUNK, bytes(10)), footer],
        [Record(12, struct.pack("<I", 2**32 - 1)), footer],
        [Record(0x80, b"")] * 100_000,
    ]
    files = [file_of(records) for records in found]
    whole = sound_recording()
    return [*files, MAGIC, b"", MAGIC + _HEAD.pack(CHUNK, 2**63), whole + whole, whole[:-8]]
