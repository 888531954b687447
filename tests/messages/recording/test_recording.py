"""Recordings: what is written is read back; cut, damaged, full disk, in parts, from elsewhere."""

import json
import random
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from palpate.messages import Header, decode, encode, recording as recordings, schema, schema_hash
from palpate.messages.recording import RecordingWriter, open_recording, part_path, parts_of
from palpate.messages.types import LogRecord, World
from palpate.nodes.recorder import SINK, Params
from tests.messages.cases import cases, file_limit

TYPES = {"/world": "World", "/log": "LogRecord"}
MILLISECOND = 1_000_000
RUN = 0xFEDC_BA98_7654_3210
WORLD = schema_hash(World)
COUNT = 100  # Log records of a whole recording
Cut = Callable[[bytes], Path]


def world_header(seq: int = 0, sent_ns: int = 5 * MILLISECOND, epoch: int = 0) -> Header:
    return Header(RUN, epoch, seq, sent_ns, 0.0, WORLD)


def body(seed: int) -> bytes:
    return encode(World(platform=0.0, reach=0.3, fingers=1, seed=seed))


def fill(writer: RecordingWriter, count: int = COUNT) -> RecordingWriter:
    """Write a world and then so many log records, a millisecond apart."""
    writer.write("/world", world_header(), body(3))
    for i in range(count):
        text = f"step {i} " + "x" * 200
        line = LogRecord(node="filter", level="info", text=text, robot_time=0.1 * i)
        header = Header(RUN, 0, i, (6 + i) * MILLISECOND, 0.0, schema_hash(LogRecord), i == 7)
        writer.write("/log", header, encode(line))
    return writer


def made(path: Path, **more: Any) -> RecordingWriter:
    about = {"version": "1.2.3", "graph": '["a graph"]'}
    return RecordingWriter(path, TYPES, {"/world": "simulator"}, about, **more)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "topics.mcap"


