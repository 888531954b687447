"""Filter node: tactile frames in, calibrated and cleaned tactile images out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.arrays import Bools, Floats
from palpate.core.touch import (
    DEFAULT_CONTACT,
    HITS,
    Calibration,
    FilterOrder,
    Pad,
    clean,
    is_repeated,
)
from palpate.messages.types import ParameterEvent, SensorInfo, TactileFrame, TactileImage
from palpate.nodes.runtime.node import Node, Outputs
from palpate.nodes.specs.sensors import calibration_of_info, pad_of_info

ADVANCE_INDEX = 3  # of the approach in the parts of a move, `MoveParts`


class Params(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    # Filters in their order: auto, none, wiener, median, median-first or wiener-first. auto leaves
    # a frame unchanged unless it has impulses; then it fits robustly.
    order: FilterOrder = "auto"
    # Minimum compression that counts as contact, also for a quiet sensor [m].
    contact: Annotated[float, Meta(gt=0, le=0.001, description="m")] = (
        DEFAULT_CONTACT.min_compression
    )


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The sensor, and the last frame."""

    pad: Pad
    noise: float  # standard deviation of one taxel [m]
    calibration: Calibration  # of the signal
    lost: Bools | None  # unreliable taxels, (rows, cols); None if there are none
    # Goal and touch of the last frame: a link may deliver a frame twice.
    last: tuple[int, int] = (-1, -1)
    before: Floats | None = None  # compression of the last frame, (rows, cols) [m]


def calibrate(params: Params, state: State | None, info: SensorInfo) -> tuple[State, Outputs]:
    """Remember the sensor."""
    lost = info.gain == 0.0
    lost = lost if lost.any() else None
    return State(pad_of_info(info), info.noise, calibration_of_info(info), lost), []


def take_frame(params: Params, state: State, frame: TactileFrame) -> tuple[State, Outputs]:
    """Convert a frame to compression, remove noise and impulses, and mark touched taxels.

    Raises ValueError if the frame is no image of the sensor's array, or its times are not in s.
    """
    if state.last == (frame.goal, frame.touch):
        return state, []
    reported = state.calibration.decode(frame.array)
    cleaned = clean(
        state.pad,
        reported,
        state.noise,
        contact=params.contact,
        order=params.order,
        lost=state.lost,
        pressed=frame.outcome in HITS,
    )
    before = state.before
    if before is not None and is_repeated(reported, before, state.noise):
        cleaned = cleaned._replace(touched=np.zeros_like(cleaned.touched), fault="frozen")
    image = TactileImage(
        goal=frame.goal,
        touch=frame.touch,
        finger=frame.finger,
        placement=frame.placement,
        direction=frame.direction,
        pose=frame.pose,
        outcome=frame.outcome,
        robot_time=frame.robot_time,
        advance=float(frame.move[ADVANCE_INDEX]),
        compression=cleaned.compression,
        mask=cleaned.touched,
        impulses=cleaned.impulses,
        fault=cleaned.fault,
    )
    state = replace(state, last=(frame.goal, frame.touch), before=reported)
    return state, [("/touch/image", image)]


NODE = Node(
    params=Params,
    step="filter",
    start=lambda params: (None, []),
    inputs={"/touch/info": (SensorInfo, calibrate), "/touch/raw": (TactileFrame, take_frame)},
    outputs={"/touch/image": TactileImage, "/filter/parameter_events": ParameterEvent},
    settable={"order": "/touch/raw", "contact": "/touch/raw"},
    needs=("/touch/info",),
)
