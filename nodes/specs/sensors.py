"""Descriptions of the fingertip's array, pad, calibration and effects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta, Struct

from palpate.core import touch
from palpate.core.explore.tracing import TOUCH_DEPTH
from palpate.core.plugins import describe_error, in_base_units
from palpate.core.robot_time import RobotPreset
from palpate.core.touch.effects import effect_type, rank
from palpate.messages.types import SensorInfo

# Widths of arrays [m]: with the tested ones between them, domed and flat, contours of a ball, a box
# and a vase of 80 to 100 mm close.
MIN_WIDTH, MAX_WIDTH = 5.0e-3, 40.0e-3
Gain = Annotated[float, Meta(ge=0, le=10, description="1")]
Offset = Annotated[float, Meta(ge=-0.01, le=0.01, description="m")]
# Parameters of each listed effect by its name, or by ``module:Class``.
EffectSpecs = dict[str, dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class SensingSettings:
    """Measuring errors that the message on the sensor does not state."""

    contact_error: float = 0.1e-3  # standard deviation of a contact of the hand [m]
    resolution_ratio: float = 0.01  # of the error of contour points without noise to the pitch


DEFAULT_SENSING = SensingSettings()


class PadSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The elastic pad over the transducers."""

    thickness: Annotated[float, Meta(ge=0.0005, le=0.05, description="m")] = 0.003  # [m]
    # Radius of a domed pad [m]; null: flat.
    radius: Annotated[float, Meta(gt=0, le=1, description="m")] | None = 0.015
    # Speed of sound [m/s].
    sound_speed: Annotated[float, Meta(ge=100, le=5000, description="m/s")] = 1000.0
    # Largest compression as a fraction of the thickness.
    saturation: Annotated[float, Meta(gt=0.4, le=0.95)] = 0.8
    # Pressure over compression [N/m^3]: 0.2 MPa at 1 mm.
    stiffness: Annotated[float, Meta(ge=1e6, le=1e10, description="N/m3")] = 2e8


class CalibrationSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The result of a calibration; without one the data sheet is used."""

    # Factor of each taxel, rows of columns; 0 marks an unreliable taxel.
    gain: tuple[tuple[Gain, ...], ...]
    offset: tuple[tuple[Offset, ...], ...]  # added to each taxel after that [m]
    # Speed of sound in the pad [m/s].
    sound_speed: Annotated[float, Meta(ge=100, le=5000, description="m/s")]
    # Standard deviation of one taxel [m].
    noise: Annotated[float, Meta(ge=0, le=0.001, description="m")]


class SensorSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The fingertip's array."""

    rows: Annotated[int, Meta(ge=4, le=64)] = 16  # of taxels
    cols: Annotated[int, Meta(ge=4, le=64)] = 16  # of taxels
    # Distance between neighbouring taxels [m].
    pitch: Annotated[float, Meta(ge=0.0002, le=0.005, description="m")] = 0.001
    pad: PadSpec = PadSpec()
    # Signal of a taxel: the time of flight of its echo, or the force on it.
    signal: touch.Signal = "time"
    calibration: CalibrationSpec | None = None

    def __post_init__(self) -> None:
        widths = [self.pitch * (count - 1) for count in (self.rows, self.cols)]
        if min(widths) < MIN_WIDTH or max(widths) > MAX_WIDTH:
            raise ValueError(
                f"rows, cols and pitch make an array of {1e3 * widths[0]:.3g} by "
                f"{1e3 * widths[1]:.3g} mm; contours are followed with {1e3 * MIN_WIDTH:g} "
                f"to {1e3 * MAX_WIDTH:g} mm"
            )
        corner = 0.5 * math.hypot(*widths)
        if self.pad.radius is not None and self.pad.radius <= corner:
            raise ValueError(
                f"pad.radius is {self.pad.radius} m; a dome over this array needs more than "
                f"{corner:.3g} m, half its diagonal"
            )
        if self.pad.saturation * self.pad.thickness < TOUCH_DEPTH:
            raise ValueError(
                f"pad.thickness is {self.pad.thickness} m; with pad.saturation "
                f"{self.pad.saturation} it must be at least "
                f"{TOUCH_DEPTH / self.pad.saturation:.3g} m, "
                f"to be pressed by {TOUCH_DEPTH} m"
            )
        for name in ("gain", "offset") if self.calibration is not None else ():
            table = getattr(self.calibration, name)
            if len(table) != self.rows or any(len(row) != self.cols for row in table):
                raise ValueError(
                    f"calibration.{name} must have {self.rows} rows of {self.cols}, "
                    "as the array; calibrate this sensor again"
                )


