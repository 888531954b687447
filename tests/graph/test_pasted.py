"""The commands of the pages, as a reader pastes them."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.launch.processes.registry import running_graphs
from tests.graph.conftest import palpate, wait_for
from tests.test_pages import COMMANDS, DOCS, ROOT, blocks

pytestmark = [pytest.mark.graph, pytest.mark.slow]
# What needs a browser, another terminal, another machine or hours, or is pasted from another page.
ELSEWHERE = re.compile(
    r"(topic|keys|host|bench|bag record|view) |.* --(view|scheduler) |film \S+ -o run.mp4 "
)
OWN_TESTS = ("tutorial.md", "own_node.md", "machines.md")
PASTED: dict[str, list[list[str]]] = {}
for page, words in COMMANDS:
    if page not in OWN_TESTS and not ELSEWHERE.match(" ".join(words) + " "):
        PASTED.setdefault(page, []).append(words)
PASTED["report.md"].insert(0, ["sweep", "two.yaml", "--out", "sweeps/mine"])  # a reader's sweep


@pytest.fixture(scope="module")
def explored(tmp_path_factory):
    """The run of a reader."""
    run = tmp_path_factory.mktemp("reader") / "run"
    words = ("run", "vase", "--tolerance", "1mm", "--composed", "--quiet", "--out", run)
    assert palpate(*words).code == 0
    return run


@pytest.fixture
def checkout(here, explored):
    """A folder with the files that ship, runs, and the files that the pages show."""
    for name in ("scenes", "examples"):
        (here / name).symlink_to(ROOT / name)
    for name in ("first", "one", "other", "a", "b"):
        shutil.copytree(explored, here / "runs" / name)
    (here / "runs" / "latest").symlink_to("first")
    for page, language, name in (
        ("sweep", "yaml", "two.yaml"),
        ("procedures", "python", "poke.py"),
    ):
        (here / name).write_text(blocks(DOCS / f"{page}.md", language)[0])
    return here


@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", PASTED)
def test_commands_of_page_work_as_pasted(page, checkout):
    for words in PASTED[page]:
        done = palpate(*words, folder=checkout)
        # These may end without their tolerance, which is said.
        missed = words[0] in ("run", "sweep", "recognise")
        assert done.code in range(1 + missed), f"{words}\n{done.out}\n{done.err}"


@pytest.fixture
def prompt(here, runtime, monkeypatch):
    """A folder of a user, in which ``palpate`` and ``python`` are those of this checkout."""
    (here / "bin").mkdir()
    program = here / "bin" / "palpate"
    program.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m palpate "$@"\n')
    program.chmod(0o755)
    path = [str(here / "bin"), str(Path(sys.executable).parent), os.environ["PATH"]]
    monkeypatch.setenv("PATH", os.pathsep.join(path))
    return here


def start(block: str) -> subprocess.Popen[str]:
    """What is pasted into a terminal."""
    command = ["python", "-c", block] if block.startswith("import") else ["sh", "-ec", block]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(command, start_new_session=True, **pipes)


def printed(block: str) -> str:
    """What it prints; it must end well."""
    with start(block) as running:
        out, _ = running.communicate(timeout=400)
    assert running.returncode == 0, f"{block}\n{out}"
    return out


def printed_beside(graph: str, block: str) -> str:
    """What a second terminal prints beside a graph that runs slowly, which then is interrupted."""
    with start(graph) as running:
        wait_for(running_graphs)
        out = printed(block)
        os.killpg(running.pid, signal.SIGINT)
        running.communicate(timeout=100)
    return out


@pytest.mark.timeout(900)
def test_tutorial_works_as_pasted(prompt):
    pasted = blocks(DOCS / "tutorial.md", r"(?:sh|python)")
    assert pasted.pop(0).startswith("git clone")
    paced = out = ""
    for block in pasted:
        if "rate: 4" in block:  # a pace for human eyes
            paced = block
            continue
        if block.startswith("palpate topic"):
            assert "curvature: 4" in printed_beside(paced, block)
            block = "sed -i /^rate/d bends.yaml\n" + paced.splitlines()[-1]
        out = printed(block)
    assert "bends: identical, 6 on /bends" in out
    assert (prompt / "tables" / "bends.csv").read_text().count("\n") == 7


def test_python_of_readme_works_as_pasted(prompt):
    [block] = blocks(ROOT / "README.md", "python")
    assert "error bound" in printed(block)
