"""A calibration as a file: what `palpate calibrate` writes and scenes read."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

from msgspec import field, to_builtins
from ruamel.yaml import YAML

from palpate.core import Floats
from palpate.core.touch import CalibrationEstimate, Pad
from palpate.launch.files.file_access import file_within
from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.files.yaml_file import convert, read_yaml
from palpate.nodes.specs import CalibrationSpec

DIGITS = 6  # Significant digits of what is written: far more than any of it is sure of
MAX_CALIBRATION_VALUES = 20_000  # Four tables of 64 by 64, and what belongs to them


class CalibrationFile(CalibrationSpec, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A calibration with its standard errors; nothing reads these but people."""

    errors: dict[str, Any] = field(default_factory=dict)  # By the names of the fields


def read_calibration(path: Path) -> CalibrationSpec:
    """The calibration in a file.

    Raises
    ------
    InputError
        If the file cannot be used; the sentence names file, line, key and value.
    """
    found = convert(read_yaml(path, MAX_CALIBRATION_VALUES), CalibrationFile, "calibration")
    return CalibrationSpec(
        gain=found.gain,
        offset=found.offset,
        sound_speed=found.sound_speed,
        noise=found.noise,
    )


def check_calibration_path(path: Path) -> None:
    """Refuse a path to which no calibration can be written, before anything is pressed.

    Raises
    ------
    InputError
        If there is something already, or no folder to put it in.
    """
    if path.exists():
        raise InputError(f"{path}: is there already; choose another name")
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: there is no folder {path.parent}")


def write_calibration(path: Path, estimate: CalibrationEstimate, pad: Pad) -> None:
    """Write a calibration whole, or not at all.

    Raises
    ------
    InputError
        If the file is there already, or cannot be written.
    """
    shape = (pad.rows, pad.cols)
    document = {
        "sound_speed": _rounded(estimate.sound_speed),
        "noise": _rounded(estimate.noise),
        "gain": _table(estimate.gain, shape),
        "offset": _table(estimate.offset, shape),
        "errors": {
            "sound_speed": _rounded(estimate.sound_speed_error),
            "gain": _table(estimate.gain_error, shape),
            "offset": _table(estimate.offset_error, shape),
        },
    }
    text = io.StringIO()
    text.write("# Written by palpate calibrate. Gains: 0 is a taxel not to be trusted.\n")
    yaml = YAML(pure=True)
    yaml.default_flow_style = None
    yaml.width = 1000
    yaml.dump(document, text)
    check_calibration_path(path)
    whole = path.with_name(path.name + ".part")
    try:
        whole.write_text(text.getvalue(), encoding="utf-8")
        whole.replace(path)
    except OSError as error:
        whole.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def with_calibration(given: SourceMapped, folder: Path) -> SourceMapped:
    """The scene with the calibration file that its sensor names read into it.

    Raises
    ------
    InputError
        If the file is not in the scene's folder, or cannot be used.
    """
    sensor = given.value.get("sensor")
    name = sensor.get("calibration") if isinstance(sensor, dict) else None
    if name is None:
        return given
    where = ("sensor", "calibration")
    if not isinstance(name, str):
        raise given.error(where, "sensor.calibration must be the name of a file")
    try:
        path = file_within(folder, name, "sensor.calibration")
    except ValueError as error:
        raise given.error(where, str(error)) from None
    found = to_builtins(read_calibration(path))
    value = {**given.value, "sensor": {**sensor, "calibration": found}}
    return SourceMapped(value, given.source, given.places)


def _table(flat: Floats, shape: tuple[int, int]) -> list[list[float | None]]:
    return [
        [_rounded(value) if math.isfinite(value) else None for value in row]
        for row in flat.reshape(shape).tolist()
    ]


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
