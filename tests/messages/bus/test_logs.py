"""What outlives a node that is killed: published frames, journal, times, parameters, progress."""

import errno
import os
from pathlib import Path
from typing import Any

import pytest

from palpate.messages import Header, pack_frame, split_frame
from palpate.messages.bus import Cause, Consumed, Journal, MessageLog, ParameterLog, SourceProgress
from tests.messages.cases import file_limit

LARGE = 1 << 16  # Bytes of a body that is written at once
EDGES = [("a", "/one"), ("b", "/two")]


def frame(seq: int, size: int = 100, topic: str = "/talk") -> bytes:
    return pack_frame(topic, Header(1, 0, seq, seq, 0.0, 5), bytes([seq % 256]) * size)


def log(folder: Path, **more: Any) -> MessageLog:
    return MessageLog(folder / "past", ["/talk", "/more"], silent=["/mute"], **more)


def bodies(past: MessageLog, since: int = 0) -> list[int]:
    return [split_frame(one)[2][0] for one in past.since("/talk", since)]


def test_frames_within_memory_need_no_file_and_promised_ones_are_made_if_asked_for(tmp_path: Path):
    past = log(tmp_path)
    for seq in range(10):
        past.add("/talk", frame(seq))
        past.add("/mute", frame(seq, topic="/mute"))
    assert list(past.since("/talk", 7)) == [frame(7), frame(8), frame(9)]
    assert list(past.since("/mute", 0)) == []
    assert past.counts == {"/talk": 10, "/more": 0, "/mute": 10}
    assert (past.count("/talk"), past.count("/mute")) == (10, 10)
    assert not (tmp_path / "past").exists()
    with pytest.raises(KeyError, match="/elsewhere"):
        past.count("/elsewhere")
    made = []

    def make() -> bytes:
        made.append(1)
        return frame(1)

    past = log(tmp_path)
    past.add("/talk", frame(0))
    past.promise("/talk", make)
    past.promise("/mute", make)
    past.add("/talk", frame(2))
    assert past.counts == {"/talk": 3, "/more": 0, "/mute": 1}
    assert list(past.since("/talk", 2)) == [frame(2)] and not made
    assert list(past.since("/talk", 0)) == [frame(0), frame(1), frame(2)]
    assert list(past.since("/talk", 1)) == [frame(1), frame(2)] and made == [1]
    past.close()


@pytest.mark.parametrize("persistent", [False, True])
@pytest.mark.parametrize("size", [1000, LARGE])
def test_frames_beyond_memory_are_found_in_the_file(tmp_path: Path, size: int, persistent: bool):
    past = log(tmp_path, max_memory=10_000, persistent=persistent)
    frames = [frame(seq, size) for seq in range(100)]
    for seq, added in enumerate(frames):
        past.add("/talk", added)
        assert next(past.since("/talk", seq)) == added
    assert list(past.since("/talk", 0)) == frames
    held = sum(map(len, frames)) - (tmp_path / "past").stat().st_size
    assert held <= 10_000 + LARGE
    past.close()


def test_file_holds_each_frame_once_across_starts(tmp_path: Path):
    for epoch in (0, 0, 1, 2):  # the second start takes the first for that of another run
        past = log(tmp_path, max_memory=0, epoch=epoch)
        for seq in range(5):
            past.add("/talk", frame(seq, LARGE))
        found = [split_frame(one)[1] for one in past.since("/talk", 3)]
        past.close()
        assert [(one.seq, one.epoch) for one in found] == [(3, epoch), (4, epoch)]
        # A record: its length, that of its cause, of which there is none, that of the frame.
        assert (tmp_path / "past").stat().st_size == 5 * (len(frame(0, LARGE)) + 12)


def test_frame_that_outlives_its_node_is_not_made_again(tmp_path: Path):
    def never() -> bytes:
        raise AssertionError("it lies in the file")

    past = log(tmp_path)
    for seq in range(4):
        past.add("/talk", frame(seq), outlives=seq in (1, 3))
    past.add("/mute", frame(0, topic="/mute"), outlives=True)
    past.close()
    path = tmp_path / "past"
    with path.open("r+b") as file:  # the last of them was cut off by its death
        file.truncate(path.stat().st_size - 1)
    for epoch, third in ((2, lambda: frame(3)), (3, never)):  # what was made at last is kept, too
        again = log(tmp_path, epoch=epoch)
        assert again.counts["/talk"] == 0
        again.add("/talk", frame(0))
        again.promise("/talk", never)
        again.add("/talk", frame(2))
        again.promise("/talk", third)
        for _ in range(2):
            headers = [split_frame(one)[1] for one in again.since("/talk", 1)]
            assert [header.seq for header in headers] == [1, 2, 3]
            assert bodies(again, 1) == [1, 2, 3]
            assert headers[0].epoch == headers[2].epoch == epoch
        again.close()


