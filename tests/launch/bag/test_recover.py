from __future__ import annotations

import errno
import os
import random
import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable
from io import BytesIO
from itertools import accumulate
from pathlib import Path

import pytest
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, Writer

from palpate import __version__
from palpate.launch.bag.recover import recover, recovered_text
from palpate.launch.cli import main as cli
from palpate.launch.located import InputError
from palpate.messages.codec import schema_hash
from palpate.messages.header import Header
from palpate.messages.recording.checked import Prefix
from palpate.messages.recording.copy import RecordingCopy
from palpate.messages.recording.parts import part_path
from palpate.messages.recording.reader import Kept, open_recording
from palpate.messages.recording.whole_file import WholeFile
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types import LogRecord, World

Record = Callable[..., Path]
COUNT = 100


def log(number: int) -> LogRecord:
    draw = random.Random(number)
    text = "".join(draw.choices("abcdefghijklmnopqrstuvwxyz ", k=60))
    return LogRecord(node="filter", level="info", text=text, robot_time=0.1 * number)


def world(seed: int) -> World:
    return World(platform=0.0, reach=0.3, fingers=1, seed=seed)


MESSAGES = [("/world", world(i)) if i % 10 == 0 else ("/log", log(i)) for i in range(COUNT)]


@pytest.fixture
def whole(record: Record) -> bytes:
    """Bytes of a closed recording of 20 kB."""
    data = record(MESSAGES).read_bytes()
    assert 15_000 < len(data) < 25_000, len(data)
    return data


def bodies(path: Path) -> list[bytes]:
    """Of the messages up to the first fault."""
    return [one.record.data for one in Prefix(path) if hasattr(one.record, "publish_time")]


def expected(whole: bytes) -> list[int]:
    """How many messages lie in whole chunks before each cut, as the stock reader tells."""
    grown = [0] * (len(whole) + 1)
    with BytesIO(whole) as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        for index in summary.chunk_indexes:
            end = index.chunk_start_offset + index.chunk_length
            chunk = Chunk.read(ReadDataStream(BytesIO(whole[index.chunk_start_offset + 9 : end])))
            grown[end] = sum(isinstance(one, Message) for one in breakup_chunk(chunk))
    return list(accumulate(grown))


def stock_counts(path: Path) -> Counter[str]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return Counter(channel.topic for _, channel, _ in reader.iter_messages())


def kept(path: Path) -> list[Kept]:
    return list(open_recording(path).messages())


@pytest.mark.parametrize(
    "step", [pytest.param(5, marks=pytest.mark.slow), 61], ids=["many bytes", "some bytes"]
)
def test_a_cut_leaves_exactly_the_messages_of_the_whole_chunks_before_it(
    whole: bytes, tmp_path: Path, step: int
) -> None:
    all_bodies, counts = bodies(tmp_path / "topics.mcap"), expected(whole)
    assert counts[-1] == len(all_bodies) == COUNT
    assert len(set(counts)) > 10

    path = tmp_path / "cut.mcap"
    path.write_bytes(whole)
    for end in range(len(whole), -1, -step):
        os.truncate(path, end)
        assert bodies(path) == all_bodies[: counts[end]], end


def test_what_is_recovered_from_a_cut_is_closed_and_any_reader_reads_it(
    whole: bytes, tmp_path: Path
) -> None:
    reference, counts = kept(tmp_path / "topics.mcap"), expected(whole)
    first = next(end for end, count in enumerate(counts) if count)
    cuts = [first, *random.Random(0).sample(range(first, len(whole)), 40), len(whole)]

    for end in cuts:
        path, out = tmp_path / f"{end}.mcap", tmp_path / f"{end}.recovered.mcap"
        path.write_bytes(whole[:end])
        saved = recover(path)
        assert saved.path == out
        assert open_recording(out).closed
        assert kept(out) == reference[: counts[end]]
        assert stock_counts(out) == saved.counts == Counter(one.topic for one in kept(out))
        assert bool(saved.end.why) is (end < len(whole))
        assert saved.end.byte <= end


