"""Files read within bounds, kept within their folder, and written whole or not at all.

A file that is read is a plain file of at most so many bytes, because a pipe would be waited for;
one that a scene names lies in the scene's own folder. What is written is first written beside its
place and moved there when it is whole.
"""

from __future__ import annotations

import errno
import os
import shutil
import stat
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from palpate.launch.files.source_map import InputError

MAX_PATH_LENGTH = 255  # Of a path within the folder
FileWriter = Callable[[Path], object]  # Writes one file at a path


def read_bounded(path: Path, most: int, what: str = "") -> bytes:
    """The bytes of a file of at most `most`; `what` is its kind for complaints, ``the mesh ``.

    InputError if it cannot be read, is larger, or is no plain file: a pipe would be waited for.
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


def file_within(folder: Path, name: str, what: str, *, confined: bool = True) -> Path:
    """Path of a file that a scene names, from the scene's own, resolved folder.

    `what` is the scene's key that holds the name; `confined`: whether it must lie in that folder,
    for the scene is from elsewhere. Raises ValueError if the name leads out of the folder, to
    something that is no file, or cannot be a name.
    """
    if not name.isprintable() or len(name) > MAX_PATH_LENGTH:
        raise ValueError(
            f"{what} is {name[:40]!r}; a name has at most {MAX_PATH_LENGTH} letters "
            "that can be seen"
        )
    try:
        path = (folder / name).resolve()
        other = path.exists() and not path.is_file()
    except (OSError, RuntimeError):  # a loop of links, or a part that is too long
        raise ValueError(f"{what} is {name!r}; it leads nowhere") from None
    # A scene from elsewhere must not have other files of the machine read.
    if confined and (Path(name).is_absolute() or not path.is_relative_to(folder)):
        raise ValueError(f"{what} is {name!r}; it must lie in the scene's own folder")
    if other:
        raise ValueError(f"{what} is {name!r}, which is no file")
    return path


def plain_name(name: str) -> str:
    """A name for what is made of a file: characters that cannot be seen, or written, are ``_``."""
    return "".join(one if one.isprintable() else "_" for one in name)


def write_atomically(files: Mapping[Path, FileWriter]) -> None:
    """Write files beside their places, and move all there once all are written.

    Each function writes at the path that it is given, whose suffix is that of its place. Raises
    InputError if a file cannot be written; then none has changed.
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


def write_or_print(path: Path, text: str) -> None:
    """Write a text whole, ``-`` to standard output; raises InputError if it cannot be."""
    if str(path) == "-":
        sys.stdout.write(text)
    else:
        write_atomically({path: lambda part: part.write_text(text, encoding="utf-8")})


def write_new(path: Path, write: Callable[[Path], object]) -> None:
    """Make a file or a folder beside its place, and move it there once it is whole.

    Raises InputError if there is something already, or it cannot be written; then nothing is left.
    """
    check_new(path)
    part = path.with_name(f".{os.getpid()}.part.{path.name}")
    try:
        write(part)
        _move_into_place(part, path)
    except FileExistsError:
        raise InputError(_exists_text(path)) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        if part.is_dir():
            shutil.rmtree(part, ignore_errors=True)
        else:
            part.unlink(missing_ok=True)


def _move_into_place(part: Path, path: Path) -> None:
    """Move what is written to its place, unless something has come there meanwhile."""
    if part.is_file():
        try:
            os.link(part, path)
            return
        except OSError as error:  # a file system without links
            if error.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS):
                raise
    if os.path.lexists(path):
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
    part.rename(path)


def check_new(path: Path) -> None:
    """Refuse a place where something is already, or where nothing can be."""
    if os.path.lexists(path):
        raise InputError(_exists_text(path))
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")


def _exists_text(path: Path) -> str:
    return f"{path}: exists already; it is not overwritten"
