from __future__ import annotations

import errno
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from palpate.messages.codec import Header, decode, schema, schema_hash
from palpate.messages.fields import MAX_MESSAGE_BYTES
from palpate.messages.recording.mcap_reading import SMALL_CHUNK_BYTES
from palpate.messages.recording.reader import ReadablePrefix, RecordingCopy, open_recording
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.world import World

Write = Callable[..., None]
MILLISECOND = 1_000_000
WORLD = schema_hash(World)


def test_what_is_written_is_read_by_any_mcap_reader(
    writer: RecordingWriter, write: Write, tmp_path: Path
):
    write(writer, 100)
    writer.close()
    with (tmp_path / "topics.mcap").open("rb") as file:
        found = list(make_reader(file, validate_crcs=True).iter_messages())
    assert [channel.topic for _, channel, _ in found] == ["/world"] + ["/log"] * 100
    assert [message.sequence for _, _, message in found[1:]] == list(range(100))
    assert found[0][2].publish_time == 5 * MILLISECOND
    assert decode(World, found[0][2].data).seed == 3
    assert json.loads(found[0][0].data) == json.loads(json.dumps(schema(World)))
    assert (found[0][0].encoding, found[0][1].message_encoding) == ("jsonschema", "msgpack")
    assert found[0][1].metadata == {
        "publisher": "simulator",
        "run": "fedcba9876543210",
        "epoch": "0",
        "schema_hash": f"{WORLD:08x}",
    }


def test_metadata_tell_what_wrote_it_and_how_much(
    writer: RecordingWriter, write: Write, tmp_path: Path
):
    write(writer, 5)
    writer.close()
    with (tmp_path / "topics.mcap").open("rb") as file:
        found = {record.name: record.metadata for record in make_reader(file).iter_metadata()}
    assert found == {
        "palpate": {"version": "1.2.3", "graph": '["a graph"]'},
        "counts": {"/log": "5", "/world": "1"},
        "missing": {"/log": "0", "/world": "0"},
    }


