"""Driver: says the frames of a file as if a sensor felt them now, in the simulator's place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from palpate.nodes.driver_frames import OUTPUTS, Sensing, frame_of, sensor_info
from palpate.nodes.frames_file import Frames, read_frames
from palpate.nodes.node import Finished, Said, Source


class Params(Sensing, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    path: str
    """File of frames, CSV or NPZ; its columns: docs/own_node.md."""
    rate: Annotated[float, Meta(gt=0, le=1e4, description="Hz")] = 10.0
    """Frames per second, where the file has no times, Hz."""
    at_once: bool = False
    """Say all as fast as they are heard, and do not wait for their times."""


def frames_of(params: Params) -> Frames:
    """The frames that will be said.

    Raises
    ------
    ValueError
        With file and line, if the file cannot be used.
    """
    try:
        changed = Path(params.path).stat().st_mtime_ns
    except OSError:
        changed = 0  # reading it says what is wrong
    return _read_once(params.path, changed, params.sensor.rows, params.sensor.cols)


def outputs_of(params: Params) -> Mapping[str, type]:
    """Topics and types; refuses a file that could not be said, before anything is started."""
    frames_of(params)
    return OUTPUTS


def open_file(params: Params) -> Iterator[Said | Finished | None]:
    """The sensor, each frame at its time, and that there are no more."""
    frames = frames_of(params)
    times = frames.times
    if times is None:
        times = np.arange(len(frames.images)) / params.rate
    yield Said(0.0, "/touch/info", sensor_info(params))
    for touch, time in enumerate((times - times[0]).tolist()):
        due = 0.0 if params.at_once else time
        pose, image = frames.poses[touch], frames.images[touch]
        yield Said(due, "/touch/raw", frame_of(params, touch, time, pose, image))
    yield Finished(f"said the {len(frames.images)} frames of {params.path}")


@lru_cache(maxsize=1)
def _read_once(path: str, changed: int, rows: int, cols: int) -> Frames:
    """The frames of a file, read again only if it has changed."""
    return read_frames(path, rows, cols)


SOURCE = Source(params=Params, outputs=outputs_of, open=open_file, longest=20.0)
