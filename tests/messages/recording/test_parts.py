from __future__ import annotations

from pathlib import Path

import pytest

from palpate.messages.codec import encode, schema_hash
from palpate.messages.header import Header
from palpate.messages.recording.parts import counts_of, part_path, parts_of
from palpate.messages.recording.reader import open_recording
from palpate.messages.types import World
from palpate.nodes.recorder import SINK, Params

TYPES = {"/world": "World"}
COUNT = 200


def say(writer: object, seqs: range) -> None:
    body = encode(World(platform=0.0, reach=0.3, fingers=1, seed=3))
    for seq in seqs:
        header = Header(7, 0, seq, 1_000_000 * seq, 0.0, schema_hash(World))
        writer.write("/world", header, body)  # type: ignore[attr-defined]


def test_parts_are_numbered_and_found_in_their_order(tmp_path: Path) -> None:
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
def test_a_recorder_that_was_killed_goes_on_and_all_is_there_once(
    tmp_path: Path, keep: float
) -> None:
    path = tmp_path / "topics.mcap"
    params = Params(path=str(path))
    first = SINK.open(params, TYPES)
    say(first, range(COUNT // 2))
    first.close()
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep * len(whole))])

    assert SINK.resume is not None
    second, had = SINK.resume(params, TYPES)
    assert had == counts_of(path)
    say(second, range(had.get("/world", 0), COUNT))
    second.close()

    recording = open_recording(path)
    assert recording.closed and recording.counts == {"/world": COUNT}
    assert [kept.seq for kept in recording.messages()] == list(range(COUNT))


def test_a_recorder_that_died_before_it_had_a_file_begins_one(tmp_path: Path) -> None:
    assert SINK.resume is not None
    writer, had = SINK.resume(Params(path=str(tmp_path / "topics.mcap")), TYPES)
    writer.close()
    assert had == {} and parts_of(tmp_path / "topics.mcap") == (tmp_path / "topics.mcap",)


def in_two_parts(path: Path) -> Path:
    """A recording whose recorder was started again half-way; its second file."""
    params = Params(path=str(path))
    first = SINK.open(params, TYPES)
    say(first, range(COUNT // 2))
    first.close()
    assert SINK.resume is not None
    second, had = SINK.resume(params, TYPES)
    say(second, range(had["/world"], COUNT))
    second.close()
    return part_path(path, 1)


def test_a_last_part_that_is_cut_off_is_still_refused(tmp_path: Path) -> None:
    last = in_two_parts(tmp_path / "topics.mcap")
    last.write_bytes(last.read_bytes()[:-20])
    with pytest.raises(ValueError, match=r"topics\.1\.mcap is cut off"):
        open_recording(tmp_path / "topics.mcap")


def test_a_first_part_that_was_damaged_since_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "topics.mcap"
    in_two_parts(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ValueError, match="damaged: it lacks /world"):
        open_recording(path)


def test_a_recording_does_not_begin_beside_a_further_part_of_another(tmp_path: Path) -> None:
    (tmp_path / "topics.1.mcap").touch()
    with pytest.raises(FileExistsError, match=r"topics\.1\.mcap is there already, of another run"):
        SINK.open(Params(path=str(tmp_path / "topics.mcap")), TYPES)
    assert not (tmp_path / "topics.mcap").exists()
