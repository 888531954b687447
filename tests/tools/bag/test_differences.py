from dataclasses import replace

import pytest

from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.world import World
from palpate.tools.bag.contents import compare_recordings, diff_text
from palpate.tools.cli import command_line as cli

Said = tuple[str, int, object]  # Topic, sequence, and the message or its body
TYPES = {"/world": "World", "/in": "LogRecord", "/out": "LogRecord"}
WORLD = World(platform=0.0, reach=1.0, fingers=1, seed=3)


def log(value):
    return LogRecord(node="x", level="info", text="", robot_time=value)


PUBLISHED: list[Said] = [
    ("/world", 0, WORLD),
    ("/in", 0, log(1.0)),
    ("/out", 0, log(2.0)),
    ("/in", 1, log(3.0)),
    ("/out", 1, log(4.0)),
]


@pytest.fixture
def record(tmp_path):
    """Writes what was published into a recording, in the order of sending."""

    def write(name, published, *, start=0, epoch=0, types=TYPES, schema=0):
        path = tmp_path / name
        writer = RecordingWriter(path, types, {}, {})
        for place, (topic, seq, message) in enumerate(published):
            body = message if isinstance(message, bytes) else encode(message)
            number = schema or schema_hash(LogRecord)
            writer.write(topic, Header(start, epoch, seq, start + place, 0.0, number), body)
        writer.close()
        return path

    return write


def text_of(a, b, *topics):
    return diff_text(compare_recordings(a, b, topics))


def test_the_same_published_at_another_time_in_another_run_is_identical(record):
    a, b = record("a.mcap", PUBLISHED), record("b.mcap", PUBLISHED, start=10**9, epoch=2)
    assert text_of(a, b) == "identical, 5 messages on 3 topics"


def test_the_order_of_different_topics_does_not_matter(record):
    turned = [PUBLISHED[1], PUBLISHED[3], PUBLISHED[0], PUBLISHED[2], PUBLISHED[4]]
    assert compare_recordings(record("a.mcap", PUBLISHED), record("b.mcap", turned)).first == ""


def test_the_first_difference_is_the_first_that_a_sent(record):
    other = [*PUBLISHED[:2], ("/out", 0, log(2.5)), ("/in", 1, log(0.0)), PUBLISHED[4]]
    a, b = record("a.mcap", PUBLISHED), record("b.mcap", other)
    assert text_of(a, b).splitlines() == [
        "first difference: /out 0 robot_time: 2.0 in A, 2.5 in B",
        "topic  compared  differ  only in A  only in B",
        "/in           2       1          0          0",
        "/out          2       1          0          0",
        "identical on 1 of 3 topics",
    ]


def test_what_one_lacks_is_named_and_counted(record):
    a, b = record("a.mcap", PUBLISHED), record("b.mcap", PUBLISHED[:3])
    assert text_of(a, b).splitlines()[0] == "first difference: /in 1: only in A"
    assert text_of(b, a).splitlines()[0] == "first difference: /in 1: only in B"
    counts = compare_recordings(b, a).topics["/out"]
    assert (counts.compared, counts.differ, counts.only_a, counts.only_b) == (1, 0, 0, 1)


def test_what_only_b_has_comes_after_all_that_differs_in_a(record):
    other = [("/world", 0, replace(WORLD, seed=4)), *PUBLISHED[1:]]
    found = compare_recordings(record("a.mcap", PUBLISHED[:4]), record("b.mcap", other))
    assert found.first == "/world 0 seed: 3 in A, 4 in B"


def test_only_the_topics_that_are_named_are_compared(record):
    other = [("/world", 0, replace(WORLD, seed=4)), *PUBLISHED[1:]]
    a, b = record("a.mcap", PUBLISHED), record("b.mcap", other)
    assert text_of(a, b, "/in", "/out") == "identical, 4 messages on 2 topics"
    assert compare_recordings(a, b, ["/world"]).first


def test_a_topic_of_neither_is_refused(record):
    a, b = record("a.mcap", PUBLISHED), record("b.mcap", PUBLISHED)
    with pytest.raises(ValueError, match="neither recording has a topic '/inn'; did you mean '/in"):
        compare_recordings(a, b, ["/inn"])


def test_messages_of_different_types_differ_in_their_type(record):
    other = record("b.mcap", PUBLISHED, types={**TYPES, "/in": "Probe"})
    found = compare_recordings(record("a.mcap", PUBLISHED), other)
    assert found.first == "/in 0 type: LogRecord in A, Probe in B"


def test_messages_of_different_versions_differ_in_their_schema(record):
    found = compare_recordings(
        record("a.mcap", PUBLISHED, schema=1), record("b.mcap", PUBLISHED, schema=2)
    )
    assert found.first == "/world 0 schema: 00000001 in A, 00000002 in B"


def test_a_body_that_is_no_message_is_compared_by_its_bytes(record):
    found = compare_recordings(
        record("a.mcap", PUBLISHED), record("b.mcap", [("/world", 0, b"\x80"), *PUBLISHED[1:]])
    )
    size = len(encode(WORLD))
    assert found.first.startswith(f"/world 0 bytes: {size} bytes in A, 1 bytes: not a World")


def test_a_recording_that_has_a_message_twice_is_refused(record):
    a, b = record("a.mcap", PUBLISHED), record("b.mcap", [*PUBLISHED, PUBLISHED[1]])
    with pytest.raises(ValueError, match=r"b\.mcap is out of order: /in 0 after 1"):
        compare_recordings(a, b)


def test_a_recording_that_was_never_closed_is_compared_as_far_as_it_goes(tmp_path, record):
    path = tmp_path / "open.mcap"
    writer = RecordingWriter(path, TYPES, {}, {})
    sent = 10**9  # late enough to be written at once
    writer.write("/world", Header(1, 0, 0, sent, 0.0, schema_hash(LogRecord)), encode(WORLD))
    lines = text_of(record("a.mcap", PUBLISHED), path).splitlines()
    writer.close()
    assert lines[0] == f"{path} was never closed: comparing as far as it goes"
    assert lines[1] == "first difference: /in 0: only in A"


def test_the_folders_of_runs_stand_for_their_recordings(record, tmp_path):
    (tmp_path / "one").mkdir()
    record("one/topics.mcap", PUBLISHED)
    assert compare_recordings(tmp_path / "one", record("b.mcap", PUBLISHED)).first == ""


def test_the_verb_tells_by_its_exit_code_whether_they_are_identical(record, capsys):
    a, b = str(record("a.mcap", PUBLISHED)), str(record("b.mcap", PUBLISHED[:3]))
    assert cli.run(["bag", "diff", a, a]) == 0
    assert capsys.readouterr().out == "identical, 5 messages on 3 topics\n"
    assert cli.run(["bag", "diff", a, b]) == 1
    assert capsys.readouterr().out.startswith("first difference: /in 1: only in A\n")
    assert cli.run(["bag", "diff", a, b, "--topics", "/world, /in"]) == 1
    assert capsys.readouterr().out.endswith("identical on 1 of 2 topics\n")
    assert cli.run(["bag", "diff", a, "none.mcap"]) == 2
    assert "none.mcap: the recording does not exist" in capsys.readouterr().err
