"""Tactile frames from files and lines of text, and as messages of drivers.

A line has an optional time, the pad's pose x, y, z, qx, qy, qz, qw, and the taxels row by row. A
column with the header ``placement``, at any position, counts how often the object was turned over.
"""

from __future__ import annotations

import io
import math
import os
import zipfile
import zlib
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from palpate.core.arrays import Floats, Ints
from palpate.core.poses import Pose
from palpate.core.touch import DEFAULT_CONTACT, contact_mask
from palpate.messages.types import SensorInfo, SequenceEnd, TactileFrame
from palpate.nodes.specs import sensors

MAX_FILE_BYTES = 256 << 20  # of a file, also unpacked
# Numbers of dimensions of the arrays of an NPZ file; times and placements are optional.
NPZ_ARRAYS = {"frames": 3, "poses": 2, "times": 1, "placements": 1}
PLACEMENT = "placement"  # header of its column
N_POSE_NUMBERS = 7  # x, y, z in m, and a quaternion x, y, z, w
MIN_SIDE, MAX_SIDE = 4, 64  # rows or columns of an array
ArraySize = tuple[int, int]
# Frames of a goal: a message lists at most 4096 goals.
FRAMES_PER_GOAL, MAX_FRAMES = 25, 100_000
GOALS_PER_PLACEMENT = MAX_FRAMES // FRAMES_PER_GOAL
MAX_TURNS = 8  # of an object
# Topics of every driver.
DRIVER_OUTPUTS: dict[str, type] = {
    "/touch/info": SensorInfo,
    "/touch/raw": TactileFrame,
    "/touch/end": SequenceEnd,
}


class FrameSequence(NamedTuple):
    """Frames of one array, in the order of their times."""

    images: Floats  # values of the taxels, (n, rows, cols)
    # Poses of the pad, (n, 7): x, y, z in m, and a quaternion x, y, z, w; the z axis points into
    # the object.
    poses: Floats
    times: Floats | None  # (n,) [s]; None if the file has none
    placements: Ints  # number of turns of the object before each frame, (n,)


def read_frames(
    path: str | os.PathLike[str], rows: int | None = None, cols: int | None = None
) -> FrameSequence:
    """The frames of a file; the array of a CSV file is square, or `rows` by `cols`.

    A ``.csv`` has one frame per line: an optional time, x, y, z, qx, qy, qz, qw and the values row
    by row. It may have a header, with a column ``placement``. An ``.npz`` has ``frames`` (n, rows,
    cols), ``poses`` (n, 7), and optional ``times`` (n,) and ``placements`` (n,).

    Raises ValueError with file and line if it cannot be read, is too large, or a frame is invalid.
    """
    file_path = Path(path)
    if file_path.suffix not in (".csv", ".npz"):
        raise ValueError(f"{file_path}: is no file of frames; its name must end in .csv or .npz")
    try:
        with file_path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise ValueError(f"{file_path}: cannot be read: {error.strerror}") from None
    if len(data) > MAX_FILE_BYTES:
        raise ValueError(
            f"{file_path}: is larger than {MAX_FILE_BYTES >> 20} MB, the most that is read"
        )
    shape = None if rows is None or cols is None else (rows, cols)
    frames = (
        _of_npz(data, file_path) if file_path.suffix == ".npz" else _of_csv(data, file_path, shape)
    )
    _check(frames, file_path, shape)
    return frames


def _of_npz(data: bytes, path: Path) -> FrameSequence:
    arrays = _arrays(data, path)
    for name, array in arrays.items():
        if array.dtype.kind not in "fiu" or array.ndim != NPZ_ARRAYS[name]:
            raise ValueError(
                f"{path}: {name} is an array of {array.dtype} with {array.ndim} dimensions; "
                f"expected numbers with {NPZ_ARRAYS[name]}"
            )
        if not np.isfinite(array).all():
            raise ValueError(f"{path}: {name} must be finite")
        arrays[name] = np.ascontiguousarray(array, np.float64)
    for name in ("frames", "poses"):
        if name not in arrays:
            raise ValueError(f"{path}: lacks the array {name!r}")
    images, poses, times = arrays["frames"], arrays["poses"], arrays.get("times")
    count = len(images)
    shapes = {"poses": (count, N_POSE_NUMBERS), "times": (count,), "placements": (count,)}
    for name, shape in shapes.items():
        if name in arrays and arrays[name].shape != shape:
            raise ValueError(f"{path}: {name} has shape {arrays[name].shape}; expected {shape}")
    if times is not None and (np.diff(times) < 0.0).any():
        raise ValueError(f"{path}: times must not fall")
    unit_poses = [unit_pose(pose, f"{path}: poses[{i}]") for i, pose in enumerate(poses)]
    placements, before = list[int](), 0
    for i, value in enumerate(arrays.get("placements", np.zeros(count)).tolist()):
        before = next_placement(value, before, f"{path}: placements[{i}]")
        placements.append(before)
    poses = np.array(unit_poses).reshape(-1, N_POSE_NUMBERS)
    return FrameSequence(images, poses, times, np.array(placements, np.int32))


