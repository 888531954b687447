from __future__ import annotations

import doctest
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest

from palpate.tools.cli.command_line import palpate_group

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


MOST_WORDS = 25_000  # Of all pages together, those excepted that list every message and erratum
REFERENCE = ("messages.md", "errata.md")


def test_the_readme_is_read_in_a_minute():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 90


def test_the_pages_are_short():
    pages = [
        ROOT / "README.md",
        *(page for page in DOCS.glob("*.md") if page.name not in REFERENCE),
    ]
    assert sum(len(page.read_text().split()) for page in pages) <= MOST_WORDS


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_a_page_links_to_is_there(page: Path) -> None:
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


@pytest.fixture
def at_a_prompt(tmp_path, monkeypatch):
    """A folder of a user's own, in which ``palpate`` and ``python`` are those of this checkout."""
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "palpate"
    program.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m palpate "$@"\n')
    program.chmod(0o755)
    path = [str(tmp_path / "bin"), str(Path(sys.executable).parent), os.environ["PATH"]]
    monkeypatch.setenv("PATH", os.pathsep.join(path))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for name in ("TMPDIR", "XDG_RUNTIME_DIR"):  # Where running graphs are looked for
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def start(block: str) -> subprocess.Popen[str]:
    """What is pasted into a terminal."""
    command = ["python", "-c", block] if block.startswith("import") else ["sh", "-ec", block]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def finish(running: subprocess.Popen[str], block: str) -> str:
    """What it printed; it must end well."""
    printed, _ = running.communicate(timeout=400)
    assert running.returncode == 0, f"{block}\n{printed}"
    return printed


def look(block: str) -> str:
    """What a second terminal prints beside a graph, as soon as there is one."""
    while subprocess.run(["palpate", "topic", "list"], capture_output=True).returncode != 0:
        time.sleep(0.2)
    return finish(start(block), block)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_tutorial_works_as_it_is_pasted(at_a_prompt):
    pasted = [
        block
        for block in blocks(DOCS / "tutorial.md", r"(?:sh|python)")
        if not block.startswith("git clone")
    ]
    printed = {}
    for block, following in zip(pasted, [*pasted[1:], ""], strict=True):
        if block.startswith("palpate topic"):
            continue
        running = start(block)
        if following.startswith("palpate topic"):
            printed[following] = look(following)
        printed[block] = finish(running, block)
    assert set(printed) == set(pasted)
    assert "curvature: 4" in printed[next(one for one in pasted if "topic echo" in one)]
    assert "bends: identical, 6 on /bends" in printed[pasted[-1]]
    assert (at_a_prompt / "tables" / "bends.csv").read_text().count("\n") == 7


# What needs another terminal, another machine or hours; two pages have tests of their own
ELSEWHERE = re.compile(
    r"palpate (topic|keys|host|launch (lab|bends|mine|driver)|bench|run .*--view|.* --scheduler)"
    r"|git clone|python "
)
# Pages that name runs of a reader's own, running graphs or shells.
PARTLY = {"tutorial.md", "own_node.md", "machines.md", "bag.md", "launch.md", "report.md"}
PASTED = sorted({page for page, _ in COMMANDS} - PARTLY)


@pytest.fixture
def in_a_checkout(at_a_prompt):
    """A folder with the files that ship, a run, and those that the pages show."""
    for name in ("scenes", "examples"):
        (at_a_prompt / name).symlink_to(ROOT / name)
    run = ["palpate", "run", "vase", "--tolerance", "1mm", "--composed", "--quiet"]
    subprocess.run(run, check=True, timeout=100)
    for name in ("one", "other"):
        shutil.copytree("runs/latest", f"runs/{name}")
    for page, language, name in (
        ("sweep", "yaml", "two.yaml"),
        ("procedures", "python", "poke.py"),
    ):
        Path(name).write_text(blocks(DOCS / f"{page}.md", language)[0])


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.usefixtures("in_a_checkout")
@pytest.mark.parametrize("name", PASTED)
def test_the_commands_of_a_page_work_as_they_are_pasted(name):
    page = ROOT / name if name == "README.md" else DOCS / name
    for line in "".join(blocks(page, "sh")).replace("\\\n", "").splitlines():
        line = line.replace("./go", "palpate")
        if not line.startswith("palpate ") or ELSEWHERE.match(line):
            continue
        ran = subprocess.run(line, shell=True, capture_output=True, text=True, timeout=300)
        # These may end without their tolerance, which then is said
        missed = line.startswith(("palpate run", "palpate sweep", "palpate recognise"))
        assert ran.returncode in range(1 + missed), f"{line}\n{ran.stdout}\n{ran.stderr}"


@pytest.mark.slow
def test_the_python_of_the_readme_works_as_it_is_pasted(at_a_prompt):
    [block] = blocks(ROOT / "README.md", "python")
    assert "error bound" in finish(start(block), block)
