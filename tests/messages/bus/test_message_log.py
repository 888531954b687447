from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from palpate.messages.bus.message_log import (
    GROWN_BYTES,
    WRITTEN_TOGETHER,
    Cause,
    Consumed,
    Journal,
    MessageLog,
    SendTimes,
    SourceProgress,
)
from palpate.messages.codec import Header, pack_frame, split_frame

LARGE = WRITTEN_TOGETHER  # Bytes of a body that is written at once


def frame(seq: int, size: int = 100, topic: str = "/talk") -> bytes:
    return pack_frame(topic, Header(1, 0, seq, seq, 0.0, 5), bytes([seq % 256]) * size)


def test_what_is_within_the_limit_needs_no_file(tmp_path: Path):
    past = MessageLog(tmp_path / "past", ["/talk"])
    for seq in range(10):
        past.add("/talk", frame(seq))
    assert list(past.since("/talk", 7)) == [frame(7), frame(8), frame(9)]
    assert past.counts == {"/talk": 10}
    assert not (tmp_path / "past").exists()


def test_what_is_beyond_the_limit_is_found_in_the_file(tmp_path: Path):
    past = MessageLog(tmp_path / "past", ["/talk"], memory=10_000)
    frames = [frame(seq, 1000) for seq in range(200)]
    for one in frames:
        past.add("/talk", one)
        assert next(past.since("/talk", past.count("/talk") - 1)) == one
    assert list(past.since("/talk", 0)) == frames
    held = sum(map(len, frames)) - (tmp_path / "past").stat().st_size
    assert 0 < held <= 10_000 + WRITTEN_TOGETHER
    past.close()


def test_a_file_of_an_earlier_start_is_begun_anew_by_who_can_publish_it_again(tmp_path: Path):
    for _ in range(2):
        past = MessageLog(tmp_path / "past", ["/talk"], memory=0)
        past.add("/talk", frame(0, LARGE))
        assert list(past.since("/talk", 0)) == [frame(0, LARGE)]
        past.close()
    # One record: its length, that of its cause, of which there is none, and that of the frame.
    assert (tmp_path / "past").stat().st_size == len(frame(0, LARGE)) + 12


def test_what_outlives_its_node_is_not_made_again(tmp_path: Path):
    def never() -> bytes:
        raise AssertionError("it lies in the file")

    path = tmp_path / "past"
    past = MessageLog(path, ["/talk"])
    for seq in range(4):
        past.add("/talk", frame(seq), outlives=seq in (1, 3))
    past.close()
    with path.open("r+b") as file:  # the last of them was cut off by its death
        file.truncate(path.stat().st_size - 1)
    again = MessageLog(path, ["/talk"], epoch=2)
    assert again.counts == {"/talk": 0}
    again.add("/talk", frame(0))
    again.promise("/talk", never)
    again.add("/talk", frame(2))
    again.promise("/talk", lambda: frame(3))
    for _ in range(2):
        found = [split_frame(one) for one in again.since("/talk", 1)]
        assert [header.seq for _, header, _ in found] == [1, 2, 3]
        assert [body[0] for _, _, body in found] == [1, 2, 3]
        assert found[0][1].epoch == found[2][1].epoch == 2
    again.close()
    third = MessageLog(path, ["/talk"], epoch=3)  # what was made at last is there, too
    third.add("/talk", frame(0))
    for _ in range(3):
        third.promise("/talk", never if third.count("/talk") != 2 else lambda: frame(2))
    assert [split_frame(one)[1].seq for one in third.since("/talk", 1)] == [1, 2, 3]
    third.close()


def test_what_is_published_again_is_not_written_again(tmp_path: Path):
    for epoch in range(3):
        past = MessageLog(tmp_path / "past", ["/talk"], memory=0, epoch=epoch)
        for seq in range(5):
            past.add("/talk", frame(seq, LARGE))
        epochs = [split_frame(one)[1].epoch for one in past.since("/talk", 3)]
        size = (tmp_path / "past").stat().st_size
        past.close()
        assert epochs == [epoch, epoch]
        assert size == 5 * (len(frame(0, LARGE)) + 12)


def test_what_nobody_receives_is_only_counted(tmp_path: Path):
    past = MessageLog(tmp_path / "past", [], silent=["/talk"], memory=0)
    for seq in range(9):
        past.add("/talk", frame(seq))
    assert past.counts == {"/talk": 9}
    assert list(past.since("/talk", 0)) == []
    assert not (tmp_path / "past").exists()


