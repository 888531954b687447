import re
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
PAGE = (ROOT / "docs/errata.md").read_text(encoding="utf-8")
ENTRIES = re.findall(r"^- .*?(?=^- |^$|^#|\Z)", PAGE, flags=re.MULTILINE | re.DOTALL)


def tests_here():
    return [
        name
        for path in sorted(HERE.glob("test_*.py"))
        if path.name != Path(__file__).name
        for name in re.findall(r"^def (test_\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]


def test_every_entry_names_one_test_and_every_test_is_named():
    named = [re.findall(r"`(test_\w+)`", entry) for entry in ENTRIES]
    assert all(len(names) == 1 for names in named)
    assert sorted(names[0] for names in named) == sorted(tests_here())


def test_every_entry_says_what_is_printed_what_is_right_and_why():
    assert len(ENTRIES) > 80
    for entry in ENTRIES:
        for word in ("Print:", "Right:", "Proof:"):
            assert entry.count(word) == 1, entry


def test_every_module_that_is_named_exists():
    modules = re.findall(r"`(core/[\w/]+\.py)`", PAGE)
    assert len(modules) > 60
    assert [path for path in modules if not (ROOT / path).is_file()] == []


def test_no_line_is_longer_than_120_characters():
    assert max(map(len, PAGE.splitlines())) <= 120
