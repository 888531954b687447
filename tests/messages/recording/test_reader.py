from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import lz4.frame
import pytest
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer

from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording import mcap_reading as framing
from palpate.messages.recording.reader import counts_of, open_recording, part_path, parts_of
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.world import World
from palpate.nodes.recorder import SINK, Params

Write = Callable[..., None]


@pytest.fixture
def whole(writer: RecordingWriter, write: Write, tmp_path: Path) -> bytes:
    """Bytes of a closed recording of one world and 100 log records."""
    write(writer, 100)
    writer.close()
    return (tmp_path / "topics.mcap").read_bytes()


@pytest.fixture
def cut(tmp_path: Path) -> Callable[[bytes], Path]:
    """Writes some bytes to a file."""

    def keep(data: bytes) -> Path:
        path = tmp_path / "cut.mcap"
        path.write_bytes(data)
        return path

    return keep


def prefix(path: Path) -> tuple[list[bytes], str]:
    """Bodies of the messages up to the first fault, and the fault."""
    bodies: list[bytes] = []
    try:
        for _, record in framing.placed_records(path):
            if hasattr(record, "publish_time"):
                bodies.append(record.data)
    except ValueError as error:
        return bodies, str(error)
    return bodies, ""


def test_a_recording_tells_what_it_holds(whole: bytes, cut: Callable[[bytes], Path]):
    recording = open_recording(cut(whole))
    assert recording.version == "1.2.3"
    assert recording.graph == b'["a graph"]'
    assert recording.counts == {"/world": 1, "/log": 100}
    assert recording.closed


def test_a_message_comes_back_with_all_that_its_frame_published(
    whole: bytes, cut: Callable[[bytes], Path]
):
    first, *_, last = open_recording(cut(whole)).messages()
    assert (first.topic, first.publisher, first.type) == ("/world", "simulator", "World")
    assert (last.topic, last.publisher, last.type) == ("/log", "", "LogRecord")
    assert (last.run, last.epoch, last.seq) == (0xFEDC_BA98_7654_3210, 0, 99)
    assert last.sent_ns == 105_000_000


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(ValueError, match=r"recording .*none.mcap cannot be read: No such file"):
        open_recording(tmp_path / "none.mcap")


def test_a_folder_is_no_recording(tmp_path: Path):
    with pytest.raises(ValueError, match="cannot be read: Is a directory"):
        open_recording(tmp_path)


def test_an_empty_file_is_refused(cut: Callable[[bytes], Path]):
    with pytest.raises(ValueError, match=r"recording .*cut.mcap is empty$"):
        open_recording(cut(b""))


@pytest.mark.parametrize("data", [b"\x89MCAP", b"#ROSBAG V2.0\n" + b"\0" * 100, b"x"])
def test_another_kind_of_file_is_refused(data: bytes, cut: Callable[[bytes], Path]):
    with pytest.raises(ValueError, match="is not an MCAP file: it begins otherwise"):
        open_recording(cut(data))


def test_an_mcap_file_of_others_is_refused(cut: Callable[[bytes], Path]):
    file = BytesIO()
    writer = Writer(file)
    writer.start()
    writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(ValueError, match="was not written by palpate"):
        open_recording(cut(file.getvalue()))


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (0, 1, "goes on after its end: 1 bytes follow the end of the recording$"),
        (0, 100, "100 bytes follow the end of the recording$"),
        (0, None, r"\d+ bytes follow the end of the recording, and begin as another one$"),
        (7, 0, "7 bytes precede the beginning of the recording$"),
    ],
)
def test_other_bytes_around_a_recording_are_counted(
    whole: bytes, cut: Callable[[bytes], Path], before: int, after: int | None, words: str
):
    rest = whole if after is None else b"x" * after
    path = cut(b"x" * before + whole + rest)
    with pytest.raises(ValueError, match=words):
        open_recording(path)
    assert before or len(prefix(path)[0]) == 101  # of what is whole nothing is lost


def test_a_recording_cut_anywhere_gives_its_beginning_or_one_sentence(
    whole: bytes, cut: Callable[[bytes], Path]
):
    reference, fault = prefix(cut(whole))
    assert (len(reference), fault) == (101, "")
    longest = 0
    for end in random.Random(0).sample(range(len(whole)), 400):
        path = cut(whole[:end])
        bodies, fault = prefix(path)
        assert bodies == reference[: len(bodies)]
        longest = max(longest, len(bodies))
        if "cut off" in fault:
            with pytest.raises(ValueError, match=r"is cut off at (byte \d+|its end)$"):
                open_recording(path)
        elif fault:
            assert fault.endswith(("is empty", "it begins otherwise"))
    assert longest == 101


