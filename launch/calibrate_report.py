"""What a calibration found, in words and figures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.touch.calibrate import Estimate
from palpate.core.touch.clean import clean
from palpate.core.touch.curvature import feel_patch
from palpate.launch.calibrate import BALL, Calibrated
from palpate.nodes.sensor import SensorSpec

CONTACT = 50e-6
"""Least compression that counts as touched, m."""
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
        ("touches", f"{found.touches} in {found.robot_time:.0f} s of robot time"),
        ("sound speed", f"{_speed(estimate)}   (data sheet {sheet:g})"),
        ("gain", f"{gain.min():.4f} to {gain.max():.4f}, each +- {gain_error:.4f}"),
        ("offset", f"{offset.min():.1f} to {offset.max():.1f} um, each +- {offset_error:.1f} um"),
        ("noise", f"{1e6 * estimate.noise:.2f} um, one taxel"),
        ("arm", f"{1e6 * estimate.pose_error:.0f} um off along the pad's normal, one touch"),
        ("taxels", f"{int(reached.sum())} calibrated, {unreached} not reached, {lost} not trusted"),
        ("ball", _check(found)),
    ]
    return "\n".join(f"{name:<13}{said}" for name, said in rows)


def _speed(estimate: Estimate) -> str:
    if not estimate.sound_speed_error:
        return f"{estimate.sound_speed:.1f} m/s, not estimated: the array sends forces"
    return f"{estimate.sound_speed:.1f} +- {estimate.sound_speed_error:.1f} m/s"


def _check(found: Calibrated) -> str:
    """Radius of the ball as it is felt, without and with the calibration."""
    before = _radius(found, lambda read: read)
    after = _radius(found, lambda read: _corrected(found, read))
    return f"of {1e3 * BALL:g} mm felt as {after} mm; {before} mm by the data sheet"


def _corrected(found: Calibrated, read: Floats) -> Floats:
    """A frame that the data sheet read, read by the calibration."""
    estimate, shape = found.estimate, read.shape
    ratio = estimate.sound_speed / found.sheet.sound_speed
    raw = found.pad.thickness - ratio * (found.pad.thickness - read)
    corrected: Floats = raw * estimate.gain.reshape(shape) + estimate.offset.reshape(shape)
    return corrected


def _radius(found: Calibrated, read: Callable[[Floats], Floats]) -> str:
    pad, noise = found.pad, found.estimate.noise
    curvatures, weights = [], []
    for one in found.on_ball:
        cleaned = clean(pad, read(one.read), noise, CONTACT, "auto")
        height = np.where(cleaned.touched, -(cleaned.compression + pad.sag()), 0.0)
        patch = feel_patch(pad, height, cleaned.touched, UP, noise)
        if patch.kind == "smooth":
            curvatures.append(patch.mean)
            weights.append(1.0 / sum(error**2 for error in patch.principal_error))
    if len(curvatures) < 2:
        return "no"
    mean, total = float(np.average(curvatures, weights=weights)), float(np.sum(weights))
    spread = float(np.sum(np.multiply(weights, (np.array(curvatures) - mean) ** 2)))
    error = (spread / (total * (len(curvatures) - 1))) ** 0.5
    return f"{1e3 / mean:.2f} +- {1e3 * error / mean**2:.2f}"
