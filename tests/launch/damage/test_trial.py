from __future__ import annotations

import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.launch.damage import trial
from palpate.launch.damage.kinds import KINDS, Kind
from palpate.launch.damage.trial import again, repeat
from palpate.launch.located import InputError
from palpate.messages.fields import CodecError


def kind(attempt: Callable[[], None], refusal: type[Exception] = ValueError) -> Kind:
    return Kind("x", lambda _: None, lambda *_: attempt(), refusal)


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
def test_the_one_error_and_its_own_children_are_refusals(
    error: Exception, refusal: type[Exception], tmp_path: Path
) -> None:
    assert repeat(kind(raising(error), refusal), 1, tmp_path)[:2] == ("refused", str(error))


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
def test_every_other_error_is_a_defect(
    error: Exception, cause: Exception | None, words: str, tmp_path: Path
) -> None:
    outcome = repeat(kind(raising(error, cause)), 1, tmp_path)

    assert outcome.verdict == "defect"
    assert outcome.said.startswith(words)


def test_what_takes_long_each_time_is_a_defect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "SECONDS", 0.01)
    tries: list[float] = []

    def slow() -> None:
        end = time.process_time() + 0.02
        tries.append(end)
        while time.process_time() < end:
            pass

    assert repeat(kind(slow), 1, tmp_path).said == "takes 0.0 s"
    assert len(tries) == 3


def test_what_was_slow_once_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    took = iter([5.0, 0.1])
    monkeypatch.setattr(trial, "_took", lambda *_: next(took))

    assert repeat(kind(lambda: None), 1, tmp_path) == ("accepted", "", 0.1)


def test_what_waits_uses_no_processor_and_is_timed_by_the_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert trial._took(time.process_time(), time.monotonic()) < 1.0
    assert trial._took(time.process_time(), time.monotonic() - 11.0) >= 11.0


def test_the_damage_of_a_number_is_always_the_same(tmp_path: Path) -> None:
    seen: list[float] = []
    drawn = Kind("x", lambda _: None, lambda rng, *_: seen.append(rng.random()), ValueError)
    for number in (3, 4, 3):
        repeat(drawn, number, tmp_path)

    assert seen[0] == seen[2] != seen[1]
    assert seen[0] == random.Random("x 3").random()


def test_one_input_can_be_tried_by_itself() -> None:
    outcome = again("meshes", 0)

    assert outcome.verdict == "refused"
    assert "states 2000000000 faces" in outcome.said


SAMPLES = {
    "messages": range(700),
    "recordings": range(80),
    "meshes": range(150),
    "solids": range(60),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_damaged_input_is_refused_in_one_sentence_or_valid(name: str, tmp_path: Path) -> None:
    KINDS[name].prepare(tmp_path)
    outcomes = [repeat(KINDS[name], number, tmp_path) for number in SAMPLES[name]]

    assert [one.said for one in outcomes if one.verdict == "defect"] == []
    assert {one.verdict for one in outcomes} == {"accepted", "refused"}


def test_damaged_scenes_are_refused_in_one_sentence_or_can_be_explored(tmp_path: Path) -> None:
    scenes = KINDS["scenes"]
    scenes.prepare(tmp_path)
    outcomes = [repeat(scenes, number, tmp_path) for number in range(0, 300, 5)]

    assert [one.said for one in outcomes if one.verdict == "defect"] == []
    assert {one.verdict for one in outcomes} == {"accepted", "refused"}
