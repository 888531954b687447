from __future__ import annotations

import doctest
from pathlib import Path

PAGE = Path(__file__).parents[4] / "docs" / "planning.md"


def test_the_examples_of_the_page_are_right() -> None:
    outcome = doctest.testfile(str(PAGE), module_relative=False)

    assert outcome.failed == 0
    assert outcome.attempted >= 10
