from __future__ import annotations

import sys

import pytest

from palpate.launch.processes.nursery import how_it_ended, no_script


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (-9, "was killed by SIGKILL"),
        (-11, "was killed by SIGSEGV"),
        (3, "ended by itself with exit code 3"),
        (0, "ended by itself with exit code 0"),
    ],
)
def test_an_exit_code_is_put_into_words(code: int, words: str) -> None:
    assert how_it_ended(code) == words


def test_the_script_is_hidden_only_for_a_moment() -> None:
    script = sys.modules["__main__"]
    with no_script():
        assert not hasattr(sys.modules["__main__"], "__file__")
    assert sys.modules["__main__"] is script
