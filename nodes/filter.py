"""Filter node: raw frames in, calibrated and cleaned tactile images out."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from palpate.core.touch.calibration import compression_from_times
from palpate.core.touch.filters import adaptive_wiener, median_filter
from palpate.messages.types import SensorInfo, TactileFrame, TactileImage
from palpate.nodes.node import Node, Outputs

CONTACT_SPREADS = 5.0
"""A taxel counts as touched from 5 standard deviations of its noise on: at 3, one in a
thousand untouched ones would put a point where there is no surface."""


TIP = 0.5
"""In pitches: no tip that a pad can feel stands higher over all the taxels around it."""


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    contact: Annotated[float, Meta(gt=0, le=0.001)] = 50e-6
    """Least compression that counts as touched, m, however quiet the sensor is."""


State = SensorInfo | None


def start(params: Params) -> tuple[State, Outputs]:
    """Begin without a calibration."""
    return None, []


def calibrate(params: Params, state: State, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    return info, []


def clean(params: Params, info: SensorInfo, frame: TactileFrame) -> tuple[State, Outputs]:
    """Times of flight to compression, noise and impulses removed, touched taxels marked."""
    raw = compression_from_times(frame.array, info.thickness, info.sound_speed)
    smoothed = adaptive_wiener(raw, info.noise**2)
    compression, _ = median_filter(smoothed, step=TIP * info.pitch)
    touched = compression > max(params.contact, CONTACT_SPREADS * info.noise)
    image = TactileImage(
        goal=frame.goal,
        touch=frame.touch,
        finger=frame.finger,
        direction=frame.direction,
        pose=frame.pose,
        outcome=frame.outcome,
        compression=compression,
        mask=touched,
        robot_time=frame.robot_time,
    )
    return info, [("/touch/image", image)]


NODE = Node(
    params=Params,
    start=start,
    inputs={"/touch/info": (SensorInfo, calibrate), "/touch/raw": (TactileFrame, clean)},
    outputs={"/touch/image": TactileImage},
    needs=("/touch/info",),
)
