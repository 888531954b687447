"""The arrays of an NPZ file, none of which is read before its size is known."""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib

import numpy as np
from numpy.typing import NDArray

FREE = 32 << 20
"""Bytes to which any file may unpack."""
MOST_TIMES = 16
"""Times its own size to which a larger one may: numbers that were measured do not pack better."""
MOST_PARTS = 4096
"""Arrays of a file."""
MOST_NUMBERS = 1 << 40
"""Along an axis."""

Arrays = dict[str, NDArray[np.generic]]

_FAULTS = (
    zipfile.BadZipFile,
    zlib.error,
    tokenize.TokenError,
    EOFError,
    LookupError,
    MemoryError,
    NotImplementedError,
    OSError,
    OverflowError,
    RecursionError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
)
"""What zipfile and numpy raise at files that are not what they say."""


def read_npz(data: bytes) -> Arrays:
    """All arrays of an NPZ file by name.

    Parameters
    ----------
    data : bytes
        The file.

    Raises
    ------
    ValueError
        If it is none, holds objects, or unpacks to far more than it is; the text is the rest of a
        sentence about the file.
    """
    try:
        parts = zipfile.ZipFile(io.BytesIO(data))
    except _FAULTS:
        raise ValueError("is no NPZ file") from None
    with parts:
        _check_sizes(parts.infolist(), len(data))
        return {one.filename.removesuffix(".npy"): _array(parts, one) for one in parts.infolist()}


def _check_sizes(parts: list[zipfile.ZipInfo], size: int) -> None:
    unpacked = sum(part.file_size for part in parts)
    packed = sum(part.compress_size for part in parts)
    if len(parts) > MOST_PARTS:
        raise ValueError(f"holds {len(parts)} arrays; at most {MOST_PARTS} are read")
    if unpacked > max(FREE, MOST_TIMES * size):
        raise ValueError(f"unpacks to {unpacked >> 20} MiB, more than is read of such a file")
    if packed > size:
        raise ValueError("is no NPZ file: its parts overlap")
    if any(part.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for part in parts):
        raise ValueError("is no NPZ file: it is packed in a way that is not read")


def _array(parts: zipfile.ZipFile, part: zipfile.ZipInfo) -> NDArray[np.generic]:
    name = part.filename[:40]
    try:
        content = io.BytesIO(parts.read(part))
        version = np.lib.format.read_magic(content)
        if version == (1, 0):
            header = np.lib.format.read_array_header_1_0(content)
        elif version == (2, 0):
            header = np.lib.format.read_array_header_2_0(content)
        else:
            raise ValueError(f"an array of format {version}")
        shape, _, kind = header
        if kind.hasobject:
            raise ValueError("an array of objects, which are not read")
        stated = math.prod(shape) * kind.itemsize
        held = part.file_size - content.tell()
        if min(shape, default=0) < 0 or max(shape, default=0) > MOST_NUMBERS or stated != held:
            raise ValueError(f"an array that states {stated} bytes, and holds {held}")
        content.seek(0)
        return np.asarray(np.lib.format.read_array(content, allow_pickle=False))
    except _FAULTS as error:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise ValueError(f"is no NPZ file of numbers: {name!r}: {reason}") from None
