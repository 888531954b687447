"""Tactile frames from a file or a line of text, and as the messages that drivers publish.

A line holds maybe a time, then the pad's pose x, y, z, qx, qy, qz, qw, then the taxels row by row.
A column that the header calls ``placement``, wherever it stands, counts how often the object had
been turned over.
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

MAX_FILE_BYTES = 256 << 20  # Largest file, also when it is unpacked
# Arrays of an NPZ file, and their dimensions; times and placements may be missing.
NPZ_ARRAYS = {"frames": 3, "poses": 2, "times": 1, "placements": 1}
PLACEMENT = "placement"  # What the header calls its column
POSE_NUMBERS = 7  # Numbers of a pose: x, y, z in m, and a quaternion x, y, z, w
MIN_SIDE, MAX_SIDE = 4, 64  # Rows or columns of an array
QUATERNION_TOLERANCE = 0.01  # A quaternion may be rounded; its length is 1 within this
ArraySize = tuple[int, int]
# Frames of a sequence that make a goal; a message lists 4096 goals at most.
FRAMES_A_GOAL, MOST_FRAMES = 25, 100_000
GOALS_A_PLACEMENT = MOST_FRAMES // FRAMES_A_GOAL
MOST_TURNS = 8  # Times that an object is turned over
# Topics of every driver.
DRIVER_OUTPUTS: dict[str, type] = {
    "/touch/info": SensorInfo,
    "/touch/raw": TactileFrame,
    "/touch/end": SequenceEnd,
}


class FrameSequence(NamedTuple):
    """Frames of one array, in the order in which they were taken."""

    images: Floats  # What the taxels sent, (n, rows, cols)
    # Poses of the pad: x, y, z in m, a quaternion x, y, z, w; its z axis points into the object;
    # (n, 7).
    poses: Floats
    times: Floats | None  # When each was taken, (n,), s; None if the file does not say
    placements: Ints  # How often the object had been turned over before each, (n,)


def read_frames(
    path: str | os.PathLike[str], rows: int | None = None, cols: int | None = None
) -> FrameSequence:
    """The frames of a file, whose array, if it is a CSV file, is square or of a given size.

    A ``.csv`` has a frame a line: x, y, z, qx, qy, qz, qw and the values row by row, maybe with a
    time before them, maybe under a header, which may name a column ``placement``. An ``.npz`` has
    ``frames`` (n, rows, cols), ``poses`` (n, 7) and maybe ``times`` (n,) and ``placements`` (n,).

    ValueError with file and line, if it cannot be read, is too large, or a frame is none.
    """
    place = Path(path)
    if place.suffix not in (".csv", ".npz"):
        raise ValueError(f"{place}: is no file of frames; its name must end in .csv or .npz")
    try:
        with place.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise ValueError(f"{place}: cannot be read: {error.strerror}") from None
    if len(data) > MAX_FILE_BYTES:
        raise ValueError(
            f"{place}: is larger than {MAX_FILE_BYTES >> 20} MB, the most that is read"
        )
    shape = None if rows is None or cols is None else (rows, cols)
    frames = _of_npz(data, place) if place.suffix == ".npz" else _of_csv(data, place, shape)
    _check(frames, place, shape)
    return frames


def _of_npz(data: bytes, path: Path) -> FrameSequence:
    found = _arrays(data, path)
    for name, array in found.items():
        if array.dtype.kind not in "fiu" or array.ndim != NPZ_ARRAYS[name]:
            raise ValueError(
                f"{path}: {name} is an array of {array.dtype} with {array.ndim} dimensions; "
                f"expected numbers with {NPZ_ARRAYS[name]}"
            )
        if not np.isfinite(array).all():
            raise ValueError(f"{path}: {name} must be finite")
        found[name] = np.ascontiguousarray(array, np.float64)
    for name in ("frames", "poses"):
        if name not in found:
            raise ValueError(f"{path}: lacks the array {name!r}")
    images, poses, times = found["frames"], found["poses"], found.get("times")
    count = len(images)
    wanted = {"poses": (count, POSE_NUMBERS), "times": (count,), "placements": (count,)}
    for name, shape in wanted.items():
        if name in found and found[name].shape != shape:
            raise ValueError(f"{path}: {name} has shape {found[name].shape}; expected {shape}")
    if times is not None and (np.diff(times) < 0.0).any():
        raise ValueError(f"{path}: times must not fall")
    turned = [unit_pose(pose, f"{path}: poses[{i}]") for i, pose in enumerate(poses)]
    placements, before = list[int](), 0
    for i, value in enumerate(found.get("placements", np.zeros(count)).tolist()):
        before = next_placement(value, before, f"{path}: placements[{i}]")
        placements.append(before)
    unit = np.array(turned).reshape(-1, POSE_NUMBERS)
    return FrameSequence(images, unit, times, np.array(placements, np.int32))


def next_placement(value: float, before: int, where: str) -> int:
    """The placement of a frame; ValueError where it does not follow that of the frame before."""
    if value not in (before, before + 1):
        raise ValueError(
            f"{where}: the placement is {value:g} after {before}; expected {before}, or "
            f"{before + 1} once the object was turned over"
        )
    if value > MOST_TURNS:
        raise ValueError(f"{where}: the placement is {value:g}; expected {MOST_TURNS} at most")
    return int(value)


def _arrays(data: bytes, path: Path) -> dict[str, NDArray[Any]]:
    """The arrays that mean something, once it is known how large they are."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(one.file_size for one in archive.infolist())
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
    found = list[FrameRow]()
    for number, line in published:
        before = found[-1].placement if found else 0
        row = parse_row(line, f"{path}:{number}", shape, column, before)
        if found and (row.time is None) != (found[0].time is None):
            raise ValueError(f"{path}:{number}: not every line has a time; expected all or none")
        if found and row.time is not None and row.time < (found[-1].time or 0.0):
            order = f"the time {row.time:g} comes before {found[-1].time:g}"
            raise ValueError(f"{path}:{number}: {order}")
        found.append(row)
        shape = row.image.shape[0], row.image.shape[1]
    if not found:
        raise ValueError(f"{path}: holds no frames")
    times = None if found[0].time is None else np.array([row.time for row in found])
    poses = np.array([row.pose for row in found])
    placements = np.array([row.placement for row in found], np.int32)
    return FrameSequence(np.array([row.image for row in found]), poses, times, placements)


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
    """What a line says."""

    time: float | None  # When the frame was taken, s; None if the line does not say
    pose: Floats  # Pose of the pad, (7,), its quaternion of length 1
    image: Floats  # What the taxels sent, (rows, cols)
    placement: int = 0  # How often the object had been turned over before it


