from __future__ import annotations

import json
import struct
import subprocess
import sys
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema

from palpate.messages.codec import Header, decode, encode, schema_hash
from palpate.messages.recording.mcap_reading import (
    MAGIC,
    MAX_CHUNK_BYTES,
    MAX_CHUNK_RATIO,
    MAX_DECLARED_BYTES,
    SMALL_CHUNK_BYTES,
)
from palpate.messages.recording.reader import open_recording
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.world import Truth

MEBIBYTE = 1 << 20
MOST_SECONDS, MOST_GROWTH = 1.0, 64 * MEBIBYTE
WATCHED = pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="nobody here tells what a process takes"
)
OPEN_ALL = """
import json, sys, time
from pathlib import Path
from palpate.messages.recording.reader import open_recording

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


def frame(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def chunk(data: bytes, size: int, compression: str = "lz4", crc: int = 0) -> bytes:
    builder = RecordBuilder()
    Chunk(compression, data, 0, 0, crc, size).write(builder)
    return bytes(builder.end())


def packed(data: bytes) -> bytes:
    """A chunk in good order, whatever it holds."""
    return chunk(lz4.frame.compress(data), len(data), crc=zlib.crc32(data))


def repeated(piece: bytes, times: int) -> bytes:
    """So many pieces, packed by lz4 without ever being in memory."""
    block, (full, rest) = piece * 10_000, divmod(times, 10_000)
    packer = lz4.frame.LZ4FrameCompressor()
    parts = [packer.begin(), *(packer.compress(block) for _ in range(full))]
    return b"".join([*parts, packer.compress(piece * rest), packer.flush()])


def declared(records: list[Schema | Channel]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def channel(number: int, topic: str) -> Channel:
    about = {"run": "0", "epoch": "0", "schema_hash": "0"}
    return Channel(number, topic, "msgpack", about, 1)


WORLD = Schema(1, b"{}", "jsonschema", "World")
CHANNEL = declared([WORLD, channel(1, "/world")])
EMPTY = frame(Opcode.MESSAGE, b"")
SMALLEST = frame(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 0, 0) + b"\x80")


def table(entries: int) -> bytes:
    builder = RecordBuilder()
    Metadata(name="palpate", metadata={f"{i:06x}": "" for i in range(entries)}).write(builder)
    return bytes(builder.end())


def bombs() -> dict[str, tuple[bytes, str]]:
    """Files that would burst, each with words of what is reported of it."""
    zeros = repeated(b"\0" * 1024, 200 * 1024)
    many = (SMALL_CHUNK_BYTES - len(CHANNEL)) // len(SMALLEST)
    names = [channel(i, f"/{i:05}" + "x" * 250) for i in range(1, 5000)]
    return {
        "zstd": (chunk(b"\x28\xb5\x2f\xfd" * 1000, 1 << 30, "zstd"), "packed by 'zstd'"),
        "understated": (chunk(zeros, 1000), "does not hold the 1000 bytes that it states"),
        "true": (chunk(zeros, 200 * MEBIBYTE), "a chunk of 209715200 bytes, at most"),
        "absurd": (chunk(zeros, 1 << 62), f"a chunk of {1 << 62} bytes, at most"),
        "one less": (chunk(lz4.frame.compress(bytes(999)), 998), "does not hold the 998 bytes"),
        "one more": (chunk(lz4.frame.compress(bytes(999)), 1000), "does not hold the 1000 bytes"),
        "cut frame": (chunk(lz4.frame.compress(bytes(999))[:-1], 999), "hold the 999 bytes"),
        "two frames": (chunk(lz4.frame.compress(b"") * 9000, 0), "does not hold the 0 bytes"),
        "no lz4": (chunk(b"no lz4 at all", 100), "a chunk cannot be unpacked"),
        "hundred million": (chunk(repeated(EMPTY, 10**8), 9 * 10**8), "a chunk of 900000000"),
        "empty": (packed(EMPTY * (SMALL_CHUNK_BYTES // 9)), "holds a record in less than 3 bytes"),
        "smallest": (packed(CHANNEL + SMALLEST * many), "holds a record in less than 3 bytes"),
        "bodiless": (packed(CHANNEL + SMALLEST[:1] + EMPTY[1:]), "a message without a body"),
        "nested": (packed(packed(packed(CHANNEL))), "a chunk holds a record of kind 6"),
        "beyond chunk": (packed(struct.pack("<BQ", 5, 1 << 60)), "reaches beyond its chunk"),
        "short head": (packed(b"\5\0"), "a chunk ends within a record"),
        "beyond file": (struct.pack("<BQ", Opcode.CHUNK, 200 * MEBIBYTE), "is cut off at byte 17"),
        "too long": (struct.pack("<BQ", Opcode.METADATA, 1 << 30), "a record of 1073741824 bytes"),
        "entries": (table(500_000), "a table of more than 4096 entries"),
        "names": (
            packed(declared([WORLD, *names])),
            f"channels of more than {MAX_DECLARED_BYTES} bytes",
        ),
        "zeros": (bytes(10_000), "no record of kind 0 has 0 bytes"),
        "bare message": (SMALLEST, "has a message outside of its chunks"),
        "twice": (
            packed(CHANNEL + CHANNEL.replace(b"/world", b"/other")),
            "declares channel 1 in two ways",
        ),
        "escape": (packed(CHANNEL.replace(b"/world", b"/\x1b[31m")), r"'/\x1b[31m'... is no name"),
        "no text": (packed(CHANNEL.replace(b"/world", b"/\xff\xff\xff\xff\xff")), "is not Unicode"),
    }


def test_a_length_beyond_the_file_is_not_even_asked_for(tmp_path: Path):
    (tmp_path / "bomb").write_bytes(MAGIC + struct.pack("<BQ", Opcode.CHUNK, 200 * MEBIBYTE))
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="is cut off at byte 17"):
            open_recording(tmp_path / "bomb")
        assert tracemalloc.get_traced_memory()[1] < MEBIBYTE
    finally:
        tracemalloc.stop()


@WATCHED
def test_no_file_that_would_burst_takes_a_second_or_64_megabytes(tmp_path: Path):
    known = bombs()
    for name, (data, _) in known.items():
        (tmp_path / name).write_bytes(MAGIC + data)
    paths = [tmp_path / name for name in known]
    done = subprocess.run(
        [sys.executable, "-c", OPEN_ALL, *map(str, paths)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == len(known)
    for (name, (_, words)), (published, seconds, _) in zip(known.items(), found, strict=True):
        assert words in published and "\n" not in published, name
        assert seconds < MOST_SECONDS, name
    # The peak only ever rises: the sum is what the worst of them took.
    assert sum(growth for _, _, growth in found) < MOST_GROWTH


@WATCHED
def test_a_large_file_of_zeros_takes_no_more_than_its_own_share(tmp_path: Path):
    share = 6 * MEBIBYTE  # random bytes, so that many are packed, and then zeros to the limit
    noise = np.random.default_rng(0).bytes(share)
    data = noise + bytes(MAX_CHUNK_RATIO * share - share - MEBIBYTE)
    inside = frame(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 0, 0) + data)
    (tmp_path / "bomb").write_bytes(MAGIC + packed(CHANNEL + inside))
    done = subprocess.run(
        [sys.executable, "-c", OPEN_ALL, str(tmp_path / "bomb")],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    published, seconds, growth = json.loads(done.stdout)
    assert "was not written by palpate" in published
    assert seconds < MOST_SECONDS
    # Once as the file has it, once unpacked, once as the body that is handed over.
    assert growth < (1 + 2 * MAX_CHUNK_RATIO) * share + 16 * MEBIBYTE


@WATCHED
def test_an_attachment_is_passed_over_unread(
    writer: RecordingWriter, write: Callable[..., None], tmp_path: Path
):
    write(writer)
    writer.close()
    whole = (tmp_path / "topics.mcap").read_bytes()
    end = whole.rindex(struct.pack("<BQ", Opcode.DATA_END, 4))
    path, size = tmp_path / "attached", 150 * MEBIBYTE
    with path.open("wb") as file:
        file.write(whole[:end] + struct.pack("<BQ", Opcode.ATTACHMENT, size))
        file.truncate(end + 9 + size)
    done = subprocess.run(
        [sys.executable, "-c", OPEN_ALL, str(path)],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    published, _, growth = json.loads(done.stdout)
    assert published == "{'/world': 1, '/log': 100}"
    assert growth < 16 * MEBIBYTE


def test_the_largest_meshes_stay_readable(tmp_path: Path):
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(1_500_000, 3))
    faces = rng.integers(0, len(vertices), (3_000_000, 3)).astype(np.int32)
    truth = Truth(
        vertices=vertices,
        faces=faces,
        floor_vertices=vertices[:10],
        floor_faces=np.zeros((0, 3), np.int32),
        height=1.0,
    )
    body = encode(truth)
    assert len(body) > 64 * MEBIBYTE
    writer = RecordingWriter(tmp_path / "topics.mcap", {"/truth": "Truth"}, {}, {})
    writer.write("/truth", Header(0, 0, 0, 0, 0.0, schema_hash(Truth)), body)
    writer.close()
    (kept,) = open_recording(tmp_path / "topics.mcap").messages()
    assert np.array_equal(decode(Truth, kept.body).vertices, vertices)


def test_the_largest_message_of_all_fits_into_a_chunk():
    assert Truth.MAX_BYTES + (1 << 16) + MAX_DECLARED_BYTES // 2 < MAX_CHUNK_BYTES


@pytest.mark.parametrize("compression", ["", "lz4"])
def test_a_chunk_whose_checksum_does_not_fit_is_refused(tmp_path: Path, compression: str):
    data = lz4.frame.compress(CHANNEL) if compression else CHANNEL
    wrong = chunk(data, len(CHANNEL), compression, zlib.crc32(CHANNEL) ^ 1)
    (tmp_path / "wrong").write_bytes(MAGIC + wrong)
    with pytest.raises(ValueError, match="the checksum of a chunk does not fit"):
        open_recording(tmp_path / "wrong")