def test_what_cannot_be_published_again_outlives_its_node(tmp_path: Path):
    names = {"silent": ["/mute"], "persistent": True}
    past = MessageLog(tmp_path / "past", ["/talk"], memory=250, **names)  # type: ignore[arg-type]
    for seq in range(5):
        past.add("/talk", frame(seq))
        past.add("/mute", frame(seq, topic="/mute"))
    past.close()
    again = MessageLog(tmp_path / "past", ["/talk"], epoch=3, **names)  # type: ignore[arg-type]
    assert again.counts == {"/talk": 5, "/mute": 5}
    headers = [split_frame(one)[1] for one in again.since("/talk", 0)]
    assert [(one.seq, one.epoch) for one in headers] == [(seq, 3) for seq in range(5)]
    again.add("/talk", frame(5))
    assert again.counts["/talk"] == 6
    again.close()


@pytest.mark.parametrize("cut", [1, 4, 30])
def test_a_frame_that_was_cut_off_when_its_node_died_was_never_published(tmp_path: Path, cut: int):
    path = tmp_path / "past"
    past = MessageLog(path, ["/talk"], persistent=True)
    for seq in range(3):
        past.add("/talk", frame(seq))
    past.close()
    path.write_bytes(path.read_bytes()[:-cut])
    again = MessageLog(path, ["/talk"], persistent=True)
    assert again.counts == {"/talk": 2}
    again.add("/talk", frame(2))
    again.close()
    assert MessageLog(path, ["/talk"], persistent=True).counts == {"/talk": 3}


def test_what_was_answered_is_known_with_all_its_answers(tmp_path: Path):
    past = MessageLog(tmp_path / "past", ["/talk", "/more"], persistent=True)
    past.add("/talk", frame(0))
    past.answer([("/talk", frame(1)), ("/more", frame(0, topic="/more"))], Cause("a", "/in", 4))
    past.answer([], Cause("b", "/in", 7, "all done"))
    past.close()
    again = MessageLog(tmp_path / "past", ["/talk", "/more"], persistent=True)
    assert again.handled == {("a", "/in"): 5, ("b", "/in"): 8}
    assert again.finished == "all done"
    assert again.counts == {"/talk": 2, "/more": 1}
    assert list(again.since("/talk", 0)) == [frame(0), frame(1)]


@pytest.mark.parametrize("cut", [1, 60, 200])
def test_of_an_answer_there_is_all_or_nothing(tmp_path: Path, cut: int):
    past = MessageLog(tmp_path / "past", ["/talk"], persistent=True)
    past.add("/talk", frame(0))
    past.answer([("/talk", frame(1)), ("/talk", frame(2))], Cause("a", "/in", 4))
    past.close()
    path = tmp_path / "past"
    path.write_bytes(path.read_bytes()[:-cut])
    again = MessageLog(path, ["/talk"], persistent=True)
    assert (again.handled, again.counts) == ({}, {"/talk": 1})


def test_answers_beyond_the_limit_are_found_in_the_file(tmp_path: Path):
    past = MessageLog(tmp_path / "past", ["/talk"], persistent=True, memory=200)
    for seq in range(0, 10, 2):
        frames = [("/talk", frame(seq)), ("/talk", frame(seq + 1))]
        past.answer(frames, Cause("a", "/in", seq))
    assert list(past.since("/talk", 0)) == [frame(seq) for seq in range(10)]


def test_what_is_promised_is_made_once_and_only_if_somebody_wants_it(tmp_path: Path):
    made = []

    def make() -> bytes:
        made.append(1)
        return frame(1)

    past = MessageLog(tmp_path / "past", ["/talk"], silent=["/mute"])
    past.add("/talk", frame(0))
    past.promise("/talk", make)
    past.promise("/mute", make)
    past.add("/talk", frame(2))
    assert past.counts == {"/talk": 3, "/mute": 1}
    assert list(past.since("/talk", 2)) == [frame(2)] and not made
    assert list(past.since("/talk", 0)) == [frame(0), frame(1), frame(2)]
    assert list(past.since("/talk", 1)) == [frame(1), frame(2)] and made == [1]


def test_an_unknown_topic_is_refused(tmp_path: Path):
    past = MessageLog(tmp_path / "past", ["/talk"])
    with pytest.raises(KeyError, match="/elsewhere"):
        past.count("/elsewhere")


def test_a_tally_goes_on_where_it_was(tmp_path: Path):
    tally = SourceProgress(tmp_path / "tally")
    assert tally.number == 0
    for _ in range(3):
        tally.up()
    tally.close()
    again = SourceProgress(tmp_path / "tally")
    assert again.number == 3
    again.close()


TOPICS = ["/talk", "/more"]


def test_times_outlive_their_node(tmp_path: Path):
    first = SendTimes(tmp_path / "times", "talker", TOPICS)
    assert first.before("/talk", 0) is None
    first.note("/talk", 5)
    first.note("/more", 6)
    first.note("/talk", 1 << 60)
    first.close()
    again = SendTimes(tmp_path / "times", "talker", TOPICS)
    again.close()
    published = [again.before(topic, seq) for topic in TOPICS for seq in range(2)]
    assert (published, again.before("/talk", 2)) == ([5, 1 << 60, 6, None], None)


