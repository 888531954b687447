"""The recording that a user means."""

from __future__ import annotations

from pathlib import Path

from palpate.launch.located import InputError
from palpate.launch.run_dir import RECORDING


def find_bag(path: Path) -> Path:
    """The recording's first file; `path` is that, or a run directory.

    Raises
    ------
    InputError
        If there is none.
    """
    bag = path / RECORDING if path.is_dir() else path
    if bag.is_file():
        return bag
    if path.is_dir():
        raise InputError(f"{path}: holds no recording: there is no {RECORDING} in it")
    why = "is no file" if path.exists() else "does not exist"
    raise InputError(f"{path}: the recording {why}")
