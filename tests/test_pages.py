from __future__ import annotations

import doctest
from pathlib import Path

import pytest

DOCS = Path(__file__).parent.parent / "docs"


@pytest.mark.parametrize(
    ("page", "least"),
    [("shapes.md", 25), ("rebuild.md", 7), ("rebuild_command.md", 12), ("lattice.md", 15)],
)
def test_the_examples_of_the_page_are_right(page: str, least: int) -> None:
    outcome = doctest.testfile(str(DOCS / page), module_relative=False)

    assert outcome.failed == 0
    assert outcome.attempted >= least
