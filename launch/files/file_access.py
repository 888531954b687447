"""Files: read within bounds, confined to a folder, and written whole or not at all.

Only plain files of limited size are read, since a pipe may never end. A file that an untrusted
scene names must be in the scene's own folder. A file is written under a temporary name beside its
place, and moved when it is complete.
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

MAX_PATH_LENGTH = 255  # of a path within the folder [characters]
FileWriter = Callable[[Path], object]  # writes a file at a path


def read_bounded(path: Path, max_bytes: int, kind: str = "") -> bytes:
    """The bytes of a file; `kind` names it in errors, as ``the mesh ``.

    Raises InputError if it cannot be read, has more than `max_bytes`, or is no plain file.
    """
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise InputError(f"{path}: {kind}cannot be read: it is no plain file")
        with path.open("rb") as file:
            # The file may grow meanwhile; read() reserves as much memory as it is asked for.
            data = file.read(min(os.fstat(file.fileno()).st_size, max_bytes) + 1)
    except OSError as error:
        raise InputError(f"{path}: {kind}cannot be read: {error.strerror}") from None
    except ValueError as error:  # a NUL or half a character in the name
        if isinstance(error, InputError):
            raise
        raise InputError(f"{str(path)!r}: {kind}cannot be read: {error}") from None
    if len(data) > max_bytes:
        size = f"{max_bytes >> 20} MiB" if max_bytes >> 20 else f"{max_bytes >> 10} kB"
        raise InputError(f"{path}: is larger than {size}, the most that is read")
    return data


def file_within(folder: Path, name: str, key: str, *, confined: bool = True) -> Path:
    """Path of a file that a scene names, relative to the scene's resolved folder.

    `key`: the scene's key of the name. `confined`: the file must be in that folder, since the scene
    is from elsewhere. Raises ValueError if the name leads out of the folder, is that of something
    else than a file, or cannot be a name.
    """
    if not name.isprintable() or len(name) > MAX_PATH_LENGTH:
        raise ValueError(
            f"{key} is {name[:40]!r}; a name has at most {MAX_PATH_LENGTH} visible characters"
        )
    try:
        path = (folder / name).resolve()
        is_other = path.exists() and not path.is_file()
    except (OSError, RuntimeError):  # a loop of links, or a part that is too long
        raise ValueError(f"{key} is {name!r}; it leads nowhere") from None
    # A scene from elsewhere must not read other files of the machine.
    if confined and (Path(name).is_absolute() or not path.is_relative_to(folder)):
        raise ValueError(f"{key} is {name!r}; it must lie in the scene's own folder")
    if is_other:
        raise ValueError(f"{key} is {name!r}, which is no file")
    return path


def plain_name(name: str) -> str:
    """A name in which ``_`` replaces invisible characters and ones that cannot be encoded."""
    return "".join(char if char.isprintable() else "_" for char in name)


def write_atomically(files: Mapping[Path, FileWriter]) -> None:
    """Write files under temporary names, and move all of them to their places at the end.

    Each function gets the temporary path, which has the suffix of the place. Raises InputError if a
    file cannot be written; then no file is changed.
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
    """Write a text to a file, or to standard output for ``-``; InputError on failure."""
    if str(path) == "-":
        sys.stdout.write(text)
    else:
        write_atomically({path: lambda part: part.write_text(text, encoding="utf-8")})


def write_new(path: Path, write: Callable[[Path], object]) -> None:
    """Write a new file or folder under a temporary name, and move it to its place at the end.

    Raises InputError if the path exists or cannot be written; then nothing is left behind.
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
    """Move a file or folder to its place; FileExistsError if the place has been taken meanwhile."""
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
    """Raise InputError if a path exists, or its folder does not."""
    if os.path.lexists(path):
        raise InputError(_exists_text(path))
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")


def _exists_text(path: Path) -> str:
    return f"{path}: exists already; it is not overwritten"
