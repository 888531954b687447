"""Files made to burst: each is refused with its reason, in little time and memory."""

import json
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import numpy as np
import pytest
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema

from palpate.messages import Header, decode, encode, schema_hash
from palpate.messages.recording import RecordingWriter, open_recording
from palpate.messages.types import Truth

MAGIC, MEBIBYTE = b"\x89MCAP0\r\n", 1 << 20
OPEN_ALL = """
import json, sys, time
from pathlib import Path
from palpate.messages.recording import open_recording

def peak():
    # Not ru_maxrss: it begins with what the process that started this one had.
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.split("VmHWM:")[1].split()[0])

for name in sys.argv[1:]:
    before, begun = peak(), time.process_time()
    try:
        text = str(open_recording(Path(name)).counts)
    except ValueError as error:
        text = str(error)
    print(json.dumps([text, time.process_time() - begun, peak() - before]), flush=True)
"""


class Opened(NamedTuple):
    """What came of opening a file."""

    text: str
    seconds: float  # Of processor time
    growth: int  # Of the process's largest memory, bytes


def opened(paths: list[Path]) -> list[Opened]:
    """Open files in a process of its own."""
    program = [sys.executable, "-c", OPEN_ALL, *map(str, paths)]
    done = subprocess.run(program, capture_output=True, text=True, timeout=300, check=True)
    return [Opened(*json.loads(line)) for line in done.stdout.splitlines()]


def frame(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def built(*records: Schema | Channel | Chunk | Metadata) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def chunk(data: bytes, size: int, compression: str = "lz4", crc: int = 0) -> bytes:
    return built(Chunk(compression, data, 0, 0, crc, size))


def packed(data: bytes) -> bytes:
    """A chunk in good order, whatever it holds."""
    return chunk(lz4.frame.compress(data), len(data), crc=zlib.crc32(data))


def repeated(piece: bytes, times: int) -> bytes:
    """So many pieces, packed by lz4 without ever being in memory."""
    block, (full, rest) = piece * 10_000, divmod(times, 10_000)
    packer = lz4.frame.LZ4FrameCompressor()
    parts = [packer.begin(), *(packer.compress(block) for _ in range(full))]
    return b"".join([*parts, packer.compress(piece * rest), packer.flush()])


def channel(number: int, topic: str) -> Channel:
    about = {"run": "0", "epoch": "0", "schema_hash": "0"}
    return Channel(number, topic, "msgpack", about, 1)


WORLD = Schema(1, b"{}", "jsonschema", "World")
CHANNEL = built(WORLD, channel(1, "/world"))
OTHER_TOPIC, OTHER_TYPE = CHANNEL.replace(b"/world", b"/other"), CHANNEL.replace(b"World", b"Other")
EMPTY = frame(Opcode.MESSAGE, b"")
SMALLEST = frame(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 0, 0) + b"\x80")
NONES = lz4.frame.compress(bytes(999))


