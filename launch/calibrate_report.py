"""What a calibration found, in words and figures."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.touch.calibrate import Estimate
from palpate.core.touch.clean import clean
from palpate.core.touch.curvature import feel_patch
from palpate.launch.calibrate import BALL, CONTACT, ROBOT, Calibrated
from palpate.nodes.sensor import SensorSpec

MOST_LOST = 0.35
"""Share of taxels that may be lost or not reached before the calibration is doubted."""
LEAST_SPEED, MOST_SPEED = 100.0, 5000.0
MOST_GAIN = 10.0
MOST_POSE = 0.6e-3
"""m."""
MOST_WRONG = 0.25
"""Share by which the ball may be felt too large or too small."""
LEAST_VARIANCE = 1e-6
"""1/m2: no curvature is surer than to a thousandth of 1 / m."""

Reading = Callable[[Floats], Floats]

UP = np.array([0.0, 1.0, 0.0])


def report(found: Calibrated, sensor: SensorSpec) -> str:
    """One line for each quantity with its standard error, and a check on the ball."""
    estimate, reached = found.estimate, found.estimate.reached
    gain, offset = estimate.gain[reached], 1e6 * estimate.offset[reached]
    gain_error = float(np.median(estimate.gain_error[reached]))
    offset_error = 1e6 * float(np.median(estimate.offset_error[reached]))
    lost = int((~estimate.trusted).sum())
    unreached = int((estimate.trusted & ~reached).sum())
    sheet = sensor.pad.sound_speed
    rows = [
        ("touches", f"{found.touches} in {found.robot_time:.0f} s of robot time ({ROBOT})"),
        ("sound speed", f"{_speed(estimate)}   (data sheet {sheet:g})"),
        ("gain", f"{gain.min():.4f} to {gain.max():.4f}, each +- {gain_error:.4f}"),
        ("offset", f"{_spread(offset)}, each +- {offset_error:.1f} um"),
        ("noise", f"{1e6 * estimate.noise:.2f} um, one taxel"),
        ("arm", f"{1e6 * estimate.pose_error:.0f} um off along the pad's normal, one touch"),
        ("taxels", f"{int(reached.sum())} calibrated, {unreached} not reached, {lost} not trusted"),
        ("ball", ball_felt(found)),
    ]
    return "\n".join(f"{name:<13}{said}" for name, said in rows)


def _spread(offset: Floats) -> str:
    common = float(np.median(offset))
    low, high = float(offset.min()) - common, float(offset.max()) - common
    return f"{low:.1f} to {high:.1f} um about a common {common:.1f} um"


def _speed(estimate: Estimate) -> str:
    if not estimate.sound_speed_error:
        return f"{estimate.sound_speed:.1f} m/s, not estimated: the array sends forces"
    return f"{estimate.sound_speed:.1f} +- {estimate.sound_speed_error:.1f} m/s"


def doubts(found: Calibrated) -> list[str]:
    """Reasons not to trust a calibration, in words; none if there is nothing to say."""
    estimate = found.estimate
    said = []
    lost = int((~estimate.reached).sum())
    if lost > MOST_LOST * len(estimate.reached):
        said.append(f"{lost} of {len(estimate.reached)} taxels could not be calibrated")
    if not LEAST_SPEED <= estimate.sound_speed <= MOST_SPEED:
        said.append(f"a speed of sound of {estimate.sound_speed:.0f} m/s is none of rubber's")
    if estimate.gain.max() > MOST_GAIN:
        said.append(f"a gain of {estimate.gain.max():.1f} is no sensor's")
    if estimate.pose_error > MOST_POSE:
        said.append(f"the arm was {1e3 * estimate.pose_error:.1f} mm off, or the pad is no spring")
    before, after = _radius(found, _as_read(found)), _radius(found, _corrected(found))
    if after is None or abs(after.mean - BALL) > MOST_WRONG * BALL:
        said.append("with it the ball is not felt as a ball of its size")
    elif before is not None and abs(after.mean - BALL) > abs(before.mean - BALL) + 3 * after.error:
        said.append("with it the ball is felt worse than by the data sheet")
    return said


def ball_felt(found: Calibrated) -> str:
    """Radius of the ball as it is felt, with and without the calibration."""
    before, after = _radius(found, _as_read(found)), _radius(found, _corrected(found))
    return f"of {1e3 * BALL:g} mm felt as {_mm(after)}; {_mm(before)} by the data sheet"


class Radius(NamedTuple):
    """A radius that was felt."""

    mean: float
    """m."""
    error: float
    """Its standard error, m."""


def _mm(radius: Radius | None) -> str:
    if radius is None:
        return "nothing smooth"
    return f"{1e3 * radius.mean:.2f} +- {1e3 * radius.error:.2f} mm"


def _as_read(found: Calibrated) -> Reading:
    return lambda read: read


def _corrected(found: Calibrated) -> Reading:
    """What turns a frame that the data sheet read into one that the calibration reads."""
    estimate, thickness = found.estimate, found.pad.thickness
    ratio = estimate.sound_speed / found.sheet.sound_speed
    shape = (found.pad.rows, found.pad.cols)
    gain, offset = estimate.gain.reshape(shape), estimate.offset.reshape(shape)
    return lambda read: (thickness - ratio * (thickness - read)) * gain + offset


def _radius(found: Calibrated, reading: Reading) -> Radius | None:
    pad, estimate = found.pad, found.estimate
    lost = ~estimate.trusted.reshape(pad.rows, pad.cols)
    curvatures, weights = [], []
    for one in found.on_ball:
        cleaned = clean(pad, reading(one.read), estimate.noise, CONTACT, "auto", lost)
        height = np.where(cleaned.touched, -(cleaned.compression + pad.sag()), 0.0)
        patch = feel_patch(pad, height, cleaned.touched, UP, estimate.noise)
        if patch.kind == "smooth" and patch.mean > 0.0:
            curvatures.append(patch.mean)
            weights.append(1.0 / max(sum(e**2 for e in patch.principal_error), LEAST_VARIANCE))
    if len(curvatures) < 2:
        return None
    mean, total = float(np.average(curvatures, weights=weights)), float(np.sum(weights))
    spread = float(np.sum(np.multiply(weights, (np.array(curvatures) - mean) ** 2)))
    error = math.sqrt(spread / (total * (len(curvatures) - 1)))
    return Radius(1.0 / mean, error / mean**2)