def test_what_is_published_again_keeps_its_time_and_the_new_is_later(bench: Any, tmp_path: Path):
    headers = []
    for epoch in range(2):
        times = SendTimes(tmp_path / "published", "talker", TOPICS)
        talker = bench.publisher(f"talker_{epoch}", epoch=epoch, times=times, again=epoch > 0)
        frames = [
            talker.send(topic, b"", robot_time=0.0, schema=5)
            for topic in ("/talk", "/more", "/talk", *(["/more"] if epoch else []))
        ]
        headers.append([split_frame(frame)[1] for frame in frames])
    first, again = headers
    assert [one._replace(epoch=1) for one in first] == again[:3]
    assert again[3].sent_ns > again[2].sent_ns


@pytest.mark.parametrize("latest", [0, 1 << 62])
def test_who_goes_on_with_what_was_kept_speaks_later_than_that(
    latest: int, bench: Any, tmp_path: Path
):
    kept = MessageLog(tmp_path / "past", TOPICS, persistent=True)
    kept.add("/talk", pack_frame("/talk", Header(1, 0, 0, latest, 0.0, 5), b""))
    kept.close()
    past = MessageLog(tmp_path / "past", TOPICS, persistent=True, epoch=1)
    talker = bench.publisher(past=past)
    frame = talker.send("/talk", b"", robot_time=0.0, schema=5)
    past.close()
    assert split_frame(frame)[1].sent_ns > latest


EDGES = [("a", "/one"), ("b", "/two")]


def test_what_was_put_down_is_there_at_the_next_start_in_its_order(tmp_path: Path):
    first = Journal(tmp_path / "j", EDGES)
    assert first.before == ()
    first.note("b", "/two", 0)
    first.note("a", "/one", 0)
    first.note("b", "/two", 1 << 40)
    second = Journal(tmp_path / "j", EDGES)
    assert second.before == (
        Consumed("b", "/two", 0),
        Consumed("a", "/one", 0),
        Consumed("b", "/two", 1 << 40),
    )
    second.note("a", "/one", 1)
    assert Journal(tmp_path / "j", EDGES).before[3:] == (Consumed("a", "/one", 1),)


@pytest.mark.parametrize("left", range(16, 32))
def test_an_entry_that_was_cut_off_is_written_anew(tmp_path: Path, left: int):
    path = tmp_path / "j"
    first = Journal(path, EDGES)
    first.note("a", "/one", 0)
    first.note("b", "/two", 5)
    whole = path.read_bytes()
    first.close()
    # The file was not grown to the end, or the second word was not written.
    for cut in (whole[:left], whole[:24] + bytes(len(whole) - 24)):
        path.write_bytes(cut)
        second = Journal(path, EDGES)
        assert second.before == (Consumed("a", "/one", 0),)
        second.note("b", "/two", 7)
        second.close()
        assert Journal(path, EDGES).before[1:] == (Consumed("b", "/two", 7),)


def test_a_journal_grows_with_what_is_put_down(tmp_path: Path):
    noted = [(*EDGES[i % 2], i) for i in range(3 * GROWN_BYTES // 16 + 5)]
    for begin, end in ((0, 1000), (1000, 1001), (1001, len(noted))):
        journal = Journal(tmp_path / "j", EDGES)
        assert [*journal.before] == noted[:begin]
        for one in noted[begin:end]:
            journal.note(*one)
        journal.close()
    assert [*Journal(tmp_path / "j", EDGES).before] == noted


def test_what_was_put_down_outlives_who_is_killed(tmp_path: Path):
    program = (
        "import os, pathlib, sys\n"
        "from palpate.messages.bus.message_log import Journal\n"
        "Journal(pathlib.Path(sys.argv[1]), [('a', '/one'), ('b', '/two')]).note('b', '/two', 3)\n"
        "os.kill(os.getpid(), 9)"
    )
    done = subprocess.run([sys.executable, "-c", program, tmp_path / "j"], timeout=60, check=False)
    assert done.returncode == -signal.SIGKILL
    assert Journal(tmp_path / "j", EDGES).before == (Consumed("b", "/two", 3),)


def test_a_journal_of_another_node_is_refused(tmp_path: Path):
    Journal(tmp_path / "j", EDGES).note("b", "/two", 0)
    with pytest.raises(ValueError, match="speaks of input 2, there are 1"):
        Journal(tmp_path / "j", EDGES[:1])


def test_an_entry_for_which_there_is_no_room_is_told_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    journal = Journal(tmp_path / "j", EDGES)
    monkeypatch.setattr(os, "pwrite", lambda file, data, place: len(data) - 1)
    with pytest.raises(OSError, match="journal of what was consumed has no more room"):
        journal.note("a", "/one", 0)