def test_a_recording_cut_between_records_was_never_closed(
    writer: RecordingWriter, write: Write, tmp_path: Path
):
    write(writer, 100)
    recording = open_recording(tmp_path / "topics.mcap")
    assert not recording.closed
    sequences = [kept.seq for kept in recording.messages() if kept.topic == "/log"]
    assert sequences == list(range(len(sequences)))
    assert len(sequences) >= 80


def test_a_flipped_bit_never_gives_a_wrong_message(whole: bytes, cut: Callable[[bytes], Path]):
    reference, _ = prefix(cut(whole))
    draw = random.Random(1)
    faults = 0
    for _ in range(600):
        damaged = bytearray(whole)
        damaged[draw.randrange(len(whole))] ^= 1 << draw.randrange(8)
        bodies, fault = prefix(cut(bytes(damaged)))
        assert bodies == reference[: len(bodies)]
        faults += bool(fault)
    # What is left lies in the index at the end, which is not read.
    assert faults > 400


def frame(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def chunk(data: bytes, size: int, compression: str) -> bytes:
    builder = RecordBuilder()
    Chunk(compression, data, 0, 0, 0, size).write(builder)
    return bytes(builder.end())


def test_a_chunk_that_bursts_is_refused_before_it_does(cut: Callable[[bytes], Path]):
    bomb = chunk(lz4.frame.compress(b"\0" * (200 << 20)), 1000, "lz4")
    with pytest.raises(ValueError, match="a chunk does not hold the 1000 bytes that it states"):
        open_recording(cut(framing.MAGIC + bomb))


def test_a_chunk_that_states_too_much_is_refused(cut: Callable[[bytes], Path]):
    bomb = chunk(lz4.frame.compress(b"\0" * 1000), 1 << 40, "lz4")
    with pytest.raises(ValueError, match=f"a chunk of {1 << 40} bytes, at most"):
        open_recording(cut(framing.MAGIC + bomb))


def test_a_record_that_states_too_much_is_refused(cut: Callable[[bytes], Path]):
    huge = struct.pack("<BQ", Opcode.CHUNK, 1 << 50)
    with pytest.raises(ValueError, match=f"is damaged at byte 8: a record of {1 << 50} bytes"):
        open_recording(cut(framing.MAGIC + huge))


def test_another_packing_is_refused(cut: Callable[[bytes], Path]):
    with pytest.raises(ValueError, match="has chunks packed by 'zstd'; only lz4 is read"):
        open_recording(cut(framing.MAGIC + chunk(b"abc", 3, "zstd")))


def test_bytes_that_do_not_unpack_are_refused(cut: Callable[[bytes], Path]):
    with pytest.raises(ValueError, match="is damaged: "):
        open_recording(cut(framing.MAGIC + chunk(b"no lz4 at all", 100, "lz4")))


def test_a_record_that_ends_too_early_is_refused(cut: Callable[[bytes], Path]):
    with pytest.raises(ValueError, match="is damaged: "):
        open_recording(cut(framing.MAGIC + frame(Opcode.METADATA, b"\5\0\0\0ab")))


def test_a_wrong_checksum_of_all_data_is_refused(whole: bytes, cut: Callable[[bytes], Path]):
    end = whole.rindex(struct.pack("<BQ", Opcode.DATA_END, 4))
    checksum = zlib.crc32(whole[:end])
    assert whole[end + 9 : end + 13] == struct.pack("<I", checksum)
    damaged = whole[: end + 9] + struct.pack("<I", checksum ^ 1) + whole[end + 13 :]
    with pytest.raises(ValueError, match="the checksum of its data does not fit"):
        open_recording(cut(damaged))


def foreign(metadata: dict[str, str], encoding: str = "msgpack", schema: bool = True) -> bytes:
    """A file with palpate's first record and one channel of this kind."""
    file = BytesIO()
    writer = Writer(file, compression=CompressionType.LZ4)
    writer.start()
    writer.add_metadata("palpate", {})
    schema_id = writer.register_schema("World", "jsonschema", b"{}") if schema else 0
    channel = writer.register_channel("/world", encoding, schema_id, metadata)
    writer.add_message(channel, 0, b"\x80", 0)
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


ABOUT = {"run": "0", "epoch": "0", "schema_hash": "0"}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (foreign({}), "/world lacks its run, epoch or schema hash"),
        (foreign(ABOUT | {"epoch": "first"}), "/world lacks its run, epoch or schema hash"),
        (foreign(ABOUT, encoding="json"), "has no schema of msgpack for /world"),
        (foreign(ABOUT, schema=False), "has no schema of msgpack for /world"),
    ],
)
def test_channels_that_are_not_ours_are_refused(
    data: bytes, words: str, cut: Callable[[bytes], Path]
):
    with pytest.raises(ValueError, match=words):
        open_recording(cut(data))


