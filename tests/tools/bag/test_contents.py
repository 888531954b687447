"""What recordings hold and differ in, what is saved of damaged ones and taken of running graphs."""

import json
import os
import random
import re
import struct
import zlib
from collections import Counter
from dataclasses import replace
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
from palpate.messages import encode
from palpate.messages.recording import open_recording, part_path
from palpate.nodes.runtime.node import recorded_nodes
from palpate.tools.bag.contents import (
    bag_info,
    compare_recordings,
    diff_text,
    info_text,
    recover_recording,
    recovered_text,
)
from palpate.tools.bag.playback import player_entry, read_remap
from tests.tools.recordings import WORLD, frame, log, write_recording
from tests.tools.toy_graph import NODES, Bends

LOG = log(value=0.0, text="x" * 100)
MESSAGES = [("/world", WORLD), *[("/log", LOG)] * 30]
GRAPH = json.dumps(
    [{"name": name, "module": "m", "params": {}, "inputs": [], "outputs": {}} for name in "ab"]
)
ABOUT = {"version": "1.2.3", "graph": GRAPH}


def test_info_shows_topics_sizes_nodes_and_metadata(record, call):
    path = record(MESSAGES, about=ABOUT)
    sizes = {"/log": 30 * len(encode(LOG)), "/world": len(encode(WORLD))}
    info = bag_info(path)
    assert info == {
        "path": str(path),
        "parts": [{"path": str(path), "bytes": path.stat().st_size, "closed": True}],
        "bytes": path.stat().st_size,
        "version": "1.2.3",
        "closed": True,
        "end": None,
        "duration_s": pytest.approx(30 * 0.007),
        "messages": 31,
        "topics": [
            {
                "topic": topic,
                "type": kind,
                "publisher": "somebody",
                "messages": count,
                "bytes": sizes[topic],
                "share": sizes[topic] / sum(sizes.values()),
            }
            for topic, kind, count in (("/log", "LogRecord", 30), ("/world", "World", 1))
        ],
        "metadata": info["metadata"],
        "nodes": ["a", "b"],
    }
    assert info["metadata"]["palpate"] == {"version": "1.2.3", "graph": len(GRAPH)}
    assert info["metadata"]["counts"] == {"/log": "30", "/world": "1"}
    code, out, _ = call("bag info", path)
    lines = out.splitlines()
    assert code == 0 and lines[0].startswith(f"recording  {path}")
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
def test_info_of_no_recording_is_refused(tmp_path, data, words, refusal):
    (tmp_path / "a.mcap").write_bytes(data)
    message = refusal("bag info", tmp_path / "a.mcap")
    assert f"a.mcap: cannot be read as a recording: {words}" in message


def test_info_of_damaged_recordings_shows_their_end(record, call):
    path = record(MESSAGES, closed=False)
    size = path.stat().st_size
    info = bag_info(path)
    assert info["end"] == {"path": str(path), "byte": size, "why": "was never closed"}
    assert "counts" not in info["metadata"]
    path = record(MESSAGES)
    size = path.stat().st_size // 2
    os.truncate(path, size)
    code, out, _ = call("bag info", path, "--json")
    info = json.loads(out)
    assert code == 1 and not info["closed"] and 0 < info["messages"] < 31
    assert info["end"]["why"] == f"is cut off at byte {size}" and 0 < info["end"]["byte"] < size
    assert "no: topics.mcap is cut off at byte" in info_text(info)


def test_parts_of_a_recording_are_counted_together(record):
    path = record(MESSAGES[:11], closed=False)
    record(MESSAGES, name="topics.1.mcap", skip=bag_info(path)["messages"])
    info = bag_info(path.parent)
    assert [part["closed"] for part in info["parts"]] == [False, True]
    assert (info["closed"], info["messages"]) == (True, 31)
    assert "topics.1.mcap" in info_text(info)


def test_hostile_texts_of_a_recording_are_shown_harmlessly(record):
    info = bag_info(record(MESSAGES, publisher="\x1b[31mred", about={"graph": "\x1b"}))
    assert info["nodes"] == [] and "nodes      not known" in info_text(info)
    assert "\x1b" not in info_text(info)
    assert info["topics"][0]["publisher"] == r"'\x1b[31mred'"


def random_text(number: int) -> str:
    draw = random.Random(number)
    return "".join(draw.choices("abcdefghijklmnopqrstuvwxyz ", k=60))


RANDOM = [
    ("/world", replace(WORLD, seed=i)) if i % 10 == 0 else ("/log", log(0.1 * i, random_text(i)))
    for i in range(100)
]


@pytest.fixture
def whole(record):
    """Bytes of a closed recording of 20 kB."""
    return record(RANDOM).read_bytes()


