from __future__ import annotations

import doctest
import re
import shlex
from pathlib import Path

import click
import pytest

from palpate.tools.cli.command_line import palpate_group

DOCS = Path(__file__).parent.parent / "docs"


# Least number of examples of a page.
EXAMPLES = {"shapes": 25, "rebuild": 7, "rebuild_command": 12, "lattice": 15, "cost": 3}
EXAMPLES |= {"planning": 10, "general": 10}
SLOW = {"general"}


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=[pytest.mark.slow] * (page in SLOW)) for page in EXAMPLES]
)
def test_the_examples_of_the_page_are_right(page: str) -> None:
    outcome = doctest.testfile(str(DOCS / f"{page}.md"), module_relative=False)

    assert outcome.failed == 0
    assert outcome.attempted >= EXAMPLES[page]


ROOT = DOCS.parent
PAGES = [*DOCS.glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
FILES = tuple(f"/{path.relative_to(ROOT)}" for path in ROOT.glob("[!.]*/**/*.*"))


def missing(text: str) -> list[str]:
    """The files of the repository, whole or from some folder on, that a text names in vain."""
    named = re.findall(r"`(\w[\w/]*/\w+\.(?:py|yaml|json))`", text)
    return [name for name in named if not any(file.endswith(f"/{name}") for file in FILES)]


# Of all pages together, those excepted that list every message, erratum and figure.
MOST_WORDS = 24_800
REFERENCE = ("messages.md", "errata.md", "gallery.md")


def test_the_pages_are_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 90
    pages = [
        ROOT / "README.md",
        *(page for page in DOCS.glob("*.md") if page.name not in REFERENCE),
    ]
    assert sum(len(page.read_text().split()) for page in pages) <= MOST_WORDS


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_a_page_names_or_links_to_is_there(page: Path) -> None:
    assert missing(page.read_text()) == []
    assert missing("see `core/poses.py` and `loft/nothing.py`") == ["loft/nothing.py"]
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        if "://" in link or name.startswith("reference/"):  # made when the site is built
            continue
        if not target.exists() or (anchor and anchor not in anchors(target.read_text())):
            broken.append(link)
    assert broken == []


def anchors(text: str) -> set[str]:
    """The names under which the headings of a page can be linked to."""
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", one.lower()).strip().replace(" ", "-") for one in headings}


def test_every_page_is_in_the_navigation_and_in_the_index():
    navigation = set(re.findall(r"- (\w+\.md)", (ROOT / "mkdocs.yml").read_text()))
    names = {page.name for page in DOCS.glob("*.md")}
    assert navigation == names
    linked = set(re.findall(r"\]\((\w+\.md)", (DOCS / "index.md").read_text()))
    assert names - linked == {"index.md"}


def blocks(page: Path, language: str) -> list[str]:
    """The blocks of code of one language on a page."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


def commands(page: Path) -> list[list[str]]:
    """The words of every command of palpate in the shell's blocks of a page."""
    text = "".join(blocks(page, "sh")).replace("\\\n", "")
    text = re.sub(r"<<'(\w+)'\n.*?^\1$", "", text, flags=re.DOTALL | re.MULTILINE)
    lines = [re.split(r"\s(?:>|&&|\|\|?)\s", line)[0] for line in text.splitlines()]
    found = [re.match(r"(?:palpate|\./go) (.+)", line) for line in lines]
    return [shlex.split(one[1], comments=True) for one in found if one]


def parse(words: list[str]) -> click.Context:
    """What the command line makes of the words, up to the verb's own work."""
    command: click.Command = palpate_group
    context, name = None, "palpate"
    while isinstance(command, click.Group):
        context = command.make_context(name, list(words), parent=context)
        resolved, command, words = command.resolve_command(
            context, [*context._protected_args, *context.args]
        )
        assert resolved is not None
        assert command is not None
        name = resolved
    return command.make_context(name, list(words), parent=context)


COMMANDS = [
    (page.name, words)
    for page in (ROOT / "README.md", *sorted(DOCS.glob("*.md")))
    for words in commands(page)
    if not words[0].startswith("--")
]


@pytest.mark.parametrize(("page", "words"), COMMANDS, ids=lambda one: str(one))
def test_the_command_line_understands_every_command_of_the_pages(
    page: str, words: list[str]
) -> None:
    parse(words)


def test_commands_that_do_not_exist_are_noticed():
    assert {"README.md", "tutorial.md"} <= {page for page, _ in COMMANDS}
    for words in (["ruin", "vase"], ["run", "vase", "--tolerence", "1mm"], ["run", "a", "b"]):
        with pytest.raises(click.UsageError):
            parse(words)
