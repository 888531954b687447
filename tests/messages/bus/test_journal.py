from __future__ import annotations

import os
from pathlib import Path

import pytest

from palpate.messages.bus.journal import Consumed, Journal

EDGES = [("a", "/one"), ("b", "/two")]


def test_what_was_put_down_is_there_at_the_next_start_in_its_order(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("cut", range(1, 12))
def test_an_entry_that_was_cut_off_is_written_anew(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "j"
    first = Journal(path, EDGES)
    first.note("a", "/one", 0)
    first.note("b", "/two", 0)
    path.write_bytes(path.read_bytes()[:-cut])
    second = Journal(path, EDGES)
    assert second.before == (Consumed("a", "/one", 0),)
    second.note("b", "/two", 7)
    assert Journal(path, EDGES).before[1:] == (Consumed("b", "/two", 7),)


def test_a_journal_of_another_node_is_refused(tmp_path: Path) -> None:
    Journal(tmp_path / "j", EDGES).note("b", "/two", 0)
    with pytest.raises(ValueError, match="speaks of input 1, there are 1"):
        Journal(tmp_path / "j", EDGES[:1])


def test_an_entry_for_which_there_is_no_room_is_told_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = Journal(tmp_path / "j", EDGES)
    monkeypatch.setattr(os, "write", lambda file, data: len(data) - 1)
    with pytest.raises(OSError, match="journal of what was consumed has no more room"):
        journal.note("a", "/one", 0)
