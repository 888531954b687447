from __future__ import annotations

import doctest
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parent.parent / "docs"


@pytest.mark.parametrize(
    ("page", "least"),
    [
        ("shapes.md", 25),
        ("rebuild.md", 7),
        ("rebuild_command.md", 12),
        ("lattice.md", 15),
        ("cost.md", 3),
    ],
)
def test_the_examples_of_the_page_are_right(page: str, least: int) -> None:
    outcome = doctest.testfile(str(DOCS / page), module_relative=False)

    assert outcome.failed == 0
    assert outcome.attempted >= least


ROOT = DOCS.parent
PAGES = [*DOCS.glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
FILES = tuple(f"/{path.relative_to(ROOT)}" for path in ROOT.glob("[!.]*/**/*.*"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_files_that_a_page_names_exist(page: Path) -> None:
    assert missing(page.read_text()) == []


def test_a_file_that_does_not_exist_is_noticed() -> None:
    assert missing("see `core/poses.py` and `loft/nothing.py`") == ["loft/nothing.py"]


def missing(text: str) -> list[str]:
    """The files of the repository, whole or from some folder on, that a text names in vain."""
    named = re.findall(r"`(\w[\w/]*/\w+\.(?:py|yaml|json))`", text)
    return [name for name in named if not any(file.endswith(f"/{name}") for file in FILES)]