def test_log_cut_anywhere_keeps_whole_records_and_goes_on(tmp_path: Path):
    past, path = log(tmp_path, persistent=True), tmp_path / "past"
    ends = []
    for seq in range(2):
        past.add("/talk", frame(seq))
        ends.append(path.stat().st_size)
    answers = [("/talk", frame(2)), ("/more", frame(0, topic="/more"))]
    past.answer(answers, Cause("a", "/in", 4))
    ends.append(path.stat().st_size)
    past.answer([], Cause("b", "/in", 7, "all done"))
    past.close()
    whole = path.read_bytes()
    for end in range(0, len(whole) + 1, 7):
        path.write_bytes(whole[:end])
        again = log(tmp_path, persistent=True)
        number = sum(end >= one for one in ends)
        assert again.counts == {"/talk": number, "/more": int(number == 3), "/mute": 0}
        # All that answers a message is there, or nothing of it.
        assert again.handled == ({("a", "/in"): 5} if number == 3 else {})
        again.add("/talk", frame(number))
        again.close()
        final = log(tmp_path, persistent=True)
        assert bodies(final) == list(range(number + 1))
        final.close()
    path.write_bytes(whole)
    again = log(tmp_path, persistent=True)
    assert again.handled == {("a", "/in"): 5, ("b", "/in"): 8} and again.finished == "all done"
    assert list(again.since("/talk", 0)) == [frame(seq) for seq in range(3)]
    again.close()


def test_full_disk_is_told_by_log_and_journal(tmp_path: Path):
    past = log(tmp_path, persistent=True)
    past.add("/talk", frame(0))
    size = (tmp_path / "past").stat().st_size
    words = "message log has no more room"
    with file_limit(size + 50), pytest.raises(OSError, match=words) as caught:
        past.add("/talk", frame(1))
    past.close()
    assert caught.value.errno == errno.ENOSPC and log(tmp_path, persistent=True).count("/talk") == 1
    words = "journal of what was consumed has no more room"
    with file_limit(100), pytest.raises(OSError, match=words):
        Journal(tmp_path / "j", EDGES).note("a", "/one", 0)


def test_journal_grows_and_goes_on_in_order(tmp_path: Path):
    noted = [Consumed(*EDGES[i % 2], i << 20) for i in range(3100)]
    for begin, end in ((0, 1000), (1000, 1001), (1001, len(noted))):
        journal = Journal(tmp_path / "j", EDGES)
        assert [*journal.before] == noted[:begin]
        for entry in noted[begin:end]:
            journal.note(*entry)
        journal.close()
        journal.close()
    assert [*Journal(tmp_path / "j", EDGES).before] == noted
    with pytest.raises(ValueError, match="has input 2, there are 1"):
        Journal(tmp_path / "j", EDGES[:1])


@pytest.mark.parametrize("left", range(16, 32, 3))
def test_journal_entry_that_was_cut_off_is_written_anew(tmp_path: Path, left: int):
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


def test_parameters_without_a_cut_line_and_progress_of_a_source_outlive_the_node(tmp_path: Path):
    for end, name in (("c", "j0c"), ("o", "j0o")):
        first = ParameterLog(tmp_path / "j0", end)
        first.note(b"one")
        first.note(b"two")
        first.close()
        file = tmp_path / name
        file.write_bytes(file.read_bytes() + b"thr")
        again = ParameterLog(tmp_path / "j0", end)
        assert again.before == [b"one\n", b"two\n"]
        again.note(b"three")
        again.close()
        assert file.read_bytes() == b"one\ntwo\nthree\n"
    assert sorted(os.listdir(tmp_path)) == ["j0c", "j0o"]
    first = SourceProgress(tmp_path / "tally")
    assert (first.number, first.paused) == (0, None)
    for _ in range(3):
        first.increment()
    first.close()
    for paused in (True, False):
        again = SourceProgress(tmp_path / "tally")
        assert (again.number, again.paused) == (3, None if paused else True)
        again.set_paused(paused)
        again.close()
    assert SourceProgress(tmp_path / "tally").paused is False
