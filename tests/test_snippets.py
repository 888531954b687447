"""The Python of README and of the pages for newcomers passes a strict type check, as pasted."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import palpate
from palpate.tools.init import begin

ROOT = Path(__file__).parent.parent
PAGES = ("README.md", "docs/tutorial.md", "docs/own_node.md", "docs/rebuild.md")
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def checked(folder, *names):
    # As if it were installed from a wheel: mypy does not follow what is installed for editing.
    env = {**os.environ, "PYTHONPATH": str(Path(palpate.__file__).parents[1])}
    command = [sys.executable, "-m", "mypy", "--strict", *names]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=300, env=env, check=False
    )


@pytest.mark.slow
def test_the_snippets_of_the_pages_are_typed(tmp_path):
    names = []
    for page in PAGES:
        for number, text in enumerate(PYTHON.findall((ROOT / page).read_text())):
            if ">>>" in text:
                continue
            names.append(f"{Path(page).stem.lower()}_{number}.py")
            (tmp_path / names[-1]).write_text(text)
    assert {"readme_0.py", "tutorial_0.py", "own_node_0.py"} <= set(names)
    begin("node", "bends", tmp_path)
    done = checked(tmp_path, *names)
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_the_check_fails_at_a_name_that_is_not_there(tmp_path):
    (tmp_path / "wrong.py").write_text('import palpate\n\nprint(palpate.explore("vase").solids)\n')
    done = checked(tmp_path, "wrong.py")
    assert done.returncode == 1 and 'has no attribute "solids"' in done.stdout
