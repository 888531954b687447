"""What a driver says: the sensor, and one frame after the other, from anybody's numbers."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose
from palpate.core.touch.contact import touched
from palpate.messages.types import SensorInfo, TactileFrame
from palpate.nodes.sensor import SensorSpec, calibration_of_info, info_of, pad_of_info

CONTACT = 50e-6
"""Least compression that counts as touched, m, as for the filter."""
OUTPUTS: dict[str, type] = {"/touch/info": SensorInfo, "/touch/raw": TactileFrame}
"""Topics of every driver."""


class Sensing(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a driver must know of its sensor."""

    sensor: SensorSpec = SensorSpec()
    """Rows, columns, pitch and pad of the array, and what it sends."""
    values: Literal["compression", "signal"] = "compression"
    """What the numbers are: compression of the pad in m, or the sensor's signal, times in s or
    forces in N, as ``sensor.signal`` says."""
    scale: Annotated[float, Meta(gt=0)] = 1.0
    """What a number is multiplied by to be in m, s or N: 0.001 for mm."""
    noise: Annotated[float, Meta(ge=0, le=0.001)] = 0.0
    """Standard deviation of one taxel's compression, m, if there is no calibration."""


def sensor_info(sensing: Sensing) -> SensorInfo:
    """What the listeners are told of the sensor."""
    return info_of(sensing.sensor, sensing.noise)


def frame_of(
    sensing: Sensing, touch: int, time: float, pose: Floats, image: Floats
) -> TactileFrame:
    """One frame as a message.

    Parameters
    ----------
    sensing : Sensing
        What the numbers mean.
    touch : int
        Number of the frame, from 0; two frames of one number are one frame to the filter.
    time : float
        When it was taken, s.
    pose : (7,) array
        Of the pad: x, y, z in m, a quaternion x, y, z, w; its z axis points into the object.
    image : (rows, cols) array
        What the taxels sent, in the driver's own unit.
    """
    info = sensor_info(sensing)
    calibration, pad = calibration_of_info(info), pad_of_info(info)
    scaled = sensing.scale * np.asarray(image, np.float64)
    array = calibration.encode(scaled) if sensing.values == "compression" else scaled
    compression = calibration.decode(array)
    pressed = bool(touched(pad, compression, CONTACT, info.noise).any())
    bottomed = float(compression.max()) >= pad.saturation * pad.thickness
    _, axes = split_pose(pose)
    return TactileFrame(
        goal=0,
        touch=touch,
        finger=1,
        direction=axes[:, 0].copy(),
        pose=np.array(pose, np.float64),
        outcome="bottomed" if bottomed else "hit" if pressed else "miss",
        array=array,
        robot_time=time,
    )
