"""Template of a driver: a sensor of your own instead of the simulator. Adapt it.

It joins the graph by its launch file; start palpate in the folder of this file:

    palpate launch template.yaml

Without changes it presses a flat pad of 16 by 16 taxels onto a ball, from all sides, and the launch
file rebuilds a solid from that. Frames from a file, or over TCP, need no driver of your own:
`palpate launch driver.yaml path:=frames.csv`,
`palpate launch socket_driver.yaml address:=127.0.0.1:5555`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from msgspec import Meta
from palpate.core.arrays import Floats
from palpate.core.poses import Pose, pad_rotation
from palpate.messages.types import SequenceEnd
from palpate.nodes import Finished, Source, Timed
from palpate.nodes.specs.frames import (
    DRIVER_OUTPUTS,
    SensorParams,
    sensor_info,
    tactile_frame,
)
from palpate.nodes.specs.sensors import PadSpec, SensorSpec


class Params(SensorParams, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Parameters that the launch file can set, with those of all sensors."""

    # The array: rows, columns, distance between taxels, m, and the pad over them.
    sensor: SensorSpec = SensorSpec(rows=16, cols=16, pitch=0.001, pad=PadSpec(radius=None))
    frames: Annotated[int, Meta(ge=1)] = 60  # number of frames
    rate: Annotated[float, Meta(gt=0)] = 5.0  # frames per second, Hz
    radius: Annotated[float, Meta(gt=0)] = 0.02  # of the ball, m


def read_frame(params: Params, number: int) -> tuple[Floats, Floats] | None:
    """One frame of the sensor: signals of the taxels, and the pose of the pad.

    YOUR HARDWARE HERE. Return None if there is no new frame yet, after at most 0.1 s. `scale` and
    `values` in the launch file convert your numbers to times or compressions. The pose is x, y, z
    of the middle of the undeformed pad's face, m, and a quaternion x, y, z, w; the z axis of the
    pad points into the object, x along its columns.
    """
    side = (np.arange(params.sensor.rows) - (params.sensor.rows - 1) / 2) * params.sensor.pitch
    x, y = np.meshgrid(side, side)
    depth = 0.5e-3 + 0.3e-3 * np.sin(0.5 * number)
    gap = params.radius - np.sqrt(params.radius**2 - x**2 - y**2)
    # Poses are spread evenly around the ball, down a spiral about its axis.
    heading, height = 2.4 * number, 1.0 - (2 * number + 1) / params.frames
    axes = pad_rotation(heading, float(np.arcsin(height)))
    return np.maximum(depth - gap, 0.0), Pose((depth - params.radius) * axes[:, 2], axes).array


def read(params: Params) -> Iterator[Timed | Finished | None]:
    """The sensor, and all frames as they come."""
    yield Timed(0.0, "/touch/info", sensor_info(params))
    touch, time = 0, 0.0
    while touch < params.frames:
        frame = read_frame(params, touch)
        if frame is None:
            yield None  # no frame yet: palpate does other work, and asks again
            continue
        image, pose = frame
        time = touch / params.rate
        # With hardware: due 0.0, so that it is sent at once, and the robot time of the hardware.
        yield Timed(time, "/touch/raw", tactile_frame(params, touch, time, pose, image))
        touch += 1
    yield Timed(time, "/touch/end", SequenceEnd(frames=touch, robot_time=time))
    yield Finished(f"published {touch} frames")


# repeats: whether a restarted driver publishes the same messages; False with hardware.
SOURCE = Source(params=Params, outputs=lambda params: DRIVER_OUTPUTS, open=read, repeats=True)
