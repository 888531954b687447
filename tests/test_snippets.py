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
    # Of a name that is not there the check must complain, and of nothing else.
    (tmp_path / "wrong.py").write_text('import palpate\n\nprint(palpate.explore("vase").solids)\n')
    # As if it were installed from a wheel: mypy does not follow what is installed for editing.
    env = {**os.environ, "PYTHONPATH": str(Path(palpate.__file__).parents[1])}
    command = [sys.executable, "-m", "mypy", "--strict", *names, "wrong.py"]
    how = {"capture_output": True, "text": True, "timeout": 300}
    done = subprocess.run(command, cwd=tmp_path, env=env, check=False, **how)
    [complaint] = [line for line in done.stdout.splitlines() if ": error: " in line]
    assert complaint.startswith("wrong.py:3: ") and 'has no attribute "solids"' in complaint
