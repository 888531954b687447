from __future__ import annotations

import sys
from pathlib import Path

import pytest

from palpate.launch.damage import guarded
from palpate.launch.damage.guarded import tally
from palpate.launch.damage.kinds import KINDS, Kind

FAULTY = """
import os, time

def prepare(folder):
    (folder / "ready").touch()

def attempt(rng, number, folder):
    assert (folder / "ready").exists()
    if number == 2:
        os._exit(9)
    if number == 4:
        time.sleep(60)
    if number == 5:
        raise KeyError("five")
    if number == 6:
        len(bytearray(80_000_000))
    if number % 2:
        raise ValueError("odd")
"""


@pytest.mark.graph
def test_a_crash_a_hang_and_every_other_error_are_told_with_their_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "faulty_kind.py").write_text(FAULTY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(guarded, "HANGS", 1.0)
    import faulty_kind

    faulty = Kind("faulty", faulty_kind.prepare, faulty_kind.attempt, ValueError)
    try:
        found = tally(faulty, 10)
    finally:
        del sys.modules["faulty_kind"]

    assert (found.accepted, found.refused) == (3, 4)
    assert found.defects == [
        "faulty 2: the process crashed",
        "faulty 4: hangs for more than 1 s",
        "faulty 5: KeyError: 'five'",
    ]
    assert found.memory_number == 6
    assert found.memory == pytest.approx(80.0, abs=5.0)  # and what reading the numbers took


@pytest.mark.graph
def test_damaged_messages_are_counted() -> None:
    found = tally(KINDS["messages"], 200)

    assert found.accepted + found.refused == 200
    assert found.defects == []
    assert found.accepted > 10
    assert 0.0 < found.slowest < 1.0
    assert found.memory < 64.0