def next_placement(value: float, before: int, where: str) -> int:
    """The placement of a frame; ValueError if it does not follow that of the frame before."""
    if value not in (before, before + 1):
        raise ValueError(
            f"{where}: the placement is {value:g} after {before}; expected {before}, or "
            f"{before + 1} once the object was turned over"
        )
    if value > MAX_TURNS:
        raise ValueError(f"{where}: the placement is {value:g}; expected {MAX_TURNS} at most")
    return int(value)


def _arrays(data: bytes, path: Path) -> dict[str, NDArray[Any]]:
    """The known arrays, after a check of their size."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(part.file_size for part in archive.infolist())
        if size <= MAX_FILE_BYTES:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                return {name: arrays[name] for name in NPZ_ARRAYS if name in arrays}
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError) as error:
        raise ValueError(f"{path}: is no NPZ file of plain arrays: {error}") from None
    raise ValueError(f"{path}: unpacks to more than {MAX_FILE_BYTES >> 20} MB")


def _of_csv(data: bytes, path: Path, shape: ArraySize | None) -> FrameSequence:
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is not text in UTF-8: {error.reason}") from None
    published = [(number, line) for number, line in enumerate(lines, start=1) if line.strip()]
    column = None
    if published and is_header(published[0][1]):
        column, published = placement_column(published[0][1]), published[1:]
    rows = list[FrameRow]()
    for number, line in published:
        before = rows[-1].placement if rows else 0
        row = parse_row(line, f"{path}:{number}", shape, column, before)
        if rows and (row.time is None) != (rows[0].time is None):
            raise ValueError(f"{path}:{number}: not every line has a time; expected all or none")
        if rows and row.time is not None and row.time < (rows[-1].time or 0.0):
            order = f"the time {row.time:g} comes before {rows[-1].time:g}"
            raise ValueError(f"{path}:{number}: {order}")
        rows.append(row)
        shape = row.image.shape[0], row.image.shape[1]
    if not rows:
        raise ValueError(f"{path}: holds no frames")
    times = None if rows[0].time is None else np.array([row.time for row in rows])
    poses = np.array([row.pose for row in rows])
    placements = np.array([row.placement for row in rows], np.int32)
    return FrameSequence(np.array([row.image for row in rows]), poses, times, placements)


def _check(frames: FrameSequence, path: Path, shape: ArraySize | None) -> None:
    count, *size = frames.images.shape
    if not count:
        raise ValueError(f"{path}: holds no frames")
    has = f"{path}: has frames of {size[0]} by {size[1]}; expected"
    if shape is not None and tuple(size) != shape:
        raise ValueError(f"{has} {shape[0]} by {shape[1]}")
    if not all(MIN_SIDE <= side <= MAX_SIDE for side in size):
        raise ValueError(f"{has} {MIN_SIDE} to {MAX_SIDE} each way")


class FrameRow(NamedTuple):
    """The frame of a line."""

    time: float | None  # [s]; None if the line has none
    pose: Floats  # of the pad, (7,), with a unit quaternion
    image: Floats  # values of the taxels, (rows, cols)
    placement: int = 0  # number of turns of the object before it


def parse_row(
    text: str, where: str, shape: ArraySize | None, column: int | None = None, before: int = 0
) -> FrameRow:
    """The frame in a line; `where` names the line in errors.

    `shape`: of the array; None: square. `column`: of the placement, if there is one. `before`: the
    placement of the frame before. Raises ValueError for a wrong number of columns, a column that is
    no finite number, an invalid quaternion, or a placement that does not follow the one before.
    """
    cells, placement = text.split(","), before
    if column is not None and column < len(cells):
        value = _number(cells.pop(column))
        placement = next_placement(math.nan if value is None else value, before, where)
    shape = shape or square_size(len(cells))
    if shape is None:
        raise ValueError(
            f"{where}: has {len(cells)} columns; expected {N_POSE_NUMBERS} of the pose and those "
            "of a square array, or say how many rows and columns it has"
        )
    n_values = N_POSE_NUMBERS + shape[0] * shape[1]
    if len(cells) not in (n_values, n_values + 1):
        raise ValueError(
            f"{where}: has {len(cells)} columns; expected {n_values}: x,y,z,qx,qy,qz,qw and "
            f"{shape[0]} by {shape[1]} values, or one more with the time first"
        )
    values = _numbers(cells, where)
    time, rest = (float(values[0]), values[1:]) if len(cells) > n_values else (None, values)
    pose, image = unit_pose(rest[:N_POSE_NUMBERS], where), rest[N_POSE_NUMBERS:].reshape(shape)
    return FrameRow(time, pose, image, placement)


def square_size(columns: int) -> ArraySize | None:
    """Rows and columns of the square array in a line of `columns`; None if there is none.

    The line may have a time: no two square numbers from 16 on differ by one.
    """
    for rest in (columns - N_POSE_NUMBERS, columns - N_POSE_NUMBERS - 1):
        side = math.isqrt(max(rest, 0))
        if side * side == rest and MIN_SIDE <= side <= MAX_SIDE:
            return side, side
    return None


def _numbers(cells: list[str], where: str) -> Floats:
    values = list[float]()
    for column, cell in enumerate(cells, start=1):
        value = _number(cell)
        if value is None or not math.isfinite(value):
            shown = f"column {column} is {cell.strip()!r:.40}"
            raise ValueError(f"{where}: {shown}; expected a finite number")
        values.append(value)
    return np.array(values)


def unit_pose(pose: Floats, where: str, tolerance: float = 0.01) -> Floats:
    """The pose with a unit quaternion; ValueError if its length is not 1 within `tolerance`."""
    length = float(np.linalg.norm(pose[3:]))
    if not abs(length - 1.0) <= tolerance:
        raise ValueError(f"{where}: the quaternion has length {length:.3g}; expected 1")
    return np.concatenate([pose[:3], pose[3:] / length])


def is_header(text: str) -> bool:
    """Whether a line has the names of columns."""
    return any(cell.strip() and _number(cell) is None for cell in text.split(","))


def placement_column(header: str) -> int | None:
    """Index of the column of the placement; None if there is none."""
    names = [cell.strip().lower() for cell in header.split(",")]
    return names.index(PLACEMENT) if PLACEMENT in names else None


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


class SensorParams(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The sensor of a driver."""

    # Rows, columns, pitch and pad of the array, and its signal.
    sensor: sensors.SensorSpec = sensors.SensorSpec()
    # Quantity of the values: compression of the pad in m, or the signal, times in s or forces in N
    # as in ``sensor.signal``.
    values: Literal["compression", "signal"] = "compression"
    # Factor of the values to m, s or N: 0.001 for mm.
    scale: Annotated[float, Meta(gt=0)] = 1.0
    # Standard deviation of one taxel's compression without calibration [m].
    noise: Annotated[float, Meta(ge=0, le=0.001, description="m")] = 0.0