def bombs() -> dict[str, tuple[bytes, str]]:
    """Files that would burst or are damaged, each with words of what is reported of it."""
    zeros = repeated(b"\0" * 1024, 200 * 1024)
    names = [channel(i, f"/{i:05}" + "x" * 250) for i in range(1, 5000)]
    table = Metadata(name="palpate", metadata={f"{i:06x}": "" for i in range(5000)})
    wrong = zlib.crc32(CHANNEL) ^ 1
    return {
        "zstd": (chunk(b"\x28\xb5\x2f\xfd" * 1000, 1 << 30, "zstd"), "packed by 'zstd'; only lz4"),
        "understated": (chunk(zeros, 1000), "does not hold the 1000 bytes that it states"),
        "true": (chunk(zeros, 200 * MEBIBYTE), "a chunk of 209715200 bytes, at most"),
        "absurd": (chunk(zeros, 1 << 62), f"a chunk of {1 << 62} bytes, at most"),
        "one less": (chunk(NONES, 998), "does not hold the 998 bytes"),
        "one more": (chunk(NONES, 1000), "does not hold the 1000 bytes"),
        "plain": (chunk(bytes(999), 998, ""), "does not hold the 998 bytes"),
        "cut frame": (chunk(NONES[:-1], 999), "does not hold the 999 bytes"),
        "two frames": (chunk(lz4.frame.compress(b"") * 9000, 0), "does not hold the 0 bytes"),
        "no lz4": (chunk(b"no lz4 at all", 100), "a chunk cannot be unpacked"),
        "lz4 sum": (chunk(lz4.frame.compress(CHANNEL), len(CHANNEL), crc=wrong), "checksum of a"),
        "plain sum": (chunk(CHANNEL, len(CHANNEL), "", wrong), "the checksum of a chunk does not"),
        "hundred million": (chunk(repeated(EMPTY, 10**8), 9 * 10**8), "a chunk of 900000000"),
        "empty": (packed(EMPTY * (MEBIBYTE * 11 // 9)), "holds a record in less than 3 bytes"),
        "smallest": (packed(CHANNEL + SMALLEST * 300_000), "holds a record in less than 3 bytes"),
        "bodiless": (packed(CHANNEL + SMALLEST[:1] + EMPTY[1:]), "a message without a body"),
        "channelless": (packed(SMALLEST), "is damaged: a message without a channel"),
        "nested": (packed(packed(packed(CHANNEL))), "a chunk holds a record of kind 6"),
        "beyond chunk": (packed(struct.pack("<BQ", 5, 1 << 60)), "reaches beyond its chunk"),
        "short head": (packed(b"\5\0"), "a chunk ends within a record"),
        "beyond file": (struct.pack("<BQ", Opcode.CHUNK, 200 * MEBIBYTE), "is cut off at byte 17"),
        "too long": (struct.pack("<BQ", Opcode.METADATA, 1 << 30), "a record of 1073741824 bytes"),
        "within field": (frame(Opcode.METADATA, b"\5\0\0\0ab"), "a record ends within a field"),
        "entries": (built(table), "a table of more than 4096 entries"),
        "names": (packed(built(WORLD, *names)), "schemas and channels of more than 1048576"),
        "zeros": (bytes(10_000), "no record of kind 0 has 0 bytes"),
        "bare message": (SMALLEST, "has a message outside of its chunks"),
        "index": (frame(Opcode.MESSAGE_INDEX, struct.pack("<HI", 1, 8)), "ends within a field"),
        "long index": (frame(Opcode.MESSAGE_INDEX, bytes(9)), "an index of messages has another"),
        "twice": (packed(CHANNEL + OTHER_TOPIC), "declares channel 1 in two ways"),
        "two schemas": (packed(CHANNEL + OTHER_TYPE), "declares schema 1 in two ways"),
        "escape": (packed(CHANNEL.replace(b"/world", b"/\x1b[31m")), r"'/\x1b[31m'... is no name"),
        "long name": (packed(built(WORLD, channel(1, "/" + "x" * 256))), "xx'... is no name"),
        "no text": (packed(CHANNEL.replace(b"/world", b"/\xff\xff\xff\xff\xff")), "is not Unicode"),
    }


def test_file_that_would_burst_takes_neither_a_second_nor_64_megabytes(tmp_path: Path):
    known = bombs()
    for name, (data, _) in known.items():
        (tmp_path / name).write_bytes(MAGIC + data)
    outcomes = opened([tmp_path / name for name in known])
    for (name, (_, words)), outcome in zip(known.items(), outcomes, strict=True):
        assert words in outcome.text and "\n" not in outcome.text, (name, outcome.text)
        assert outcome.seconds < 1.0, name
    # The peak only ever rises: the sum is what the worst of them took.
    assert sum(outcome.growth for outcome in outcomes) < 64 * MEBIBYTE


def test_attachment_and_zeros_take_no_more_than_their_share(tmp_path: Path):
    share, ratio = 2 * MEBIBYTE, 8  # random bytes, so that many are packed, then zeros to the limit
    data = np.random.default_rng(0).bytes(share) + bytes(ratio * share - share - MEBIBYTE)
    inside = frame(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 0, 0) + data)
    zeros, attached = tmp_path / "zeros", tmp_path / "attached"
    zeros.write_bytes(MAGIC + packed(CHANNEL + inside))
    writer = RecordingWriter(attached, {"/truth": "Truth"}, {}, {})
    writer.write("/truth", Header(0, 0, 0, 0, 0.0, schema_hash(Truth)), b"\x80")
    writer.close()
    whole, size = attached.read_bytes(), 150 * MEBIBYTE
    end = whole.rindex(struct.pack("<BQ", Opcode.DATA_END, 4))
    with attached.open("wb") as file:
        file.write(whole[:end] + struct.pack("<BQ", Opcode.ATTACHMENT, size))
        file.truncate(end + 9 + size)
    passed, full = opened([attached, zeros])
    assert passed.text == "{'/truth': 1}" and passed.growth < 16 * MEBIBYTE
    assert "was not written by palpate" in full.text and full.seconds < 1.0
    # Once as the file has it, once unpacked, once as the body that is handed over.
    assert full.growth < (1 + 2 * ratio) * share + 16 * MEBIBYTE


@pytest.mark.slow
def test_largest_meshes_stay_readable(tmp_path: Path):
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(1_500_000, 3))
    truth = Truth(
        vertices=vertices,
        faces=rng.integers(0, len(vertices), (3_000_000, 3)).astype(np.int32),
        floor_vertices=vertices[:10],
        floor_faces=np.zeros((0, 3), np.int32),
        height=1.0,
    )
    writer = RecordingWriter(tmp_path / "topics.mcap", {"/truth": "Truth"}, {}, {})
    body = encode(truth)
    assert len(body) > 64 * MEBIBYTE
    writer.write("/truth", Header(0, 0, 0, 0, 0.0, schema_hash(Truth)), body)
    writer.close()
    (kept,) = open_recording(tmp_path / "topics.mcap").messages()
    assert np.array_equal(decode(Truth, kept.body).vertices, vertices)
