import errno
import json
import os
import random
import re
import struct
import zlib
from collections import Counter
from io import BytesIO
from itertools import accumulate

import pytest
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, Writer

from palpate import __version__
from palpate.launch.files.source_map import InputError
from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.reader import (
    ReadablePrefix,
    RecordingCopy,
    open_recording,
    part_path,
)
from palpate.messages.recording.writer import AtomicFile, RecordingWriter
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.world import World
from palpate.tools.bag.contents import bag_info, info_text, recover_recording, recovered_text
from palpate.tools.cli import command_line as cli

WORLD = World(platform=0.0, reach=0.3, fingers=1, seed=3)
LOG = LogRecord(node="filter", level="info", text="x" * 100, robot_time=0.0)
MESSAGES = [("/world", WORLD), *[("/log", LOG)] * 30]
GRAPH = json.dumps(
    [{"name": name, "module": "m", "params": {}, "inputs": [], "outputs": {}} for name in "ab"]
)


def test_a_recording_says_what_it_holds(record):
    path = record(MESSAGES, graph=GRAPH)
    info = bag_info(path)
    sizes = [30 * len(encode(LOG)), len(encode(WORLD))]
    assert info["parts"] == [{"path": str(path), "bytes": info["bytes"], "closed": True}]
    assert info["bytes"] == path.stat().st_size
    assert (info["version"], info["closed"], info["end"]) == ("1.2.3", True, None)
    assert (info["messages"], info["nodes"]) == (31, ["a", "b"])
    assert info["duration_s"] == pytest.approx(30 * 0.007)
    assert info["topics"] == [
        {
            "topic": topic,
            "type": kind,
            "publisher": "somebody",
            "messages": count,
            "bytes": size,
            "share": size / sum(sizes),
        }
        for topic, kind, count, size in zip(
            ["/log", "/world"], ["LogRecord", "World"], [30, 1], sizes, strict=True
        )
    ]
    assert info["metadata"]["palpate"] == {"version": "1.2.3", "graph": len(GRAPH)}
    assert info["metadata"]["counts"] == {"/log": "30", "/world": "1"}


def test_a_recording_that_is_cut_off_is_shown_up_to_the_cut(record):
    path = record(MESSAGES)
    size = path.stat().st_size // 2
    path.write_bytes(path.read_bytes()[:size])
    info = bag_info(path)
    assert not info["closed"] and info["end"] is not None
    assert info["end"]["why"] == f"is cut off at byte {size}"
    assert 0 < info["end"]["byte"] < size
    assert 0 < info["messages"] < 31
    assert "no: topics.mcap is cut off at byte" in info_text(info)


def test_a_recording_that_was_never_closed_says_so(record):
    path = record(MESSAGES, close=False)
    info = bag_info(path)
    size = path.stat().st_size
    assert info["end"] == {"path": str(path), "byte": size, "why": "was never closed"}
    assert "counts" not in info["metadata"]


def test_the_parts_of_a_recording_are_listed_and_counted_together(record):
    path = record(MESSAGES[:11], close=False)
    had = bag_info(path)["messages"]
    record(MESSAGES, name="topics.1.mcap", skip=had)
    info = bag_info(path.parent)
    assert [part["closed"] for part in info["parts"]] == [False, True]
    assert (info["closed"], info["messages"]) == (True, 31)
    assert "topics.1.mcap" in info_text(info)


def test_a_graph_that_is_none_is_not_believed(record):
    info = bag_info(record(MESSAGES, graph="[{}]"))
    assert info["nodes"] == []
    assert "nodes      not known" in info_text(info)


def test_a_text_that_steers_a_terminal_is_shown_in_quotes(record):
    info = bag_info(record(MESSAGES, publisher="\x1b[31mred", graph="\x1b"))
    assert "\x1b" not in info_text(info)
    assert info["topics"][0]["publisher"] == r"'\x1b[31mred'"


def test_lines_for_people(record):
    lines = info_text(bag_info(record(MESSAGES, graph=GRAPH))).splitlines()
    assert lines[1:6] == [
        "version    1.2.3",
        "closed     yes",
        "duration   0.210 s",
        "messages   31",
        "nodes      a, b",
    ]
    assert f"metadata   palpate: version 1.2.3, graph of {len(GRAPH)} characters" in lines
    assert "metadata   counts: /log 30, /world 1" in lines
    assert lines[-3].split() == ["topic", "type", "publisher", "messages", "bytes", "share"]
    assert lines[-2].split()[:4] == ["/log", "LogRecord", "somebody", "30"]
    assert len({len(line) for line in lines[-3:]}) == 1


@pytest.mark.parametrize(
    ("data", "words"), [(b"", "it is empty"), (b"x" * 99, "it is not an MCAP file")]
)
def test_what_is_no_recording_is_refused(tmp_path, data, words):
    (tmp_path / "a.mcap").write_bytes(data)
    with pytest.raises(InputError, match=f"a.mcap: cannot be read as a recording: {words}"):
        bag_info(tmp_path / "a.mcap")


