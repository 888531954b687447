"""Calibration of the sensor of a scene from presses of a known flat and a known ball."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.tracing import TOUCH_DEPTH
from palpate.core.poses import FACING_DOWN, Pose
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.shapes import MIN_EXPONENT, PosedShape, Shape, Superquadric
from palpate.core.touch import (
    Calibration,
    CalibrationEstimate,
    CalibrationTouches,
    Pad,
    Pipeline,
    SimulatedTouch,
    StageStates,
    clean,
    contact_mask,
    estimate_calibration,
    fit_patch,
)
from palpate.launch.scene import SceneSpec
from palpate.nodes import filter
from palpate.nodes.specs.sensors import SensorSpec, build_pipeline, sensed_face

ROBOT = "modern"  # preset of the robot's speeds
MIN_COMPRESSION = filter.Params().contact  # of a taxel in contact [m], the same as in the filter
CalibrationProgress = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class PressSettings:
    """Presses from which a sensor is calibrated."""

    ball_radius: float = 0.03  # [m]
    n_tilts: int = 7  # angles of the pad about each axis: n_tilts^2 poses at each depth
    depths: tuple[float, ...] = (0.4, 0.7, 1.0)  # [fraction of the depth of a usual touch]
    n_free_frames: int = 40  # frames without contact, for the noise
    start_height: float = 0.03  # [m] of the pad's middle over the surface before a press
    reach: float = 0.05  # [m] longest move from there
    pause: float = 3.0  # [s] before each press, in which a pad stops creeping


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationLimits:
    """When a calibration is doubted."""

    max_lost_share: float = 0.35  # fraction of the taxels that could not be calibrated
    min_sound_speed: float = 100.0  # [m/s] of rubber
    max_sound_speed: float = 5000.0  # [m/s]
    max_gain: float = 10.0  # of a taxel: factor of its compression; 1: ideal
    max_pose_error: float = 0.6e-3  # [m] standard deviation of the arm along the pad's normal
    max_radius_error: float = 0.25  # [fraction of the ball's radius] error of the measured one


PRESSES, LIMITS = PressSettings(), CalibrationLimits()


class KnownPress(NamedTuple):
    """One touch of a known shape."""

    pose: Pose  # of the pad, as the arm measured it
    read: Floats  # (rows, cols) compression, converted by the data sheet [m]
    known: Floats  # (rows, cols) computed from the known shape [m]; 0 without contact


class Calibrated(NamedTuple):
    """A calibration, and the presses of the ball that check it."""

    estimate: CalibrationEstimate
    pad: Pad  # with the face of the data sheet
    sheet: Calibration  # of the data sheet
    on_ball: tuple[KnownPress, ...]
    ball_radius: float  # [m]
    touches: int  # number of all touches
    robot_time: float  # of all touches [s]


def calibrate(
    scene: SceneSpec, progress: CalibrationProgress, settings: PressSettings = PRESSES
) -> Calibrated:
    """Press a known flat and a known ball; raises ValueError if too few taxels were pressed."""
    pipeline = build_pipeline(scene.sensor, scene.effects, ROBOT_PRESETS[ROBOT], seed=scene.seed)
    finger = _Finger(pipeline, settings)
    pad = pipeline.finger.pad
    # Where it is pressed, the plate is flat to far less than a nanometre.
    plate = _below((0.2, 0.2, 0.05), MIN_EXPONENT)
    ball = _below((settings.ball_radius,) * 3, 1.0)
    upright = _tilts(pad, settings)[0]
    free = [finger.touch(plate, upright, 0.0).read for _ in range(settings.n_free_frames)]
    progress(f"{settings.n_free_frames} frames of nothing")
    on_flat = tuple(_presses(finger, plate, progress, "the flat"))
    on_ball = tuple(_presses(finger, ball, progress, "the ball"))
    all_presses = [*on_flat, *on_ball]
    presses = CalibrationTouches(
        known=np.stack([press.known.ravel() for press in all_presses]),
        read=np.stack([press.read.ravel() for press in all_presses]),
        free=np.stack([read.ravel() for read in free]),
    )
    (x, y), sheet = pad.grid(), pipeline.finger.calibration
    progress(f"all done; fitting {len(all_presses)} presses")
    estimate = estimate_calibration(presses, x.ravel(), y.ravel(), sheet)
    pad = replace(pad, face=sensed_face(pipeline))
    touches, time = finger.touches, finger.clock
    return Calibrated(estimate, pad, sheet, on_ball, settings.ball_radius, touches, time)


def _presses(
    finger: _Finger, shape: Shape, progress: CalibrationProgress, name: str
) -> Iterator[KnownPress]:
    tilts = _tilts(finger.pad, finger.settings)
    for fraction in finger.settings.depths:
        depth = fraction * TOUCH_DEPTH
        for pose in tilts:
            yield finger.touch(shape, pose, depth)
        progress(f"{len(tilts)} presses of {name}, {1e3 * depth:.1f} mm deep")


def _tilts(pad: Pad, settings: PressSettings) -> list[Pose]:
    """Poses over the top of a shape: upright first, then tilted until each taxel is reached."""
    half = 0.5 * pad.pitch * max(pad.rows - 1, pad.cols - 1)
    limit = math.atan(pad.dome * half) + TOUCH_DEPTH / (2.0 * half)
    angles = sorted(np.linspace(-limit, limit, settings.n_tilts).tolist(), key=abs)
    position = np.array([0.0, 0.0, settings.start_height])
    turns = [(math.cos(a), math.sin(a)) for a in angles]
    about_x = [np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) for c, s in turns]
    about_y = [np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) for c, s in turns]
    return [Pose(position, FACING_DOWN @ (x @ y)) for x, y in product(about_x, about_y)]


def _below(size: Sequence[float], exponent: float) -> Shape:
    """A superquadric with half axes `size` (3,) [m], and its top at height 0."""
    shape = Superquadric(np.array(size), np.full(2, exponent))
    return PosedShape(shape, Pose(np.array([0.0, 0.0, -float(size[2])]), np.eye(3)))


class _Finger:
    """A finger that makes the presses, one after the other."""

    def __init__(self, pipeline: Pipeline, settings: PressSettings):
        self._pipeline, self._face = pipeline, sensed_face(pipeline)
        self.settings = settings
        self.pad = pipeline.finger.pad
        self._states: StageStates = pipeline.begin()
        self.touches, self.clock = 0, 0.0

    def touch(self, shape: Shape, pose: Pose, depth: float) -> KnownPress:
        """Press to a depth [m]; 0: stop before contact."""
        pad, sheet = self._pipeline.finger.pad, self._pipeline.finger.calibration
        touch = SimulatedTouch(
            shape=shape,
            number=self.touches,
            believed=pose,
            actual=pose,
            reach=self.settings.reach if depth else 0.0,
            depth=depth,
            begun=self.clock + self.settings.pause,
            previous=self.clock,
        )
        self._states = self._pipeline.simulate(touch, self._states)
        self.touches, self.clock = self.touches + 1, touch.time
        read = sheet.decode(sheet.encode(touch.reading))
        known = _ideal_compression(shape, pad, touch.believed)
        if self._face.kind != "springs":
            # The face bulges: fewer taxels touch the shape than the undeformed face would cut.
            subscriber = replace(self.pad, face=self._face)
            loaded = contact_mask(subscriber, read, MIN_COMPRESSION, self._pipeline.noise)
            known = np.where(loaded, known, 0.0)
        return KnownPress(touch.believed, read, known)


def _ideal_compression(shape: Shape, pad: Pad, pose: Pose) -> Floats:
    """Compression (rows, cols) [m] of an ideal pad in a pose."""
    ranges = shape.cast(pose.to_outer(pad.transducers()), pose.axes[:, 2], pad.thickness)
    compression = np.clip(pad.thickness - ranges, 0.0, pad.saturation * pad.thickness)
    return compression.reshape((pad.rows, pad.cols))


def calibration_figures(
    calibrated: Calibrated, sensor: SensorSpec, limits: CalibrationLimits = LIMITS
) -> dict[str, Any]:
    """Quantities with standard errors in SI units, the check on the ball, and warnings."""
    estimate, reached = calibrated.estimate, calibrated.estimate.reached
    gain, offset = estimate.gain[reached], estimate.offset[reached]
    before, after = _radii(calibrated)
    return {
        "touches": calibrated.touches,
        "robot": ROBOT,
        "robot_time_s": calibrated.robot_time,
        "sound_speed_m_s": estimate.sound_speed,
        "sound_speed_error_m_s": estimate.sound_speed_error,  # 0: not estimated
        "sheet_sound_speed_m_s": sensor.pad.sound_speed,
        "gain": [float(gain.min()), float(gain.max())],
        "gain_error": float(np.median(estimate.gain_error[reached])),
        "offset_m": [float(offset.min()), float(offset.max())],
        "common_offset_m": float(np.median(offset)),
        "offset_error_m": float(np.median(estimate.offset_error[reached])),
        "noise_m": estimate.noise,
        "pose_error_m": estimate.pose_error,
        "calibrated": int(reached.sum()),
        "not_reached": int((estimate.trusted & ~reached).sum()),
        "not_trusted": int((~estimate.trusted).sum()),
        "ball_radius_m": calibrated.ball_radius,
        "measured_radius_m": after and after._asdict(),
        "measured_radius_by_sheet_m": before and before._asdict(),
        "warnings": calibration_warnings(calibrated, limits),
    }


def calibration_text(figures: Mapping[str, Any]) -> str:
    """Lines of quantities with their standard errors, and of the check on the ball."""
    common = 1e6 * figures["common_offset_m"]
    low, high = (1e6 * value - common for value in figures["offset_m"])
    speed = f"{figures['sound_speed_m_s']:.1f} +- {figures['sound_speed_error_m_s']:.1f} m/s"
    if not figures["sound_speed_error_m_s"]:
        speed = f"{figures['sound_speed_m_s']:.1f} m/s, not estimated: the array sends forces"
    rows = [
        (
            "touches",
            f"{figures['touches']} in {figures['robot_time_s']:.0f} s of robot time ({ROBOT})",
        ),
        ("sound speed", f"{speed}   (data sheet {figures['sheet_sound_speed_m_s']:g})"),
        (
            "gain",
            "{:.4f} to {:.4f}".format(*figures["gain"]) + f", each +- {figures['gain_error']:.4f}",
        ),
        (
            "offset",
            f"{low:.1f} to {high:.1f} um about a common {common:.1f} um, each +- "
            f"{1e6 * figures['offset_error_m']:.1f} um",
        ),
        ("noise", f"{1e6 * figures['noise_m']:.2f} um, one taxel"),
        (
            "arm",
            f"{1e6 * figures['pose_error_m']:.0f} um off along the pad's normal, one touch",
        ),
        (
            "taxels",
            f"{figures['calibrated']} calibrated, {figures['not_reached']} not reached, "
            f"{figures['not_trusted']} not trusted",
        ),
        (
            "ball",
            f"of {1e3 * figures['ball_radius_m']:g} mm measured as "
            f"{_mm(figures['measured_radius_m'])}; "
            f"by sheet {_mm(figures['measured_radius_by_sheet_m'])}",
        ),
    ]
    return "\n".join(f"{name:<13}{text}" for name, text in rows)


def _mm(radius: Mapping[str, float] | None) -> str:
    if radius is None:
        return "nothing smooth"
    return f"{1e3 * radius['mean']:.2f} +- {1e3 * radius['error']:.2f} mm"


def calibration_warnings(calibrated: Calibrated, limits: CalibrationLimits = LIMITS) -> list[str]:
    """Reasons to doubt a calibration, in words; empty without any."""
    estimate, radius = calibrated.estimate, calibrated.ball_radius
    warnings = []
    lost = int((~estimate.reached).sum())
    if lost > limits.max_lost_share * len(estimate.reached):
        warnings.append(f"{lost} of {len(estimate.reached)} taxels could not be calibrated")
    if not limits.min_sound_speed <= estimate.sound_speed <= limits.max_sound_speed:
        warnings.append(f"a speed of sound of {estimate.sound_speed:.0f} m/s is none of rubber's")
    if estimate.gain.max() > limits.max_gain:
        warnings.append(f"a gain of {estimate.gain.max():.1f} is no sensor's")
    if estimate.pose_error > limits.max_pose_error:
        warnings.append(
            f"the arm was {1e3 * estimate.pose_error:.1f} mm off, or the pad is no spring"
        )
    before, after = _radii(calibrated)
    error, error_before = (
        math.inf if measured is None else abs(measured.mean - radius)
        for measured in (after, before)
    )
    if after is None or error > limits.max_radius_error * radius:
        warnings.append("with it the ball is not measured as a ball of its size")
    elif error > error_before + 3 * after.error:
        warnings.append("with it the ball is measured worse than by the data sheet")
    return warnings


def _radius(
    calibrated: Calibrated, reading: Callable[[Floats], Floats], min_variance: float = 1e-6
) -> MeasuredRadius | None:
    """Radius of the ball from its presses; None if fewer than two are smooth.

    `min_variance` [1/m2] of a press's curvature: limits its weight, which is 1 / variance.
    """
    pad, estimate, up = calibrated.pad, calibrated.estimate, np.array([0.0, 1.0, 0.0])
    lost = ~estimate.trusted.reshape(pad.rows, pad.cols)
    curvatures, weights = [], []
    for press in calibrated.on_ball:
        cleaned = clean(pad, reading(press.read), estimate.noise, MIN_COMPRESSION, "auto", lost)
        height = pad.surface(cleaned.compression, cleaned.touched)
        patch = fit_patch(pad, height, cleaned.touched, up, estimate.noise)
        if patch.kind == "smooth" and patch.mean > 0.0:
            curvatures.append(patch.mean)
            weights.append(1.0 / max(sum(e**2 for e in patch.principal_error), min_variance))
    if len(curvatures) < 2:
        return None
    mean, total = float(np.average(curvatures, weights=weights)), float(np.sum(weights))
    spread = float(np.sum(np.multiply(weights, (np.array(curvatures) - mean) ** 2)))
    error = math.sqrt(spread / (total * (len(curvatures) - 1)))
    return MeasuredRadius(1.0 / mean, error / mean**2)


def _radii(calibrated: Calibrated) -> tuple[MeasuredRadius | None, MeasuredRadius | None]:
    """Radius of the ball by the data sheet, and by the calibration."""
    estimate, thickness = calibrated.estimate, calibrated.pad.thickness
    ratio = estimate.sound_speed / calibrated.sheet.sound_speed
    shape = (calibrated.pad.rows, calibrated.pad.cols)
    gain, offset = estimate.gain.reshape(shape), estimate.offset.reshape(shape)
    return (
        _radius(calibrated, lambda read: read),
        _radius(calibrated, lambda read: (thickness - ratio * (thickness - read)) * gain + offset),
    )


class MeasuredRadius(NamedTuple):
    """A measured radius."""

    mean: float  # [m]
    error: float  # standard error [m]