def parse_row(
    text: str, where: str, shape: ArraySize | None, column: int | None = None, before: int = 0
) -> FrameRow:
    """The frame in a line; where that stands is for complaints, None stands for a square array.

    `column`: of the placement, if there is one. `before`: the placement of the frame before.

    Raises ValueError if columns are another number, one is no finite number, or no quaternion, or
    if the placement does not follow the one before.
    """
    cells, placement = text.split(","), before
    if column is not None and column < len(cells):
        value = _number(cells.pop(column))
        placement = next_placement(math.nan if value is None else value, before, where)
    shape = shape or square_size(len(cells))
    if shape is None:
        raise ValueError(
            f"{where}: has {len(cells)} columns; expected {POSE_NUMBERS} of the pose and those of "
            "a square array, or say how many rows and columns it has"
        )
    wanted = POSE_NUMBERS + shape[0] * shape[1]
    if len(cells) not in (wanted, wanted + 1):
        raise ValueError(
            f"{where}: has {len(cells)} columns; expected {wanted}: x,y,z,qx,qy,qz,qw and "
            f"{shape[0]} by {shape[1]} values, or one more with the time first"
        )
    values = _numbers(cells, where)
    time, rest = (float(values[0]), values[1:]) if len(cells) > wanted else (None, values)
    pose, image = unit_pose(rest[:POSE_NUMBERS], where), rest[POSE_NUMBERS:].reshape(shape)
    return FrameRow(time, pose, image, placement)


def square_size(columns: int) -> ArraySize | None:
    """Rows and columns of the square array of a line with so many columns; None if there is none.

    With or without a time: no two squares from 4 by 4 on differ by one.
    """
    for rest in (columns - POSE_NUMBERS, columns - POSE_NUMBERS - 1):
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


def unit_pose(pose: Floats, where: str) -> Floats:
    """The pose with a quaternion of length 1; ValueError if it is off by more than rounding."""
    length = float(np.linalg.norm(pose[3:]))
    if not abs(length - 1.0) <= QUATERNION_TOLERANCE:
        raise ValueError(f"{where}: the quaternion has length {length:.3g}; expected 1")
    return np.concatenate([pose[:3], pose[3:] / length])


def is_header(text: str) -> bool:
    """Whether a line names columns, and is no frame."""
    return any(cell.strip() and _number(cell) is None for cell in text.split(","))


def placement_column(header: str) -> int | None:
    """Which column a header calls the placement; None if there is none."""
    names = [cell.strip().lower() for cell in header.split(",")]
    return names.index(PLACEMENT) if PLACEMENT in names else None


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


class SensorParams(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a driver must know of its sensor."""

    # Rows, columns, pitch and pad of the array, and what it sends.
    sensor: sensors.SensorSpec = sensors.SensorSpec()
    # What the numbers are: compression of the pad in m, or the sensor's signal, times in s or
    # forces in N, as ``sensor.signal`` says.
    values: Literal["compression", "signal"] = "compression"
    # What a number is multiplied by to be in m, s or N: 0.001 for mm.
    scale: Annotated[float, Meta(gt=0)] = 1.0
    # Standard deviation of one taxel's compression, m, if there is no calibration.
    noise: Annotated[float, Meta(ge=0, le=0.001, description="m")] = 0.0


def sensor_info(sensing: SensorParams) -> SensorInfo:
    """What subscribers are told of the sensor."""
    return sensors.info_of(sensing.sensor, sensing.noise)


def tactile_frame(
    sensing: SensorParams,
    touch: int,
    time: float,
    pose: Floats,
    image: Floats,
    placement: int = 0,
) -> TactileFrame:
    """One frame as a message.

    Frames count from 0; two of one number are one frame to the filter. The time is in s; the pad's
    pose is x, y, z in m, a quaternion x, y, z, w, and its z axis points into the object; the image
    is what the taxels sent, in the driver's own unit; the placement counts how often the object was
    turned over before. Raises ValueError if there are too many, or
    the pad would be compressed by more than it is thick: then the unit is another.
    """
    if touch >= MOST_FRAMES:
        raise ValueError(f"frame {touch}: a sequence has {MOST_FRAMES} frames at most")
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
    least = DEFAULT_CONTACT.min_compression
    pressed = bool(contact_mask(pad, compression, least, info.noise).any())
    bottomed = deepest >= pad.saturation * pad.thickness
    axes = Pose.from_array(pose).axes
    return TactileFrame(
        goal=placement * GOALS_A_PLACEMENT + touch // FRAMES_A_GOAL,
        touch=touch % FRAMES_A_GOAL,
        finger=1,
        placement=placement,
        direction=axes[:, 0].copy(),
        pose=np.array(pose, np.float64),
        outcome="bottomed" if bottomed else "hit" if pressed else "miss",
        array=array,
        robot_time=time,
    )