def pad_of_spec(sensor: SensorSpec) -> touch.Pad:
    """The pad of a scene."""
    radius = sensor.pad.radius
    return touch.Pad(
        rows=sensor.rows,
        cols=sensor.cols,
        pitch=sensor.pitch,
        thickness=sensor.pad.thickness,
        dome=0.0 if radius is None else 1.0 / radius,
        saturation=sensor.pad.saturation,
    )


def info_of(sensor: SensorSpec, noise: float, face: touch.FaceModel = touch.SPRINGS) -> SensorInfo:
    """The message on a sensor: its calibration, or the data sheet and `noise` [m]."""
    pad, calibration = pad_of_spec(sensor), sensor.calibration
    shape = (pad.rows, pad.cols)
    return SensorInfo(
        rows=pad.rows,
        cols=pad.cols,
        pitch=pad.pitch,
        thickness=pad.thickness,
        dome=pad.dome,
        saturation=pad.saturation,
        signal=sensor.signal,
        sound_speed=sensor.pad.sound_speed if calibration is None else calibration.sound_speed,
        taxel_stiffness=sensor.pad.stiffness * sensor.pitch**2,
        gain=np.ones(shape) if calibration is None else np.array(calibration.gain, np.float64),
        offset=np.zeros(shape) if calibration is None else np.array(calibration.offset, np.float64),
        face=face.kind,
        face_decay=face.decay,
        noise=noise if calibration is None else calibration.noise,
    )


def pad_of_info(info: SensorInfo) -> touch.Pad:
    """Pad with the array and dome of a SensorInfo."""
    return touch.Pad(
        rows=info.rows,
        cols=info.cols,
        pitch=info.pitch,
        thickness=info.thickness,
        dome=info.dome,
        saturation=info.saturation,
        face=touch.FaceModel(info.face, info.face_decay),
    )


def resolution_of_info(info: SensorInfo, settings: SensingSettings = DEFAULT_SENSING) -> float:
    """Smallest error of a surface that the sensor can measure [m]."""
    return max(settings.resolution_ratio * info.pitch, info.noise)


def calibration_of_info(info: SensorInfo) -> touch.Calibration:
    """The calibration of a SensorInfo."""
    return touch.Calibration(
        signal=info.signal,
        thickness=info.thickness,
        sound_speed=info.sound_speed,
        taxel_stiffness=info.taxel_stiffness,
        gain=info.gain,
        offset=info.offset,
    )


def describe_effects(listed: Mapping[str, Mapping[str, Any]]) -> dict[str, touch.Effect]:
    """The listed effects in the order in which they act.

    Raises ValueError if there is no such effect, or a parameter is unknown or out of its range.
    """
    described = {name: _described(name, parameters) for name, parameters in listed.items()}
    return dict(sorted(described.items(), key=lambda item: (item[1].phase, rank(item[0]), item[0])))


def _described(name: str, parameters: Mapping[str, Any]) -> touch.Effect:
    try:
        kind = effect_type(name)
    except LookupError as error:
        raise ValueError(str(error.args[0])) from None
    known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    for key in parameters:
        if key not in known:
            raise ValueError(f"effects.{name} has no parameter {key!r}; it has {known}")
    try:
        return msgspec.convert(in_base_units(kind, parameters), kind)
    except ValueError as error:
        raise ValueError(f"effects.{name}: {error}") from None
    except Exception as error:  # a user's own class may raise anything
        raise ValueError(f"the effect {name!r} cannot be made: {describe_error(error)}") from error


def build_pipeline(
    sensor: SensorSpec,
    listed: Mapping[str, Mapping[str, Any]],
    robot: RobotPreset,
    finger: int = 1,
    seed: int = 0,
) -> touch.Pipeline:
    """A fingertip with its effects; ValueError if one is unavailable, or unsuited to the sensor."""
    owner = touch.Fingertip(pad_of_spec(sensor), data_sheet(sensor), robot, finger, seed)
    return touch.assemble(owner, tuple(describe_effects(listed).values()))


def data_sheet(sensor: SensorSpec) -> touch.Calibration:
    """The calibration of the sensor by its data sheet."""
    return touch.Calibration(
        signal=sensor.signal,
        thickness=sensor.pad.thickness,
        sound_speed=sensor.pad.sound_speed,
        taxel_stiffness=sensor.pad.stiffness * sensor.pitch**2,
    )


def sensed_face(pipeline: touch.Pipeline) -> touch.FaceModel:
    """The face model in the array's signal: forces have no skirt about a contact."""
    is_force = pipeline.finger.calibration.signal == "force"
    return touch.SPRINGS if is_force else pipeline.face