def test_a_cut_before_the_first_whole_chunk_leaves_nothing_and_no_file(
    whole: bytes, tmp_path: Path
) -> None:
    first = next(end for end, count in enumerate(expected(whole)) if count)
    folder = tmp_path / "alone"
    folder.mkdir()
    path = folder / "cut.mcap"
    for end in (0, 5, 8, 40, first // 2, first - 1):
        path.write_bytes(whole[:end])
        with pytest.raises(InputError, match="nothing can be recovered: no message comes before"):
            recover(path)
        assert [one.name for one in folder.iterdir()] == ["cut.mcap"]


def test_a_flipped_bit_never_puts_a_wrong_message_into_what_is_recovered(
    whole: bytes, tmp_path: Path
) -> None:
    reference = kept(tmp_path / "topics.mcap")
    draw, shorter = random.Random(2), 0
    for number in range(100):
        damaged = bytearray(whole)
        damaged[draw.randrange(len(whole))] ^= 1 << draw.randrange(8)
        path = tmp_path / f"{number}.mcap"
        path.write_bytes(damaged)
        try:
            found = kept(recover(path).path)
        except InputError as error:
            assert "nothing can be recovered" in str(error)
            found = []
        assert found == reference[: len(found)]
        shorter += len(found) < len(reference)
    assert shorter > 50


def test_a_copy_has_all_that_the_recording_says(whole: bytes, tmp_path: Path) -> None:
    out = recover(tmp_path / "topics.mcap").path

    with out.open("rb") as new, (tmp_path / "topics.mcap").open("rb") as old:
        readers = make_reader(new, validate_crcs=True), make_reader(old, validate_crcs=True)
        header = readers[0].get_header()
        told = [{one.name: one.metadata for one in each.iter_metadata()} for each in readers]
        summaries = [each.get_summary() for each in readers]
        assert (header.profile, header.library) == ("palpate", f"palpate {__version__}")
    note = told[0].pop("recovered")
    assert note == {"from": "topics.mcap", "to": f"topics.mcap, byte {len(whole)}", "why": ""}
    assert told[0] == told[1]
    assert summaries[0] is not None and summaries[1] is not None
    assert summaries[0].schemas == summaries[1].schemas
    assert summaries[0].channels == summaries[1].channels
    assert {one.compression for one in summaries[0].chunk_indexes} == {"lz4"}


def test_a_copy_has_the_checksums_of_a_recording(whole: bytes, tmp_path: Path) -> None:
    data = recover(tmp_path / "topics.mcap").path.read_bytes()

    end = data.rindex(struct.pack("<BQ", Opcode.DATA_END, 4))
    assert struct.unpack("<I", data[end + 9 : end + 13]) == (zlib.crc32(data[:end]),)


def test_parts_become_one_file_with_every_message_once(record: Record, tmp_path: Path) -> None:
    path = record(MESSAGES[:70], close=False)
    whole = len(kept(path))
    record(MESSAGES, name="topics.1.mcap", skip=whole)
    path.write_bytes(path.read_bytes() + b"\6half a chunk")

    saved = recover(path)

    assert saved.parts == (path, part_path(path, 1))
    assert [one.seq for one in kept(saved.path) if one.topic == "/world"] == list(range(10))
    assert len(kept(saved.path)) == COUNT
    assert stock_counts(saved.path) == {"/world": 10, "/log": 90}
    names = ["palpate", "missing", "counts", "recovered"]
    with saved.path.open("rb") as file:
        assert [one.name for one in make_reader(file).iter_metadata()] == names
    assert "100 messages on 2 topics, of 2 files; that is all that there was" in recovered_text(
        saved
    )


def test_log_times_never_go_back_from_part_to_part(tmp_path: Path) -> None:
    path = tmp_path / "topics.mcap"
    for number, seq, sent in ((0, 0, 50), (1, 1, 40), (1, 2, 60)):
        part = part_path(path, number)
        if not part.exists():
            writer = RecordingWriter(part, {"/world": "World"}, {}, {})
        writer.write("/world", Header(1, 0, seq, sent, 0.0, schema_hash(World)), b"\x80")
        if seq != 1:
            writer.close()

    with recover(path).path.open("rb") as file:
        found = [message for _, _, message in make_reader(file).iter_messages()]
    assert [one.log_time for one in found] == [50, 50, 60]
    assert [one.publish_time for one in found] == [50, 40, 60]


def test_parts_between_which_messages_are_missing_are_recovered_up_to_there(
    record: Record,
) -> None:
    path = record(MESSAGES[:70])
    record(MESSAGES, name="topics.1.mcap", skip=80)

    saved = recover(path)

    assert len(kept(saved.path)) == 70
    assert saved.end.part == part_path(path, 1)
    assert saved.end.why == "is damaged: it lacks /world 7"


def test_a_run_directory_stands_for_its_recording(record: Record, tmp_path: Path) -> None:
    record(MESSAGES)

    assert recover(tmp_path).path == tmp_path / "topics.recovered.mcap"


def test_a_recording_that_was_never_closed_is_said_to_be(record: Record, tmp_path: Path) -> None:
    saved = recover(record(MESSAGES, close=False), tmp_path / "new.mcap")

    assert recovered_text(saved).endswith(
        "all that there is in topics.mcap, which was never closed"
    )


def test_nothing_is_overwritten(record: Record, tmp_path: Path) -> None:
    path, out = record(MESSAGES), tmp_path / "new.mcap"
    out.write_bytes(b"mine")
    with pytest.raises(InputError, match=r"new.mcap: exists already; it is not overwritten"):
        recover(path, out)
    with pytest.raises(InputError, match=r"topics.mcap: exists already"):
        recover(path, path)
    (tmp_path / "other.1.mcap").touch()
    with pytest.raises(InputError, match=r"other.1.mcap: would be taken for a part of"):
        recover(path, tmp_path / "other.mcap")
    with pytest.raises(InputError, match=r"there is no folder .*none"):
        recover(path, tmp_path / "none" / "a.mcap")
    assert out.read_bytes() == b"mine"


def test_a_copy_that_cannot_be_written_leaves_nothing_behind(
    record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = record(MESSAGES)

    def full(self: WholeFile, data: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(WholeFile, "write", full)
    with pytest.raises(InputError, match=r"topics.recovered.mcap: cannot be written: No space"):
        recover(path)
    assert [one.name for one in tmp_path.iterdir()] == ["topics.mcap"]


def test_a_copy_that_is_not_what_was_written_is_not_believed(
    record: Record, tmp_path: Path
) -> None:
    copy = RecordingCopy(tmp_path / "copy.mcap", "palpate")
    copy.take(Prefix(record(MESSAGES)))
    copy.close("recovered", {})
    copy.check()
    copy.counts["/log"] -= 1

    with pytest.raises(ValueError, match="does not hold what was written to it"):
        copy.check()


def test_the_exit_code_says_whether_anything_was_recovered(
    record: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = record(MESSAGES), tmp_path / "new.mcap"
    path.write_bytes(path.read_bytes()[:6000])
    assert cli.run(["bag", "recover", str(path), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert re.fullmatch(
        rf"{out}: \d+ messages on 2 topics; that is up to byte \d+ of topics.mcap, "
        r"which is cut off at byte 6000\n",
        said,
    )

    path.write_bytes(b"")
    assert cli.run(["bag", "recover", str(path)]) == 2
    assert capsys.readouterr().err == (
        f"palpate: {path}: nothing can be recovered: no message comes before its end: it is empty\n"
    )


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none.mcap: the recording does not exist"):
        recover(tmp_path / "none.mcap")
    with pytest.raises(InputError, match=r"holds no recording: there is no topics.mcap in it"):
        recover(tmp_path)


@pytest.mark.parametrize(
    ("encoding", "told", "words"),
    [
        ("ros1", {}, "it was not written by palpate: /chatter lacks its run"),
        ("msgpack", {"run": "0", "epoch": "0", "schema_hash": "0"}, "ends before it began"),
    ],
)
def test_a_recording_of_others_is_refused(
    tmp_path: Path, encoding: str, told: dict[str, str], words: str
) -> None:
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start()
        schema = writer.register_schema("Chatter", "jsonschema", b"{}")
        channel = writer.register_channel("/chatter", encoding, schema, told)
        writer.add_message(channel, 0, b"hello", 0)
        writer.finish()  # type: ignore[no-untyped-call]

    with pytest.raises(InputError, match=words):
        recover(path)
