"""Where a launch file lies: by path, or by name if it comes with palpate."""

from __future__ import annotations

from pathlib import Path

from palpate.launch.located import InputError

SHIPPED = Path(__file__).parent
"""Where the launch files lie that come with palpate."""
EXPLORE = SHIPPED / "explore.yaml"
"""The one that explores a scene."""


def find_launch_file(path: Path) -> Path:
    """A launch file given by path, or by name if it is a shipped one.

    Raises
    ------
    InputError
        If there is no such file, or it is neither YAML nor Python.
    """
    shipped = SHIPPED / f"{path.name.removesuffix('.yaml')}.yaml"
    if not path.is_file() and path.parent == Path() and shipped.is_file():
        return shipped
    if path.suffix not in (".yaml", ".yml", ".py"):
        raise InputError(f"{path}: is no launch file; its name must end in .yaml or .py")
    if not path.is_file():
        raise InputError(f"{path}: the launch file does not exist")
    return path
