from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate.launch.cli import main as cli
from palpate.launch.launch_file import describe

PAGE = (Path(__file__).parents[2] / "docs" / "own_node.md").read_text()
SHELL = [
    line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines()
]
[SNIPPET] = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def reader(here: Path) -> Path:
    """The reader's folder: ten frames of a ball of 20 mm, the last one without contact."""
    side = (np.arange(16) - 7.5) * 1e-3
    x, y = np.meshgrid(side, side)
    depths = [*np.linspace(0.4e-3, 1e-3, 9), 0.0]
    images = [np.maximum(depth - 0.5 * (x**2 + y**2) / 0.02, 0.0) for depth in depths]
    rows = [[0, 0, 0.01 * i, 0, 0, 0, 1, *image.ravel()] for i, image in enumerate(images)]
    np.savetxt("frames.csv", rows, delimiter=",")
    return here


def test_the_page_is_short() -> None:
    assert len(PAGE.splitlines()) <= 60
    assert len([line for line in SNIPPET.splitlines() if line]) <= 10


def test_the_snippet_tells_normals_and_curvatures(
    reader: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    exec(SNIPPET, {})

    *lines, last = capsys.readouterr().out.splitlines()
    assert last == "miss"
    assert len(lines) == 9
    for line in lines:
        found = re.fullmatch(r"k1 (\S+) \+- (\S+), k2 (\S+) \+- (\S+) 1/m, normal \[.+\]", line)
        assert found is not None
        assert found.groups() == ("50.00", "0.00", "50.00", "0.00")


def test_every_command_of_the_page_does_what_it_says(reader: Path) -> None:
    for line in SHELL:
        program, *words = shlex.split(line)
        if program == "python":
            command = [sys.executable, *words, "-p", "no:cacheprovider"]
            done = subprocess.run(command, capture_output=True, text=True, timeout=100)
            assert done.returncode == 0, done.stdout
        elif words[0] == "launch":
            assert cli.run([*words, "--composed", "--quiet", "--out", f"{words[1]}.d"]) == 0, line
        elif words[0] == "topic":
            graph = describe(Path("bends.yaml"), {}, reader).graph
            assert words[2] in graph.topics()
        else:
            assert cli.run(words) == 0, line
    assert len(SHELL) == 8


def test_what_the_table_names_is_there() -> None:
    import palpate.testing

    named = re.findall(r"`([a-z_]+)\(", PAGE)
    assert {*named} == {*palpate.testing.__all__}
