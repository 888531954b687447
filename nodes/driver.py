"""Driver node: publishes the frames of a file in place of the simulator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from palpate.messages.types import SequenceEnd
from palpate.nodes.runtime.node import Finished, Source, Timed
from palpate.nodes.specs.frames import (
    DRIVER_OUTPUTS,
    FrameSequence,
    SensorParams,
    read_frames,
    sensor_info,
    tactile_frame,
)


class Params(SensorParams, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    path: str  # file of frames, CSV or NPZ; its columns: docs/own_node.md
    # Frame rate if the file has no times [Hz].
    rate: Annotated[float, Meta(gt=0, le=1e4, description="Hz")] = 10.0
    at_once: bool = False  # whether frames are published without waiting for their times


def frames_of(params: Params) -> FrameSequence:
    """The frames of the file; ValueError with file and line if it cannot be used."""
    try:
        changed = Path(params.path).stat().st_mtime_ns
    except OSError:
        changed = 0  # reading it raises the error
    return _read_once(params.path, changed, params.sensor.rows, params.sensor.cols)


def outputs_of(params: Params) -> Mapping[str, type]:
    """Topics and types; ValueError for an unusable file, before anything is started."""
    frames = frames_of(params)
    deepest = int(frames.images.max(axis=(1, 2)).argmax()) if params.values == "compression" else 0
    tactile_frame(params, deepest, 0.0, frames.poses[deepest], frames.images[deepest])
    return DRIVER_OUTPUTS


def open_file(params: Params) -> Iterator[Timed | Finished | None]:
    """The sensor, each frame at its time, and the end of the sequence."""
    frames = frames_of(params)
    times = frames.times
    if times is None:
        times = np.arange(len(frames.images)) / params.rate
    yield Timed(0.0, "/touch/info", sensor_info(params))
    time, placements = 0.0, frames.placements.tolist()
    for touch, time in enumerate((times - times[0]).tolist()):
        due = 0.0 if params.at_once else time
        pose, image, placement = frames.poses[touch], frames.images[touch], placements[touch]
        frame = tactile_frame(params, touch, time, pose, image, placement)
        yield Timed(due, "/touch/raw", frame)
    ended = SequenceEnd(frames=len(frames.images), robot_time=time)
    yield Timed(0.0 if params.at_once else time, "/touch/end", ended)
    yield Finished(f"published the {len(frames.images)} frames of {params.path}")


@lru_cache(maxsize=1)
def _read_once(path: str, changed: int, rows: int, cols: int) -> FrameSequence:
    """The frames of a file, which is read again only if it has changed."""
    return read_frames(path, rows, cols)


SOURCE = Source(params=Params, outputs=outputs_of, open=open_file, handler_timeout=20.0)
