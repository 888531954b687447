"""A file that is read whole, and not at all if it is too large or no plain file."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from palpate.launch.located import InputError


def read_bounded(path: Path, most: int, what: str = "") -> bytes:
    """The bytes of a file.

    Parameters
    ----------
    path : Path
        The file.
    most : int
        Most bytes that it may have.
    what : str
        What it is, with a blank behind it, for complaints: ``the mesh ``.

    Raises
    ------
    InputError
        If it cannot be read, is larger, or is no plain file: a pipe would be waited for.
    """
    try:
        told = path.stat()
        if not stat.S_ISREG(told.st_mode) and not stat.S_ISDIR(told.st_mode):
            raise InputError(f"{path}: {what}cannot be read: it is no plain file")
        with path.open("rb") as file:
            # It may grow meanwhile; what is asked for takes memory before it is there.
            data = file.read(min(os.fstat(file.fileno()).st_size, most) + 1)
    except OSError as error:
        raise InputError(f"{path}: {what}cannot be read: {error.strerror}") from None
    except ValueError as error:  # a NUL or half a character in the name
        if isinstance(error, InputError):
            raise
        raise InputError(f"{str(path)!r}: {what}cannot be read: {error}") from None
    if len(data) > most:
        size = f"{most >> 20} MiB" if most >> 20 else f"{most >> 10} kB"
        raise InputError(f"{path}: is larger than {size}, the most that is read")
    return data
