"""A rebuilt solid as one file that holds everything, and back, bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.core.archive import FORM, from_arrays, to_arrays
from palpate.core.rebuild.solid import Solid
from palpate.launch.bounded_file import read_bounded
from palpate.launch.located import InputError
from palpate.launch.npz_file import Arrays, read_npz
from palpate.launch.whole_files import write_whole

SUFFIX = ".npz"
MAX_BYTES = 512 << 20
"""Largest file."""


def save(solid: Solid, path: str | Path) -> None:
    """Write everything that there is to a solid.

    Parameters
    ----------
    solid : Solid
        What `palpate.reconstruct` returned.
    path : str or Path
        A name that ends in ``.npz``. It is replaced as a whole.

    Raises
    ------
    InputError
        If the name ends otherwise, or the file cannot be written.
    TypeError
        If it is no solid.
    """
    if not isinstance(solid, Solid):
        raise TypeError(f"solid must be a Solid, as reconstruct returns it, got {solid!r:.60}")
    path = Path(path)
    if path.suffix != SUFFIX:
        raise InputError(f"{path}: must end in {SUFFIX}, got {path.suffix or 'no suffix'!r}")
    arrays = to_arrays(solid)
    write_whole({path: lambda part: write_arrays(part, arrays)})


def load(path: str | Path) -> Solid:
    """The solid that `save` wrote, or that a run left in its ``model.npz``.

    Parameters
    ----------
    path : str or Path
        The file. It may be from anybody: nothing in it is ever run.

    Raises
    ------
    InputError
        If it cannot be read, or holds no solid, or one of another version.
    """
    path = Path(path)
    arrays = read_arrays(path)
    if FORM not in arrays:
        raise InputError(f"{path}: holds no solid: it was not written by palpate.save")
    try:
        found = from_arrays(arrays)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if not isinstance(found, Solid):
        raise InputError(f"{path}: holds a {type(found).__name__}, not a solid")
    return found


def write_arrays(path: Path, arrays: Arrays) -> None:
    """An NPZ file of arrays, the same bytes for the same arrays."""
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def read_arrays(path: Path) -> Arrays:
    """All arrays of an NPZ file.

    Raises
    ------
    InputError
        If it cannot be read, is too large, or holds objects.
    """
    data = read_bounded(path, MAX_BYTES)
    try:
        return read_npz(data)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
