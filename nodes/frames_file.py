"""Tactile frames from a file: CSV with a frame a line, or NPZ with arrays of all of them."""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.nodes.frame_row import (
    LEAST,
    MOST,
    POSE,
    FrameRow,
    Shape,
    is_header,
    parse_row,
    unit_pose,
)

MAX_BYTES = 256 << 20
"""Largest file, also when it is unpacked."""
ARRAYS = {"frames": 3, "poses": 2, "times": 1}
"""Arrays of an NPZ file, and their dimensions; the times may be missing."""


class Frames(NamedTuple):
    """Frames of one array, in the order in which they were taken."""

    images: Floats
    """What the taxels sent, (n, rows, cols)."""
    poses: Floats
    """Poses of the pad: x, y, z in m, a quaternion x, y, z, w; its z axis points into the object;
    (n, 7)."""
    times: Floats | None
    """When each was taken, (n,), s; None if the file does not say."""


def read_frames(
    path: str | os.PathLike[str], rows: int | None = None, cols: int | None = None
) -> Frames:
    """The frames of a file.

    Parameters
    ----------
    path : path
        A ``.csv`` with a frame a line: x, y, z, qx, qy, qz, qw and the values row by row, maybe
        with a time before them, maybe under a header. Or an ``.npz`` with ``frames``
        (n, rows, cols), ``poses`` (n, 7) and maybe ``times`` (n,).
    rows, cols : int, optional
        Of the array; needed for a CSV file whose array is not square.

    Raises
    ------
    ValueError
        With file and line, if the file cannot be read, is too large, or a frame is none.
    """
    place = Path(path)
    if place.suffix not in (".csv", ".npz"):
        raise ValueError(f"{place}: is no file of frames; its name must end in .csv or .npz")
    try:
        with place.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ValueError(f"{place}: cannot be read: {error.strerror}") from None
    if len(data) > MAX_BYTES:
        raise ValueError(f"{place}: is larger than {MAX_BYTES >> 20} MB, the most that is read")
    shape = None if rows is None or cols is None else (rows, cols)
    frames = _of_npz(data, place) if place.suffix == ".npz" else _of_csv(data, place, shape)
    _check(frames, place, shape)
    return frames


def _of_csv(data: bytes, path: Path, shape: Shape | None) -> Frames:
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is not text in UTF-8: {error.reason}") from None
    said = [(number, line) for number, line in enumerate(lines, start=1) if line.strip()]
    if said and is_header(said[0][1]):
        said = said[1:]
    found = list[FrameRow]()
    for number, line in said:
        row = parse_row(line, f"{path}:{number}", shape)
        if found and (row.time is None) != (found[0].time is None):
            raise ValueError(f"{path}:{number}: not every line has a time; expected all or none")
        if found and row.time is not None and row.time < (found[-1].time or 0.0):
            raise ValueError(
                f"{path}:{number}: the time {row.time:g} comes before {found[-1].time:g}"
            )
        found.append(row)
        shape = row.image.shape[0], row.image.shape[1]
    if not found:
        raise ValueError(f"{path}: holds no frames")
    times = None if found[0].time is None else np.array([row.time for row in found])
    poses = np.array([row.pose for row in found])
    return Frames(np.array([row.image for row in found]), poses, times)


def _of_npz(data: bytes, path: Path) -> Frames:
    found = _arrays(data, path)
    for name, array in found.items():
        if array.dtype.kind not in "fiu" or array.ndim != ARRAYS[name]:
            raise ValueError(
                f"{path}: {name} is an array of {array.dtype} with {array.ndim} dimensions; "
                f"expected numbers with {ARRAYS[name]}"
            )
        if not np.isfinite(array).all():
            raise ValueError(f"{path}: {name} must be finite")
        found[name] = np.ascontiguousarray(array, np.float64)
    for name in ("frames", "poses"):
        if name not in found:
            raise ValueError(f"{path}: lacks the array {name!r}")
    images, poses, times = found["frames"], found["poses"], found.get("times")
    wanted = {"poses": (len(images), POSE), "times": (len(images),)}
    for name, shape in wanted.items():
        if name in found and found[name].shape != shape:
            raise ValueError(f"{path}: {name} has shape {found[name].shape}; expected {shape}")
    if times is not None and (np.diff(times) < 0.0).any():
        raise ValueError(f"{path}: times must not fall")
    turned = [unit_pose(pose, f"{path}: poses[{i}]") for i, pose in enumerate(poses)]
    return Frames(images, np.array(turned).reshape(-1, POSE), times)


def _arrays(data: bytes, path: Path) -> dict[str, NDArray[Any]]:
    """The arrays that mean something, once it is known how large they are."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(one.file_size for one in archive.infolist())
        if size <= MAX_BYTES:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                return {name: arrays[name] for name in ARRAYS if name in arrays}
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError) as error:
        raise ValueError(f"{path}: is no NPZ file of plain arrays: {error}") from None
    raise ValueError(f"{path}: unpacks to more than {MAX_BYTES >> 20} MB")


def _check(frames: Frames, path: Path, shape: Shape | None) -> None:
    count, *size = frames.images.shape
    if not count:
        raise ValueError(f"{path}: holds no frames")
    if shape is not None and tuple(size) != shape:
        raise ValueError(
            f"{path}: has frames of {size[0]} by {size[1]}; expected {shape[0]} by {shape[1]}"
        )
    if not all(LEAST <= side <= MOST for side in size):
        raise ValueError(
            f"{path}: has frames of {size[0]} by {size[1]}; expected {LEAST} to {MOST} each way"
        )