@pytest.fixture
def writer(path: Path) -> Iterator[RecordingWriter]:
    writer = made(path)
    yield writer
    writer.close()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Bytes of a closed recording."""
    path = tmp_path_factory.mktemp("whole") / "topics.mcap"
    fill(made(path)).close({"/log": 2})
    return path.read_bytes()


@pytest.fixture
def cut(tmp_path: Path) -> Cut:
    """Writes bytes into a file."""

    def keep(data: bytes) -> Path:
        (tmp_path / "cut.mcap").write_bytes(data)
        return tmp_path / "cut.mcap"

    return keep


def prefix(path: Path) -> tuple[list[bytes], str]:
    """Bodies of the messages up to the first fault, and the fault."""
    records = recordings.ReadablePrefix(path)
    bodies = [one.record.data for one in records if hasattr(one.record, "publish_time")]
    return bodies, records.end.why


def test_recording_tells_all_that_its_frames_told_to_any_mcap_reader(whole: bytes, cut: Cut):
    recording = open_recording(cut(whole))
    assert (recording.version, recording.graph) == ("1.2.3", b'["a graph"]')
    assert recording.counts == {"/world": 1, "/log": COUNT} and recording.closed
    assert recording.type_of("/world") is World
    with pytest.raises(ValueError, match="/world was recorded with another version of World"):
        recording.type_of("/world", WORLD ^ 1)
    first, *_, last = messages = list(recording.messages())
    assert (first.topic, first.publisher, first.type) == ("/world", "simulator", "World")
    assert (last.topic, last.publisher, last.type) == ("/log", "", "LogRecord")
    assert (last.run, last.epoch, last.seq, last.sent_ns) == (RUN, 0, 99, 105 * MILLISECOND)
    assert first.body == body(3) and first.schema == WORLD
    assert [one.seq for one in messages if one.outside] == [7]
    reader = make_reader(BytesIO(whole), validate_crcs=True)
    read = list(reader.iter_messages())
    numbers = [("/world", 0), *(("/log", i) for i in range(COUNT))]
    assert sorted((channel.topic, one.sequence) for _, channel, one in read) == sorted(numbers)
    schema_, channel, message = read[0]
    assert message.publish_time == 5 * MILLISECOND and decode(World, message.data).seed == 3
    assert json.loads(schema_.data) == json.loads(json.dumps(schema(World)))
    assert (schema_.encoding, channel.message_encoding) == ("jsonschema", "msgpack")
    assert channel.metadata == {
        "publisher": "simulator",
        "run": "fedcba9876543210",
        "epoch": "0",
        "schema_hash": f"{WORLD:08x}",
    }
    assert {one.name: one.metadata for one in reader.iter_metadata()} == {
        "palpate": {"version": "1.2.3", "graph": '["a graph"]'},
        "counts": {"/log": "100", "/world": "1"},
        "missing": {"/log": "2", "/world": "0"},
    }
    kinds = [type(one).__name__ for one in StreamReader(BytesIO(whole), validate_crcs=True).records]
    assert (kinds[0], kinds[-1]) == ("Header", "Footer")


def test_log_times_never_go_back_and_a_restart_has_its_own_channel(writer, path):
    # Two publishers: what the second sent earlier was received later.
    for seq, (sent, epoch) in enumerate([(50, 0), (40, 0), (60, 1)]):
        writer.write("/world", world_header(seq, sent, epoch), b"\x80")
    writer.close()
    found = [one for _, _, one in make_reader(BytesIO(path.read_bytes())).iter_messages()]
    assert [(one.log_time, one.publish_time) for one in found] == [(50, 50), (50, 40), (60, 60)]
    kept = list(open_recording(path).messages())
    assert [(one.epoch, one.seq) for one in kept] == [(0, 0), (0, 1), (1, 2)]


def test_no_more_than_twenty_milliseconds_are_held(writer, path):
    fill(writer, 200)
    recording = open_recording(path)
    sequences = [one.seq for one in recording.messages() if one.topic == "/log"]
    assert not recording.closed and sequences == list(range(len(sequences)))
    assert 180 <= len(sequences) <= 200
    writer.flush()
    assert open_recording(path).counts == {"/world": 1, "/log": 200}
    writer.write("/world", world_header(1, 1_000 * MILLISECOND), b"\x80")  # after a pause: at once
    assert open_recording(path).counts == {"/world": 2, "/log": 200}


def test_closed_recording_stays_as_it_is(writer, path):
    writer.close()
    recording = open_recording(path)
    assert (recording.closed, recording.counts, list(recording.messages())) == (True, {}, [])
    before = path.read_bytes()
    writer.close()
    with pytest.raises(ValueError, match=r"recording .*topics.mcap is closed"):
        writer.write("/world", world_header(), b"\x80")
    with pytest.raises(FileExistsError, match="exists already; it is not overwritten"):
        made(path)
    assert path.read_bytes() == before


def test_message_or_recording_that_cannot_be_kept_is_refused(writer, tmp_path: Path):
    for topic, size, words in (
        ("/score", 1, "/score is not among the topics to record"),
        ("/world", (256 << 20) + 1, f"at most {256 << 20} are allowed"),
    ):
        with pytest.raises(ValueError, match=words):
            writer.write(topic, world_header(), bytes(size))
    with pytest.raises(ValueError, match="no message type to record /a as Strange; known are"):
        RecordingWriter(tmp_path / "a", {"/a": "Strange"}, {}, {})
    assert not (tmp_path / "a").exists()
    with pytest.raises(OSError, match=r"recording .*nowhere/a cannot be made: No such file"):
        made(tmp_path / "nowhere" / "a")


def test_large_regular_messages_are_read_back_and_copied(tmp_path: Path, path: Path):
    # Zeros are packed more densely than a reader believes of chunks beyond 12 MiB.
    bodies = [b"\x80", bytes((12 << 20) - 1), b"0123456789" * (13 << 17), b"\x81"]
    writer = made(path)
    for seq, body in enumerate(bodies):
        writer.write("/world", world_header(seq, seq), body)
    writer.close()
    assert [kept.body for kept in open_recording(path).messages()] == bodies
    copy = recordings.RecordingCopy(tmp_path / "copy.mcap", "")
    copy.take(recordings.ReadablePrefix(path))
    copy.close("copied", {})
    copy.check()
    assert open_recording(tmp_path / "copy.mcap").counts == {"/world": 4}


@pytest.mark.parametrize("limit", [200, 1000, 2000, 2600, 3500, 4500, 5300, 6200, 7000, 7700])
def test_disk_full_at_any_byte_leaves_whole_records(path: Path, whole: bytes, limit: int):
    writer = made(path)
    words = r"recording stopped, .* cannot be written: File too la"
    with file_limit(limit * len(whole) // 8000), pytest.raises(OSError, match=words):
        fill(writer).close()
    writer.close()
    with pytest.raises(ValueError, match="is closed"):
        writer.write("/world", world_header(), b"\x80")
    recording = open_recording(path)
    sequences = [kept.seq for kept in recording.messages() if kept.topic == "/log"]
    assert sequences == list(range(len(sequences))) and not recording.closed


def test_recording_is_closed_before_the_disk_is_full(path: Path):
    writer = made(path, spare=1 << 60)
    words = rf"only \d+ MiB are free on the disk, {1 << 40} are to stay so; what it held"
    with pytest.raises(OSError, match=words):
        fill(writer)
    recording = open_recording(path)
    assert recording.closed
    sequences = [kept.seq for kept in recording.messages() if kept.topic == "/log"]
    assert sequences == list(range(len(sequences))) and len(sequences) > 10
    with pytest.raises(ValueError, match="is closed"):
        writer.flush()


def test_recording_cut_or_damaged_anywhere_gives_its_beginning_or_one_sentence(
    whole: bytes, cut: Cut
):
    reference, fault = prefix(cut(whole))
    assert (len(reference), fault) == (COUNT + 1, "")
    longest = 0
    for end in random.Random(0).sample(range(len(whole)), 150):
        path = cut(whole[:end])
        bodies, fault = prefix(path)
        assert bodies == reference[: len(bodies)]
        longest = max(longest, len(bodies))
        if "cut off" in fault:
            with pytest.raises(ValueError, match=r"is cut off at (byte \d+|its end)$"):
                open_recording(path)
        else:
            assert fault in ("is empty", "was never closed") or "begins otherwise" in fault
    assert longest == COUNT + 1
    draw, faults = random.Random(1), 0
    for _ in range(200):
        damaged = bytearray(whole)
        damaged[draw.randrange(len(whole))] ^= 1 << draw.randrange(8)
        bodies, fault = prefix(cut(bytes(damaged)))
        assert bodies == reference[: len(bodies)]
        faults += bool(fault)
    assert faults > 130  # The rest lies in the index at the end, which is not read.


@cases(
    "before, after, words",
    (0, b"x", "goes on after its end: 1 bytes follow the end of the recording$"),
    (0, None, r"\d+ bytes follow the end of the recording, and begin as another one$"),
    (7, b"", "7 bytes precede the beginning of the recording$"),
)
def test_other_bytes_around_a_recording_are_counted(whole, cut, before, after, words):
    path = cut(b"x" * before + whole + (whole if after is None else after))
    with pytest.raises(ValueError, match=words):
        open_recording(path)
    assert before or len(prefix(path)[0]) == COUNT + 1


def foreign(metadata: dict[str, str] | None, encoding: str = "msgpack", schema: bool = True):
    """A file of another program, or with one channel of this kind."""
    file = BytesIO()
    writer = Writer(file, compression=CompressionType.LZ4)
    writer.start()
    if metadata is not None:
        writer.add_metadata("palpate", {})
        schema_id = writer.register_schema("World", "jsonschema", b"{}") if schema else 0
        channel = writer.register_channel("/world", encoding, schema_id, metadata)
        writer.add_message(channel, 0, b"\x80", 0)
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


KEPT = {"run": "0", "epoch": "0", "schema_hash": "0"}


@cases(
    "data, words",
    (b"", "is empty$"),
    *((one, "is not an MCAP file: it begins otherwise") for one in (b"\x89MCAP", b"x" * 99)),
    (foreign(None), "was not written by palpate"),
    (foreign({}), "/world lacks its run, epoch or schema hash"),
    (foreign(KEPT | {"epoch": "first"}), "/world lacks its run, epoch or schema hash"),
    (foreign(KEPT, encoding="json"), "has no schema of msgpack for /world"),
    (foreign(KEPT, schema=False), "has no schema of msgpack for /world"),
    ids=range(8),
)
def test_file_of_another_kind_is_refused(data: bytes, words: str, cut: Cut):
    with pytest.raises(ValueError, match=rf"recording .*cut.mcap .*{words}"):
        open_recording(cut(data))


def test_file_that_cannot_be_read_or_has_a_wrong_checksum_is_refused(
    tmp_path: Path, whole: bytes, cut: Cut
):
    with pytest.raises(ValueError, match=r"recording .*none.mcap cannot be read: No such file"):
        open_recording(tmp_path / "none.mcap")
    with pytest.raises(ValueError, match="cannot be read: Is a directory"):
        open_recording(tmp_path)
    end = whole.rindex(struct.pack("<BQ", Opcode.DATA_END, 4))
    checksum = zlib.crc32(whole[:end])
    assert whole[end + 9 : end + 13] == struct.pack("<I", checksum)
    damaged = whole[: end + 9] + struct.pack("<I", checksum ^ 1) + whole[end + 13 :]
    with pytest.raises(ValueError, match="the checksum of its data does not fit"):
        open_recording(cut(damaged))


def record(writer: Any, seqs: range) -> None:
    for seq in seqs:
        writer.write("/world", world_header(seq, MILLISECOND * seq), body(seq))


@pytest.mark.parametrize("keep", [None, 0.0, 0.001, 0.3, 0.7, 0.999, 1.0])
def test_recorder_that_was_killed_goes_on_and_keeps_all_once(path: Path, keep: float | None):
    params, types = Params(path=str(path)), {"/world": "World"}
    if keep is not None:
        first = SINK.open(params, types)
        record(first, range(50))
        first.close({})
        whole = path.read_bytes()
        path.write_bytes(whole[: int(keep * len(whole))])
    assert SINK.resume is not None
    second, had = SINK.resume(params, types)
    assert had == recordings.counts_of(path)
    record(second, range(had.get("/world", 0), 100))
    second.close({})
    recording = open_recording(path)
    assert recording.closed and recording.counts == {"/world": 100}
    assert [(one.seq, one.body) for one in recording.messages()] == [
        (seq, body(seq)) for seq in range(100)
    ]
    assert len(parts_of(path)) == (1 if keep is None else 2)


@pytest.mark.parametrize(
    ("number", "keep", "words"),
    [(1, 0.99, r"topics\.1\.mcap is cut off"), (0, 0.5, "damaged: it lacks /world")],
)
def test_parts_that_do_not_fit_together_are_refused(path, number: int, keep: float, words: str):
    test_recorder_that_was_killed_goes_on_and_keeps_all_once(path, 1.0)
    part = part_path(path, number)
    part.write_bytes(part.read_bytes()[: int(keep * part.stat().st_size)])
    with pytest.raises(ValueError, match=words):
        open_recording(path)


def test_parts_are_numbered_without_gaps(path: Path):
    assert parts_of(path) == (path,)
    names = ["topics.mcap", "topics.1.mcap", "topics.3.mcap"]
    for number, name in zip((0, 1, 3), names, strict=True):
        assert part_path(path, number).name == name
        part_path(path, number).touch()
    assert parts_of(path) == (path, path.with_name("topics.1.mcap"))
    path.unlink()
    with pytest.raises(FileExistsError, match=r"topics\.1\.mcap of another run exists already"):
        SINK.open(Params(path=str(path)), TYPES)
    assert not path.exists()
