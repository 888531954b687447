"""A tree as one array of bytes, to be sent in a message: an NPZ archive of its arrays."""

from __future__ import annotations

import io
import zipfile

import numpy as np
from numpy.typing import NDArray

from palpate.core.archive import Arrays, to_arrays


def pack(tree: object) -> NDArray[np.uint8]:
    """Bytes (n,) that hold a tree; the same for the same tree.

    Raises
    ------
    ValueError
        As `to_arrays`.
    """
    data = io.BytesIO()
    np.savez(data, allow_pickle=False, **to_arrays(tree))
    return np.frombuffer(data.getvalue(), np.uint8)


def unpack(data: NDArray[np.uint8]) -> Arrays:
    """The arrays in bytes (n,) that `pack` returned, for `from_arrays`.

    Raises
    ------
    ValueError
        If they are no such bytes.
    """
    try:
        with np.load(io.BytesIO(data.tobytes()), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (OSError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise ValueError(f"bytes must be a packed tree, got {data.size}: {error}") from None