def sensor_info(sensing: SensorParams) -> SensorInfo:
    """The message on the sensor."""
    return sensors.info_of(sensing.sensor, sensing.noise)


def tactile_frame(
    sensing: SensorParams,
    touch: int,
    time: float,
    pose: Floats,
    image: Floats,
    placement: int = 0,
) -> TactileFrame:
    """A frame as a message.

    `touch`: number of the frame from 0; repeated numbers are ignored by the filter. `time` is in s.
    `pose`: of the pad, (7,), x, y, z in m and a quaternion x, y, z, w; its z axis points into the
    object. `image`: values of the taxels in the driver's own unit. `placement`: number of turns of
    the object before it. Raises ValueError if there are too many frames, or the compression exceeds
    the thickness of the pad, as with a wrong unit.
    """
    if touch >= MAX_FRAMES:
        raise ValueError(f"frame {touch}: a sequence has {MAX_FRAMES} frames at most")
    info = sensor_info(sensing)
    calibration, pad = sensors.calibration_of_info(info), sensors.pad_of_info(info)
    scaled = sensing.scale * np.asarray(image, np.float64)
    array = calibration.encode(scaled) if sensing.values == "compression" else scaled
    compression = calibration.decode(array)
    deepest = float(compression.max())
    if deepest > pad.thickness:
        raise ValueError(
            f"frame {touch}: the pad is compressed by {deepest:.3g} m, but is {pad.thickness:g} m "
            "thick; are the numbers in mm? Then scale is 0.001"
        )
    is_pressed = bool(
        contact_mask(pad, compression, DEFAULT_CONTACT.min_compression, info.noise).any()
    )
    is_bottomed = deepest >= pad.saturation * pad.thickness
    axes = Pose.from_array(pose).axes
    return TactileFrame(
        goal=placement * GOALS_PER_PLACEMENT + touch // FRAMES_PER_GOAL,
        touch=touch % FRAMES_PER_GOAL,
        finger=1,
        placement=placement,
        direction=axes[:, 0].copy(),
        pose=np.array(pose, np.float64),
        outcome="bottomed" if is_bottomed else "hit" if is_pressed else "miss",
        array=array,
        robot_time=time,
    )
