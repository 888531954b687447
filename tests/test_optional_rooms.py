"""Optional rooms can be deleted: the rest imports, and what asks for them says what is missing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.test_layering import MODULES, imports

ROOT = Path(__file__).parent.parent
# What is deleted together, and the command line that asks for it.
ROOMS = {
    "procedures": (
        ("core/procedures", "core/cones", "nodes/procedure.py", "palpate/procedures.py"),
        ("run", "sphere", "--procedure", "planar"),
    ),
    # The gallery draws the thesis's figures.
    "thesis": (
        ("core/thesis", "palpate/thesis.py", "tools/gallery"),
        ("rebuild", f"{ROOT}/examples/contours.csv", "--method", "thesis", "--unit", "mm"),
    ),
    "recognition": (("core/recognition", "tools/recognition"), ("recognise", "x")),
    "calibration": (("tools/calibration",), ("calibrate", "vase")),
    "exporters": (("tools/exporters",), ("bag", "export", "x", "--format", "rerun", "-o", "y")),
    "gallery": (("tools/gallery",), ("gallery",)),
    "film": (("tools/film",), ("film", "x", "-o", "x.gif")),
    "hosts": (("launch/hosts", "tools/hosts"), ("host", "192.168.1.5")),
    "sweep": (("tools/sweep",), ("sweep", "x.yaml")),
}


def inside(module: str, paths: tuple[str, ...]) -> bool:
    names = tuple("palpate." + path.removesuffix(".py").replace("/", ".") for path in paths)
    return any(module == name or module.startswith(f"{name}.") for name in names)


@pytest.mark.parametrize("room", ROOMS)
def test_optional_room_is_imported_by_nothing_else(room):
    paths = ROOMS[room][0]
    found = [
        f"{name}:{line} imports {used}"
        for name, path in MODULES.items()
        if not inside(name, paths) and not name.startswith("palpate.bench.")
        for line, used, _ in imports(path.read_text())
        if inside(used, paths)
    ]
    assert found == []


@pytest.fixture
def without(tmp_path):
    """A copy of the tree, and a function that runs Python or palpate there."""
    copy = tmp_path / "copy"
    folders = ("core", "messages", "nodes", "launch", "tools", "bench", "palpate", "src", "scenes")
    for name in folders:
        shutil.copytree(
            ROOT / name, copy / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )

    def call(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(copy / "src")},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    return copy, call


@pytest.mark.slow
@pytest.mark.parametrize("room", ROOMS)
def test_without_an_optional_room_the_rest_works(room, without):
    paths, asking = ROOMS[room]
    copy, call = without
    for path in map(copy.joinpath, paths):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    left = [
        name.removesuffix(".__init__")
        for name in MODULES
        if not inside(name, paths) and ".templates." not in name and ".bench." not in name
    ]
    imported = call("-c", "import " + ", ".join(left))
    assert imported.returncode == 0, imported.stderr[-500:]
    help_text = call("-m", "palpate", "--help")
    assert help_text.returncode == 0
    assert asking[0] in ("run", "bag", "rebuild") or f"  {asking[0]} " not in help_text.stdout
    asked = call("-m", "palpate", *asking)
    assert asked.returncode == 2
    assert len(asked.stderr.strip().splitlines()) == 1, asked.stderr
