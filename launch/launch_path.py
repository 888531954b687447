"""Where a launch file lies: by path, or by name if it is the one that comes with palpate."""

from __future__ import annotations

from pathlib import Path

from palpate.launch.located import InputError

EXPLORE = Path(__file__).parent / "explore.yaml"
"""The launch file that comes with palpate."""


def find_launch_file(path: Path) -> Path:
    """A launch file given by path, or by name if it is the shipped one.

    Raises
    ------
    InputError
        If there is no such file, or it is neither YAML nor Python.
    """
    if not path.is_file() and str(path) in (EXPLORE.name, EXPLORE.stem):
        return EXPLORE
    if path.suffix not in (".yaml", ".yml", ".py"):
        raise InputError(f"{path}: is no launch file; its name must end in .yaml or .py")
    if not path.is_file():
        raise InputError(f"{path}: the launch file does not exist")
    return path
