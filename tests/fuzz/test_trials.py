from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from palpate.launch.files.source_map import InputError
from palpate.messages.fields import CodecError
from tests.fuzz import trials
from tests.fuzz.trials import (
    COUNTS,
    INPUT_KINDS,
    QUICK,
    InputKind,
    Tally,
    reproduce,
    tally,
    tally_rows,
    try_input,
)


def test_every_kind_is_counted_fully_and_quickly():
    assert set(COUNTS) == set(QUICK) == set(INPUT_KINDS)
    assert all(QUICK[name] < COUNTS[name] for name in QUICK)


def test_what_holds_is_told_in_four_rows():
    rows = list(tally_rows("meshes", 2000, Tally(200, 1800, [], 0.25, 7, 12.4, 8)))
    assert all(row.holds for row in rows)
    assert [row.value for row in rows] == ["200, 1800", "0", "250 ms", "12 MB"]
    assert rows[0].name == "2,000 damaged meshes: accepted, refused"


@pytest.mark.parametrize(
    ("found", "missed"),
    [
        (Tally(1, 1, ["meshes 3: KeyError: 'x'"]), "damaged meshes: other errors"),
        (Tally(1, 1, [], 1.01), "damaged meshes: slowest"),
        (Tally(1, 1, [], 0.1, 2, 64.1), "damaged meshes: memory"),
    ],
)
def test_each_missed_demand_is_named(found, missed):
    rows = list(tally_rows("meshes", 2, found))
    assert [row.name for row in rows if not row.holds] == [missed]


def test_a_defect_is_told_with_its_number():
    defects = [f"meshes {i}: KeyError: 'x'" for i in range(9)]
    rows = list(tally_rows("meshes", 20, Tally(1, 1, defects)))
    assert [row.name for row in rows if row.name.startswith("  ")] == [
        f"  {one}" for one in defects[:5]
    ]


def kind(attempt: Callable[[], None], refusal: type[Exception] = ValueError) -> InputKind:
    return InputKind("x", lambda _: None, lambda *_: attempt(), refusal)


def raising(error: Exception, cause: Exception | None = None) -> Callable[[], None]:
    def attempt() -> None:
        try:
            if cause is not None:
                raise cause
        finally:
            raise error

    return attempt


@pytest.mark.parametrize(
    ("error", "refusal"),
    [
        (ValueError("a word is a map"), ValueError),
        (CodecError("not a World"), ValueError),
        (InputError("a.ply: is empty"), InputError),
    ],
)
def test_the_one_error_and_its_own_children_are_refusals(error, refusal, tmp_path):
    assert try_input(kind(raising(error), refusal), 1, tmp_path)[:2] == ("refused", str(error))


@pytest.mark.parametrize(
    ("error", "cause", "words"),
    [
        (KeyError("a"), None, "KeyError: 'a'"),
        (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "bad"), None, "UnicodeDecodeError: "),
        (OverflowError("far"), None, "OverflowError: far"),
        (AssertionError("is not finite"), None, "AssertionError: is not finite"),
        (ValueError(""), None, "refused in no sentence, but 0 letters"),
        (ValueError("a\nb"), None, "refused in no sentence"),
        (ValueError("x" * 1001), None, "refused in no sentence, but 1001 letters"),
        (ValueError("no"), MemoryError(), "refused for want of memory: no"),
    ],
)
def test_every_other_error_is_a_defect(error, cause, words, tmp_path):
    outcome = try_input(kind(raising(error, cause)), 1, tmp_path)
    assert outcome.verdict == "defect"
    assert outcome.reason.startswith(words)


def test_what_takes_long_each_time_is_a_defect(tmp_path, monkeypatch):
    monkeypatch.setattr(trials, "MOST_CPU_SECONDS", 0.01)
    tries: list[float] = []

    def slow() -> None:
        end = time.process_time() + 0.02
        tries.append(end)
        while time.process_time() < end:
            pass

    assert try_input(kind(slow), 1, tmp_path).reason == "takes 0.0 s"
    assert len(tries) == 3


def test_what_was_slow_once_is_tried_again(tmp_path, monkeypatch):
    took = iter([5.0, 0.1])
    monkeypatch.setattr(trials, "_took", lambda *_: next(took))
    assert try_input(kind(lambda: None), 1, tmp_path) == ("accepted", "", 0.1)


def test_what_waits_uses_no_processor_and_is_timed_by_the_clock(monkeypatch):
    assert trials._took(time.process_time(), time.monotonic()) < 1.0
    assert trials._took(time.process_time(), time.monotonic() - 11.0) >= 11.0


def test_the_damage_of_a_number_is_always_the_same(tmp_path):
    seen: list[float] = []
    drawn = InputKind("x", lambda _: None, lambda rng, *_: seen.append(rng.random()), ValueError)
    for number in (3, 4, 3):
        try_input(drawn, number, tmp_path)
    assert seen[0] == seen[2] != seen[1]
    assert seen[0] == random.Random("x 3").random()


def test_every_second_file_is_one_made_to_hurt_while_there_are_any(tmp_path, monkeypatch):
    read: list[str] = []
    toys = {
        "hostile_toys": lambda: [("a", b""), ("b", b"")],
        "mutated_toys": lambda rng: ("hurt", b""),
        "read_toys": lambda path: read.append(path.name),
    }
    monkeypatch.setitem(sys.modules, "toys", SimpleNamespace(**toys))
    toy = trials._files("toys", "toys", ValueError)
    for number in range(6):
        toy.attempt(random.Random(number), number, tmp_path)
    assert read == ["a", "hurt", "b", "hurt", "hurt", "hurt"]


def test_one_input_can_be_tried_by_itself():
    outcome = reproduce("meshes", 0)
    assert outcome.verdict == "refused"
    assert "states 2000000000 faces" in outcome.reason


SAMPLES = {
    "messages": range(700),
    "recordings": range(80),
    "meshes": range(150),
    "scenes": range(0, 300, 7),
    "solids": range(60),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_damaged_input_is_refused_in_one_sentence_or_valid(name, tmp_path):
    INPUT_KINDS[name].prepare(tmp_path)
    outcomes = [try_input(INPUT_KINDS[name], number, tmp_path) for number in SAMPLES[name]]
    assert [one.reason for one in outcomes if one.verdict == "defect"] == []
    assert {one.verdict for one in outcomes} == {"accepted", "refused"}


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
def test_a_crash_a_hang_and_every_other_error_are_told_with_their_number(tmp_path, monkeypatch):
    (tmp_path / "faulty_kind.py").write_text(FAULTY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(trials, "HANG_SECONDS", 1.0)
    import faulty_kind

    faulty = InputKind("faulty", faulty_kind.prepare, faulty_kind.attempt, ValueError)
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
def test_damaged_messages_are_counted():
    found = tally(INPUT_KINDS["messages"], 200)
    assert found.accepted + found.refused == 200
    assert found.defects == []
    assert found.accepted > 10
    assert 0.0 < found.slowest < 1.0
    assert found.memory < 64.0