def counts_before(whole: bytes) -> list[int]:
    """Messages in whole chunks before each byte, by the stock reader."""
    grown = [0] * (len(whole) + 1)
    with BytesIO(whole) as file:
        for index in make_reader(file).get_summary().chunk_indexes:
            end = index.chunk_start_offset + index.chunk_length
            chunk = Chunk.read(ReadDataStream(BytesIO(whole[index.chunk_start_offset + 9 : end])))
            grown[end] = sum(isinstance(one, Message) for one in breakup_chunk(chunk))
    return list(accumulate(grown))


def kept(path):
    return list(open_recording(path).messages())


def stock_counts(path):
    with path.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages()
        return Counter(channel.topic for _, channel, _ in messages)


def test_recovery_of_a_cut_keeps_exactly_its_whole_chunks(whole, tmp_path):
    reference, counts = kept(tmp_path / "topics.mcap"), counts_before(whole)
    assert counts[-1] == 100 and len(set(counts)) > 10
    first = next(end for end, count in enumerate(counts) if count)
    cuts = {first, *random.Random(0).sample(range(first, len(whole)), 15), len(whole)}
    for end in cuts:
        path, out = tmp_path / f"{end}.mcap", tmp_path / f"{end}.recovered.mcap"
        path.write_bytes(whole[:end])
        saved = recover_recording(path)
        assert saved.path == out and open_recording(out).closed
        assert kept(out) == reference[: counts[end]]
        assert stock_counts(out) == saved.counts == Counter(one.topic for one in kept(out))
        assert bool(saved.end.why) is (end < len(whole)) and saved.end.byte <= end
    path = tmp_path / "alone" / "cut.mcap"  # before the first chunk: no file is left
    path.parent.mkdir()
    for end in (0, 5, 8, 40, first // 2, first - 1):
        path.write_bytes(whole[:end])
        with pytest.raises(InputError, match="nothing can be recovered: no message comes before"):
            recover_recording(path)
        assert [*path.parent.iterdir()] == [path]


def test_recovered_copy_holds_all_that_the_recording_says(whole, tmp_path):
    out = recover_recording(tmp_path / "topics.mcap").path
    with out.open("rb") as new, (tmp_path / "topics.mcap").open("rb") as old:
        readers = make_reader(new, validate_crcs=True), make_reader(old, validate_crcs=True)
        header = readers[0].get_header()
        metadata = [{one.name: one.metadata for one in each.iter_metadata()} for each in readers]
        summaries = [each.get_summary() for each in readers]
    assert (header.profile, header.library) == ("palpate", f"palpate {__version__}")
    note = metadata[0].pop("recovered")
    assert note == {"from": "topics.mcap", "to": f"topics.mcap, byte {len(whole)}", "why": ""}
    assert metadata[0] == metadata[1]
    assert summaries[0].schemas == summaries[1].schemas
    assert summaries[0].channels == summaries[1].channels
    assert {one.compression for one in summaries[0].chunk_indexes} == {"lz4"}
    data = out.read_bytes()
    end = data.rindex(struct.pack("<BQ", Opcode.DATA_END, 4))
    assert struct.unpack("<I", data[end + 9 : end + 13]) == (zlib.crc32(data[:end]),)


def test_parts_are_recovered_into_one_file(record, tmp_path):
    path = record(RANDOM[:70], closed=False)
    record(RANDOM, name="topics.1.mcap", skip=len(kept(path)))
    path.write_bytes(path.read_bytes() + b"\6half a chunk")
    saved = recover_recording(tmp_path)  # a run's folder stands for its recording
    assert saved.parts == (path, part_path(path, 1))
    assert saved.path == tmp_path / "topics.recovered.mcap"
    assert [one.seq for one in kept(saved.path) if one.topic == "/world"] == [*range(10)]
    assert stock_counts(saved.path) == {"/world": 10, "/log": 90}
    text = recovered_text(saved)
    assert "100 messages on 2 topics, of 2 files; that is all that there was" in text
    saved.path.unlink()
    record(RANDOM[:70])
    record(RANDOM, name="topics.1.mcap", skip=80)  # lacks messages
    saved = recover_recording(path)
    assert len(kept(saved.path)) == 70 and saved.end.part == part_path(path, 1)
    assert saved.end.why == "is damaged: it lacks /world 7"


def test_log_times_never_decrease_across_parts(record):
    worlds = [("/world", WORLD)] * 3
    path = record(worlds[:1], sent=[50])
    record(worlds, sent=[50, 40, 60], skip=1, name="topics.1.mcap")
    with recover_recording(path).path.open("rb") as file:
        found = [message for _, _, message in make_reader(file).iter_messages()]
    assert [one.log_time for one in found] == [50, 50, 60]
    assert [one.publish_time for one in found] == [50, 40, 60]


def test_recover_command_reports_saved_messages(record, tmp_path, call, refusal):
    out = tmp_path / "new.mcap"
    saved = call("bag recover", record(RANDOM, closed=False), "-o", out).out
    assert saved.endswith("all that there is in topics.mcap, which was never closed\n")
    out.unlink()
    path = record(RANDOM)
    os.truncate(path, 6000)
    code, text, _ = call("bag recover", path, "-o", out)
    pattern = r"\d+ messages on 2 topics; that is up to byte \d+ of topics.mcap, which is cut off"
    assert code == 0 and re.fullmatch(rf"{out}: {pattern} at byte 6000\n", text)
    os.truncate(path, 0)
    why = "nothing can be recovered: no message comes before its end: it is empty"
    assert refusal("bag recover", path) == f"palpate: {path}: {why}\n"


def test_recovery_overwrites_nothing(record, tmp_path):
    path, out = record(RANDOM), tmp_path / "new.mcap"
    out.write_bytes(b"mine")
    (tmp_path / "other.1.mcap").touch()
    for target, words in (
        (out, r"new.mcap: exists already; it is not overwritten"),
        (path, r"topics.mcap: exists already"),
        (tmp_path / "other.mcap", r"other.1.mcap: would be taken for a part of"),
        (tmp_path / "none" / "a.mcap", r"there is no folder .*none"),
    ):
        with pytest.raises(InputError, match=words):
            recover_recording(path, target)
    assert out.read_bytes() == b"mine"


@pytest.mark.parametrize(
    ("encoding", "metadata", "words"),
    [
        ("ros1", {}, "it was not written by palpate: /chatter lacks its run"),
        ("msgpack", {"run": "0", "epoch": "0", "schema_hash": "0"}, "ends before it began"),
    ],
)
def test_recordings_of_other_programs_are_refused(tmp_path, encoding, metadata, words):
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start()
        schema = writer.register_schema("Chatter", "jsonschema", b"{}")
        channel = writer.register_channel("/chatter", encoding, schema, metadata)
        writer.add_message(channel, 0, b"hello", 0)
        writer.finish()
    with pytest.raises(InputError, match=words):
        recover_recording(path)


TYPES = {"/world": "World", "/in": "LogRecord", "/out": "LogRecord"}
A = [
    ("/world", WORLD, 0),
    ("/in", log(1.0), 0),
    ("/out", log(2.0), 0),
    ("/in", log(3.0), 1),
    ("/out", log(4.0), 1),
]
SEED = [("/world", replace(WORLD, seed=4), 0), *A[1:]]
OTHER = [*A[:2], ("/out", log(2.5), 0), ("/in", log(0.0), 1), A[4]]


@pytest.fixture
def differ(tmp_path):
    """What is told of the differences between two recordings, line by line."""

    def do(a, b, *topics, first=None, second=None):
        first_path = write_recording(tmp_path / "a.mcap", a, **{"types": TYPES, **(first or {})})
        other = write_recording(tmp_path / "b.mcap", b, **{"types": TYPES, **(second or {})})
        return diff_text(compare_recordings(first_path, other, topics)).splitlines()

    return do


@pytest.mark.parametrize(
    ("a", "b", "how", "line"),
    [
        (A, A, {"second": {"run": 8, "epoch": 2, "sent": [9, 19, 29, 39, 49]}}, "identical, 5 "),
        (A, [A[1], A[3], A[0], A[2], A[4]], {}, "identical, 5 messages on 3 topics"),
        (A, OTHER, {}, "first difference: /out 0 robot_time: 2.0 in A, 2.5 in B"),
        (A, A[:3], {}, "first difference: /in 1: only in A"),
        (A[:3], A, {}, "first difference: /in 1: only in B"),
        (A[:4], SEED, {}, "first difference: /world 0 seed: 3 in A, 4 in B"),
        (A, A, {"second": {"types": {**TYPES, "/in": "Probe"}}},
         "first difference: /in 0 type: LogRecord in A, Probe in B"),
        (A, A, {"first": {"schema": 1}, "second": {"schema": 2}},
         "first difference: /world 0 schema: 00000001 in A, 00000002 in B"),
        (A, [("/world", b"\x80", 0), *A[1:]], {"first": {"schema": 1}, "second": {"schema": 1}},
         f"first difference: /world 0 bytes: {len(encode(WORLD))} bytes in A, 1 bytes: not a W"),
    ],
)  # fmt: skip
def test_diff_names_the_first_difference(differ, a, b, how, line):
    assert differ(a, b, **how)[0].startswith(line)


def test_diff_counts_by_topic_named_ones_only_and_to_the_end_of_an_unclosed_one(differ, tmp_path):
    assert differ(A, OTHER)[1:] == [
        "topic  compared  differ  only in A  only in B",
        "/in           2       1          0          0",
        "/out          2       1          0          0",
        "identical on 1 of 3 topics",
    ]
    assert differ(A[:3], A)[3].split() == ["/out", "1", "0", "0", "1"]
    assert differ(A, SEED, "/in", "/out") == ["identical, 4 messages on 2 topics"]
    with pytest.raises(ValueError, match="neither recording has a topic '/inn'; did you mean '/in"):
        differ(A, A, "/inn")
    with pytest.raises(ValueError, match=r"b\.mcap is out of order: /in 0 after 1"):
        differ(A, [*A, A[1]])
    late = {"closed": False, "sent": [10**9, 10**10]}
    lines = differ(A, A[:2], second=late)
    assert lines[0] == f"{tmp_path / 'b.mcap'} was never closed: compared up to its end"
    assert lines[1] == "first difference: /out 0: only in A"


def test_diff_command_has_exit_code_of_result(record, call, refusal, tmp_path):
    a = record(A, types=TYPES, name="run/topics.mcap")
    b = record(A[:3], types=TYPES, name="b.mcap")
    assert call("bag diff", a, a.parent) == (0, "identical, 5 messages on 3 topics\n", "")
    code, out, _ = call("bag diff", a, b)
    assert code == 1 and out.startswith("first difference: /in 1: only in A\n")
    code, out, _ = call("bag diff", a, b, "--topics", "/world, /in")
    assert code == 1 and out.endswith("identical on 1 of 2 topics\n")
    assert "none.mcap: the recording does not exist" in refusal("bag diff", a, "none.mcap")


@pytest.mark.parametrize("copied", [True, False])
def test_recording_has_messages_from_before_its_start(graph, call, tmp_path, copied):
    frames = [frame(touch) for touch in range(50)]  # more than come in one answer
    for sent in frames:
        graph.publish("/t", sent, copied=copied)
    graph.publish("/own", Bends(goal=1, curvature=2.0))
    graph.start()
    path = tmp_path / "a.mcap"
    code, out, _ = call("bag record --duration 0.01 -o", path, "--topics", "/t,/own")
    first, last = out.splitlines()
    assert first == f"recording 2 topics of vase into {path}; Ctrl-C ends it"
    assert (code, last) == (0, f"{path}: 51 messages on 2 topics")
    recording = open_recording(path)
    bodies = [sent.body for sent in recording.messages() if sent.topic == "/t"]
    assert bodies == [encode(sent) for sent in frames] and recording.closed
    assert [sent.name for sent in recorded_nodes(recording.graph)] == [sent.name for sent in NODES]
    assert call("bag info", path).code == 0


def test_lost_copies_are_asked_for_and_lost_messages_counted(graph, call, tmp_path):
    for touch in range(3):
        graph.publish("/t", frame(touch))
    for seq in (5, 8):  # the talker does not have the others any more
        graph.copy("/t", seq, frame(seq))
    graph.copy("/t", 9, frame(9), run=1)  # of another run
    graph.start()
    path = tmp_path / "a.mcap"
    code, out, _ = call("bag record --duration 0.5 -o", path, "--topics", "/t")
    assert code == 1 and out.endswith("5 messages on 1 topics; not recorded: 4 of /t\n")
    assert [one.seq for one in open_recording(path).messages()] == [0, 1, 2, 5, 8]


def test_recordings_that_cannot_be_are_refused(graph, refusal, tmp_path):
    (tmp_path / "there").touch()
    for topic, name, words in (
        ("/log", "a", "/log cannot be recorded"),
        ("/node/status", "a", "/node/status cannot be recorded"),
        ("/none", "a", "no node publishes /none"),
        ("/t", "there", "there: exists already; it is not overwritten"),
    ):
        assert words in refusal("bag record -o", tmp_path / name, "--topics", topic)
    assert [one.name for one in tmp_path.iterdir()] == ["there"]


def test_player_publishes_a_recording_under_other_names(record, tmp_path):
    remap = read_remap(["/a:=/b", "/c:=/d"])
    assert remap == {"/a": "/b", "/c": "/d"}
    path = record([("/a", frame(0))])
    entry = player_entry(tmp_path, {"rate": 2.0}, remap)
    assert entry.params == {"path": str(path), "rate": 2.0} and entry.remap == remap
    for wrong in ("/a", "/a:=", ":=/b"):
        with pytest.raises(InputError, match=f"--remap {wrong}: must look like"):
            read_remap([wrong])