@pytest.mark.parametrize("size", [SMALL_CHUNK_BYTES - 1, SMALL_CHUNK_BYTES, 20 << 20])
@pytest.mark.parametrize("content", [b"\0", b"0123456789" * 7])
def test_large_regular_messages_are_read_back(tmp_path: Path, content: bytes, size: int):
    bodies = [b"\x80", content * (size // len(content)), b"\x81"]
    path = tmp_path / "topics.mcap"
    writer = RecordingWriter(path, {"/world": "World"}, {}, {})
    for seq, body in enumerate(bodies):
        writer.write("/world", Header(1, 0, seq, seq, 0.0, WORLD), body)
    writer.close()
    assert [kept.body for kept in open_recording(path).messages()] == bodies
    copy = RecordingCopy(tmp_path / "copy.mcap", "")
    copy.take(ReadablePrefix(path))
    copy.close("copied", {})
    copy.check()


def test_a_message_that_no_reader_would_take_is_refused(writer: RecordingWriter):
    with pytest.raises(ValueError, match=f"at most {MAX_MESSAGE_BYTES} are allowed"):
        writer.write("/world", Header(1, 0, 0, 0, 0.0, WORLD), bytes(MAX_MESSAGE_BYTES + 1))


def test_log_times_never_go_back(writer: RecordingWriter, tmp_path: Path):
    # Two publishers: what the second sent earlier was received later.
    for seq, sent in enumerate([50, 40, 60]):
        writer.write("/world", Header(1, 0, seq, sent, 0.0, WORLD), b"\x80")
    writer.close()
    with (tmp_path / "topics.mcap").open("rb") as file:
        found = [message for _, _, message in make_reader(file).iter_messages()]
    assert [message.log_time for message in found] == [50, 50, 60]
    assert [message.publish_time for message in found] == [50, 40, 60]
    assert [message.sequence for message in found] == [0, 1, 2]


def test_no_more_than_twenty_milliseconds_are_held(
    writer: RecordingWriter, write: Write, tmp_path: Path
):
    write(writer, 200)  # a millisecond apart; not closed
    on_disk = open_recording(tmp_path / "topics.mcap").counts["/log"]
    assert 180 <= on_disk <= 200


def test_the_first_message_after_a_pause_is_written_at_once(
    writer: RecordingWriter, tmp_path: Path
):
    writer.write("/world", Header(1, 0, 0, 1_000 * MILLISECOND, 0.0, WORLD), b"\x80")
    assert open_recording(tmp_path / "topics.mcap").counts == {"/world": 1}


def test_a_restarted_publisher_has_its_own_channel(writer: RecordingWriter, tmp_path: Path):
    for seq, epoch in enumerate([0, 0, 1]):
        writer.write("/world", Header(1, epoch, seq, seq, 0.0, WORLD), b"\x80")
    writer.close()
    found = list(open_recording(tmp_path / "topics.mcap").messages())
    assert [(kept.epoch, kept.seq) for kept in found] == [(0, 0), (0, 1), (1, 2)]


def test_a_recording_without_messages_can_be_read(writer: RecordingWriter, tmp_path: Path):
    writer.close()
    recording = open_recording(tmp_path / "topics.mcap")
    assert (recording.closed, recording.counts, list(recording.messages())) == (True, {}, [])


def test_closing_twice_is_closing_once(writer: RecordingWriter, write: Write, tmp_path: Path):
    write(writer)
    writer.close()
    size = (tmp_path / "topics.mcap").stat().st_size
    writer.close()
    assert (tmp_path / "topics.mcap").stat().st_size == size


def test_nothing_is_written_after_closing(writer: RecordingWriter):
    writer.close()
    with pytest.raises(ValueError, match=r"recording .*topics.mcap is closed"):
        writer.write("/world", Header(1, 0, 0, 0, 0.0, WORLD), b"\x80")


def test_a_topic_that_was_not_declared_is_refused(writer: RecordingWriter):
    with pytest.raises(ValueError, match="/score is not among the topics to record"):
        writer.write("/score", Header(1, 0, 0, 0, 0.0, WORLD), b"\x80")


def test_an_unknown_type_is_refused_before_there_is_a_file(tmp_path: Path):
    path = tmp_path / "topics.mcap"
    with pytest.raises(ValueError, match="no message type to record /a as Strange; known are"):
        RecordingWriter(path, {"/a": "Strange"}, {}, {})
    assert not path.exists()


def test_a_recording_is_not_overwritten(writer: RecordingWriter, write: Write, tmp_path: Path):
    write(writer)
    writer.close()
    before = (tmp_path / "topics.mcap").read_bytes()
    with pytest.raises(FileExistsError, match="exists already; it is not overwritten"):
        RecordingWriter(tmp_path / "topics.mcap", {}, {}, {})
    assert (tmp_path / "topics.mcap").read_bytes() == before


def test_a_folder_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(OSError, match=r"recording .*nowhere/a.mcap cannot be made: No such file"):
        RecordingWriter(tmp_path / "nowhere" / "a.mcap", {}, {}, {})


class FullDisk:
    """A raw file that writes half of the n-th write and then has no room; later it has again."""

    def __init__(self, raw: Any, fails: int) -> None:
        self._raw, self._left = raw, fails

    def write(self, data: Any) -> int:
        self._left -= 1
        if self._left == 0:
            return int(self._raw.write(data[: len(data) // 2 + 1]))
        if self._left == -1:
            raise OSError(errno.ENOSPC, "No space left on device")
        return int(self._raw.write(data))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._raw, name)


@pytest.mark.parametrize("fails", range(1, 15))
def test_a_full_disk_at_any_write_leaves_whole_records(
    fails: int, writer: RecordingWriter, write: Write, tmp_path: Path
):
    file = writer._file
    file._raw = FullDisk(file._raw, fails)  # type: ignore[assignment]
    with pytest.raises(OSError, match=r"recording stopped, .* cannot be written: No space left"):
        write(writer, 60)
        writer.close()
    writer.close()
    # The library's own reader agrees: no record is cut, and what is there is the beginning.
    recording = open_recording(tmp_path / "topics.mcap")
    sequences = [kept.seq for kept in recording.messages() if kept.topic == "/log"]
    assert sequences == list(range(len(sequences)))
    assert not recording.closed
    with pytest.raises(ValueError, match="is closed"):
        writer.write("/world", Header(1, 0, 0, 0, 0.0, WORLD), b"\x80")


def test_the_full_disk_test_reaches_the_end_of_the_file(writer: RecordingWriter, write: Write):
    # The 15th write is never reached: the parameters above are all writes of such a run.
    file = writer._file
    file._raw = FullDisk(file._raw, 15)  # type: ignore[assignment]
    write(writer, 60)
    writer.close()
    assert file._raw._left == 1  # type: ignore[attr-defined]


def test_a_large_message_is_kept(writer: RecordingWriter, tmp_path: Path):
    body = bytes(range(256)) * (1 << 15)  # 8 MiB
    writer.write("/log", Header(1, 0, 0, 1, 0.0, schema_hash(LogRecord)), body)
    writer.close()
    [kept] = open_recording(tmp_path / "topics.mcap").messages()
    assert kept.body == body


def test_a_closed_file_ends_as_the_format_tells(
    writer: RecordingWriter, write: Write, tmp_path: Path
):
    write(writer)
    writer.close()
    with (tmp_path / "topics.mcap").open("rb") as file:
        kinds = [type(record).__name__ for record in StreamReader(file, validate_crcs=True).records]
    assert kinds[0] == "Header"
    assert kinds[-1] == "Footer"


def test_before_the_disk_is_full_the_recording_is_closed(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    free = iter([200 << 20, 100 << 20, 63 << 20])
    monkeypatch.setattr("palpate.messages.recording.writer.free_bytes", lambda _: next(free))
    path = tmp_path / "guarded.mcap"
    writer = RecordingWriter(
        path, {"/world": "World", "/log": "LogRecord"}, {}, {"version": "1"}, 64 << 20
    )
    with pytest.raises(
        OSError, match=r"only 63 MiB are free on the disk, 64 are to stay so; what it held"
    ):
        write(writer, 100)
    recording = open_recording(path)
    assert recording.closed
    with path.open("rb") as file:
        kept = [one.sequence for _, channel, one in make_reader(file).iter_messages("/log")]
    assert kept == list(range(len(kept))) and len(kept) > 20
    with pytest.raises(ValueError, match="is closed"):
        writer.flush()


def test_what_is_flushed_is_on_the_disk(writer: RecordingWriter, tmp_path: Path):
    header = Header(1, 0, 0, 5, 0.0, WORLD)
    writer.write("/world", header, b"\x80")
    writer.write("/world", header._replace(seq=1, sent_ns=6), b"\x80")
    assert open_recording(tmp_path / "topics.mcap").counts == {}
    writer.flush()
    assert open_recording(tmp_path / "topics.mcap").counts == {"/world": 2}
