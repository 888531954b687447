"""Files that are there whole or not at all, several at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path

from palpate.launch.located import InputError

Write = Callable[[Path], object]
"""Writes one file at a path."""


def write_whole(files: Mapping[Path, Write]) -> None:
    """Write files beside their places, and move all there once all are written.

    Parameters
    ----------
    files : map of Path to function
        Each writes at the path that it is given, whose suffix is that of its place.

    Raises
    ------
    InputError
        If a file cannot be written; then none has changed.
    """
    for path in files:
        if path.is_dir():
            raise InputError(f"{path}: cannot be written: it is a folder")
        if not path.parent.is_dir():
            raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")
    parts = {path: path.with_name(f".{os.getpid()}.part.{path.name}") for path in files}
    try:
        for path, write in files.items():
            try:
                write(parts[path])
            except OSError as error:
                raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        for path, part in parts.items():
            part.replace(path)
    finally:
        for part in parts.values():
            part.unlink(missing_ok=True)