def test_a_message_without_a_channel_is_refused(cut: Callable[[bytes], Path]):
    message = struct.pack("<HIQQ", 9, 0, 0, 0) + b"\x80"
    data = frame(Opcode.MESSAGE, message)
    packed = chunk(lz4.frame.compress(data), len(data), "lz4")
    with pytest.raises(ValueError, match="is damaged: a message without a channel"):
        open_recording(cut(framing.MAGIC + packed))


TYPES = {"/world": "World"}
COUNT = 200


def publish(writer: object, seqs: range) -> None:
    body = encode(World(platform=0.0, reach=0.3, fingers=1, seed=3))
    for seq in seqs:
        header = Header(7, 0, seq, 1_000_000 * seq, 0.0, schema_hash(World))
        writer.write("/world", header, body)  # type: ignore[attr-defined]


def test_parts_are_numbered_and_found_in_their_order(tmp_path: Path):
    path = tmp_path / "topics.mcap"
    assert parts_of(path) == (path,)
    assert [part_path(path, number).name for number in (0, 1, 12)] == [
        "topics.mcap",
        "topics.1.mcap",
        "topics.12.mcap",
    ]
    for number in (0, 1, 3):
        part_path(path, number).touch()
    assert parts_of(path) == (path, tmp_path / "topics.1.mcap")


@pytest.mark.parametrize("keep", [0.0, 0.001, 0.3, 0.7, 0.999])
def test_a_recorder_that_was_killed_goes_on_and_all_is_there_once(tmp_path: Path, keep: float):
    path = tmp_path / "topics.mcap"
    params = Params(path=str(path))
    first = SINK.open(params, TYPES)
    publish(first, range(COUNT // 2))
    first.close()
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep * len(whole))])
    assert SINK.resume is not None
    second, had = SINK.resume(params, TYPES)
    assert had == counts_of(path)
    publish(second, range(had.get("/world", 0), COUNT))
    second.close()
    recording = open_recording(path)
    assert recording.closed and recording.counts == {"/world": COUNT}
    assert [kept.seq for kept in recording.messages()] == list(range(COUNT))


def test_a_recorder_that_died_before_it_had_a_file_begins_one(tmp_path: Path):
    assert SINK.resume is not None
    writer, had = SINK.resume(Params(path=str(tmp_path / "topics.mcap")), TYPES)
    writer.close()
    assert had == {} and parts_of(tmp_path / "topics.mcap") == (tmp_path / "topics.mcap",)


def in_two_parts(path: Path) -> Path:
    """A recording whose recorder was started again half-way; its second file."""
    params = Params(path=str(path))
    first = SINK.open(params, TYPES)
    publish(first, range(COUNT // 2))
    first.close()
    assert SINK.resume is not None
    second, had = SINK.resume(params, TYPES)
    publish(second, range(had["/world"], COUNT))
    second.close()
    return part_path(path, 1)


def test_a_last_part_that_is_cut_off_is_still_refused(tmp_path: Path):
    last = in_two_parts(tmp_path / "topics.mcap")
    last.write_bytes(last.read_bytes()[:-20])
    with pytest.raises(ValueError, match=r"topics\.1\.mcap is cut off"):
        open_recording(tmp_path / "topics.mcap")


def test_a_first_part_that_was_damaged_since_is_refused(tmp_path: Path):
    path = tmp_path / "topics.mcap"
    in_two_parts(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ValueError, match="damaged: it lacks /world"):
        open_recording(path)


def test_a_recording_does_not_begin_beside_a_further_part_of_another(tmp_path: Path):
    (tmp_path / "topics.1.mcap").touch()
    with pytest.raises(FileExistsError, match=r"topics\.1\.mcap is there already, of another run"):
        SINK.open(Params(path=str(tmp_path / "topics.mcap")), TYPES)
    assert not (tmp_path / "topics.mcap").exists()
