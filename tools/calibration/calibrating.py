"""Calibrate a scene's sensor: press a known flat and a known ball, estimate, and judge."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
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

ROBOT = "modern"  # Preset of the robot's speeds
BALL_RADIUS = 0.03  # Radius of the known ball, m
TILTS = 7  # Ways to lean along each axis
DEPTHS = (0.4 * TOUCH_DEPTH, 0.7 * TOUCH_DEPTH, TOUCH_DEPTH)
FREE_FRAMES = 40
HEIGHT, REACH = 0.03, 0.05  # The pad's middle starts so high over it, and goes this far, m
CONTACT = filter.Params().contact  # Least compression that counts as touched, m: the filter's
PAUSE = 3.0  # Between two presses, s: a pad that creeps has come to rest
CalibrationProgress = Callable[[str], None]
MAX_LOST_SHARE = 0.35  # Of taxels lost or not reached before the calibration is doubted
MIN_SOUND_SPEED, MAX_SOUND_SPEED = 100.0, 5000.0
MAX_GAIN = 10.0
MAX_POSE_ERROR = 0.6e-3  # m
MAX_RADIUS_ERROR = 0.25  # Share by which the ball may be measured too large or too small
MIN_VARIANCE = 1e-6  # 1/m2: no curvature is surer than to a thousandth of 1 / m
UP = np.array([0.0, 1.0, 0.0])


class KnownPress(NamedTuple):
    """One touch of something known."""

    pose: Pose  # Where the arm believed the pad
    read: Floats  # What the data sheet makes of the signal, (rows, cols), m
    known: Floats  # Compression that the known shape makes there, (rows, cols), m; 0 where none


class Calibrated(NamedTuple):
    """What came of pressing."""

    estimate: CalibrationEstimate  # The calibration
    pad: Pad  # The array, and what its data sheet says of its face
    sheet: Calibration  # What it was read by
    on_ball: tuple[KnownPress, ...]  # The touches of the ball
    touches: int  # All touches made
    robot_time: float  # Robot time that they took, s


def calibrate(scene: SceneSpec, progress: CalibrationProgress) -> Calibrated:
    """Press a known flat and a known ball; raises ValueError if too few taxels could be pressed."""
    pipeline = build_pipeline(scene.sensor, scene.effects, ROBOT_PRESETS[ROBOT], seed=scene.seed)
    finger = _Finger(pipeline)
    pad = pipeline.finger.pad
    # The plate is flat to far less than a nanometre where it is pressed.
    plate, ball = _below((0.2, 0.2, 0.05), MIN_EXPONENT), _below((BALL_RADIUS,) * 3, 1.0)
    free = [finger.touch(plate, lean, 0.0).read for lean in _tilts(pad)[:1] * FREE_FRAMES]
    progress(f"{FREE_FRAMES} frames of nothing")
    on_flat = tuple(_presses(finger, plate, progress, "the flat"))
    on_ball = tuple(_presses(finger, ball, progress, "the ball"))
    made = [*on_flat, *on_ball]
    presses = CalibrationTouches(
        known=np.stack([one.known.ravel() for one in made]),
        read=np.stack([one.read.ravel() for one in made]),
        free=np.stack([one.ravel() for one in free]),
    )
    (x, y), sheet = pad.grid(), pipeline.finger.calibration
    progress(f"all done; fitting {len(made)} presses")
    estimate = estimate_calibration(presses, x.ravel(), y.ravel(), sheet)
    pad = replace(pad, face=sensed_face(pipeline))
    return Calibrated(estimate, pad, sheet, on_ball, finger.touches, finger.clock)


def _presses(
    finger: _Finger, shape: Shape, progress: CalibrationProgress, name: str
) -> Iterator[KnownPress]:
    leans = _tilts(finger.pad)
    for depth in DEPTHS:
        for lean in leans:
            yield finger.touch(shape, lean, depth)
        progress(f"{len(leans)} presses of {name}, {1e3 * depth:.1f} mm deep")


def _tilts(pad: Pad) -> list[Pose]:
    """Poses over the top of something: upright first, then so that each taxel is reached."""
    half = 0.5 * pad.pitch * max(pad.rows - 1, pad.cols - 1)
    most = math.atan(pad.dome * half) + TOUCH_DEPTH / (2.0 * half)
    angles = sorted(np.linspace(-most, most, TILTS).tolist(), key=abs)
    position = np.array([0.0, 0.0, HEIGHT])
    turns = [(math.cos(a), math.sin(a)) for a in angles]
    about_x = [np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) for c, s in turns]
    about_y = [np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) for c, s in turns]
    return [Pose(position, FACING_DOWN @ (x @ y)) for x, y in product(about_x, about_y)]


def _below(size: Sequence[float], exponent: float) -> Shape:
    """A superquadric of these half axes, m, with its top at height 0."""
    shape = Superquadric(np.array(size), np.full(2, exponent))
    return PosedShape(shape, Pose(np.array([0.0, 0.0, -float(size[2])]), np.eye(3)))


class _Finger:
    """A finger on its way through the presses."""

    def __init__(self, pipeline: Pipeline):
        self._pipeline, self._face = pipeline, sensed_face(pipeline)
        self.pad = pipeline.finger.pad
        self._states: StageStates = pipeline.begin()
        self.touches, self.clock = 0, 0.0

    def touch(self, shape: Shape, pose: Pose, depth: float) -> KnownPress:
        """Press to a depth; 0 to stop before anything is met."""
        pad, sheet = self._pipeline.finger.pad, self._pipeline.finger.calibration
        touch = SimulatedTouch(
            shape=shape,
            number=self.touches,
            believed=pose,
            actual=pose,
            reach=REACH if depth else 0.0,
            depth=depth,
            begun=self.clock + PAUSE,
            previous=self.clock,
        )
        self._states = self._pipeline.simulate(touch, self._states)
        self.touches, self.clock = self.touches + 1, touch.time
        read = sheet.decode(sheet.encode(touch.reading))
        known = _ideal_compression(shape, pad, touch.believed)
        if self._face.kind != "springs":
            # It is touched by less of the shape than that would cut through it.
            subscriber = replace(self.pad, face=self._face)
            loaded = contact_mask(subscriber, read, CONTACT, self._pipeline.noise)
            known = np.where(loaded, known, 0.0)
        return KnownPress(touch.believed, read, known)


def _ideal_compression(shape: Shape, pad: Pad, pose: Pose) -> Floats:
    """Compression that an ideal pad would have in this pose, (rows, cols), m."""
    ranges = shape.cast(pose.to_outer(pad.transducers()), pose.axes[:, 2], pad.thickness)
    compression = np.clip(pad.thickness - ranges, 0.0, pad.saturation * pad.thickness)
    return compression.reshape((pad.rows, pad.cols))


def calibration_figures(found: Calibrated, sensor: SensorSpec) -> dict[str, Any]:
    """Each quantity with its standard error, a check on the ball, and reasons for doubt, SI."""
    estimate, reached = found.estimate, found.estimate.reached
    gain, offset = estimate.gain[reached], estimate.offset[reached]
    before, after = _radii(found)
    return {
        "touches": found.touches,
        "robot": ROBOT,
        "robot_time_s": found.robot_time,
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
        "ball_radius_m": BALL_RADIUS,
        "measured_radius_m": after and after._asdict(),
        "measured_radius_by_sheet_m": before and before._asdict(),
        "warnings": calibration_warnings(found),
    }


def calibration_text(figures: Mapping[str, Any]) -> str:
    """One line for each quantity with its standard error, and a check on the ball."""
    one = figures
    common = 1e6 * one["common_offset_m"]
    low, high = (1e6 * value - common for value in one["offset_m"])
    speed = f"{one['sound_speed_m_s']:.1f} +- {one['sound_speed_error_m_s']:.1f} m/s"
    if not one["sound_speed_error_m_s"]:
        speed = f"{one['sound_speed_m_s']:.1f} m/s, not estimated: the array sends forces"
    rows = [
        ("touches", f"{one['touches']} in {one['robot_time_s']:.0f} s of robot time ({ROBOT})"),
        ("sound speed", f"{speed}   (data sheet {one['sheet_sound_speed_m_s']:g})"),
        ("gain", "{:.4f} to {:.4f}".format(*one["gain"]) + f", each +- {one['gain_error']:.4f}"),
        (
            "offset",
            f"{low:.1f} to {high:.1f} um about a common {common:.1f} um, each +- "
            f"{1e6 * one['offset_error_m']:.1f} um",
        ),
        ("noise", f"{1e6 * one['noise_m']:.2f} um, one taxel"),
        ("arm", f"{1e6 * one['pose_error_m']:.0f} um off along the pad's normal, one touch"),
        (
            "taxels",
            f"{one['calibrated']} calibrated, {one['not_reached']} not reached, "
            f"{one['not_trusted']} not trusted",
        ),
        (
            "ball",
            f"of {1e3 * BALL_RADIUS:g} mm measured as {_mm(one['measured_radius_m'])}; "
            f"by sheet {_mm(one['measured_radius_by_sheet_m'])}",
        ),
    ]
    return "\n".join(f"{name:<13}{text}" for name, text in rows)


def _mm(radius: Mapping[str, float] | None) -> str:
    told = radius and f"{1e3 * radius['mean']:.2f} +- {1e3 * radius['error']:.2f} mm"
    return told or "nothing smooth"


def calibration_warnings(found: Calibrated) -> list[str]:
    """Reasons not to trust a calibration, in words; none if there is nothing to say."""
    estimate = found.estimate
    told = []
    lost = int((~estimate.reached).sum())
    if lost > MAX_LOST_SHARE * len(estimate.reached):
        told.append(f"{lost} of {len(estimate.reached)} taxels could not be calibrated")
    if not MIN_SOUND_SPEED <= estimate.sound_speed <= MAX_SOUND_SPEED:
        told.append(f"a speed of sound of {estimate.sound_speed:.0f} m/s is none of rubber's")
    if estimate.gain.max() > MAX_GAIN:
        told.append(f"a gain of {estimate.gain.max():.1f} is no sensor's")
    if estimate.pose_error > MAX_POSE_ERROR:
        told.append(f"the arm was {1e3 * estimate.pose_error:.1f} mm off, or the pad is no spring")
    before, after = _radii(found)
    off, was = (math.inf if one is None else abs(one.mean - BALL_RADIUS) for one in (after, before))
    if after is None or off > MAX_RADIUS_ERROR * BALL_RADIUS:
        told.append("with it the ball is not measured as a ball of its size")
    elif off > was + 3 * after.error:
        told.append("with it the ball is measured worse than by the data sheet")
    return told


def _radius(found: Calibrated, reading: Callable[[Floats], Floats]) -> MeasuredRadius | None:
    pad, estimate = found.pad, found.estimate
    lost = ~estimate.trusted.reshape(pad.rows, pad.cols)
    curvatures, weights = [], []
    for one in found.on_ball:
        cleaned = clean(pad, reading(one.read), estimate.noise, CONTACT, "auto", lost)
        height = pad.surface(cleaned.compression, cleaned.touched)
        patch = fit_patch(pad, height, cleaned.touched, UP, estimate.noise)
        if patch.kind == "smooth" and patch.mean > 0.0:
            curvatures.append(patch.mean)
            weights.append(1.0 / max(sum(e**2 for e in patch.principal_error), MIN_VARIANCE))
    if len(curvatures) < 2:
        return None
    mean, total = float(np.average(curvatures, weights=weights)), float(np.sum(weights))
    spread = float(np.sum(np.multiply(weights, (np.array(curvatures) - mean) ** 2)))
    error = math.sqrt(spread / (total * (len(curvatures) - 1)))
    return MeasuredRadius(1.0 / mean, error / mean**2)


def _radii(found: Calibrated) -> tuple[MeasuredRadius | None, MeasuredRadius | None]:
    """The ball's radius by the data sheet, and as the calibration reads the same frames."""
    estimate, thickness = found.estimate, found.pad.thickness
    ratio = estimate.sound_speed / found.sheet.sound_speed
    shape = (found.pad.rows, found.pad.cols)
    gain, offset = estimate.gain.reshape(shape), estimate.offset.reshape(shape)
    return (
        _radius(found, lambda read: read),
        _radius(found, lambda read: (thickness - ratio * (thickness - read)) * gain + offset),
    )


class MeasuredRadius(NamedTuple):
    """A radius that was measured."""

    mean: float  # m
    error: float  # Its standard error, m
