"""The page of errata: each entry names its test, and what is printed, right and why."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/errata.md").read_text(encoding="utf-8")
ENTRIES = re.findall(r"^- .*?(?=^- |^$|^#|\Z)", PAGE, flags=re.MULTILINE | re.DOTALL)
# A test is a function, or a row of the table that `test_figures` goes through.
TEST = re.compile(r'^(?:def |    ")(test_\w+)(?:\(|":)', re.MULTILINE)


def test_every_entry_names_one_test_and_every_test_is_named():
    files = [
        path for path in Path(__file__).parent.glob("test_*.py") if path.name != "test_page.py"
    ]
    here = [name for path in files for name in TEST.findall(path.read_text(encoding="utf-8"))]
    named = [re.findall(r"`(test_\w+)`", entry) for entry in ENTRIES]
    assert all(len(names) == 1 for names in named)
    assert sorted(names[0] for names in named) == sorted(set(here) - {"test_figures"})
    assert len(here) == len(set(here)) + here.count("test_figures") - 1


def test_every_entry_says_what_is_printed_what_is_right_and_why():
    assert max(map(len, PAGE.splitlines())) <= 120
    assert len(ENTRIES) > 80
    for entry in ENTRIES:
        assert [entry.count(word) for word in ("Print:", "Right:", "Proof:")] == [1, 1, 1], entry
