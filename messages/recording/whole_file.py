"""A file in which every write is there whole or not at all.

A disk that is full in the middle of a write, and has room again later, would leave a hole that
no reader can cross. Here what a failed write left behind is taken back.
"""

from __future__ import annotations

import os
from pathlib import Path


class WholeFile:
    """A new file, without a buffer of its own.

    Raises
    ------
    FileExistsError
        If there is such a file already: recordings are not overwritten.
    OSError
        If it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._raw = path.open("xb", buffering=0)
        except FileExistsError as error:
            raise FileExistsError(
                error.errno, f"recording {path} exists already; it is not overwritten"
            ) from None
        except OSError as error:
            raise OSError(
                error.errno, f"recording {path} cannot be made: {error.strerror}"
            ) from None
        self._end = 0

    def write(self, data: bytes) -> int:
        """Write all of `data`; on an OSError the file is as it was before."""
        left = memoryview(data)
        try:
            while left:
                left = left[self._raw.write(left) :]
        except OSError:
            self._raw.seek(self._end)
            self._raw.truncate()
            raise
        self._end += len(data)
        return len(data)

    def tell(self) -> int:
        """Bytes written so far."""
        return self._end

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """Close the file."""
        self._raw.close()


def free_bytes(folder: Path) -> int:
    """Bytes that are free for this user where a folder lies."""
    found = os.statvfs(folder)
    return found.f_bavail * found.f_frsize
