"""A file that a scene names: it lies in the scene's own folder, and is a file."""

from __future__ import annotations

from pathlib import Path

MOST_LETTERS = 255
"""Of a path within the folder."""


def file_in(folder: Path, name: str, what: str) -> Path:
    """Path of a file that a scene from elsewhere names.

    Parameters
    ----------
    folder : Path
        The scene's own, resolved.
    name : str
        The path within it.
    what : str
        Key of the scene that holds the name, for complaints.

    Raises
    ------
    ValueError
        If the name leads out of the folder, to something that is no file, or cannot be a name.
    """
    if not name.isprintable() or len(name) > MOST_LETTERS:
        raise ValueError(
            f"{what} is {name[:40]!r}; a name has at most {MOST_LETTERS} letters that can be seen"
        )
    try:
        path = (folder / name).resolve()
        other = path.exists() and not path.is_file()
    except (OSError, RuntimeError):  # a loop of links, or a part that is too long
        raise ValueError(f"{what} is {name!r}; it leads nowhere") from None
    # A scene from elsewhere must not have other files of the machine read.
    if Path(name).is_absolute() or not path.is_relative_to(folder):
        raise ValueError(f"{what} is {name!r}; it must lie in the scene's own folder")
    if other:
        raise ValueError(f"{what} is {name!r}, which is no file")
    return path