def test_the_exit_code_says_whether_a_recording_is_whole(record, capsys):
    path = record(MESSAGES)
    assert cli.run(["bag", "info", str(path)]) == 0
    assert capsys.readouterr().out.startswith(f"recording  {path}")
    path.write_bytes(path.read_bytes()[:-3])
    assert cli.run(["bag", "info", str(path), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["closed"] is False
    assert cli.run(["bag", "info", "none.mcap"]) == 2
    assert capsys.readouterr().err == "palpate: none.mcap: the recording does not exist\n"


COUNT = 100


def log(number):
    draw = random.Random(number)
    text = "".join(draw.choices("abcdefghijklmnopqrstuvwxyz ", k=60))
    return LogRecord(node="filter", level="info", text=text, robot_time=0.1 * number)


def world(seed):
    return World(platform=0.0, reach=0.3, fingers=1, seed=seed)


RECOVER_MESSAGES = [("/world", world(i)) if i % 10 == 0 else ("/log", log(i)) for i in range(COUNT)]


@pytest.fixture
def whole(record):
    """Bytes of a closed recording of 20 kB."""
    data = record(RECOVER_MESSAGES).read_bytes()
    assert 15_000 < len(data) < 25_000, len(data)
    return data


def bodies(path):
    """Of the messages up to the first fault."""
    return [one.record.data for one in ReadablePrefix(path) if hasattr(one.record, "publish_time")]


def expected(whole):
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


def stock_counts(path):
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return Counter(channel.topic for _, channel, _ in reader.iter_messages())


def kept(path):
    return list(open_recording(path).messages())


@pytest.mark.parametrize(
    "step", [pytest.param(5, marks=pytest.mark.slow), 61], ids=["many bytes", "some bytes"]
)
def test_a_cut_leaves_exactly_the_messages_of_the_whole_chunks_before_it(whole, tmp_path, step):
    all_bodies, counts = bodies(tmp_path / "topics.mcap"), expected(whole)
    assert counts[-1] == len(all_bodies) == COUNT
    assert len(set(counts)) > 10
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole)
    for end in range(len(whole), -1, -step):
        os.truncate(path, end)
        assert bodies(path) == all_bodies[: counts[end]], end


def test_what_is_recovered_from_a_cut_is_closed_and_any_reader_reads_it(whole, tmp_path):
    reference, counts = kept(tmp_path / "topics.mcap"), expected(whole)
    first = next(end for end, count in enumerate(counts) if count)
    cuts = [first, *random.Random(0).sample(range(first, len(whole)), 40), len(whole)]
    for end in cuts:
        path, out = tmp_path / f"{end}.mcap", tmp_path / f"{end}.recovered.mcap"
        path.write_bytes(whole[:end])
        saved = recover_recording(path)
        assert saved.path == out
        assert open_recording(out).closed
        assert kept(out) == reference[: counts[end]]
        assert stock_counts(out) == saved.counts == Counter(one.topic for one in kept(out))
        assert bool(saved.end.why) is (end < len(whole))
        assert saved.end.byte <= end


def test_a_cut_before_the_first_whole_chunk_leaves_nothing_and_no_file(whole, tmp_path):
    first = next(end for end, count in enumerate(expected(whole)) if count)
    folder = tmp_path / "alone"
    folder.mkdir()
    path = folder / "cut.mcap"
    for end in (0, 5, 8, 40, first // 2, first - 1):
        path.write_bytes(whole[:end])
        with pytest.raises(InputError, match="nothing can be recovered: no message comes before"):
            recover_recording(path)
        assert [one.name for one in folder.iterdir()] == ["cut.mcap"]


def test_a_flipped_bit_never_puts_a_wrong_message_into_what_is_recovered(whole, tmp_path):
    reference = kept(tmp_path / "topics.mcap")
    draw, shorter = random.Random(2), 0
    for number in range(100):
        damaged = bytearray(whole)
        damaged[draw.randrange(len(whole))] ^= 1 << draw.randrange(8)
        path = tmp_path / f"{number}.mcap"
        path.write_bytes(damaged)
        try:
            found = kept(recover_recording(path).path)
        except InputError as error:
            assert "nothing can be recovered" in str(error)
            found = []
        assert found == reference[: len(found)]
        shorter += len(found) < len(reference)
    assert shorter > 50


def test_a_copy_has_all_that_the_recording_says(whole, tmp_path):
    out = recover_recording(tmp_path / "topics.mcap").path
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


def test_a_copy_has_the_checksums_of_a_recording(whole, tmp_path):
    data = recover_recording(tmp_path / "topics.mcap").path.read_bytes()
    end = data.rindex(struct.pack("<BQ", Opcode.DATA_END, 4))
    assert struct.unpack("<I", data[end + 9 : end + 13]) == (zlib.crc32(data[:end]),)


def test_parts_become_one_file_with_every_message_once(record, tmp_path):
    path = record(RECOVER_MESSAGES[:70], close=False)
    whole = len(kept(path))
    record(RECOVER_MESSAGES, name="topics.1.mcap", skip=whole)
    path.write_bytes(path.read_bytes() + b"\6half a chunk")
    saved = recover_recording(path)
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


def test_log_times_never_go_back_from_part_to_part(tmp_path):
    path = tmp_path / "topics.mcap"
    for number, seq, sent in ((0, 0, 50), (1, 1, 40), (1, 2, 60)):
        part = part_path(path, number)
        if not part.exists():
            writer = RecordingWriter(part, {"/world": "World"}, {}, {})
        writer.write("/world", Header(1, 0, seq, sent, 0.0, schema_hash(World)), b"\x80")
        if seq != 1:
            writer.close()
    with recover_recording(path).path.open("rb") as file:
        found = [message for _, _, message in make_reader(file).iter_messages()]
    assert [one.log_time for one in found] == [50, 50, 60]
    assert [one.publish_time for one in found] == [50, 40, 60]


def test_parts_between_which_messages_are_missing_are_recovered_up_to_there(record):
    path = record(RECOVER_MESSAGES[:70])
    record(RECOVER_MESSAGES, name="topics.1.mcap", skip=80)
    saved = recover_recording(path)
    assert len(kept(saved.path)) == 70
    assert saved.end.part == part_path(path, 1)
    assert saved.end.why == "is damaged: it lacks /world 7"


def test_a_run_directory_stands_for_its_recording(record, tmp_path):
    record(RECOVER_MESSAGES)
    assert recover_recording(tmp_path).path == tmp_path / "topics.recovered.mcap"


def test_a_recording_that_was_never_closed_is_reported_to_be(record, tmp_path):
    saved = recover_recording(record(RECOVER_MESSAGES, close=False), tmp_path / "new.mcap")
    assert recovered_text(saved).endswith(
        "all that there is in topics.mcap, which was never closed"
    )


def test_nothing_is_overwritten(record, tmp_path):
    path, out = record(RECOVER_MESSAGES), tmp_path / "new.mcap"
    out.write_bytes(b"mine")
    with pytest.raises(InputError, match=r"new.mcap: exists already; it is not overwritten"):
        recover_recording(path, out)
    with pytest.raises(InputError, match=r"topics.mcap: exists already"):
        recover_recording(path, path)
    (tmp_path / "other.1.mcap").touch()
    with pytest.raises(InputError, match=r"other.1.mcap: would be taken for a part of"):
        recover_recording(path, tmp_path / "other.mcap")
    with pytest.raises(InputError, match=r"there is no folder .*none"):
        recover_recording(path, tmp_path / "none" / "a.mcap")
    assert out.read_bytes() == b"mine"


def test_a_copy_that_cannot_be_written_leaves_nothing_behind(record, tmp_path, monkeypatch):
    path = record(RECOVER_MESSAGES)

    def full(self, data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(AtomicFile, "write", full)
    with pytest.raises(InputError, match=r"topics.recovered.mcap: cannot be written: No space"):
        recover_recording(path)
    assert [one.name for one in tmp_path.iterdir()] == ["topics.mcap"]


def test_a_copy_that_is_not_what_was_written_is_not_believed(record, tmp_path):
    copy = RecordingCopy(tmp_path / "copy.mcap", "palpate")
    copy.take(ReadablePrefix(record(RECOVER_MESSAGES)))
    copy.close("recovered", {})
    copy.check()
    copy.counts["/log"] -= 1
    with pytest.raises(ValueError, match="does not hold what was written to it"):
        copy.check()


def test_the_exit_code_says_whether_anything_was_recovered(record, tmp_path, capsys):
    path, out = record(RECOVER_MESSAGES), tmp_path / "new.mcap"
    path.write_bytes(path.read_bytes()[:6000])
    assert cli.run(["bag", "recover", str(path), "-o", str(out)]) == 0
    published = capsys.readouterr().out
    assert re.fullmatch(
        rf"{out}: \d+ messages on 2 topics; that is up to byte \d+ of topics.mcap, "
        r"which is cut off at byte 6000\n",
        published,
    )
    path.write_bytes(b"")
    assert cli.run(["bag", "recover", str(path)]) == 2
    assert capsys.readouterr().err == (
        f"palpate: {path}: nothing can be recovered: no message comes before its end: it is empty\n"
    )


def test_what_is_no_recording_is_refused_recover(tmp_path):
    with pytest.raises(InputError, match=r"none.mcap: the recording does not exist"):
        recover_recording(tmp_path / "none.mcap")
    with pytest.raises(InputError, match=r"holds no recording: there is no topics.mcap in it"):
        recover_recording(tmp_path)


@pytest.mark.parametrize(
    ("encoding", "told", "words"),
    [
        ("ros1", {}, "it was not written by palpate: /chatter lacks its run"),
        ("msgpack", {"run": "0", "epoch": "0", "schema_hash": "0"}, "ends before it began"),
    ],
)
def test_a_recording_of_others_is_refused(tmp_path, encoding, told, words):
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start()
        schema = writer.register_schema("Chatter", "jsonschema", b"{}")
        channel = writer.register_channel("/chatter", encoding, schema, told)
        writer.add_message(channel, 0, b"hello", 0)
        writer.finish()
    with pytest.raises(InputError, match=words):
        recover_recording(path)
