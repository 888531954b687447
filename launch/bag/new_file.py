"""New files and folders that are there whole or not at all, and overwrite nothing."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path

from palpate.launch.located import InputError


def write_new(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file or a folder beside its place, and move it there once it is whole.

    Parameters
    ----------
    path : Path
        Where it shall be; there must be nothing yet.
    write : function
        Makes the file or the folder at the path that it is given, which has the same suffix.

    Raises
    ------
    InputError
        If there is something already, or it cannot be written; then nothing is left behind.
    """
    check_new(path)
    part = path.with_name(f".{os.getpid()}.part.{path.name}")
    try:
        write(part)
        _move(part, path)
    except FileExistsError:
        raise InputError(_there(path)) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        if part.is_dir():
            shutil.rmtree(part, ignore_errors=True)
        else:
            part.unlink(missing_ok=True)


def check_new(path: Path) -> None:
    """Refuse a place where something is already, or where nothing can be.

    Raises
    ------
    InputError
        In both cases.
    """
    if os.path.lexists(path):
        raise InputError(_there(path))
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")


def _move(part: Path, path: Path) -> None:
    """Move what is written to its place, unless something has come there meanwhile."""
    if part.is_file():
        try:
            os.link(part, path)
            return
        except FileExistsError:
            raise
        except OSError as error:  # a file system without links
            if error.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS):
                raise
    if os.path.lexists(path):
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
    part.rename(path)


def _there(path: Path) -> str:
    return f"{path}: exists already; it is not overwritten"
